"""A map of voxels as a world to fly in, before brute force over its voxels."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid
from maxjax.core.voxel_map import VoxelMap
from maxjax.sim.worlds.geoms import PLANE
from maxjax.sim.worlds.raycast import cast_rays
from maxjax.sim.worlds.solid_distance import distance
from maxjax.sim.worlds.voxel_boxes import box_rows, cover
from maxjax.sim.worlds.voxel_city import REACH, VoxelCity

EDGE = 2.0
EVERYWHERE = np.ones((30, 24), bool)


def town(seed: int = 0, *, hill: bool = False) -> VoxelMap:
    """Towers on ground of two layers, with a hill of two more, in national coordinates."""
    rng = np.random.default_rng(seed)
    occupied, ground = np.zeros((30, 24, 16), bool), np.zeros((30, 24, 16), bool)
    ground[:, :, :2] = True
    if hill:
        ground[18:, :, 2:4] = True
    for x, y, dx, dy, top in zip(
        *rng.integers([[0], [0], [1], [1], [3]], [[28], [22], [6], [5], [15]], (5, 9)), strict=True
    ):
        occupied[x : x + dx, y : y + dy, :top] = True
    occupied[4:9, 4:7, 9:11] = True  # a bridge
    return VoxelMap.of(occupied | ground, spacing=EDGE, origin=(80_001.0, 450_001.0, -5.0), ground=ground & ~occupied)


def cubes(city: VoxelCity) -> Float[np.ndarray, "n 3"]:
    """Middles of the occupied voxels, the layer below z = 0 included [m]."""
    return np.array(city.grid.origin) + EDGE * np.argwhere(np.asarray(city.voxels.occupied))


def gaps(points: Float[np.ndarray, "n 3"], middles: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " n"]:
    """Distances of points to the nearest of some voxels [m]."""
    beyond = np.maximum(np.abs(points[:, None] - middles) - 0.5 * EDGE, 0.0)
    return np.asarray(np.linalg.norm(beyond, axis=-1).min(axis=1))


def ways_to(
    place: Float[np.ndarray, " 3"], ways: Float[np.ndarray, "n 3"], middles: Float[np.ndarray, "m 3"]
) -> Float[np.ndarray, " n"]:
    """How far rays from a free place go until they enter a voxel, by slabs of each one [m]; infinite where none."""
    with np.errstate(divide="ignore"):
        sides = (middles - place + 0.5 * EDGE * np.array([-1.0, 1.0])[:, None, None]) / ways[:, None, None]
    enters, leaves = (
        np.minimum(*np.moveaxis(sides, 1, 0)).max(axis=-1),
        np.maximum(*np.moveaxis(sides, 1, 0)).min(axis=-1),
    )
    return np.asarray(np.where((enters <= leaves) & (enters > 0.0), enters, np.inf).min(axis=1))


@pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 0.95, 1.0])
def test_boxes_cover_what_is_occupied_and_nothing_else(share: float) -> None:
    occupied = np.random.default_rng(1).random((9, 8, 7)) < share
    covered: Bool[np.ndarray, "nx ny nz"] = np.zeros_like(occupied)
    for x, y, z, u, v, w in cover(occupied):
        covered[x:u, y:v, z:w] = True
    np.testing.assert_array_equal(covered, occupied)


def test_a_tower_on_a_podium_is_two_boxes_and_a_bridge_one_more() -> None:
    occupied = np.zeros((12, 12, 9), bool)
    occupied[2:8, 2:8, :3] = occupied[3:5, 3:5, :9] = occupied[:, 10, 6] = True
    rows = box_rows(occupied, Grid((12, 12, 9), 0.5, (0.25, 0.25, 0.25)))
    found = {tuple(row) for row in np.round(rows, 6).tolist()}
    assert found == {
        (2.5, 2.5, 1.5, 1.5, 0.0, 1.5, 0.0),
        (2.0, 2.0, 0.5, 0.5, 0.0, 4.5, 0.0),
        (3.0, 5.25, 3.0, 0.25, 3.0, 3.5, 0.0),
    }


@pytest.mark.parametrize("hill", [False, True])
def test_distances_and_rays_are_those_to_the_voxels(hill: bool) -> None:
    given = town(hill=hill)
    city = VoxelCity.of(given, EVERYWHERE)
    assert city.origin == (80_030.0, 450_024.0, -2.0)
    middles, rng = cubes(city), np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-29, 29, 400), rng.uniform(-23, 23, 400), rng.uniform(0.1, 35, 400)])
    points = points[gaps(points, middles) > 1e-3]
    geoms = city.solids(points[0], points[0], 512)
    assert len(points) > 200
    assert geoms.type[0] == PLANE
    found = jax.vmap(distance, (None, 0))(geoms, jnp.asarray(points, jnp.float32))
    np.testing.assert_allclose(found, gaps(points, middles), atol=2e-4)

    way = rng.normal(size=(200, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    hit = np.asarray(cast_rays(geoms, jnp.asarray(points[0], jnp.float32), jnp.asarray(way, jnp.float32)), np.float64)
    # Beyond the voxels the plane goes on.
    below = np.where(way[:, 2] < 0.0, -points[0, 2] / np.minimum(way[:, 2], -1e-9), np.inf)
    np.testing.assert_allclose(hit, np.minimum(ways_to(points[0], way, middles), below), atol=1e-3)


def test_the_plane_lies_where_the_lowest_ground_within_the_data_ends() -> None:
    given = town(hill=True)
    within = EVERYWHERE.copy()
    within[:18] = False
    city = VoxelCity.of(given, within)
    assert city.origin[2] == 2.0
    assert city.tells_ground
    assert city.ground_top.max() == 0.0
    city = VoxelCity.of(given, EVERYWHERE)
    assert city.origin[2] == -2.0
    assert set(np.unique(city.ground_top)) == {0.0, 4.0}
    assert city.ground_at(np.array([25.0, 10.0, 7.0])) in (0.0, 4.0)
    assert city.ground_at(np.array([900.0, 10.0, 7.0])) == 0.0


def test_without_ground_the_plane_lies_below_the_lowest_voxel() -> None:
    occupied = np.zeros((8, 8, 9), bool)
    occupied[3:5, 3:5, 4:6] = True
    city = VoxelCity.of(VoxelMap.of(occupied, spacing=0.5, origin=(0.25, 0.25, 0.25)), np.ones((8, 8), bool))
    assert not city.tells_ground
    assert city.origin == (2.0, 2.0, 2.0)
    np.testing.assert_allclose(city.boxes, [[0.0, 0.0, 0.5, 0.5, 0.0, 1.0, 0.0]])
    empty = VoxelCity.of(
        VoxelMap.of(np.zeros((8, 8, 9), bool), spacing=0.5, origin=(0.25, 0.25, 0.25)), np.ones((8, 8), bool)
    )
    assert len(empty.boxes) == 0
    assert empty.columns_beside(1.0, 2.0).all()


def test_columns_beside_are_clear_of_every_column_in_which_something_stands() -> None:
    city = VoxelCity.of(town(hill=True), EVERYWHERE)
    occupied, ground = np.asarray(city.voxels.occupied), np.asarray(city.voxels.ground)
    stands = np.zeros(EVERYWHERE.shape, bool)
    for x, y in np.ndindex(*stands.shape):
        top = np.flatnonzero(ground[x, y])[-1]
        stands[x, y] = (occupied & ~ground)[x, y, top:].any()
    places = np.argwhere(stands)
    for least, most in ((3.0, 9.0), (6.5, 100.0)):
        found = city.columns_beside(least, most)
        for place in np.ndindex(*stands.shape):
            apart = np.abs(places - place)
            gap = EDGE * np.linalg.norm(np.maximum(apart - 1, 0), axis=1).min()
            assert found[place] == (gap >= least and EDGE * np.linalg.norm(apart, axis=1).min() <= most)


def test_no_place_has_more_boxes_around_it_than_slots() -> None:
    rng = np.random.default_rng(3)
    occupied = np.zeros((400, 300, 3), bool)
    occupied[..., :2] = rng.random((400, 300, 1)) < 0.1
    occupied[:60, :60] = False
    city = VoxelCity.of(VoxelMap.of(occupied, spacing=EDGE, origin=(1.0, 1.0, 1.0)), np.ones((400, 300), bool))
    slots, apart = city.slots_within(40.0), 40.0
    most = 0
    for _ in range(300):
        start = rng.uniform(city.grid.lower, city.grid.upper)
        turn = rng.uniform(0.0, 2.0 * np.pi)
        goal = start + 2.0 * apart * np.array([np.cos(turn), np.sin(turn), 0.0])
        if (np.abs(0.5 * (start + goal))[:2] > np.array(city.grid.upper[:2])).any():
            continue
        low, high = np.minimum(start, goal)[:2] - REACH, np.maximum(start, goal)[:2] + REACH
        here = city.solids(start, goal, slots)
        used = int((np.asarray(here.position)[1:, 2] > 0.0).sum())
        most = max(most, used)
        reaching = sum(
            x + a > low[0] and x - a < high[0] and y + b > low[1] and y - b < high[1]
            for x, y, a, b in city.boxes[:, :4]
        )
        assert used == reaching <= slots
    assert slots < 2.5 * most
    assert slots.bit_count() <= 2
    with pytest.raises(ValueError, match="slots: expected at least"):
        city.solids(np.zeros(3), np.zeros(3), 512)
