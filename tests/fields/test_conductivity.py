"""The paper's formula, at voxels worked out by hand."""

from __future__ import annotations

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Grid, conductivity

GRID = Grid((16, 18, 20))
GOAL = jnp.asarray([5, 6, 7], jnp.int32)
EMPTY = jnp.zeros(GRID.shape, bool)


@pytest.mark.parametrize(
    ("offset", "expected"),
    [
        ((0, 0, 0), 1e6),
        ((0, 0, 1), 1e2 + 1e6),
        ((-1, 0, 0), 1e2 + 1e6),
        ((1, 1, 1), 1e2 + 1e6 / 3**0.5),
        ((3, -4, 0), 1e2 + 2e5),
        ((2, 3, 6), 1e2 + 1e6 / 7),
        ((10, 11, 12), 1e2 + 1e6 / 365**0.5),
    ],
)
def test_formula(offset: tuple[int, int, int], expected: float) -> None:
    sigma = conductivity(EMPTY, GOAL, GRID)
    assert sigma.dtype == np.float32
    assert float(sigma[tuple(np.array(GOAL) + offset)]) == pytest.approx(expected, rel=1e-6)


def test_obstacles_conduct_nothing_and_the_rest_is_unchanged() -> None:
    occupied = np.random.default_rng(1).random(GRID.shape) < 0.3
    sigma = np.asarray(conductivity(jnp.asarray(occupied), GOAL, GRID))
    np.testing.assert_array_equal(sigma, np.where(occupied, 0, conductivity(EMPTY, GOAL, GRID)))
    assert conductivity(EMPTY.at[5, 6, 7].set(True), GOAL, GRID)[5, 6, 7] == 0


def test_a_goal_outside_the_grid_gives_a_finite_field() -> None:
    sigma = conductivity(EMPTY, jnp.asarray([-3, 6, 99], jnp.int32), GRID)
    assert np.isfinite(sigma).all()
    assert sigma.max() < 1e6


def test_vmap_over_goals_equals_a_loop() -> None:
    goals = jnp.asarray([[5, 6, 7], [0, 0, 0], [15, 17, 19]], jnp.int32)
    batch = jax.vmap(lambda goal: conductivity(EMPTY, goal, GRID))(goals)
    np.testing.assert_array_equal(batch, jnp.stack([conductivity(EMPTY, goal, GRID) for goal in goals]))


def test_wrong_shapes_are_told_with_what_was_given() -> None:
    with pytest.raises(ValueError, match=r"occupied: expected shape \(..., 16, 18, 20\), given \(4, 5, 6\)"):
        inspect.unwrap(conductivity)(jnp.zeros((4, 5, 6), bool), GOAL, GRID)
