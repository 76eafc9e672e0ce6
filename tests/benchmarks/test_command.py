"""`--tiny` of experiments: a small configuration that writes beside recorded results, and options above it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from benchmarks.common.command import FOLDER, configured


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
