"""The documentation site: what pages include, where their links lead, and that every public name is in the reference.

`make docs` builds the pages and executes their cells. Here is what it cannot tell: that the page of the reference
leaves no name out, and that blocks which are only shown run as well.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import maxjax
from maxjax.cli import commands, main

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.glob("*.md"), *(DOCS / "tutorials").glob("*.md")])


def tool(name: str) -> ModuleType:
    """A module of docs/site/, which is no package."""
    spec = importlib.util.spec_from_file_location(f"docs_{name}", DOCS / "site" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look for it
    spec.loader.exec_module(module)
    return module


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def test_the_reference_has_every_public_name_once() -> None:
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    named = re.findall(r"^\.\. auto\w+:: maxjax\.(\w+)$", text, re.MULTILINE)
    assert sorted(named) == sorted(maxjax.__all__)


def test_every_page_stands_in_the_contents_once() -> None:
    contents = re.findall(r"```{toctree}\n(.*?)```", (DOCS / "index.md").read_text(encoding="utf-8"), re.DOTALL)
    listed = [line for line in "\n".join(contents).splitlines() if re.fullmatch(r"[\w/]+", line)]
    present = [page.relative_to(DOCS).with_suffix("").as_posix() for page in PAGES]
    assert sorted([*listed, "index"]) == sorted(present)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_command_lines_of_pages_parse(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for _, module, function in commands._COMMANDS.values():
        monkeypatch.setattr(importlib.import_module(f"maxjax.cli.{module}"), function, lambda *_: 0)
    for line in "".join(blocks(page, "bash")).replace("\\\n", " ").splitlines():
        program, *arguments = shlex.split(line, comments=True)
        if program == "maxjax" and not any(word.isupper() for word in arguments):
            assert main(arguments) == 0, line


@pytest.mark.large
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_that_is_only_shown_runs(page: Path, tmp_path: Path) -> None:
    """Cells are executed by the build; blocks of plain Python run here, those of a page in a row."""
    source = "\n".join(blocks(page, "python"))
    if source:
        (tmp_path / "docs").symlink_to(DOCS)  # what a block writes, it writes beside this
        done = subprocess.run([sys.executable, "-c", source], cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr


def test_a_section_ends_where_the_next_of_its_rank_begins() -> None:
    section = tool("included").section
    text = "# T\nhead\n## A\none\n### B\ntwo\n```\n## no heading\n```\n## C\nthree\n"
    assert section(text, "A") == "one\n### B\ntwo\n```\n## no heading\n```"
    assert section(text, "C") == "three"
    assert section(text, None).startswith("head\n## A")
    for missing in ("no heading", "D"):
        with pytest.raises(ValueError, match="expected one, given 0"):
            section(text, missing)


@pytest.mark.parametrize(
    ("link", "source", "wanted"),
    [
        ("[maps](docs/maps.md)", "README.md", "[maps](../maps.md)"),
        ("[all](experiments/RESULTS.md#speed)", "README.md", "[all](../results.md#speed)"),
        ("[the rates](maxjax/api.py)", "README.md", "the rates"),
        ("[api.py](maxjax/api.py)", "README.md", "`api.py`"),
        ("[docs/limits.md](docs/limits.md)", "README.md", "[What it cannot do](../limits.md)"),
        ("[`RESULTS.md`](experiments/RESULTS.md)", "README.md", "[Results](../results.md)"),
        ("![a](demo.png)", "docs/solver.md", "![a](../demo.png)"),
        ("[there](https://example.org/a)", "README.md", "[there](https://example.org/a)"),
        ("[below](#limits)", "docs/solver.md", "[below](#limits)"),
    ],
)
def test_links_lead_to_the_same_place_from_a_page(link: str, source: str, wanted: str) -> None:
    assert tool("included").relinked(link, ROOT / source, DOCS / "tutorials" / "page.md") == wanted


def test_figures_of_tables_stay_in_one_line() -> None:
    text = "| a 1 of 2 | 3.0 ± 0.5 (4 of 5) | 7 (8.1) |\n1 of 2"
    kept = "| a 1~of~2 | 3.0~±~0.5 (4~of~5) | 7~(8.1) |\n1 of 2".replace("~", "\N{NO-BREAK SPACE}")
    assert tool("included").unbroken(text) == kept


def test_the_check_of_a_site_finds_what_is_wrong(tmp_path: Path) -> None:
    faults = tool("links").faults
    good = '<a href="b.html#x">b</a><a href="https://example.org">out</a><img src="p.png">'
    (tmp_path / "a.html").write_text(good)
    (tmp_path / "b.html").write_text('<p id="x"></p><a href="a.html">a</a>')
    (tmp_path / "p.png").write_bytes(b"")
    assert faults(tmp_path) == []
    bad = '<a href="b.html#y">b</a><a href="c.html">c</a><script src="https://example.org/s.js"></script>'
    (tmp_path / "a.html").write_text(bad)
    assert [sentence.split(": ", 1)[1] for sentence in faults(tmp_path)] == [
        "b.html#y: no such place on that page",
        "c.html leads nowhere",
        "https://example.org/s.js is loaded from elsewhere",
    ]
    assert faults(tmp_path / "nothing") != []


def test_docstrings_are_plain_text() -> None:
    assert tool("docstrings").escaped("(*b, 3) of |q| and `*a`") == r"(\*b, 3) of \|q\| and `*a`"
