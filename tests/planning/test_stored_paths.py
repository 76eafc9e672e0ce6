"""Without a price, and with what is blocked given as it is, paths are those of the planner before prices.

`stored_paths.npz` holds six maps of 49 x 49 x 33 voxels of 2 m, dilated by 8 m, and the paths that commit d3c5901
planned in them: four in cities, two through three walls with a gap each.
"""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import maxjax
from maxjax import VoxelMap
from maxjax.fields.geodesic import geodesic
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import plan_task
from maxjax.planning.run.field_planner import FieldPlanner

GRID = maxjax.Grid((49, 49, 33), 2.0, (-48.0, -48.0, 0.0))


def with_its_length(sigma: jax.Array, goal: jax.Array, price: jax.Array | None) -> maxjax.Potential:
    """The potential with the screening length of that commit, which let float32 span φ."""
    _, steps = geodesic(sigma > 0, goal)
    return maxjax.solve_potential(sigma, goal, price, screening_length=jnp.maximum(jnp.max(steps) / 68.0, 1.5))


def farthest(points: np.ndarray, path: np.ndarray) -> float:
    """The largest distance of points from a path."""
    a, d = path[:-1], np.diff(path, axis=0)
    square = np.maximum((d**2).sum(axis=1), 1e-12)
    t = np.clip(((points[:, None] - a) * d).sum(axis=-1) / square, 0, 1)
    return float(np.linalg.norm(points[:, None] - a - t[..., None] * d, axis=-1).min(axis=1).max())


def test_paths_are_those_of_the_planner_before_prices_to_a_centimetre() -> None:
    stored = np.load(Path(__file__).with_name("stored_paths.npz"))
    blocked = np.unpackbits(stored["blocked"], axis=-1, count=GRID.shape[2]).astype(bool)
    task = Task.of(VoxelMap.on(GRID, blocked), stored["start"], stored["goal"], Distances(0.0, 0.0))
    for plan, path in zip(plan_task(task, FieldPlanner(with_its_length)), stored["path"], strict=True):
        assert plan.status is maxjax.Status.OK
        assert plan.exemptions == (0.0, 0.0)
        assert plan.cost == plan.length
        assert max(farthest(plan.path, path), farthest(path, plan.path)) < 0.01
