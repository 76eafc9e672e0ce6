"""Lines of sight against exact rational arithmetic: what is called clear is clear, and little else is refused."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from references import touched

from maxjax import Grid
from maxjax.core.lowering import lowered_for
from maxjax.planning.contacts import touched_voxels
from maxjax.planning.sight import TOUCH, clear, span_codes, stands_free, visibility

SHAPE = (5, 6, 4)
see = jax.jit(jax.vmap(clear, in_axes=(None, 0, 0)))
bits_of = jax.jit(span_codes)
stand = jax.jit(jax.vmap(stands_free, in_axes=(None, 0)))


def meets_wall(blocked: np.ndarray, a: np.ndarray, b: np.ndarray, grown: float) -> bool:
    """Whether the segment (index coordinates) meets a blocked voxel, those around the grid included."""
    padded = np.pad(blocked, 1, constant_values=True)
    # Voxel i is [i, i + 1] for the oracle, and the padding shifts it by one more.
    found = touched(np.asarray(a, float) + 1.5, np.asarray(b, float) + 1.5, padded.shape, grown)
    return any(padded[v] for v in found)


def segments(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    a, b = rng.uniform(-0.6, np.array(SHAPE) - 0.4, (2, count, 3))
    # Every third runs between quarters: along faces and edges and through corners.
    a[::3], b[::3] = np.round(4 * a[::3]) / 4, np.round(4 * b[::3]) / 4
    b[::7] = a[::7]
    b[1::5, 0] = a[1::5, 0]
    return a.astype(np.float32), b.astype(np.float32)


def test_clear_is_never_wrong_and_never_wary_by_more_than_half_a_voxel() -> None:
    rng = np.random.default_rng(1)
    seen = 0
    for density in (0.0, 0.1, 0.3):
        blocked = rng.random(SHAPE) < density
        a, b = segments(rng, 60)
        for start, end, free in zip(a, b, np.asarray(see(bits_of(blocked), a, b)), strict=True):
            seen += free
            if free:
                assert not meets_wall(blocked, start, end, 0.0)
            else:
                # The span of a slab half a voxel thick holds no voxel further away than that.
                assert meets_wall(blocked, start, end, 0.5 + 2 * TOUCH)
    assert 30 < seen < 150


def test_clear_is_exact_in_a_plane_of_the_grid() -> None:
    """With one other coordinate in motion no slab holds a voxel too many."""
    rng = np.random.default_rng(2)
    blocked = rng.random(SHAPE) < 0.15
    a, b = segments(rng, 120)
    for k in range(120):
        b[k, k % 3] = a[k, k % 3]
    for start, end, free in zip(a, b, np.asarray(see(bits_of(blocked), a, b)), strict=True):
        assert not (free and meets_wall(blocked, start, end, 0.0))
        assert free or meets_wall(blocked, start, end, 2 * TOUCH)


def test_does_not_see_through_closed_corners() -> None:
    blocked = np.zeros(SHAPE, bool)
    blocked[1, 2, 0] = blocked[2, 1, 0] = True
    ends = np.array([[[1, 1, 0], [2, 2, 0]], [[0, 0, 0], [3, 3, 0]], [[1, 1, 1], [2, 2, 1]]], np.float32)
    assert see(bits_of(blocked), ends[:, 0], ends[:, 1]).tolist() == [False, False, True]


def test_is_symmetric_and_jit_equals_eager() -> None:
    rng = np.random.default_rng(3)
    bits = bits_of(rng.random(SHAPE) < 0.15)
    a, b = segments(rng, 200)
    forth, back = np.asarray(see(bits, a, b)), np.asarray(see(bits, b, a))
    # Rounding may differ by direction, but only within the tolerance of a face.
    assert (forth != back).mean() < 0.02
    for k in range(5):
        assert clear(bits, jnp.asarray(a[k]), jnp.asarray(b[k])) == forth[k]


def test_segments_longer_than_the_slabs_are_not_clear() -> None:
    bits = bits_of(np.zeros(SHAPE, bool))
    a, b = jnp.asarray([0.0, 0, 0]), jnp.asarray([0.0, 5, 0])
    assert clear(bits, a, b)
    assert clear(bits, a, b, slabs=6)
    assert not clear(bits, a, b, slabs=5)


def test_accelerators_see_the_same() -> None:
    """Where few half slabs are looked up one by one."""
    rng = np.random.default_rng(7)
    bits = bits_of(rng.random(SHAPE) < 0.1)
    a, b = segments(rng, 200)
    together = np.asarray(clear(bits, jnp.asarray(a), jnp.asarray(b), slabs=4))
    with lowered_for("gpu"):
        one_by_one = np.asarray(clear(bits, jnp.asarray(a), jnp.asarray(b), slabs=4))
    np.testing.assert_array_equal(one_by_one, together)
    assert 20 < one_by_one.sum() < 180


def test_long_segments_on_real_maps_agree_with_the_judge(data: Path) -> None:
    with np.load(data / "warframe" / "crop101_Complex.npz") as crop:
        blocked = crop["occupancy"]
    rng = np.random.default_rng(4)
    free = np.argwhere(~blocked)
    a = free[rng.integers(len(free), size=1500)]
    b = np.clip(a + rng.integers(-40, 41, a.shape), 0, 100) + rng.uniform(-0.4, 0.4, a.shape)
    a, b = a.astype(np.float32), b.astype(np.float32)
    seen = np.asarray(see(bits_of(blocked), a, b))
    grid = Grid(blocked.shape, 1.0, (0.0, 0.0, 0.0))  # type: ignore[arg-type]
    hits = np.array([blocked[tuple(touched_voxels(*ends, grid).T)].any() for ends in zip(a, b, strict=True)])
    assert not (seen & hits).any()
    assert (seen == ~hits).mean() > 0.97
    assert seen.sum() > 100


def test_visibility_is_the_upper_triangle() -> None:
    rng = np.random.default_rng(5)
    bits = bits_of(rng.random(SHAPE) < 0.1)
    points = rng.uniform(0, np.array(SHAPE) - 1, (7, 3)).astype(np.float32)
    given = np.asarray(visibility(bits, jnp.asarray(points)))
    pairs = np.triu_indices(7, 1)
    np.testing.assert_array_equal(given[pairs], see(bits, points[pairs[0]], points[pairs[1]]))
    assert not np.tril(given).any()


def test_stands_free_touches_what_a_point_touches() -> None:
    rng = np.random.default_rng(6)
    blocked = rng.random(SHAPE) < 0.3
    points, _ = segments(rng, 150)
    points = np.concatenate([points, np.float32([[np.nan, 1, 1], [np.inf, 1, 1], [1e9, 1, 1], [-0.5, 1, 1]])])
    given = np.asarray(stand(blocked, points))
    for point, free in zip(points[:150], given, strict=False):
        assert not (free and meets_wall(blocked, point, point, 0.0))
        assert free or meets_wall(blocked, point, point, 2 * TOUCH)
    assert not given[150:].any()
