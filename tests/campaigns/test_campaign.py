"""Campaigns: what cannot be flown is refused, and A* as the finder of a flight."""

from __future__ import annotations

import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.campaigns.campaign import Campaign
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.ascent import Ascent
from maxjax.planning.baselines.astar import astar
from maxjax.planning.problem import pose
from maxjax.planning.sight import clear, span_codes
from maxjax.sim.astar_finder import POINTS, corners_of, search
from maxjax.sim.disturbances import Disturbances
from maxjax.sim.flight import FlightConfig


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"map": "venice"}, "midtown, downtown, suburb, given 'venice'"),
        ({"method": "magic"}, "solver, network, astar"),
        ({"trials": range(0)}, "at least one"),
        ({"seed": -1}, "seed"),
        ({"config": FlightConfig(Disturbances(dropout=1.5))}, "dropout: expected a number from 0 to 1"),
        ({"config": FlightConfig(Disturbances(wind=-1.0))}, "wind: expected a number from 0"),
        ({"config": FlightConfig(Disturbances(drift=float("nan")))}, "drift"),
        ({"config": FlightConfig(reactive=-0.1)}, "reactive"),
    ],
)
def test_what_cannot_be_flown_is_refused(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Campaign(**{"map": "suburb", **changes})


# --- A* as the finder of a flight. ---


def problem_of(seed: int) -> tuple[Any, Grid]:
    rng = np.random.default_rng(seed)
    grid = Grid((14, 12, 9), 2.0, (0.0, 0.0, 0.0))
    occupied = rng.random(grid.shape) < 0.25
    start, goal = np.array([1.0, 1.0, 1.0]) * 2 + 0.3, np.array([12.0, 10.0, 7.0]) * 2 - 0.3
    occupied[1, 1, 1] = occupied[12, 10, 7] = False
    if seed == 2:
        occupied[5] = True
    nothing = jnp.zeros(grid.shape, bool)
    return pose(jnp.asarray(occupied), nothing, jnp.asarray(start), jnp.asarray(goal), 0.0, grid), grid


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_astar_in_the_loop_is_astar(seed: int) -> None:
    problem, grid = problem_of(seed)
    path, status, certified = jax.jit(search, static_argnums=1)(problem, grid)
    expected = astar(np.asarray(problem.blocked), (1, 1, 1), (12, 10, 7))
    assert path.shape == (POINTS, 3) == (Ascent().steps + 1, 3)
    assert not certified
    assert int(status) == expected.status == (Status.NO_VALID_PATH if seed == 2 else Status.OK)
    if expected.status != Status.OK:
        assert np.all(path == path[0])
        return
    found = np.asarray(path)
    np.testing.assert_allclose(found[0], problem.start)
    np.testing.assert_allclose(found[-1], problem.goal)
    # From the exact start past its voxel's centre, then through A*'s corners, in order, to the exact goal.
    corners = corners_of(expected.path)[1:]
    inner = found[:-1][np.any(np.diff(found, axis=0) != 0, axis=1)]
    np.testing.assert_array_equal(inner[-len(corners) :], corners)
    assert len(inner) == len(corners) + 1 or np.array_equal(inner[1], expected.path[1])
    bits = span_codes(problem.blocked)
    assert all(clear(bits, jnp.asarray(a), jnp.asarray(b)) for a, b in itertools.pairwise(inner))


def test_astar_in_the_loop_under_vmap_is_each_by_itself() -> None:
    problems = [problem_of(seed)[0] for seed in (0, 1, 2)]
    grid = problem_of(0)[1]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *problems)
    paths, statuses, _ = jax.vmap(lambda one: search(one, grid))(batch)
    for problem, path, status in zip(problems, paths, statuses, strict=True):
        alone, expected, _ = search(problem, grid)
        np.testing.assert_array_equal(path, alone)
        assert status == expected


def test_corners_keep_the_line() -> None:
    path = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 1, 0], [4, 2, 0], [4, 2, 1]], np.int32)
    np.testing.assert_array_equal(corners_of(path), path[[0, 2, 4, 5]])
    np.testing.assert_array_equal(corners_of(path[:1]), path[:1])
    np.testing.assert_array_equal(corners_of(path[:2]), path[:2])
