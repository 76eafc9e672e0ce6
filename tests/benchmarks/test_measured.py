"""The measured page says what the result files say."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import measured


def test_the_measured_figures_are_those_of_the_result_files() -> None:
    text = measured.PAGE.read_text(encoding="utf-8")
    assert measured.rewritten(text, measured.block()) == text, "run: python -m benchmarks.measured"


def test_markers_are_wanted_once_and_in_order() -> None:
    assert measured.rewritten(f"a\n{measured.BEGIN}old\n{measured.END}b\n", "new\n") == (
        f"a\n{measured.BEGIN}new\n{measured.END}b\n"
    )
    for text in ("", measured.BEGIN, measured.END + measured.BEGIN, 2 * (measured.BEGIN + measured.END)):
        with pytest.raises(ValueError, match="expected one"):
            measured.rewritten(text, "new\n")


def test_a_missing_result_names_the_command(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"plan\.json is missing; run: python -m benchmarks\.plan"):
        measured.block(tmp_path)
