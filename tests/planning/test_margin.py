"""The chosen margin is the largest that joins the ends, by distance transforms and labels of SciPy."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from references import component_of, random_blocks, random_free
from scipy.ndimage import distance_transform_edt

from maxjax import Grid, Status
from maxjax.planning.ends import locate
from maxjax.planning.margin import ladder, largest_joined, largest_joined_each
from maxjax.planning.problem import formulate

GRID = Grid((16, 18, 20), 2.0, (0.0, 0.0, 0.0))
NO_GROUND = np.zeros(GRID.shape, bool)

_formulate = jax.jit(formulate, static_argnames=("margin", "grid"))


def blocked_by(occupied: np.ndarray, margin: float) -> np.ndarray:
    if not occupied.any():
        return occupied
    return distance_transform_edt(~occupied) <= margin / GRID.spacing + 1e-9


@pytest.mark.parametrize("margin", [8.0, 5.0])
def test_takes_the_largest_margin_that_joins_start_and_goal(margin: float) -> None:
    rng = np.random.default_rng(1)
    chosen = []
    for _ in range(60):
        occupied = random_blocks(rng, GRID.shape, int(rng.integers(1, 40)), int(rng.integers(2, 6)))
        ends = random_free(rng, occupied, 2)
        a, b = (tuple(v) for v in ends)
        margins = [*np.arange(margin, 0, -GRID.spacing), 0.0]
        feasible = [m for m in margins if component_of(~blocked_by(occupied, m), a)[b]]
        problem = _formulate(occupied, NO_GROUND, ends.astype(np.float32), margin=margin, grid=GRID)
        if feasible:
            assert problem.status == Status.OK
            assert float(problem.margin) == pytest.approx(max(feasible))
            np.testing.assert_array_equal(problem.blocked, blocked_by(occupied, max(feasible)))
            np.testing.assert_allclose(problem.start, ends[0], atol=1e-5)
            np.testing.assert_array_equal(problem.goal_index, ends[1])
        else:
            assert problem.status == Status.NO_VALID_PATH
            assert problem.margin == 0
        chosen.append(float(problem.margin))
    assert len(set(chosen)) >= 3


def test_the_margins_of_many_starts_are_those_of_each() -> None:
    rng = np.random.default_rng(5)

    @jax.jit
    def both(occupied: jax.Array, starts: jax.Array, goal: jax.Array) -> tuple[tuple[jax.Array, ...], ...]:
        margins = ladder(occupied, jnp.asarray(NO_GROUND), 6.0, GRID)
        many, one = jax.vmap(lambda x: locate(x, GRID.shape))(starts), locate(goal, GRID.shape)
        alone = jax.vmap(functools.partial(largest_joined, margins), in_axes=(0, None))(many, one)
        return largest_joined_each(margins, many, one, jnp.ones(len(starts), bool)), alone

    rungs, sealed = [], 0
    for _ in range(6):
        occupied = random_blocks(rng, GRID.shape, 25, 5)
        occupied[1:4, 1:4, 1:4] = True  # a closed box around the first start
        occupied[2, 2, 2] = False
        index = np.concatenate([[[2, 2, 2]], random_free(rng, occupied, 7)])
        ends = (index + rng.uniform(-0.4, 0.4, (8, 3))).astype(np.float32)
        together, alone = both(occupied, ends[:-1], ends[-1])
        np.testing.assert_array_equal(together[1], alone[1])
        joined = np.asarray(together[1])
        np.testing.assert_array_equal(np.asarray(together[0])[joined], np.asarray(alone[0])[joined])
        rungs += np.asarray(together[0])[joined].tolist()
        sealed += int((~joined).sum())
    assert len(set(rungs)) >= 3
    assert sealed > 0
