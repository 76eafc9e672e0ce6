"""Options of experiments and benchmarks: recorded results are replaced only where `--record` asks for it."""

from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path

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
    assert "Options of experiments and benchmarks: recorded results are replaced only" in told


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
