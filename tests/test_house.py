"""Files stay short, a public name stands once in its package, a test file's name once; `make lint` checks the rest."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

TESTS = Path(__file__).parent
MAXJAX = TESTS.parent / "maxjax"
MODULES = sorted(MAXJAX.rglob("*.py"))
LINES = 350


def test_files_are_short() -> None:
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    assert lengths
    assert not [f"{path.relative_to(MAXJAX)}: {n} lines" for path, n in lengths.items() if n > LINES]


def test_a_public_name_stands_once_in_its_package() -> None:
    found: dict[tuple[str, str], list[str]] = defaultdict(list)
    for path in MODULES:
        package, *_ = path.relative_to(MAXJAX).parts[:-1] or [""]
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
                found[package, node.name].append(path.name)
    assert found["planning", "Task"] == ["task.py"]
    assert not {name: files for name, files in found.items() if len(files) > 1}


def test_a_test_file_has_its_name_alone() -> None:
    """Folders of tests are no packages: pytest imports the first file of a name only, and one process alone says so."""
    files = sorted(TESTS.rglob("test_*.py"))
    assert Path(__file__) in files
    names = [path.name for path in files]
    assert not [path.relative_to(TESTS) for path in files if names.count(path.name) > 1]
