from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int32

from maxjax.core.batching import settle
from maxjax.core.lowering import materialise, maximum


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Walker:
    position: Float[Array, "2"]
    turns: Int32[Array, ""]


def walk(target: Float[Array, "2"], stride: Float[Array, ""], start: Float[Array, "2"], parts: int) -> Walker:
    """Towards the target by one stride a turn: as many turns as it is far."""

    def going(data: tuple[Array, Array], walker: Walker) -> Array:
        return jnp.max(jnp.abs(data[0] - walker.position)) > 0

    def step(data: tuple[Array, Array], walker: Walker) -> Walker:
        target, stride = data
        move = jnp.clip(target - walker.position, -stride, stride)
        return Walker(walker.position + move, walker.turns + 1)

    return settle(going, step, (target, stride), Walker(start, jnp.int32(0)), parts=parts)


@pytest.mark.parametrize("parts", [1, 8, 64])
@pytest.mark.parametrize("shared", [False, True])
def test_every_member_gets_what_it_gets_alone(parts: int, shared: bool) -> None:
    targets = jnp.asarray(np.random.default_rng(0).integers(-9, 9, (37, 2)), jnp.float32).at[5].set(0.0)
    targets = targets.at[36].set(jnp.array([40.0, 2.0]))  # the last one fills up incomplete parts
    strides = jnp.float32(1) if shared else 1 + jnp.arange(37, dtype=jnp.float32) % 3
    start = jnp.zeros(2)
    axes = (0, None if shared else 0, None)
    batch = jax.jit(jax.vmap(lambda t, s, x: walk(t, s, x, parts), axes))(targets, strides, start)
    for k, target in enumerate(targets):
        alone = walk(target, strides if shared else strides[k], start, parts)
        expected = np.ceil(np.abs(target).max() / (1 if shared else strides[k]))
        np.testing.assert_array_equal(batch.position[k], target)
        assert int(alone.turns) == int(batch.turns[k]) == expected


def test_nested_batches() -> None:
    targets = jnp.arange(24, dtype=jnp.float32).reshape(3, 4, 2)
    nested = jax.vmap(jax.vmap(lambda t: walk(t, jnp.float32(2), jnp.zeros(2), 1)))(targets)
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
