"""The experiment on trajectories, at a small size."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest


def test_trajectories_hold_before_independent_judges(tmp_path: Path) -> None:
    pytest.importorskip("toppra", reason="needs toppra (extra bench)")
    from experiments import trajectories

    limited, free = trajectories.main(dataclasses.replace(trajectories.TINY, out=tmp_path))
    for row in (limited, free):
        assert row["trajectories"] == 1
        assert row["beyond_limits"] == row["below_radius"] == 0
    assert free["over_toppra_worst"] <= 1.05
    text = trajectories.section({"rows": [limited, free], "provenance": {"device": "cpu", "cpus": 2}})
    assert "| suburb | 8 | 1 | 0 | 0 |" in text
