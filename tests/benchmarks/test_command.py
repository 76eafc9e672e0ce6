"""`--tiny` of experiments and benchmarks: a small configuration that writes beside recorded results, and options."""

from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path

import pytest

from benchmarks.common.command import FOLDER, configured

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


def test_without_it_the_configuration_is_the_whole_one() -> None:
    assert configured(TINY, []) == _Config()
    assert configured(TINY, ["--problems", "7"]) == _Config(problems=7)


def test_a_tiny_run_never_writes_where_results_are() -> None:
    assert configured(TINY, ["--tiny"]) == _Config(problems=2, out=FOLDER)
    assert configured(TINY, ["--problems", "3", "--tiny"]) == _Config(problems=3, out=FOLDER)
    assert configured(TINY, ["--tiny", "--out", "elsewhere"]).out == Path("elsewhere")


def test_help_tells_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        configured(TINY, ["--help"])
    assert ended.value.code == 0
    assert "--tiny" in capsys.readouterr().out


@pytest.mark.parametrize("name", commands())
def test_every_command_has_a_tiny_run_that_leaves_results_alone(name: str) -> None:
    module = importlib.import_module(name)
    tiny, asked = module.TINY, configured(module.TINY, ["--tiny"])
    assert configured(tiny, []) == type(tiny)()
    moved = {name: path for name, path in vars(asked).items() if path != getattr(tiny, name)}
    assert "out" in moved
    assert all(FOLDER in (path, path.parent) for path in moved.values())
    file = Path(str(module.__file__))
    started = file.with_name("__main__.py") if file.with_name("__main__.py").exists() else file
    assert "main(configured(TINY))" in started.read_text(encoding="utf-8")
