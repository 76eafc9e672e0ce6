"""What the glossary names exists, where it says."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def rows() -> list[tuple[str, str, str]]:
    """Word, meaning and place of every row."""
    text = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [(word, meaning, place) for word, meaning, place in cells if not set(word) <= set("- :")][1:]


def defined(path: Path) -> set[str]:
    """What a module defines."""
    found: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)):
                found.add(name)
            case ast.Assign(targets=targets):
                found |= {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}
            case _:
                pass
    return found


PLACES = sorted({place for _, _, text in rows() for place in re.findall(r"`([^`]+)`", text)})


def test_every_word_has_one_row() -> None:
    given = [word.lower() for word, _, _ in rows()]
    assert len(given) == len(set(given))
    assert all(meaning for _, meaning, _ in rows())


@pytest.mark.parametrize("place", PLACES)
def test_what_it_names_is_defined_where_it_says(place: str) -> None:
    """A module (a file or a folder of maxjax/), or a module and what it defines."""
    file, _, name = place.partition("::")
    path = ROOT / "maxjax" / file
    assert path.exists(), place
    assert not name or name in defined(path)


def test_a_class_is_defined_once() -> None:
    wanted = {place.partition("::")[2] for place in PLACES}
    places: dict[str, list[str]] = {}
    for folder in ("maxjax", "experiments", "benchmarks", "tests"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef) and node.name in wanted:
                    places.setdefault(node.name, []).append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert places
    assert not {name: found for name, found in places.items() if len(found) > 1}
