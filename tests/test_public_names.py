"""README, CHANGELOG and docs promise nothing that is not there: names, modules, files and links."""

from __future__ import annotations

import importlib
import re
from functools import cache
from pathlib import Path

import pytest

import maxjax

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
TEXTS = {page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8") for page in PAGES}
# Folders against which a path may be written.
BASES = [ROOT, ROOT / "maxjax", ROOT / "benchmarks" / "results", ROOT / "experiments" / "results"]
# What commands write and read.
EXAMPLES = {
    *("scan/scan.npz", "demo/plan.png", "mission.json", "build/docs", "build/results", "config.json", "shards/K-of-N")
}


def found(pattern: str) -> list[tuple[str, str]]:
    """Page and match, each once."""
    return sorted({(page, match) for page, text in TEXTS.items() for match in re.findall(pattern, text)})


CODE = found(r"`([^`\n]+)`")


@cache
def resolved(name: str) -> object:
    """The module or object of this full name; an AttributeError or ImportError says what is missing."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            thing: object = importlib.import_module(".".join(parts[:count]))
        except ModuleNotFoundError as error:
            if error.name is None or not name.startswith(error.name):
                raise  # one of its own imports is missing
            continue
        for part in parts[count:]:
            thing = getattr(thing, part)
        return thing
    raise ModuleNotFoundError(name)


@pytest.mark.parametrize(("page", "name"), found(r"\b((?:maxjax|experiments|benchmarks)(?:\.[A-Za-z_]\w*)+)"))
def test_every_full_name_can_be_imported(page: str, name: str) -> None:
    resolved(name)


@pytest.mark.parametrize(("page", "name"), found(r"\b(plan_[a-z]+|load_[a-z]+|solve_[a-z]+)\b(?!\w*[./])"))
def test_every_public_function_exists(page: str, name: str) -> None:
    assert callable(getattr(maxjax, name))


def test_every_called_name_exists() -> None:
    """In code, what stands bare before a bracket: public, or, in docs/, defined anywhere in maxjax/."""
    called = {(page, name) for page, code in CODE for name in re.findall(r"(?<![\w.])([a-z_]\w+)\(", code)}
    sources = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "maxjax").rglob("*.py"))
    private = set(re.findall(r"^ *(?:def|class) (\w+)", sources, re.MULTILINE))
    for page, name in called:
        assert hasattr(maxjax, name) or (page.startswith("docs/") and name in private), (page, name)


FOLDERS = ("maxjax", "experiments", "benchmarks", "tests", "docs")
WRITTEN_OUT = rf"(?<![\w/.-])((?:{'|'.join(FOLDERS)})/[\w./*-]*\w)"
# Within code also from maxjax/ on, with patterns such as `potential*.json`, or a bare file name.
IN_CODE = r"(?<![\w/.:-])((?:[a-z_]+/)+[\w.*-]*\w|\w+\.(?:py|md|json))(?![\w/])"


@pytest.mark.parametrize(
    ("page", "path"),
    sorted({*found(WRITTEN_OUT), *((page, path) for page, code in CODE for path in re.findall(IN_CODE, code))}),
)
def test_every_path_leads_to_a_file(page: str, path: str) -> None:
    """A bare file name lies anywhere; other words, as `fields/geodesic.geodesic`, is a name in a module."""
    if path in EXAMPLES:
        return
    if "/" not in path:
        assert (ROOT / path).exists() or any(next((ROOT / folder).rglob(path), None) for folder in FOLDERS)
    elif not any(next(base.glob(path), None) for base in BASES):
        resolved("maxjax." + path.replace("/", "."))


@pytest.mark.parametrize(("page", "link"), found(r"\]\(([^)\s]+)\)"))
def test_every_relative_link_leads_somewhere(page: str, link: str) -> None:
    if link.startswith("https://"):
        return
    path, _, anchor = link.partition("#")
    target = (ROOT / page).parent / path if path else ROOT / page
    assert target.exists()
    if anchor:
        headings = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.MULTILINE)
        assert anchor in {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}
