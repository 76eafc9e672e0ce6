"""The history is measured by public names of all times: today's commit has a figure for each."""

from __future__ import annotations

import dataclasses
import json
import subprocess
from pathlib import Path

import pytest

from benchmarks import history, tables


def _is_clone() -> bool:
    return not subprocess.run(["git", "-C", str(history.ROOT), "rev-parse"], capture_output=True).returncode


@pytest.mark.nightly
@pytest.mark.skipif(not _is_clone(), reason="needs the repository's history, not a copy of its files")
def test_the_commit_that_is_checked_out_has_all_figures_and_is_measured_once(tmp_path: Path) -> None:
    (row,) = history.main(dataclasses.replace(history.TINY, out=tmp_path))
    figures = {name: value for name, value in row.items() if name not in ("number", "commit", "date")}
    assert len(figures) == 1 + 11
    assert all(isinstance(value, float) and value > 0 for value in figures.values())
    document = json.loads((tmp_path / "history.json").read_text())
    assert f"| `{row['commit']}` |" in tables.history(document)
    kept = (tmp_path / "history.json").stat().st_mtime_ns
    assert history.main(dataclasses.replace(history.TINY, out=tmp_path)) == [row]
    assert (tmp_path / "history.json").stat().st_mtime_ns == kept


def test_what_a_commit_has_not_is_a_dash() -> None:
    row = {"number": 75, "commit": "0123456", "date": "2026-01-01", "peer [ms]": 30.0, "import": 12.4, "plan": None}
    assert "| 75, 2026-01-01 | `0123456` | 12 | – |" in tables.history({"rows": [row]})
