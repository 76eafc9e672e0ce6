"""The tools of the documentation site (docs/site/), and the licences of what it stands on."""

from __future__ import annotations

import importlib.util
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
# For benchmarks, tests and documentation alone; docutils gives a choice.
COPYLEFT = {"casadi", "dijkstra3d", "docutils", "evo", "pymavlink"}
# Link, source, and what it is on a page of the tutorials.
LINKS = (
    ("[maps](docs/maps.md)", "README.md", "[maps](../maps.md)"),
    ("[all](experiments/RESULTS.md#speed)", "README.md", "[all](../results.md#speed)"),
    ("[the rates](maxjax/api.py)", "README.md", "the rates"),
    ("[api.py](maxjax/api.py)", "README.md", "`api.py`"),
    ("[docs/limits.md](docs/limits.md)", "README.md", "[What it cannot do](../limits.md)"),
    ("[`RESULTS.md`](experiments/RESULTS.md)", "README.md", "[Results](../results.md)"),
    ("![a](demo.png)", "docs/solver.md", "![a](../demo.png)"),
    ("[there](https://example.org/a)", "README.md", "[there](https://example.org/a)"),
    ("[below](#limits)", "docs/solver.md", "[below](#limits)"),
)


def tool(name: str) -> ModuleType:
    """A module of docs/site/, which is no package."""
    spec = importlib.util.spec_from_file_location(f"docs_{name}", DOCS / "site" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look for it
    spec.loader.exec_module(module)
    return module


def test_what_pages_take_from_elsewhere_reads_there_as_at_home(tmp_path: Path) -> None:
    """A section ends where the next of its rank begins; links lead to the same place; figures stay in one line."""
    included = tool("included")
    text = "# T\nhead\n## A\none\n### B\ntwo\n```\n## no heading\n```\n## C\nthree\n"
    assert included.section(text, "A") == "one\n### B\ntwo\n```\n## no heading\n```"
    assert included.section(text, "C") == "three"
    assert included.section(text, None).startswith("head\n## A")
    for missing in ("no heading", "D"):
        with pytest.raises(ValueError, match="expected one, given 0"):
            included.section(text, missing)
    for link, source, wanted in LINKS:
        assert included.relinked(link, ROOT / source, DOCS / "tutorials" / "page.md") == wanted
    text = "| a 1 of 2 | 3.0 ± 0.5 (4 of 5) | 7 (8.1) |\n1 of 2"
    kept = "| a 1~of~2 | 3.0~±~0.5 (4~of~5) | 7~(8.1) |\n1 of 2".replace("~", "\N{NO-BREAK SPACE}")
    assert included.unbroken(text) == kept
    assert tool("docstrings").escaped("(*b, 3) of |q| and `*a`") == r"(\*b, 3) of \|q\| and `*a`"
    # What the check of a built site finds.
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


def test_what_users_install_is_permissive_and_copyleft_stands_in_no_extra_of_theirs() -> None:
    licences = tool("licences")
    found = licences.found()
    users = [one for one in found if one.users]
    assert {"jax", "mujoco", "numpy", "pyproj", "scipy", "tyro"} <= {one.name for one in users}
    for one in users:
        assert licences.PERMISSIVE.search(one.licence), one
        assert not licences.COPYLEFT.search(one.licence), one
    assert {one.name for one in found if licences.COPYLEFT.search(one.licence)} <= COPYLEFT
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    asked = [project["dependencies"], *(project["optional-dependencies"][extra] for extra in licences.USERS)]
    assert not [text for texts in asked for text in texts for name in COPYLEFT if text.startswith(name)]
    assert len(licences.table().splitlines()) == 2 + len(found)
