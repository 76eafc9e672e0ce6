"""Exact occupancy against dense sampling and against C MuJoCo's distances between geoms and voxel cubes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from jax import numpy as jnp
from scipy.spatial.transform import Rotation

from maxjax import Grid
from maxjax.sim.worlds.geoms import BOX, CAPSULE, ELLIPSOID, PLANE, SPHERE, Geoms
from maxjax.sim.worlds.scenes import MAPS, make_scene, occupancy, scene_xml

FULL = Grid((101, 101, 101), 2.0, (-100.0, -100.0, -40.0))


def one_geom(geom_type: int, position: np.ndarray, rotation: np.ndarray, size: np.ndarray) -> Geoms:
    return Geoms(
        jnp.asarray(position, jnp.float32)[None],
        jnp.asarray(rotation, jnp.float32)[None],
        jnp.asarray(size, jnp.float32)[None],
        (geom_type,),
    )


def inside(geoms: Geoms, i: int, points: np.ndarray) -> np.ndarray:
    """Whether points (..., 3) lie in the interior of geom i."""
    local = (points - np.asarray(geoms.position[i], float)) @ np.asarray(geoms.rotation[i], float)
    size = np.asarray(geoms.size[i], float)
    if geoms.type[i] == PLANE:
        return local[..., 2] < 0.0
    if geoms.type[i] == BOX:
        return np.all(np.abs(local) < size, axis=-1)
    if geoms.type[i] == ELLIPSOID:
        return np.sum((local / size) ** 2, axis=-1) < 1.0
    half = size[1] if geoms.type[i] == CAPSULE else 0.0
    axial = np.clip(local[..., 2], -half, half)
    radial = local - np.stack([np.zeros_like(axial), np.zeros_like(axial), axial], -1)
    return np.linalg.norm(radial, axis=-1) < size[0]


def bounding_half(geoms: Geoms, i: int) -> np.ndarray:
    size = np.asarray(geoms.size[i], float)
    if geoms.type[i] == CAPSULE:
        return np.array([size[0], size[0], size[0] + size[1]])
    return np.full(3, size[0]) if geoms.type[i] == SPHERE else size


class VoxelOracle:
    """C MuJoCo's signed distance between every geom and one movable cube."""

    def __init__(self, geoms: Geoms, spacing: float) -> None:
        half = spacing / 2
        cube = f'<body mocap="true"><geom type="box" size="{half} {half} {half}"/></body>'
        xml = scene_xml(geoms).replace("</worldbody>", cube + "</worldbody>")
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.model.opt.ccd_tolerance = 1e-9
        self.model.opt.ccd_iterations = 500
        self.data = mujoco.MjData(self.model)
        self.types = geoms.type

    def least_distance(self, center: np.ndarray) -> float:
        self.data.mocap_pos[0] = center
        mujoco.mj_kinematics(self.model, self.data)
        cube = self.model.ngeom - 1
        gaps = np.linalg.norm(self.data.geom_xpos - center, axis=1) - self.model.geom_rbound - 2.0
        near = [g for g in range(cube) if self.types[g] == PLANE or gaps[g] <= 0.0]
        distances = [mujoco.mj_geomDistance(self.model, self.data, g, cube, 5.0, None) for g in near]
        return min(distances, default=5.0)


@pytest.mark.parametrize("name", MAPS)
def test_no_interior_point_lies_in_an_unoccupied_voxel(name: str) -> None:
    rng = np.random.default_rng(0)
    for seed in range(2):
        geoms = make_scene(name, seed).geoms
        occupied, _ = occupancy(geoms, FULL)
        for i in range(1, len(geoms.type)):
            local = rng.uniform(-1.0, 1.0, (2000, 3)) * bounding_half(geoms, i)
            points = np.asarray(geoms.position[i], float) + local @ np.asarray(geoms.rotation[i], float).T
            points = points[inside(geoms, i, points)]
            index = np.floor((points - FULL.origin) / FULL.spacing + 0.5).astype(int)
            index = index[np.all((index >= 0) & (index < FULL.shape), axis=1)]
            assert np.all(occupied[tuple(index.T)])


@pytest.mark.large
@pytest.mark.parametrize("name", MAPS)
def test_occupied_voxels_are_confirmed_by_sampling_or_by_mujoco(name: str) -> None:
    """Sampling finds most of them; the slivers that it misses, and the free ones, are judged by C MuJoCo."""
    rng = np.random.default_rng(1)
    geoms = make_scene(name, 5).geoms
    occupied, ground = occupancy(geoms, FULL)
    oracle = VoxelOracle(geoms, FULL.spacing)
    solid = np.argwhere(occupied & ~ground)
    solid = solid[rng.choice(len(solid), 400, replace=False)]
    ticks = (np.arange(8) + 0.5) / 8 - 0.5
    offsets = FULL.spacing * np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1).reshape(-1, 3)
    centers = np.asarray(FULL.origin) + FULL.spacing * solid
    points = centers[:, None] + offsets
    confirmed = np.any([np.any(inside(geoms, i, points), axis=1) for i in range(1, len(geoms.type))], axis=0)
    assert confirmed.mean() > 0.9
    assert all(oracle.least_distance(center) < 1e-5 for center in centers[~confirmed])

    # Free voxels beside solids, where a rasteriser errs.
    beside = np.zeros_like(occupied)
    beside[1:-1, 1:-1, 1:-1] = np.any(
        [np.roll(occupied, s, a)[1:-1, 1:-1, 1:-1] for a in range(3) for s in (-1, 1)], axis=0
    )
    free = np.argwhere(beside & ~occupied)
    free = free[rng.choice(len(free), 400, replace=False)]
    assert all(oracle.least_distance(c) > -1e-5 for c in np.asarray(FULL.origin) + FULL.spacing * free)


@pytest.mark.parametrize("geom_type", [BOX, ELLIPSOID, CAPSULE, SPHERE])
def test_every_voxel_of_a_turned_solid_agrees_with_mujoco(geom_type: int) -> None:
    rng = np.random.default_rng(geom_type)
    grid = Grid((9, 9, 9), 0.8, (-3.2, -3.2, -3.2))
    centers = np.asarray(grid.origin) + grid.spacing * np.indices(grid.shape).reshape(3, -1).T
    for rotation in [np.eye(3), *Rotation.random(3, rng).as_matrix()]:
        geoms = one_geom(geom_type, rng.uniform(-0.5, 0.5, 3), rotation, rng.uniform(0.3, 2.0, 3))
        occupied, ground = occupancy(geoms, grid)
        oracle = VoxelOracle(geoms, grid.spacing)
        distance = np.array([oracle.least_distance(center) for center in centers]).reshape(grid.shape)
        assert np.all(occupied[distance < -1e-5])
        assert not np.any(occupied[distance > 1e-5])
        assert np.mean(np.abs(distance) <= 1e-5) < 0.02
        assert not np.any(ground)


def test_touching_does_not_count() -> None:
    grid = Grid((5, 5, 5), 2.0, (0.0, 0.0, 0.0))
    box = one_geom(BOX, np.array([4.0, 4.0, 4.0]), np.eye(3), np.array([1.0, 3.0, 1.0]))
    occupied, _ = occupancy(box, grid)
    expected = np.zeros(grid.shape, bool)
    expected[2, 1:4, 2] = True
    assert np.array_equal(occupied, expected)
    # A face diagonal exactly through cube edges: only the cubes whose inside it cuts.
    turned = one_geom(
        BOX,
        np.array([4.0, 4.0, 4.0]),
        Rotation.from_euler("z", 45, degrees=True).as_matrix(),
        np.array([np.sqrt(2.0) * (1.0 - 1e-6), np.sqrt(2.0) * (1.0 - 1e-6), 1.0]),
    )
    expected = np.zeros(grid.shape, bool)
    expected[1:4, 2, 2] = expected[2, 1:4, 2] = True
    assert np.array_equal(occupancy(turned, grid)[0], expected)


def test_ground_is_what_dips_below_zero() -> None:
    plane = Geoms(jnp.zeros((1, 3)), jnp.eye(3)[None], jnp.array([[0.0, 0.0, 1.0]]), (PLANE,))
    for z0, lowest_free in ((-4.0, 3), (-3.0, 2), (-3.5, 3)):
        occupied, ground = occupancy(plane, Grid((2, 2, 6), 2.0, (0.0, 0.0, z0)))
        assert np.array_equal(occupied, ground)
        assert np.array_equal(ground[0, 0], np.arange(6) < lowest_free)


def test_solids_outside_the_grid_leave_it_free() -> None:
    box = one_geom(BOX, np.array([50.0, 0.0, 0.0]), np.eye(3), np.ones(3))
    assert not np.any(occupancy(box, Grid((5, 5, 5), 1.0, (0.0, 0.0, 0.0)))[0])
