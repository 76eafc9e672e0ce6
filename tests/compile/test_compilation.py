"""What is told of a compilation, and the one message of XLA's that is not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from maxjax.compile import cache
from maxjax.compile.compilation import compiling, told


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path))
    found = cache.cache_folder()
    assert found is not None
    return found


def test_the_time_told_is_that_of_the_last_time_and_none_is_told_before(folder: Path) -> None:
    heard: list[str] = []
    with told(heard.append):
        with compiling("solve"):
            pass
        with compiling("solve"):
            pass
        with pytest.raises(ZeroDivisionError), compiling("ascend"):
            _ = 1 / 0
        with compiling("ascend"):
            pass
    with compiling("solve"):  # nobody listens
        pass
    first, second, failed, again = heard[::2]
    assert heard[1::2] == [""] * 4
    assert first == "compiling solve"
    assert re.fullmatch(r"compiling solve, \d+ s last time", second)
    assert failed == again == "compiling ascend"


def test_programs_that_compile_at_a_time_are_told_together(folder: Path) -> None:
    (folder / "seconds.json").write_text('{"sense": 3.2, "plan": 30.0}')
    heard: list[str] = []
    with told(heard.append), compiling("sense"), compiling("plan"), compiling("follow"):
        pass
    started = [
        "compiling sense, 3 s last time",
        "compiling sense, plan, 30 s last time",
        "compiling sense, plan, follow",
    ]
    assert heard == [*started, started[1], started[0], ""]


@pytest.mark.parametrize("content", ["", "{", "[1]", '{"solve": "long"}'])
def test_a_damaged_file_of_times_is_as_good_as_none(content: str, folder: Path) -> None:
    (folder / "seconds.json").write_text(content)
    heard: list[str] = []
    with told(heard.append), compiling("solve"):
        pass
    assert heard == ["compiling solve", ""]


def test_without_a_folder_no_time_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(cache.VARIABLE, "off")
    heard: list[str] = []
    with told(heard.append):
        for _ in range(2):
            with compiling("solve"):
                pass
    assert heard == ["compiling solve", ""] * 2
