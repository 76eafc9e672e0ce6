"""The field of a large map is solved in coarse voxels, and drawn where the map has its own."""

import numpy as np
import pytest

from maxjax import VoxelMap
from maxjax.core.grid import Grid
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.ui.figures import planned

GRID = Grid((40, 33, 18), 2.0, (5.0, -3.0, 1.0))


def test_refined_values_are_linear_between_the_centres_of_coarse_voxels() -> None:
    coarse = np.moveaxis(np.indices((14, 11, 6)), 0, -1) @ np.array([1.0, -2.0, 0.5])
    fine = planned.refine_field(coarse.astype(np.float32), 3, GRID.shape)
    at = (np.moveaxis(np.indices(GRID.shape), 0, -1) - 1) / 3  # of coarse voxels
    inside = ((at >= 0) & (at <= np.array(coarse.shape) - 1)).all(axis=-1)
    assert np.allclose(fine[inside], (at @ np.array([1.0, -2.0, 0.5]))[inside], atol=1e-4)
    hole = coarse.copy()
    hole[3:11, 2:9, :] = -np.inf
    fine = planned.refine_field(hole.astype(np.float32), 3, GRID.shape)
    assert not np.isfinite(fine[15:27, 12:21]).any()
    assert np.isfinite(fine[:9]).all()


def test_the_coarse_field_of_a_map_is_about_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    occupied = np.zeros(GRID.shape, bool)
    occupied[14:18, :22, :] = True
    ends = np.array(GRID.origin) + GRID.spacing * np.array([[4.0, 5.0, 8.0], [34.0, 6.0, 9.0]])
    task = Task.of(VoxelMap.on(GRID, occupied), ends[:1], ends[1:], Distances(1.0, 4.0))
    own = planned._log_potential(task)
    monkeypatch.setattr(planned, "_FINE", GRID.shape[0] * GRID.shape[1] * GRID.shape[2] // 4)
    coarse = planned._log_potential(task)
    assert coarse.shape == own.shape
    both = np.isfinite(own) & np.isfinite(coarse)
    assert both.sum() > 0.95 * np.isfinite(own).sum()
    # The screening length counts voxels, so that the logarithm of a voxel twice as wide falls half as fast.
    assert np.corrcoef(own[both], coarse[both])[0, 1] > 0.99
