"""How the project's sources are laid out: imports run downwards, and functions and files stay short.

A function that needs more than six arguments says why in a comment `# arguments: <reason>`, on the line of its `def` or
on the one above.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ARGUMENTS, REASON = 6, "# arguments: "
FUNCTION_LINES, FILE_LINES = 60, 350

# What each room of maxjax/ may import, the lowest first; whatever a row names stands above it in the table.
FLOORS: dict[str, tuple[str, ...]] = {
    "core": (),
    "programs": ("core",),
    "verification": ("core",),
    "airspace": ("core",),
    "fields": ("core", "programs"),
    "solvers": ("core", "programs", "fields"),
    "planning": ("core", "programs", "fields", "verification"),
    "baselines": ("core", "programs", "fields", "planning"),
    "trajectories": ("core", "programs", "fields", "verification", "planning"),
    "maps": ("core", "fields", "airspace"),
    "missions": ("core", "maps", "airspace", "planning", "trajectories"),
    "worlds": ("core", "programs", "fields", "maps"),
    "nn": ("core", "programs", "fields", "solvers", "worlds"),
    "sim": ("core", "programs", "fields", "verification", "planning", "trajectories", "worlds"),
    "campaigns": ("core", "programs", "fields", "planning", "maps", "worlds", "sim"),
    "methods": ("core", "fields", "solvers", "planning", "baselines", "nn"),
}
# On top of all of these.
for room in ("viz", "api", "api_mission", "view", "cli", "__init__", "__main__"):
    FLOORS[room] = tuple(FLOORS)


def sources(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def imported(path: Path) -> Iterator[tuple[int, str]]:
    """Line and full name of every module or object that a file imports."""
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = list(package[: len(package) + 1 - node.level]) if node.level else []
            module = ".".join([*base, *filter(None, [node.module])])
            yield from ((node.lineno, f"{module}.{alias.name}") for alias in node.names)


def functions(path: Path) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def argument_count(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Arguments beside self and cls."""
    given = function.args
    every = [*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg]
    return sum(argument is not None and argument.arg not in ("self", "cls") for argument in every)


def where(path: Path, line: int) -> str:
    return f"{path.relative_to(ROOT)}:{line}"


def test_the_table_of_floors_names_every_room() -> None:
    rooms = {
        path.stem for path in (ROOT / "maxjax").iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()
    }
    assert rooms == set(FLOORS)
    for above, (room, below) in enumerate(FLOORS.items()):
        assert set(below) <= set(list(FLOORS)[:above]) | {room}, room


def test_imports_run_downwards() -> None:
    upward = []
    for path in sources("maxjax"):
        room = path.relative_to(ROOT / "maxjax").parts[0].removesuffix(".py")
        for line, name in imported(path):
            top, _, rest = name.partition(".")
            if top in ("experiments", "benchmarks", "tests"):
                upward.append(f"{where(path, line)} imports {name}")
            elif top == "maxjax" and rest.split(".")[0] in FLOORS:
                other = rest.split(".")[0]
                if other != room and other not in FLOORS[room]:
                    upward.append(f"{where(path, line)} imports {name}")
            elif top == "maxjax" and room not in ("cli", "__init__", "__main__"):
                upward.append(f"{where(path, line)} imports {name}, which is made of the rooms above it")
    assert not upward, "\n".join(upward)


def test_benchmarks_import_no_experiment() -> None:
    """The other way is allowed: experiments use the benchmarks' common room."""
    found = [f"{where(path, line)} imports {name}" for path in sources("benchmarks") for line, name in imported(path)]
    assert any("benchmarks.common" in line for line in found)
    assert not [line for line in found if " imports experiments" in line]


def test_a_function_of_more_than_six_arguments_says_why() -> None:
    silent = []
    for path in sources("maxjax"):
        lines = ["", *path.read_text(encoding="utf-8").splitlines()]
        for function in functions(path):
            count = argument_count(function)
            if count > ARGUMENTS and not any(REASON in lines[k] for k in (function.lineno - 1, function.lineno)):
                silent.append(f"{where(path, function.lineno)} {function.name}: {count} arguments")
    assert not silent, "\n".join(silent)


def test_functions_are_short() -> None:
    long = []
    for path in sources("maxjax"):
        for function in functions(path):
            assert function.end_lineno is not None
            lines = function.end_lineno - function.lineno + 1
            if lines >= FUNCTION_LINES:
                long.append(f"{where(path, function.lineno)} {function.name}: {lines} lines")
    assert not long, "\n".join(long)


def test_files_are_short() -> None:
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in sources("maxjax")}
    assert not [f"{path.relative_to(ROOT)}: {n} lines" for path, n in lengths.items() if n > FILE_LINES]


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("def f(a, b, /, c, *, d): ...", 4),
        ("def f(self, a, *rest, **named): ...", 3),
        ("async def f(cls): ...", 0),
    ],
)
def test_arguments_are_counted(source: str, count: int) -> None:
    (function,) = ast.parse(source).body
    assert isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef)
    assert argument_count(function) == count
