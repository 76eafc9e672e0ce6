"""Pages promise nothing that is not there: names, modules, files, links, commands, code, and words of the glossary.

`make docs` runs this after it has built the pages. Each test collects all that is wrong before it fails.
"""

from __future__ import annotations

import ast
import importlib
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest

import maxjax
from maxjax.ui.cli import commands, main

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.glob("*.md"), *(DOCS / "tutorials").glob("*.md")])
PROMISES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted(DOCS.glob("*.md"))]
TEXTS = {page.relative_to(ROOT).as_posix(): page.read_text(encoding="utf-8") for page in PROMISES}
FOLDERS = ("maxjax", "experiments", "benchmarks", "tests", "docs")
# Folders against which a path may be written.
BASES = [ROOT, ROOT / "maxjax", ROOT / "benchmarks" / "results", ROOT / "experiments" / "results"]
# What commands write and read.
EXAMPLES = {
    *("scan/scan.npz", "demo/plan.png", "mission.json", "build/docs", "build/results", "config.json", "shards/K-of-N")
}
WRITTEN_OUT = rf"(?<![\w/.-])((?:{'|'.join(FOLDERS)})/[\w./*-]*\w)"
# Within code also from maxjax/ on, with patterns such as `potential*.json`, or a bare file name.
IN_CODE = r"(?<![\w/.:-])((?:[a-z_]+/)+[\w.*-]*\w|\w+\.(?:py|md|json))(?![\w/])"


def found(pattern: str) -> list[tuple[str, str]]:
    """Page and match, each once."""
    return sorted({(page, match) for page, text in TEXTS.items() for match in re.findall(pattern, text)})


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


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


def wrong(check: Callable[[str, str], object], cases: list[tuple[str, str]]) -> list[str]:
    """The cases that this check refuses, by an exception or a False; there have to be cases."""
    assert cases
    faults = []
    for page, word in cases:
        try:
            if check(page, word) is False:
                faults.append(f"{page}: {word}")
        except (AttributeError, ImportError) as error:
            faults.append(f"{page}: {word}: {error}")
    return faults


def test_no_page_and_no_public_name_is_left_out() -> None:
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"^\.\. auto\w+:: maxjax\.(\w+)$", text, re.MULTILINE)) == sorted(maxjax.__all__)
    contents = re.findall(r"```{toctree}\n(.*?)```", (DOCS / "index.md").read_text(encoding="utf-8"), re.DOTALL)
    listed = [line for line in "\n".join(contents).splitlines() if re.fullmatch(r"[\w/]+", line)]
    present = [page.relative_to(DOCS).with_suffix("").as_posix() for page in PAGES]
    assert sorted([*listed, "index"]) == sorted(present)


def test_every_name_in_the_pages_exists() -> None:
    """Full names can be imported, plan_… and load_… are public; what stands bare before a bracket is public, or, in
    docs/, defined anywhere in maxjax/."""
    full = found(r"\b((?:maxjax|experiments|benchmarks)(?:\.[A-Za-z_]\w*)+)")
    public = found(r"\b(plan_[a-z]+|load_[a-z]+|solve_[a-z]+)\b(?!\w*[./])")
    codes = found(r"`([^`\n]+)`")
    called = sorted({(page, name) for page, code in codes for name in re.findall(r"(?<![\w.])([a-z_]\w+)\(", code)})
    sources = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "maxjax").rglob("*.py"))
    private = set(re.findall(r"^ *(?:def|class) (\w+)", sources, re.MULTILINE))
    faults = [
        *wrong(lambda _, name: resolved(name), full),
        *wrong(lambda _, name: callable(getattr(maxjax, name)), public),
        *wrong(lambda page, name: hasattr(maxjax, name) or (page.startswith("docs/") and name in private), called),
    ]
    assert faults == []


def test_every_path_and_every_relative_link_leads_to_a_file() -> None:
    """A bare file name lies anywhere; other words, as `fields/geodesic.geodesic`, are a name in a module."""

    def lies(_: str, path: str) -> bool:
        if "/" not in path:
            return (ROOT / path).exists() or any(next((ROOT / folder).rglob(path), None) for folder in FOLDERS)
        if path not in EXAMPLES and not any(next(base.glob(path), None) for base in BASES):
            resolved("maxjax." + path.replace("/", "."))
        return True

    def leads(page: str, link: str) -> bool:
        path, _, anchor = link.partition("#")
        target = (ROOT / page).parent / path if path else ROOT / page
        if not anchor or not target.exists():
            return target.exists()
        headings = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.MULTILINE)
        return anchor in {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}

    in_code = {(page, path) for page, code in found(r"`([^`\n]+)`") for path in re.findall(IN_CODE, code)}
    paths = sorted({*found(WRITTEN_OUT), *in_code} - {(page, path) for page in TEXTS for path in EXAMPLES})
    links = [(page, link) for page, link in found(r"\]\(([^)\s]+)\)") if not link.startswith("https://")]
    faults = [*wrong(lies, paths), *wrong(leads, links)]
    assert faults == []


def test_command_lines_of_pages_parse(monkeypatch: pytest.MonkeyPatch) -> None:
    for _, module, function in commands._COMMANDS.values():
        monkeypatch.setattr(importlib.import_module(f"maxjax.ui.cli.{module}"), function, lambda *_: 0)
    lines = []
    for page in PAGES:
        for line in "".join(blocks(page, "bash")).replace("\\\n", " ").splitlines():
            program, *arguments = shlex.split(line, comments=True)
            if program == "maxjax" and not any(word.isupper() for word in arguments):
                lines.append((page.stem, shlex.join(arguments)))
    faults = wrong(lambda _, line: main(shlex.split(line)) == 0, lines)
    assert faults == []


def test_python_that_is_only_shown_runs(tmp_path: Path) -> None:
    """Cells are executed by the build; blocks of plain Python run here, those of a page in a row."""
    faults = {}
    for page in PAGES:
        if source := "\n".join(blocks(page, "python")):
            folder = tmp_path / page.stem
            folder.mkdir()
            (folder / "docs").symlink_to(DOCS)  # what a block writes, it writes beside this
            words = [sys.executable, "-c", source]
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=300)
            if done.returncode:
                faults[page.stem] = done.stderr
    assert not faults


def test_the_glossary_has_a_word_once_and_names_what_is_defined_where_it_says() -> None:
    """A place is a module (a file or a folder of maxjax/), or a module and what it defines; a class is defined once."""
    lines = [line for line in (DOCS / "glossary.md").read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    rows = [(word, meaning, place) for word, meaning, place in cells if not set(word) <= set("- :")][1:]
    words = [word.lower() for word, _, _ in rows]
    assert len(words) == len(set(words))
    assert all(meaning for _, meaning, _ in rows)
    places = sorted({place for _, _, text in rows for place in re.findall(r"`([^`]+)`", text)})

    def defines(_: str, place: str) -> bool:
        file, _, name = place.partition("::")
        path = ROOT / "maxjax" / file
        return path.exists() and (not name or name in defined(path))

    faults = wrong(defines, [("glossary", place) for place in places])
    assert faults == []
    wanted = {place.partition("::")[2] for place in places}
    classes: dict[str, list[str]] = {}
    for folder in ("maxjax", "experiments", "benchmarks", "tests"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef) and node.name in wanted:
                    classes.setdefault(node.name, []).append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert classes
    assert not {name: where for name, where in classes.items() if len(where) > 1}


def defined(path: Path) -> set[str]:
    """What a module defines."""
    names: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)):
                names.add(name)
            case ast.Assign(targets=targets):
                names |= {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}
            case _:
                pass
    return names
