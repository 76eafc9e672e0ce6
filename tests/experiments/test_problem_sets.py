"""Problems of a set stand off the solids, and are the same however many are asked for."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.common.problems import voxels_of
from experiments import problem_sets
from experiments.city_windows import windows
from maxjax.sim.worlds.real_city import TOLERANCE, city
from maxjax.sim.worlds.solid_distance import distance


def test_ends_in_a_surveyed_city_stand_off_its_solids(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = tuple(data / file for file in problem_sets.CITIES["Venice"][:1])
    tiles = windows(files, 60.0, TOLERANCE)[:2]
    monkeypatch.setattr(problem_sets, "windows", lambda *_: tiles)
    found, first = (problem_sets.problem_set("Venice", count, half=60.0, data=data) for count in (6, 3))
    for one, other in zip(found, first, strict=False):
        np.testing.assert_array_equal([one.start, one.goal], [other.start, other.goal])
    for k, one in enumerate(found):
        ends = np.stack([one.start, one.goal])
        assert not one.map.barred[tuple(voxels_of(ends, one.map.grid).T)].any()
        geoms = city(tiles[k % 2].rows, len(tiles[k % 2].rows))
        off = jax.vmap(distance, in_axes=(None, 0))(geoms, jnp.asarray(ends, jnp.float32))
        assert np.all(np.asarray(off) >= 1.5 - 1e-4)
        assert 40 <= np.linalg.norm(one.start - one.goal) <= 100


def test_random_problems_are_those_of_the_offline_protocol() -> None:
    (one,) = problem_sets.problem_set("suburb", 1, half=24.0)
    (task,) = problem_sets.problems("suburb", 1, 0, one.grid)
    np.testing.assert_array_equal([one.start, one.goal], [task.starts[0], task.goals[0]])
    np.testing.assert_array_equal(one.map.barred, task.barred)
