from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from jaxtyping import Array, Float, Int32
from scipy import ndimage
from scipy.sparse.csgraph import dijkstra

from maxjax.compile.batching import settle, settle_batch, with_batch_rule
from maxjax.compile.lowering import (
    by_target,
    costs_to_last,
    every,
    first_maximum,
    in_block,
    in_this_turn,
    lowering_for,
    materialise,
    maximum,
    neighbours,
    once,
    repeat,
    shift_axis,
    total,
)
from tests.short_programs import shorten


@pytest.fixture(autouse=True)
def _both_forms() -> None:
    """As users have them: JAX chooses the form when it lowers."""
    shorten(False)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Walker:
    position: Float[Array, "2"]
    turns: Int32[Array, ""]


def goes_on(data: tuple[Array, Array], walker: Walker) -> Array:
    return jnp.max(jnp.abs(data[0] - walker.position)) > 0


def strides(data: tuple[Array, Array], walker: Walker) -> Walker:
    target, stride = data
    move = jnp.clip(target - walker.position, -stride, stride)
    return Walker(walker.position + move, walker.turns + 1)


def walk(target: Float[Array, "2"], stride: Float[Array, ""], start: Float[Array, "2"], at_once: int) -> Walker:
    """Towards the target by one stride a turn: as many turns as it is far."""
    return settle(goes_on, strides, (target, stride), Walker(start, jnp.int32(0)), at_once=at_once)


@pytest.mark.parametrize("at_once", [64, 8, 1])
@pytest.mark.parametrize("shared", [False, True])
def test_every_member_gets_what_it_gets_alone(at_once: int, shared: bool) -> None:
    targets = jnp.asarray(np.random.default_rng(0).integers(-9, 9, (37, 2)), jnp.float32).at[5].set(0.0)
    targets = targets.at[36].set(jnp.array([40.0, 2.0]))  # the last one fills up incomplete parts
    pace = jnp.float32(1) if shared else 1 + jnp.arange(37, dtype=jnp.float32) % 3
    start = jnp.zeros(2)
    axes = (0, None if shared else 0, None)
    batch = jax.jit(jax.vmap(lambda t, s, x: walk(t, s, x, at_once), axes))(targets, pace, start)
    for k, target in enumerate(targets):
        alone = walk(target, pace if shared else pace[k], start, at_once)
        expected = np.ceil(np.abs(target).max() / (1 if shared else pace[k]))
        np.testing.assert_array_equal(batch.position[k], target)
        assert int(alone.turns) == int(batch.turns[k]) == expected


def test_a_batch_settles_without_a_member_traced() -> None:
    targets = jnp.asarray(np.random.default_rng(1).integers(-9, 9, (11, 2)), jnp.float32)
    first = Walker(jnp.zeros((11, 2)), jnp.zeros(11, jnp.int32))
    found = jax.jit(lambda: settle_batch(goes_on, strides, (targets, jnp.ones(11)), first, at_once=3))()
    np.testing.assert_array_equal(found.position, targets)
    np.testing.assert_array_equal(found.turns, np.abs(targets).max(axis=1))


def test_nested_batches() -> None:
    targets = jnp.arange(24, dtype=jnp.float32).reshape(3, 4, 2)
    nested = jax.vmap(jax.vmap(lambda t: walk(t, jnp.float32(2), jnp.zeros(2), 2)))(targets)
    np.testing.assert_array_equal(nested.position, targets)
    np.testing.assert_array_equal(nested.turns, np.ceil(np.asarray(targets).max(-1) / 2))


@pytest.mark.parametrize("dtype", [bool, np.uint8, np.int32, np.float32])
def test_what_is_computed_once_is_what_it_was(dtype: type) -> None:
    volume = np.random.default_rng(0).integers(0, 9, (3, 4, 5)).astype(dtype)
    run = jax.jit(lambda x: materialise(x[:, ::-1]))
    np.testing.assert_array_equal(run(volume), volume[:, ::-1])
    batch = np.stack([volume, np.zeros_like(volume)])
    np.testing.assert_array_equal(jax.vmap(materialise)(jnp.asarray(batch)), batch)


def test_what_is_computed_once_may_be_no_number_and_has_a_derivative() -> None:
    bad = np.float32([[np.nan, 1.0], [np.inf, -np.inf]])
    np.testing.assert_array_equal(jax.jit(materialise)(bad), bad)
    slope = jax.jit(jax.grad(lambda x: jnp.sum(materialise(x**2))))(jnp.float32([1.0, 2.0]))
    np.testing.assert_array_equal(slope, [2.0, 4.0])


@pytest.mark.parametrize("size", [1, 5, 8, 21, 104])
@pytest.mark.parametrize("where", [0, -1])
def test_the_largest_is_found_in_every_part(size: int, where: int) -> None:
    a, b = np.random.default_rng(size).normal(size=(2, size, 3, 4)).astype(np.float32)

    @jax.jit
    def found(a: Array, b: Array) -> Array:
        return maximum(lambda a, b: jnp.abs(a - b), a, b)

    assert found(a, b) == np.abs(a - b).max()
    a[where, -1, 2] = 99
    assert found(a, b) == np.abs(a - b).max()
    np.testing.assert_array_equal(jax.vmap(found, (0, None))(np.stack([a, b]), b), [np.abs(a - b).max(), 0])
    a[where, 0, 0] = np.nan
    assert np.isnan(found(a, b))


both = pytest.mark.parametrize("platform", ["cpu", "gpu"])


@both
@pytest.mark.parametrize("count", [0, 1, 5])
def test_a_step_is_repeated_so_many_times(platform: str, count: int) -> None:
    with lowering_for(platform):
        walker = jax.jit(
            lambda x: repeat(count, lambda w: Walker(w.position * 2, w.turns + 1), Walker(x, jnp.int32(0)), 2)
        )(jnp.ones(2))
    assert (float(walker.position[0]), int(walker.turns)) == (2.0**count, count)


@both
@pytest.mark.parametrize("beyond", [0, -1.0])
def test_neighbours_are_those_of_a_padded_copy(platform: str, beyond: float) -> None:
    volume = np.random.default_rng(0).normal(size=(3, 4, 5)).astype(np.float32)
    around = np.pad(volume, 1, constant_values=beyond)
    with lowering_for(platform):
        found = jax.jit(lambda x: neighbours(x, beyond))(volume)
    for axis, (ahead, behind) in enumerate(found):
        core = (slice(1, -1),) * 3
        np.testing.assert_array_equal(ahead, np.roll(around, -1, axis)[core])
        np.testing.assert_array_equal(behind, np.roll(around, 1, axis)[core])
    np.testing.assert_array_equal(shift_axis(jnp.asarray(volume), 1, -2, 7)[:, :2], 7)


@both
def test_all_of_a_few_numbers_or_many_meet_a_condition(platform: str) -> None:
    limits = jnp.asarray([0, 3, 6, 20])
    for count in (1, 6, 12):
        with lowering_for(platform):
            found = jax.jit(lambda m: every(lambda k: k < m[:, None], count, jnp.int32(count)))(limits)  # noqa: B023
        np.testing.assert_array_equal(found, limits >= count)


@both
def test_sums_stop_where_nothing_follows(platform: str) -> None:
    ends = jnp.asarray([0, 3, 17, 40])
    with lowering_for(platform):
        below, squares = jax.jit(
            lambda m: total(lambda k: (k < m[:, None], jnp.where(k < m[:, None], k * k, 0)), 50, jnp.max(m))
        )(ends)
    np.testing.assert_array_equal(below, ends)
    np.testing.assert_array_equal(squares, [sum(k * k for k in range(end)) for end in ends])


@both
def test_ways_to_the_last_point_cost_what_dijkstra_says(platform: str) -> None:
    rng = np.random.default_rng(4)
    for n in (2, 7, 64):
        edges = np.where(rng.random((n, n)) < 0.3, rng.uniform(1, 9, (n, n)), np.inf)
        edges[np.arange(n - 1), np.arange(1, n)] = 5.0
        edges = np.where(np.triu(np.ones((n, n), bool), 1), edges, np.inf).astype(np.float32)
        with lowering_for(platform):
            found = jax.jit(costs_to_last)(edges)
        weights = np.where(np.isfinite(edges), edges, 0)
        np.testing.assert_allclose(found, dijkstra(weights.T, indices=n - 1), rtol=1e-5)


@both
@pytest.mark.parametrize("shape", [(4, 9, 5), (12, 13, 14)])
def test_what_lies_near_is_read_from_a_block_as_from_the_whole(platform: str, shape: tuple[int, int, int]) -> None:
    volume = np.random.default_rng(5).normal(size=shape).astype(np.float32)

    def sum_around(volume: Array, corner: Array, at: Array) -> Array:
        away = [abs(lax.broadcasted_iota(jnp.int32, volume.shape, k) + corner[k] - at[k]) for k in range(3)]
        return jnp.sum(jnp.where((away[0] <= 1) & (away[1] <= 1) & (away[2] <= 1), volume, 0))

    with lowering_for(platform):
        found = jax.jit(jax.vmap(lambda at: in_block(sum_around, volume, at, 1, at)))(
            np.array(list(np.ndindex(*shape)), np.int32)
        )
    around = ndimage.uniform_filter(volume.astype(float), 3, mode="constant") * 27
    np.testing.assert_allclose(found, around.reshape(-1), atol=1e-5)


def test_the_first_of_equal_maxima_is_taken_with_its_rows() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        score = rng.integers(0, 4, 8).astype(np.float32)
        rows = rng.normal(size=(8, 3)).astype(np.float32)
        best, row = first_maximum(jnp.asarray(score), jnp.asarray(rows))
        assert best == score.max()
        np.testing.assert_array_equal(row, rows[np.argmax(score)])


def test_arrays_computed_once_are_what_they_were() -> None:
    a, b = jnp.arange(3.0), jnp.ones((2, 2))
    np.testing.assert_array_equal(jax.jit(once)(a), a)
    for given, found in zip((a, b), jax.jit(once)(a, b), strict=True):
        np.testing.assert_array_equal(found, given)
    (kept,) = jax.jit(in_this_turn)((a,), b)
    np.testing.assert_array_equal(kept, a)


def test_each_target_has_a_program_of_its_own() -> None:
    @jax.jit
    def which(x: Array) -> Array:
        return by_target(x, cpu=lambda x: x, default=lambda x: x + 3)

    assert which(jnp.float32(0)) == 0
    with lowering_for("gpu"):
        assert which(jnp.float32(0)) == 3
    assert which(jnp.float32(0)) == 0


def test_a_batch_is_computed_by_its_own_rule() -> None:
    rule = with_batch_rule(lambda a, b: a + b, lambda a, b: 10 * (a + b))
    assert rule(jnp.float32(1), jnp.float32(2)) == 3
    found = jax.vmap(rule, (0, None))(jnp.arange(3.0), jnp.float32(1))
    np.testing.assert_array_equal(found, [10, 20, 30])
