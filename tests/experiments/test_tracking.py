"""The experiment on seeing movers runs at a tiny size and writes its section."""

from __future__ import annotations

import json
from pathlib import Path

from experiments.tracking import Config, main, section


def test_it_runs_and_writes_its_section(tmp_path: Path) -> None:
    small = {"worlds": ("suburb", "field"), "counts": (3,), "speeds": (5.0,), "obstacles": (6,)}
    rows = main(Config(**small, seeds=1, looks=8, channels=32, rays=4096, out=tmp_path))
    assert [row["world"] for row in rows] == ["suburb", "field"]
    assert all(row["looks"] == 3 for row in rows)
    text = section(json.loads((tmp_path / "tracking.json").read_text()))
    assert "| suburb | 3 | 5 |" in text
    assert "| field | 6 |" in text
