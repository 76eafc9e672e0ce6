"""One word, one meaning: the glossary's names exist, and words that meant several things are gone."""

from __future__ import annotations

import ast
import importlib
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = sorted(
    path
    for folder in ("maxjax", "experiments", "benchmarks", "tests")
    for path in (ROOT / folder).rglob("*.py")
    if path != Path(__file__)
)

# In no identifier, comment, docstring or text.
GONE = {"begun", "posed", "said", "blind", "blindly", "squad", "squads", "squadron", "squadrons", "crew", "crews"}
GONE |= {"muster", "musters", "mustered"}
COMPOUNDS = ("colour-blind", "colorblind")  # the established term for readers of figures

# The neighbours along an axis: nothing else is called so, and only these files name them.
NEIGHBOURS = {"ahead", "behind"}
NEIGHBOUR_ROOMS = {"maxjax/fields/stencil.py", "maxjax/programs/lowering.py", "maxjax/planning/line_of_sight.py"}
NEIGHBOUR_ROOMS |= {"tests/programs/test_lowering.py"}
# Where comments may speak of them.
NEIGHBOUR_PROSE = NEIGHBOUR_ROOMS | {
    "maxjax/fields/gradient.py",
    "maxjax/solvers/goal.py",
    "tests/fields/test_stencil.py",
}

GLOSSARY = ROOT / "docs" / "glossary.md"


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def words(text: str) -> set[str]:
    """Words of prose and of identifiers, in lower case: `two_words` and `TwoWords` are two."""
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", text)}


def bound(source: str) -> Iterator[tuple[int, str]]:
    """Line and name of everything that a source gives a name to."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.lineno, node.name


def comments(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of every comment and docstring."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            yield node.lineno, node.value.value


def rows() -> list[tuple[str, str, str]]:
    """Word, meaning and place of every row of the glossary."""
    lines = [line for line in GLOSSARY.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [(word, meaning, place) for word, meaning, place in cells if not set(word) <= set("- :")][1:]


def test_words_that_meant_several_things_are_gone() -> None:
    found = []
    for path in SOURCES:
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            for compound in COMPOUNDS:
                line = line.replace(compound, "")
            found += [f"{named(path)}:{number} {word}" for word in sorted(GONE & words(line))]
    assert not found, "\n".join(found)


def test_there_is_the_name_of_nothing() -> None:
    found = [f"{named(p)}:{line}" for p in SOURCES for line, name in bound(p.read_text("utf-8")) if name == "there"]
    assert not found, "\n".join(found)


def test_ahead_and_behind_are_the_neighbours_along_an_axis() -> None:
    found = []
    for path in SOURCES:
        source = path.read_text(encoding="utf-8")
        if named(path) not in NEIGHBOUR_ROOMS:
            found += [f"{named(path)}:{line} {name}" for line, name in bound(source) if name.strip("_") in NEIGHBOURS]
        if named(path) not in NEIGHBOUR_PROSE:
            found += [f"{named(path)}:{line} ahead" for line, text in comments(source) if "ahead" in words(text)]
    assert not found, "\n".join(found)


def test_a_block_is_a_city_block() -> None:
    """The multigrid has aggregates, a line of sight spans, the judge tiles and the network octets of voxels."""
    rooms = ("maxjax/solvers", "maxjax/planning", "maxjax/nn", "maxjax/fields")
    found = []
    for path in SOURCES:
        if named(path).startswith(rooms):
            found += [f"{named(path)}:{n} {name}" for n, name in bound(path.read_text("utf-8")) if words(name) & BLOCKS]
    assert not found, "\n".join(found)


BLOCKS = {"block", "blocks"}


def test_every_word_of_the_glossary_has_one_row() -> None:
    given = [word.lower() for word, _, _ in rows()]
    assert len(given) == len(set(given))
    assert all(meaning for _, meaning, _ in rows())


@pytest.mark.parametrize("place", sorted({p for _, _, place in rows() for p in re.findall(r"`([^`]+)`", place)}))
def test_what_the_glossary_names_is_defined_where_it_says(place: str) -> None:
    """A module (a file or a folder of maxjax/), or a module and what it defines."""
    file, _, name = place.partition("::")
    path = ROOT / "maxjax" / file
    assert path.exists(), place
    if name:
        module = importlib.import_module(".".join(("maxjax", *Path(file).with_suffix("").parts)))
        assert hasattr(module, name)
        assert name in {name for _, name in bound(path.read_text(encoding="utf-8"))}


def test_a_class_of_the_glossary_is_defined_once() -> None:
    wanted = {place.partition("::")[2] for _, _, text in rows() for place in re.findall(r"`([^`]+)`", text)}
    classes: dict[str, list[str]] = {}
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and node.name in wanted:
                classes.setdefault(node.name, []).append(f"{named(path)}:{node.lineno}")
    assert classes
    assert not {name: places for name, places in classes.items() if len(places) > 1}
