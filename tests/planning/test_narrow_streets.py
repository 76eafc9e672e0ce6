"""Long ways through narrow streets of a large map are good ways: about what the cheapest lattice path costs."""

from __future__ import annotations

import numpy as np
import pytest

import maxjax
from maxjax.core.status import Status
from maxjax.planning.windows import focus_window

SPACING, SHAPE = 2.0, (560, 560, 96)
BLOCK, STREET = 20, 4  # voxels: houses of 40 m, streets of 8 m


def quarter() -> maxjax.VoxelMap:
    """A city of 30 million voxels whose houses reach to the top of the map, so that streets are the way."""
    occupied, ground = np.zeros(SHAPE, bool), np.zeros(SHAPE, bool)
    step = BLOCK + STREET
    for x in range(3, SHAPE[0], step):
        for y in range(1, SHAPE[1], step):
            shift = 2 * ((x // step) % 2)  # streets that no coarse lattice meets in its own rhythm
            occupied[x : x + BLOCK, y + shift : y + shift + BLOCK] = True
    ground[:, :, 0] = True
    return maxjax.VoxelMap.of(occupied, spacing=SPACING, origin=(0.0, 0.0, 0.0), ground=ground)


@pytest.mark.large
@pytest.mark.usefixtures("compiled_astar")
def test_streets_of_eight_metres_stay_open_in_thirty_million_voxels(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(focus_window, "SHAPES", ((64, 64, 32),))  # one program for all legs
    where = quarter()
    step = SPACING * (BLOCK + STREET)
    start, goal = (2.0 + 2 * step, 200.0, 10.0), (2.0 + 14 * step, 500.0, 10.0)
    plan = maxjax.plan(where, start, goal)
    rival = maxjax.plan(where, start, goal, planner=maxjax.AStar())
    assert plan.status == rival.status == Status.OK
    assert plan.certified
    assert plan.cost <= 1.03 * rival.cost
    assert plan.stats.ratio == pytest.approx(plan.cost / rival.cost, rel=0.02)
