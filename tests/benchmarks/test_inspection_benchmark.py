"""The benchmark of photographs runs at a small size, and what it claims holds there."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from benchmarks import inspection


@pytest.mark.nightly
def test_all_three_are_measured(tmp_path: Path) -> None:
    """A building, its round, an area, places for vehicles: verified, and nearly all is seen."""
    rows = {str(row["what"]): row for row in inspection.main(dataclasses.replace(inspection.TINY, out=tmp_path))}
    assert json.loads((tmp_path / "inspection.json").read_text())["rows"] == list(rows.values())
    building, area, places = rows["building"], rows["area"], rows["8 places for 2 vehicles"]
    assert building["ok"]
    assert area["ok"]
    assert places["ok"]
    assert float(str(building["share"])) > 0.99
    assert int(str(building["least"])) <= int(str(building["viewpoints"]))
    rival = rows["round through the viewpoints"]["ortools_cost_s"]
    assert rival is None or float(str(rows["round through the viewpoints"]["cost_s"])) <= 1.05 * float(str(rival))
