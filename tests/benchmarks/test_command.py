"""Commands of experiments and benchmarks: what their options mean, and that a small run of each ends with figures."""

from __future__ import annotations

import dataclasses
import importlib
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from benchmarks.common.command import FOLDER, TINY_FOLDER, configured

ROOT = Path(__file__).parents[2]
OTHERS = ("experiments/network_training.py",)  # runs nothing: it reads what training wrote


def commands() -> list[str]:
    """Modules of experiments and benchmarks that have a configuration."""
    files = (path for room in ("experiments", "benchmarks") for path in sorted((ROOT / room).rglob("*.py")))
    named = [path.relative_to(ROOT) for path in files if "\nclass Config:" in path.read_text(encoding="utf-8")]
    return [".".join(path.with_suffix("").parts) for path in named if str(path) not in OTHERS]


@dataclasses.dataclass(frozen=True)
class _Config:
    """Settings."""

    problems: int = 100
    shape: tuple[int, int] = (101, 33)
    out: Path = Path("results")


TINY = _Config(problems=2)


def test_recorded_results_are_replaced_only_where_that_is_asked_for() -> None:
    assert configured(TINY, ["--record"]) == _Config()
    assert configured(TINY, []) == _Config(out=FOLDER)
    assert configured(TINY, ["--problems", "7"]) == _Config(problems=7, out=FOLDER)
    assert configured(TINY, ["--out", "elsewhere"]).out == Path("elsewhere")


def test_a_tiny_run_never_writes_where_results_are() -> None:
    assert configured(TINY, ["--tiny"]) == _Config(problems=2, out=TINY_FOLDER)
    assert configured(TINY, ["--problems", "3", "--tiny"]) == _Config(problems=3, out=TINY_FOLDER)
    assert configured(TINY, ["--tiny", "--out", "elsewhere"]).out == Path("elsewhere")
    with pytest.raises(SystemExit, match="--tiny and --record: expected one of them"):
        configured(TINY, ["--tiny", "--record"])


def test_help_tells_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        configured(TINY, ["--help"])
    assert ended.value.code == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "With --tiny: a small run" in told
    assert "Commands of experiments and benchmarks: what their options mean" in told


@pytest.mark.parametrize("name", commands())
def test_every_command_has_a_tiny_run_that_leaves_results_alone(name: str) -> None:
    module = importlib.import_module(name)
    tiny, asked = module.TINY, configured(module.TINY, ["--tiny"])
    assert configured(tiny, ["--record"]) == type(tiny)()
    moved = {name: path for name, path in vars(asked).items() if path != getattr(tiny, name)}
    assert "out" in moved
    assert all(TINY_FOLDER in (path, path.parent) for path in moved.values())
    file = Path(str(module.__file__))
    started = file.with_name("__main__.py") if file.with_name("__main__.py").exists() else file
    assert "main(configured(TINY))" in started.read_text(encoding="utf-8")


# A benchmark and an experiment that take seconds; the small runs of the others by night.
QUICK = {"benchmarks.lidar", "experiments.heights_picture"}


def numbers(thing: object) -> Iterator[float]:
    """All that there are in rows, in lists of them, and in arrays."""
    if isinstance(thing, dict):
        thing = list(thing.values())
    if isinstance(thing, float | np.floating):
        yield thing
    elif isinstance(thing, list | tuple | np.ndarray):
        for part in thing:
            yield from numbers(part)


@pytest.mark.large
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.nightly]) for name in commands()]
)
def test_a_small_run_ends_with_finite_figures(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> None:
    try:
        module = importlib.import_module(name)
        given = {key: value for key, value in vars(module.TINY).items() if key in ("out", "figures", "docs")}
        changes = {key: tmp_path / path.name if path.suffix else tmp_path for key, path in given.items()}
        if hasattr(module.TINY, "data"):
            changes["data"] = request.getfixturevalue("data")
        rows = module.main(dataclasses.replace(module.TINY, **changes))
    except ModuleNotFoundError as missing:
        if str(missing.name).split(".")[0] in ("maxjax", "experiments", "benchmarks"):
            raise
        pytest.skip(f"needs {missing.name}: pip install 'maxjax[bench]'")
    assert any(tmp_path.iterdir())
    assert rows is None or len(rows) > 0
    assert all(math.isfinite(number) for number in numbers(rows))
