"""Lines of sight against exact rational arithmetic: what is called clear is clear, and little else is refused."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

from maxjax import Grid
from maxjax.compile.lowering import lowering_for
from maxjax.planning.path.line_of_sight import TOUCH, clear, clear_and_costs, sight_of, stands_free, visibility
from maxjax.verification.contacts import touched_voxels
from tests.references import keeps, touched

SHAPE = (5, 6, 4)
see = jax.jit(jax.vmap(clear, in_axes=(None, 0, 0)))
sights = jax.jit(sight_of, static_argnums=1)
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
        for start, end, free in zip(a, b, np.asarray(see(sights(blocked), a, b)), strict=True):
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
    for start, end, free in zip(a, b, np.asarray(see(sights(blocked), a, b)), strict=True):
        assert not (free and meets_wall(blocked, start, end, 0.0))
        assert free or meets_wall(blocked, start, end, 2 * TOUCH)


def test_does_not_see_through_closed_corners() -> None:
    blocked = np.zeros(SHAPE, bool)
    blocked[1, 2, 0] = blocked[2, 1, 0] = True
    ends = np.array([[[1, 1, 0], [2, 2, 0]], [[0, 0, 0], [3, 3, 0]], [[1, 1, 1], [2, 2, 1]]], np.float32)
    assert see(sights(blocked), ends[:, 0], ends[:, 1]).tolist() == [False, False, True]


def test_is_symmetric_and_jit_equals_eager() -> None:
    rng = np.random.default_rng(3)
    sight = sights(rng.random(SHAPE) < 0.15)
    a, b = segments(rng, 200)
    forth, back = np.asarray(see(sight, a, b)), np.asarray(see(sight, b, a))
    # Rounding may differ by direction, but only within the tolerance of a face.
    assert (forth != back).mean() < 0.02
    for k in range(5):
        assert clear(sight, jnp.asarray(a[k]), jnp.asarray(b[k])) == forth[k]


def test_segments_longer_than_the_slabs_are_not_clear() -> None:
    sight = sights(np.zeros(SHAPE, bool))
    a, b = jnp.asarray([0.0, 0, 0]), jnp.asarray([0.0, 5, 0])
    assert clear(sight, a, b)
    assert clear(sight, a, b, slabs=6)
    assert not clear(sight, a, b, slabs=5)


def test_accelerators_see_the_same() -> None:
    """Where few half slabs are looked up one by one."""
    rng = np.random.default_rng(7)
    sight = sights(rng.random(SHAPE) < 0.1)
    a, b = segments(rng, 200)
    together = np.asarray(clear(sight, jnp.asarray(a), jnp.asarray(b), slabs=4))
    with lowering_for("gpu"):
        one_by_one = np.asarray(clear(sight, jnp.asarray(a), jnp.asarray(b), slabs=4))
    np.testing.assert_array_equal(one_by_one, together)
    assert 20 < one_by_one.sum() < 180


def test_room_is_kept_and_little_else_is_refused() -> None:
    rng = np.random.default_rng(8)
    possible = seen = 0
    for density in (0.03, 0.1, 0.2):
        blocked = rng.random(SHAPE) < density
        sight = sights(blocked, 0.5)
        a, b = segments(rng, 200)
        # Every other one is short, every fifth runs between centres.
        b[::2] = a[::2] + (b[::2] - a[::2]) / 4
        a[::5], b[::5] = np.round(a[::5]), np.round(b[::5])
        for start, end, free in zip(a, b, np.asarray(see(sight, a, b)), strict=True):
            line = np.stack([start, end])
            assert keeps(line, blocked, 0.5 - 1e-3) or not free
            if keeps(line, blocked, 0.5 - 1e-9):
                possible += 1
                seen += free
                # What is refused moves along all three axes: it may cross two planes of centres in one slab.
                assert free or (start != end).all()
        points = np.concatenate([a, b])
        given = np.asarray(jax.vmap(stands_free, in_axes=(None, 0, None))(jnp.asarray(blocked), points, 0.5))
        for x, free in zip(points, given, strict=True):
            assert keeps(np.stack([x, x]), blocked, 0.5 - (2 if free else 0) * TOUCH) == free
        np.testing.assert_array_equal(see(sight, points, points), given)
    assert possible > 100
    assert seen > 0.98 * possible


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_with_room_one_passes_corridors_one_voxel_wide(axis: int) -> None:
    long = np.ones((3, 90, 3), bool)
    long[1, :, 1] = False
    sight = sights(np.moveaxis(long, 1, axis), 0.5)
    a, b = (np.insert(np.float32([1, 1]), axis, k) for k in (0, 89))
    off = np.eye(3, dtype=np.float32)[(axis + 1) % 3]
    for start, end in ((a, b), (a + 0.3 * (b - a) / 89, b), (a, a), (a + (b - a) / 178, a + (b - a) / 178)):
        assert clear(sight, jnp.asarray(start), jnp.asarray(end))
        assert not clear(sight, jnp.asarray(start), jnp.asarray(end + 2e-3 * off))
    assert not clear(sight, jnp.asarray(a), jnp.asarray(b + (b - a) / 178))  # beyond the grid


def test_with_room_diagonals_need_all_that_they_span() -> None:
    for spanned in ((1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 1, 1)):
        blocked = np.ones((5, 5, 5), bool)
        blocked[tuple(slice(1, 2 + k) for k in spanned)] = False
        one, other = jnp.ones(3), jnp.ones(3) + jnp.asarray(spanned, jnp.float32)
        assert clear(sights(blocked, 0.5), one, other)
        for at in np.argwhere(~blocked):
            again = blocked.copy()
            again[tuple(at)] = True
            assert not clear(sights(again, 0.5), one, other)


def test_rooms_are_two() -> None:
    with pytest.raises(ValueError, match=r"expected room 0 or 0\.5, given 0\.25"):
        sight_of(jnp.zeros(SHAPE, bool), 0.25)


def test_long_segments_on_real_maps_agree_with_the_judge(data: Path) -> None:
    with np.load(data / "warframe" / "crop101_Complex.npz") as crop:
        blocked = crop["occupancy"]
    rng = np.random.default_rng(4)
    free = np.argwhere(~blocked)
    a = free[rng.integers(len(free), size=1500)]
    b = np.clip(a + rng.integers(-40, 41, a.shape), 0, 100) + rng.uniform(-0.4, 0.4, a.shape)
    a, b = a.astype(np.float32), b.astype(np.float32)
    seen = np.asarray(see(sights(blocked), a, b))
    grid = Grid(blocked.shape, 1.0, (0.0, 0.0, 0.0))  # type: ignore[arg-type]
    hits = np.array([blocked[tuple(touched_voxels(*ends, grid).T)].any() for ends in zip(a, b, strict=True)])
    assert not (seen & hits).any()
    assert (seen == ~hits).mean() > 0.97
    assert seen.sum() > 100


def test_visibility_is_the_upper_triangle() -> None:
    rng = np.random.default_rng(5)
    sight = sights(rng.random(SHAPE) < 0.1)
    points = rng.uniform(0, np.array(SHAPE) - 1, (7, 3)).astype(np.float32)
    given, length = map(np.asarray, visibility(sight, jnp.asarray(points)))
    pairs = np.triu_indices(7, 1)
    np.testing.assert_array_equal(given[pairs], see(sight, points[pairs[0]], points[pairs[1]]))
    np.testing.assert_allclose(length[pairs], np.linalg.norm(points[pairs[0]] - points[pairs[1]], axis=1), rtol=1e-6)
    assert not np.tril(given).any()
    assert not np.tril(length).any()


def test_what_is_paid_is_the_integral_of_the_price() -> None:
    """Against fine sampling of the trilinear interpolation, within the bound that the module states."""
    rng = np.random.default_rng(9)
    smooth = 3 + ndimage.gaussian_filter(rng.normal(size=(20, 18, 16)), 3.0, mode="nearest") * 30
    rough = rng.uniform(1, 5, smooth.shape)
    a, b = rng.uniform(0, np.array(smooth.shape) - 1, (2, 150, 3)).astype(np.float32)
    b[::9], b[1::3] = a[::9], np.clip(a[1::3] + rng.uniform(-1, 1, (50, 3)), 0, 15)
    length = np.linalg.norm(b - a, axis=1)
    middles = (np.arange(400) + 0.5)[:, None, None] / 400
    at = np.moveaxis(a + middles * (b - a).astype(float), -1, 0)
    error = []
    for price in (smooth, rough):
        expected = length * ndimage.map_coordinates(price, at, order=1, mode="nearest").mean(0)
        sight = sights(rng.random(price.shape) < 0.02, 0.5)
        free, paid = jax.jit(clear_and_costs)(sight, price.astype(np.float32), a, b)
        np.testing.assert_array_equal(free, see(sight, a, b))
        steepest = max(np.abs(np.diff(price, axis=axis)).max() for axis in range(3))
        assert (np.abs(paid - expected) <= steepest * length + 1e-4).all()
        error.append(np.abs(paid - expected) / np.maximum(length, 1))
    assert error[0].mean() < 0.005 * smooth.mean()
    assert error[1].mean() < 0.05 * rough.mean()


@pytest.mark.large
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
