"""Experiments run at a small size, and what they claim holds there."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from experiments import warframe_crops


@pytest.mark.nightly
def test_warframe_subset_is_solved_certified_and_short(data: Path, tmp_path: Path) -> None:
    config = dataclasses.replace(warframe_crops.TINY, data=data, out=tmp_path)
    rows = {(row["crop"], row["method"]): row for row in warframe_crops.main(config)}
    for crop in ("Complex", "Simple"):
        ours, rival = rows[crop, "solver"], rows[crop, "astar"]
        assert ours["ok"] == ours["certified"] == ours["verified"] == ours["scenarios"]
        assert ours["over_optimum_mean"] <= 0.98
        assert ours["over_optimum_worst"] <= 1.05
        assert rival["ok"] == rival["scenarios"]
        assert rival["off_optimum"] == 0


@pytest.mark.nightly
def test_random_problems_hold_before_independent_judges(tmp_path: Path) -> None:
    pytest.importorskip("skfmm", reason="the eikonal oracle needs scikit-fmm: pip install 'maxjax[bench]'")
    from experiments import random_problems

    *maps, sealed = random_problems.main(dataclasses.replace(random_problems.TINY, out=tmp_path))
    assert [row["map"] for row in maps] == ["midtown", "downtown", "suburb"]
    for row in maps:
        assert row["solved"] == row["certified"] == row["largest_margin"] == row["solvable"]
        assert row["proved_unsolvable"] == row["problems"] - row["solvable"]
        assert row["unsafe"] == 0
        assert row["length_over_geodesic_mean"] <= 1.03
    assert sealed["solvable"] == sealed["solved"] == sealed["certified"] == 0
    assert sealed["proved_unsolvable"] == sealed["problems"]


@pytest.mark.nightly
def test_random_problems_end_alike_in_national_coordinates(tmp_path: Path) -> None:
    """The same problems on a map that lies at a Dutch easting and northing."""
    pytest.importorskip("skfmm", reason="the eikonal oracle needs scikit-fmm: pip install 'maxjax[bench]'")
    from experiments import random_problems

    tiny = dataclasses.replace(random_problems.TINY, problems=3, sealed=3, out=tmp_path)
    here, away = (
        [
            {key: value for key, value in row.items() if not key.endswith("_ms_median")}
            for row in random_problems.main(dataclasses.replace(tiny, origin=origin))
        ]
        for origin in ((0.0, 0.0, 0.0), (84888.0, 447501.0, 0.0))
    )
    assert here == away
