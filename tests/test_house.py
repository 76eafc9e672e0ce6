"""Files stay short, and a public name stands once in its package; `make lint` checks the rest."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

MAXJAX = Path(__file__).parents[1] / "maxjax"
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
