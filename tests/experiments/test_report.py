"""RESULTS.md is what the result files say."""

from __future__ import annotations

from pathlib import Path

from experiments import report


def test_the_page_is_that_of_the_result_files() -> None:
    assert report.PAGE.read_text(encoding="utf-8") == report.page(), "run: make results"


def test_every_result_file_has_a_section() -> None:
    known = {name for sections in report.CHAPTERS.values() for name, _ in sections}
    assert {path.stem for path in (report.HERE / "results").glob("*.json")} <= known


def test_what_is_not_measured_is_left_out(tmp_path: Path) -> None:
    text = report.page(tmp_path, tmp_path)
    assert "###" not in text
    assert not any(f"## {chapter}" in text for chapter in (*report.CHAPTERS, "Faulty inputs", "Speed"))


def test_every_benchmark_has_a_table_or_a_figure() -> None:
    known = {name for _, names in (*report.SPEED, *report.INPUTS) for name in names}
    # Drawn, in docs/solver.md.
    assert {path.stem for path in report.BENCHMARKS.glob("*.json")} - known == {"solver_figures"}
