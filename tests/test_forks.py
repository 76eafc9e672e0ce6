"""What is written for the compiler stands in two files of `compile/`: no other forks on a device or holds XLA back."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

MAXJAX = Path(__file__).parents[1] / "maxjax"
ROOMS = ("core", "fields", "verification", "solvers", "planning", "trajectories", "baselines", "nn", "io", "sim", "ui")
# Names of JAX that fork on a device, stop fusion, rule over batches or name a memory; `by_target` is their own fork.
FORKS = {"platform_dependent", "default_backend", "optimization_barrier", "custom_vmap", "Space", "by_target"}


def names(source: str) -> set[str]:
    """Every name and attribute that a program reads or imports, prose left out."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Name(id=name) | ast.Attribute(attr=name) | ast.alias(name=name):
                found.add(name)
            case _:
                pass
    return found


@pytest.mark.parametrize("room", ROOMS)
def test_no_room_forks_on_a_device(room: str) -> None:
    files = sorted((MAXJAX / room).rglob("*.py"))
    assert files
    found = {str(file.relative_to(MAXJAX)): sorted(names(file.read_text()) & FORKS) for file in files}
    assert {file: forks for file, forks in found.items() if forks} == {}


def test_compile_forks_in_two_files() -> None:
    forking = {file.name for file in (MAXJAX / "compile").glob("*.py") if names(file.read_text()) & FORKS}
    assert forking == {"batching.py", "lowering.py"}


def test_no_test_replaces_how_a_program_is_lowered() -> None:
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        if file != Path(__file__):
            assert '"platform_dependent"' not in file.read_text(), file
