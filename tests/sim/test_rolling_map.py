"""The rolling map: frames, evidence, free space against ray marching in truth, and safety under disturbed scans."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maxjax import Grid
from maxjax.sim.mapping.rolling_map import RollingMap, empty, fuse_scan, ground, occupied_voxels, origin, recentre, seen
from maxjax.sim.sensors.lidar import Lidar, Scan, directions, scan
from maxjax.sim.sensors.range_image import arctan2
from maxjax.sim.worlds.geoms import BOX, CAPSULE, Geoms, concatenate, ground_plane
from maxjax.sim.worlds.raycast import cast_rays
from maxjax.sim.worlds.scenes import occupancy

SHAPE = (41, 41, 21)
CLEAN = Lidar(range_noise=0.0, dropout=0.0)
KEY = jax.random.key(0)
LEVEL = jnp.eye(3)

jit_scan = jax.jit(scan)
jit_fuse = jax.jit(fuse_scan, static_argnames="snapshot")
jit_recentre = jax.jit(recentre)


def street() -> Geoms:
    """Ground, a wall along x at y = 8 to 10 m, a block in front, and a lamp post of 12 cm radius."""
    boxes = Geoms(
        jnp.array([[0.0, 9.0, 6.0], [26.3, -5.1, 5.0]]),
        jnp.broadcast_to(jnp.eye(3), (2, 3, 3)),
        jnp.array([[60.0, 1.0, 6.0], [3.0, 4.0, 5.0]]),
        (BOX, BOX),
    )
    pole = Geoms(jnp.array([[9.2, -6.3, 4.0]]), jnp.eye(3)[None], jnp.array([[0.12, 4.0, 0.0]]), (CAPSULE,))
    return concatenate([ground_plane(), boxes, pole])


STREET = street()


def grid_of(rolling_map: RollingMap) -> Grid:
    x, y, z = (float(c) for c in origin(rolling_map))
    return Grid(rolling_map.cells.shape, rolling_map.spacing, (x, y, z))


def voxel_at(rolling_map: RollingMap, *point: float) -> tuple[int, ...]:
    return tuple(int(i) for i in np.floor((np.array(point) - np.asarray(origin(rolling_map))) / 2.0 + 0.5))


def lost(result: Scan, kept: np.ndarray) -> Scan:
    """The scan with the returns outside `kept` lost."""
    hit = jnp.asarray(kept) & result.hit
    return Scan(jnp.where(hit[:, None], result.points, jnp.nan), jnp.where(hit, result.distance, jnp.inf), hit)


def hand_scan(distance: np.ndarray, lidar: Lidar = CLEAN) -> Scan:
    """A scan with the ranges given (infinity: lost), level sensor at the origin."""
    d = jnp.asarray(distance, jnp.float32)
    hit = jnp.isfinite(d)
    return Scan(jnp.where(hit[:, None], d[:, None] * directions(lidar), jnp.nan), d, hit)


def test_lattice_recentring_and_forgetting() -> None:
    """Against NumPy: a voxel keeps its world place as long as the map holds it."""
    rng = np.random.default_rng(0)
    rolling_map = empty(jnp.array([0.9, -1.1, 13.0]), (9, 7, 5))
    assert np.array_equal(rolling_map.corner, [0 - 4, -1 - 3, 7 - 2])
    np.testing.assert_allclose(origin(rolling_map), [-8.0, -8.0, 10.0])
    cells = rng.integers(0, 7, (9, 7, 5)).astype(np.uint8)
    rolling_map = dataclasses.replace(rolling_map, cells=jnp.asarray(cells))
    world = {tuple(i + np.asarray(rolling_map.corner)): cells[tuple(i)] for i in np.argwhere(cells >= 0)}
    for position in ([0.9, -1.1, 13.0], [3.1, -1.1, 11.5], [-7.0, 6.0, 13.0], [1e4, 0.0, 0.0]):
        moved = jit_recentre(rolling_map, jnp.array(position))
        middle = np.floor(np.array(position) / 2.0 + 0.5)
        assert np.array_equal(moved.corner, middle - [4, 3, 2])
        expected = [world.get(tuple(i + np.asarray(moved.corner)), 0) for i in np.argwhere(np.ones(cells.shape, bool))]
        assert np.array_equal(np.asarray(moved.cells).ravel(), expected)
    still = jit_recentre(rolling_map, jnp.array([jnp.nan, 0.0, 0.0]))
    assert np.array_equal(still.cells, cells)
    assert np.array_equal(still.corner, rolling_map.corner)


def test_a_goal_that_the_map_holds_stays_in_it_and_so_does_the_vehicle() -> None:
    """Away from the goal the map lags behind, by up to half its reach; one that it never held it does not wait for."""
    half = np.array([10, 8, 6])
    rolling_map, goal = empty(jnp.zeros(3), (21, 17, 13)), jnp.array([12.0, -9.0, 4.0])

    def indices(moved: RollingMap, point: object) -> np.ndarray:
        index: np.ndarray = np.floor(np.asarray(point) / 2.0 + 0.5) - np.asarray(moved.corner)
        return index

    def inside(index: np.ndarray) -> bool:
        return bool(np.all((index >= 0) & (index <= 2 * half)))

    for away in np.random.default_rng(1).uniform(-1.4, 1.4, (200, 3)):
        at = np.asarray(goal) + 2.0 * half * away
        moved = jit_recentre(rolling_map, jnp.asarray(at), goal)
        assert inside(indices(moved, goal))
        assert inside(indices(moved, at))
        near = np.abs(indices(rolling_map, at) - indices(rolling_map, goal)) <= half
        assert np.array_equal(indices(moved, at)[near], half[near])
    for far, kept in (
        ([60.0, -9.0, 4.0], goal),
        ([3.0, 2.0, 1.0], jnp.array([40.0, 0.0, 0.0])),
        ([0.0] * 3, goal * jnp.nan),
    ):
        moved = jit_recentre(rolling_map, jnp.array(far), kept)
        assert inside(indices(moved, far))
        assert inside(indices(moved, kept)) is False
    assert np.array_equal(indices(moved, [0.0] * 3), half)


def test_hits_land_in_the_voxels_of_their_points() -> None:
    """From the pose given, not from the scan's own world points: with drift, at the estimated position."""
    position = jnp.array([2.0, 1.0, 5.0])
    turn = jnp.asarray(Rotation.from_euler("zyx", [130.0, 8.0, -11.0], degrees=True).as_matrix(), jnp.float32)
    result = jit_scan(STREET, CLEAN, position, turn, KEY)
    for drift in (0.0, 0.7):
        estimated = position + drift
        rolling_map = jit_fuse(empty(estimated, SHAPE), result, CLEAN, estimated, turn)
        points = np.asarray(result.points, float)[np.asarray(result.hit)] + drift
        index = np.floor((points - np.asarray(origin(rolling_map), float)) / 2.0 + 0.5).astype(int)
        inside = np.all((index >= 0) & (index < SHAPE), axis=1)
        # Points within rounding of a face may fall to either side.
        clear = np.all(np.abs((points / 2.0 + 0.5) % 1.0 - 0.5) < 0.499, axis=1)
        mine = np.zeros(SHAPE, bool)
        mine[tuple(index[inside].T)] = True
        sure = np.zeros(SHAPE, bool)
        sure[tuple(index[inside & clear].T)] = True
        given = np.asarray(occupied_voxels(rolling_map))
        assert np.all(given[sure])
        assert np.sum(given & ~mine) <= 30
        assert not np.any(given & np.asarray(seen(rolling_map)))


def test_seen_voxels_lie_in_sight_and_hold_nothing() -> None:
    """Oracle: rays from the sensor to points inside each voxel, cast through the true scene."""
    position = jnp.array([0.0, -2.0, 6.0])
    rolling_map = jit_fuse(
        empty(position, SHAPE), jit_scan(STREET, CLEAN, position, LEVEL, KEY), CLEAN, position, LEVEL
    )
    free = np.asarray(seen(rolling_map))
    truth, _ = occupancy(STREET, grid_of(rolling_map))
    assert not np.any(free & truth)
    rng = np.random.default_rng(1)
    index = np.argwhere(free)
    index = index[rng.choice(len(index), 1500, replace=False)]
    points = np.asarray(origin(rolling_map)) + 2.0 * (index + rng.uniform(-0.5, 0.5, index.shape))
    ray = points - np.asarray(position)
    length = np.linalg.norm(ray, axis=1)
    distance = np.asarray(cast_rays(STREET, position, jnp.asarray(ray / length[:, None], jnp.float32)))
    assert np.mean(distance >= length) > 0.999

    # And most of what is in plain sight is seen: the cone of the sensor above the ground, short of the wall.
    center = np.asarray(origin(rolling_map)) + 2.0 * np.argwhere(np.ones(SHAPE, bool)) - np.asarray(position)
    distance = np.linalg.norm(center, axis=1)
    level = np.abs(np.degrees(np.arcsin(center[:, 2] / np.maximum(distance, 1.0)))) < 35.0
    near = (distance < 25.0) & level & (center[:, 2] > -5.0) & (np.abs(center[:, 1]) < 6.0) & ~truth.ravel()
    assert free.ravel()[near & (center[:, 0] < 0.0)].mean() > 0.9


def test_evidence_counts_saturates_and_fades() -> None:
    """A ghost of one hit goes after two clear looks, a lasting one after six; a hit brings it back at once."""
    ghost, clear = np.full(CLEAN.rays, 30.0), np.full(CLEAN.rays, 30.0)
    straight = np.argmax(np.asarray(directions(CLEAN))[:, 0])
    ghost[straight] = 10.0
    zero = jnp.zeros(3)
    for hits, looks in ((1, 2), (2, 4), (3, 6), (9, 6)):
        rolling_map = empty(zero, SHAPE)
        cell = tuple(np.array([5, 0, 0]) - np.asarray(rolling_map.corner))
        for _ in range(hits):
            rolling_map = jit_fuse(rolling_map, hand_scan(ghost), CLEAN, zero, LEVEL)
            assert occupied_voxels(rolling_map)[cell]
        for look in range(looks):
            assert occupied_voxels(rolling_map)[cell]
            assert not seen(rolling_map)[cell]
            rolling_map = jit_fuse(rolling_map, hand_scan(clear), CLEAN, zero, LEVEL)
            assert bool(occupied_voxels(rolling_map)[cell]) == (look < looks - 1)
        assert seen(rolling_map)[cell]
        rolling_map = jit_fuse(rolling_map, hand_scan(ghost), CLEAN, zero, LEVEL)
        assert occupied_voxels(rolling_map)[cell]
        assert not seen(rolling_map)[cell]


def test_what_did_not_return_is_clear_only_beside_returns() -> None:
    """Empty scan: no change. Sector without returns: nothing seen free. Sky above a street: free to the range."""
    zero = jnp.zeros(3)
    start = empty(zero, SHAPE)
    nothing = jit_fuse(start, hand_scan(np.full(CLEAN.rays, np.inf)), CLEAN, zero, LEVEL)
    assert not np.any(nothing.cells)
    image = np.full((64, 512), np.inf)
    image[:20] = 40.0
    image[:, 64:192] = np.inf
    rolling_map = jit_fuse(start, hand_scan(image.ravel()), CLEAN, zero, LEVEL)
    free = np.asarray(seen(rolling_map))
    x, y, z = (2.0 * np.indices(SHAPE)[a] + float(origin(rolling_map)[a]) for a in range(3))
    azimuth = np.degrees(np.arctan2(y, x)) % 360.0
    far = np.hypot(x, y) > 6.0
    empty_sector = (azimuth > 46.0) & (azimuth < 134.0) & far
    assert not free[empty_sector].any()
    open_sky = (azimuth > 160.0) & far & (z > 2.0) & (z < 0.7 * np.hypot(x, y))
    assert free[open_sky].mean() > 0.99


@pytest.mark.parametrize("disturbed", ["dropout", "noise", "sector"])
def test_disturbed_scans_never_erase_what_stands(disturbed: str) -> None:
    """Twelve poses along the street: every voxel of wall, block and lamp that was hit stays, whatever is lost."""
    lidar = {"dropout": Lidar(dropout=0.5), "noise": Lidar(range_noise=0.2)}.get(disturbed, CLEAN)
    rng = np.random.default_rng(5)
    rolling_map = empty(jnp.array([-12.0, 0.0, 5.0]), SHAPE)
    met: set[tuple[int, ...]] = set()
    for step in range(12):
        position = jnp.array([-12.0 + 2.0 * step, 0.0, 5.0])
        turn = Rotation.from_euler("zyx", [rng.uniform(0, 360), *rng.normal(0, 8, 2)], degrees=True).as_matrix()
        rotation = jnp.asarray(turn, jnp.float32)
        result = jit_scan(STREET, lidar, position, rotation, jax.random.key(step))
        if disturbed == "sector":
            dead = (rng.integers(512) + np.arange(128)) % 512
            kept = np.ones((64, 512), bool)
            kept[:, dead] = False
            result = lost(result, kept.ravel())
        rolling_map = jit_fuse(jit_recentre(rolling_map, position), result, lidar, position, rotation)
        truth, _ = occupancy(STREET, grid_of(rolling_map))
        hit = np.asarray(result.points)[np.asarray(result.hit)]
        index = np.unique(np.floor(hit / 2.0 + 0.5).astype(int), axis=0) - np.asarray(rolling_map.corner)
        index = index[np.all((index >= 0) & (index < SHAPE), axis=1)]
        met |= {tuple(i) for i in index + np.asarray(rolling_map.corner)}
        # The map moves on along x: what has left it does not come back.
        index = np.array(sorted(met)) - np.asarray(rolling_map.corner)
        index = index[index[:, 0] >= 0]
        index = index[truth[tuple(index.T)]]
        gone = ~np.asarray(occupied_voxels(rolling_map))[tuple(index.T)]
        # Returns within rounding of a face may be counted to the neighbour here and there.
        assert gone.sum() <= (3 if disturbed == "noise" else 1)
        pole = {(5, -3, k) for k in range(1, 4)} & met
        if np.linalg.norm(np.array([9.2, -6.3]) - np.asarray(position)[:2]) < 20.0:
            assert all(occupied_voxels(rolling_map)[tuple(np.array(p) - np.asarray(rolling_map.corner))] for p in pole)
        # Nothing that is solid passes for free.
        assert np.sum(np.asarray(seen(rolling_map)) & truth) <= 2
    assert len(met) > 300
    false = np.asarray(occupied_voxels(rolling_map)) & ~truth
    assert false.sum() <= (0.15 if disturbed == "noise" else 0.02) * occupied_voxels(rolling_map).sum()


def test_snapshot_knows_only_the_latest_scan() -> None:
    first, second = jnp.array([-6.0, 0.0, 5.0]), jnp.array([6.0, 0.0, 5.0])
    scans = [jit_scan(STREET, CLEAN, p, LEVEL, KEY) for p in (first, second)]
    rolling = jit_fuse(empty(first, SHAPE), scans[0], CLEAN, first, LEVEL)
    rolling = jit_recentre(rolling, second)
    snapshot = jit_fuse(rolling, scans[1], CLEAN, second, LEVEL, snapshot=True)
    fresh = jit_fuse(empty(second, SHAPE), scans[1], CLEAN, second, LEVEL)
    both = jit_fuse(rolling, scans[1], CLEAN, second, LEVEL)
    assert np.array_equal(snapshot.cells, fresh.cells)
    assert np.sum(occupied_voxels(both)) > np.sum(occupied_voxels(fresh))
    assert np.sum(seen(both)) > np.sum(seen(fresh))


def test_ground_is_the_layer_of_z_zero() -> None:
    position = jnp.array([0.0, -2.0, 6.0])
    rolling_map = jit_fuse(
        empty(position, SHAPE), jit_scan(STREET, CLEAN, position, LEVEL, KEY), CLEAN, position, LEVEL
    )
    low = np.asarray(ground(rolling_map))
    layer = -int(rolling_map.corner[2])
    assert float(origin(rolling_map)[2]) + 2.0 * layer == 0.0
    assert low[:, :, : layer + 1].all()
    assert not low[:, :, layer + 1 :].any()
    _, truth = occupancy(STREET, grid_of(rolling_map))
    assert np.array_equal(low, truth)


def test_batches_equal_the_loop_and_a_nan_touches_no_other() -> None:
    positions = jnp.array([[0.0, -2.0, 6.0], [-5.0, 1.0, 4.0], [3.0, jnp.nan, 5.0]])
    rotations = jnp.broadcast_to(LEVEL, (3, 3, 3))
    at = jnp.nan_to_num(positions)
    scans = jax.tree.map(lambda *a: jnp.stack(a), *[jit_scan(STREET, CLEAN, p, LEVEL, KEY) for p in at])
    maps = jax.vmap(functools.partial(empty, shape=SHAPE))(at)

    def step(rolling_map: RollingMap, result: Scan, position: jax.Array, rotation: jax.Array) -> RollingMap:
        return fuse_scan(recentre(rolling_map, position), result, CLEAN, position, rotation)

    batch = jax.jit(jax.vmap(step))(maps, scans, positions, rotations)
    for i in range(2):
        rolling_map, result, position, rotation = jax.tree.map(lambda a, i=i: a[i], (maps, scans, positions, rotations))
        one = jit_fuse(jit_recentre(rolling_map, position), result, CLEAN, position, rotation)
        assert np.mean(np.asarray(batch.cells[i]) != np.asarray(one.cells)) < 1e-4
        assert np.array_equal(batch.corner[i], one.corner)
    assert not np.any(batch.cells[2])
    assert batch.cells.dtype == jnp.uint8


def test_a_mover_occupies_nothing_and_hides_what_is_behind_it() -> None:
    """A block in front of the wall: with its hits taken away the map has neither it nor anything free behind it."""
    block = Geoms(jnp.array([[0.0, 4.0, 3.0]]), jnp.eye(3)[None], jnp.array([[1.5, 0.5, 1.5]]), (BOX,))
    at = jnp.array([0.0, 0.0, 3.0])
    result = jit_scan(concatenate([STREET, block]), CLEAN, at, LEVEL, KEY)
    points = np.asarray(result.points)
    on_block = (np.abs(points[:, 0]) < 1.6) & (points[:, 1] > 3.0) & (points[:, 1] < 5.0) & (points[:, 2] > 1.4)
    assert on_block.sum() > 100
    before = jit_fuse(empty(at, SHAPE), jit_scan(STREET, CLEAN, at, LEVEL, KEY), CLEAN, at, LEVEL)
    masked = dataclasses.replace(result, hit=result.hit & ~jnp.asarray(on_block))
    after = jit_fuse(before, masked, CLEAN, at, LEVEL)
    block_voxel, wall = voxel_at(before, 0.0, 4.0, 3.0), voxel_at(before, 0.0, 8.2, 3.0)
    assert occupied_voxels(jit_fuse(before, result, CLEAN, at, LEVEL))[block_voxel]
    assert not occupied_voxels(after)[block_voxel]
    assert occupied_voxels(before)[wall]
    assert after.cells[wall] == before.cells[wall]
    # Removed with their distances, they would have shown the wall behind them to be gone.
    gone = jit_fuse(before, lost(result, ~on_block), CLEAN, at, LEVEL)
    assert gone.cells[wall] % 128 < before.cells[wall] % 128


def test_a_ghost_fades_in_two_scans_of_a_map_that_forgets() -> None:
    at = jnp.array([0.0, 0.0, 3.0])
    ghost = Geoms(jnp.array([[0.0, 4.0, 3.0]]), jnp.eye(3)[None], jnp.array([[1.0, 0.3, 1.0]]), (BOX,))
    shown = jit_scan(concatenate([STREET, ghost]), CLEAN, at, LEVEL, KEY)
    clear = jit_scan(STREET, CLEAN, at, LEVEL, KEY)
    needed = {}
    for loss in (1, 3):
        rolling_map = empty(at, SHAPE, loss=loss)
        voxel = voxel_at(rolling_map, 0.0, 4.0, 3.0)
        for _ in range(4):
            rolling_map = jit_fuse(rolling_map, shown, CLEAN, at, LEVEL)
        needed[loss] = 0
        while occupied_voxels(rolling_map)[voxel]:
            rolling_map = jit_fuse(jit_recentre(rolling_map, at), clear, CLEAN, at, LEVEL)
            needed[loss] += 1
        assert seen(rolling_map)[voxel]
    assert needed == {1: 6, 3: 2}


def test_the_angle_is_good_to_a_thousandth_of_a_beam() -> None:
    rng = np.random.default_rng(6)
    x, y = rng.normal(size=(2, 20_000)) * 10.0 ** rng.uniform(-3, 3, (2, 20_000))
    x, y = np.concatenate([x, [0, 0, 1, -1]]), np.concatenate([y, [1, -1, 0, 0]])
    given = np.asarray(arctan2(jnp.asarray(y, jnp.float32), jnp.asarray(x, jnp.float32)), float)
    error = np.angle(np.exp(1j * (given - np.arctan2(y, x))))
    assert np.abs(error).max() < 1.5e-5


def test_bad_input_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(ValueError, match="three positive integers"):
        empty(jnp.zeros(3), (0, 5, 5))
    with pytest.raises(ValueError, match="spacing"):
        empty(jnp.zeros(3), SHAPE, spacing=float("nan"))
    with pytest.raises(ValueError, match="loss: expected 1 to 6, given 0"):
        empty(jnp.zeros(3), SHAPE, loss=0)
    with pytest.raises(ValueError, match="expected 32768 rays"):
        fuse_scan(
            empty(jnp.zeros(3), SHAPE), hand_scan(np.full(2048, 9.0), Lidar(32, 2048)), CLEAN, jnp.zeros(3), LEVEL
        )
