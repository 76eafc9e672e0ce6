"""The experiment on fleets at a tiny size: one that swaps in open sky."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from experiments.fleets import TINY, main, open_swaps, section


@pytest.mark.nightly
def test_a_row_says_who_arrived_and_how_to_fly_a_failure_again(tmp_path: Path) -> None:
    (row,) = main(dataclasses.replace(TINY, out=tmp_path))
    assert row["arrived"] == row["flights"] == 4
    assert row["met"] == row["walls"] == row["stuck"] == row["late"] == 0
    assert 40.0 / 5.0 - 1.0 < float(row["seconds"] or 0.0) < 14.0
    assert row["at_least"] == 39.76  # 0.025^(1/4)
    assert row["met_at_most"] == 60.24
    document = json.loads((tmp_path / "fleets.json").read_text())
    assert "| circle | 4 | 100 | 4 of 4 |" in section(document)
    failed = {**row, "arrived": 0, "met": 2, "seconds": None, "again": "python -m x --first 3"}
    assert "- `python -m x --first 3`" in section({**document, "rows": [failed]})


def test_all_ways_in_open_sky_meet_and_starts_are_apart() -> None:
    for world, size in (("circle", 10), ("level", 128), ("sphere", 10), ("sphere", 128)):
        swaps = open_swaps(world, size, 3)
        middle = 0.5 * (swaps.start + swaps.goal)
        assert np.linalg.norm(middle - middle.mean(axis=0), axis=1).max() < 1.0
        for ends in (swaps.start, swaps.goal):
            apart = np.linalg.norm(ends[:, None] - ends[None], axis=-1)[np.triu_indices(size, 1)]
            assert apart.min() > 3.0
        assert not np.array_equal(swaps.start, open_swaps(world, size, 4).start)
