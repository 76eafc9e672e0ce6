"""The experiment on trajectories, at a small size."""

from __future__ import annotations

import dataclasses
import importlib.util
import math
from pathlib import Path

import pytest


@pytest.mark.nightly
def test_trajectories_hold_before_independent_judges(tmp_path: Path) -> None:
    for name in ("toppra", "casadi", "crazyflow"):
        if importlib.util.find_spec(name) is None:
            pytest.skip(f"needs {name} (extra bench)")
    from experiments import trajectories

    limited, free = trajectories.main(dataclasses.replace(trajectories.TINY, out=tmp_path))
    for row in (limited, free):
        assert row["trajectories"] == 1
        assert row["beyond_limits"] == row["below_radius"] == 0
    assert free["over_toppra_worst"] <= 1.05
    assert limited["over_oracle_worst"] <= 1.05
    for name in ("flown", "crazyflow"):
        assert limited[name] == 1
        assert limited[f"{name}_contacts"] == limited[f"{name}_off"] == limited[f"{name}_lost"] == 0
        assert 0.0 < limited[f"{name}_error_95"] <= 0.4
    text = trajectories.section({"rows": [limited, free], "provenance": {"device": "cpu", "cpus": 2}})
    assert "| suburb | 8 | 1 | 0 | 0 |" in text
    assert "| suburb | 1 | 0 | 0 |" in text
    old = {key: value for key, value in limited.items() if not key.startswith(("flown", "crazyflow"))}
    assert "IPOPT" not in trajectories.section({"rows": [old, free], "provenance": {"device": "cpu", "cpus": 2}})


def test_the_oracle_of_jerk_knows_a_straight_line() -> None:
    """From rest to rest in closed form: the acceleration rises for A / J, stays, falls, and the same to brake."""
    pytest.importorskip("casadi", reason="needs casadi (extra bench)")
    import numpy as np

    import maxjax
    from benchmarks.common.jerk_oracle import fastest_time_with_jerk

    limits, length = maxjax.FlightLimits(), 20.0
    time = np.linspace(0.0, 6.0, 601)
    rest = 0.5 - 0.5 * np.cos(np.pi * time / time[-1])
    points = np.column_stack([length * rest, 0.0 * rest, 0.0 * rest])
    rise = limits.acceleration / limits.jerk
    least = rise + math.sqrt(rise**2 + 4.0 * length / limits.acceleration)
    found = fastest_time_with_jerk(time, points, np.full(len(time), 50.0), limits)
    assert found == pytest.approx(least, rel=5e-3)
