"""Scenes: fixed structure, streets that stay open, MuJoCo and MJX agree, batches equal loops."""

from __future__ import annotations

import itertools
from functools import partial

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco import mjx
from scipy import ndimage
from scipy.spatial.transform import Rotation

from maxjax import Grid
from maxjax.sim.worlds.geoms import BOX, CAPSULE, ELLIPSOID, PLANE, Geoms, quaternion
from maxjax.sim.worlds.mjx_model import cast_rays_mjx, mjx_scene, place
from maxjax.sim.worlds.scenes import MAPS, layout, make_scene, occupancy, scene_xml

pytestmark = pytest.mark.parametrize("name", MAPS)


def visible(geoms: Geoms) -> np.ndarray:
    return np.asarray(geoms.position)[:, 2] > -500.0


def test_structure_is_fixed_and_mostly_built(name: str) -> None:
    scenes = [make_scene(name, seed) for seed in range(5)]
    for scene in scenes:
        assert scene.geoms.type == scenes[0].geoms.type
        assert 180 <= len(scene.geoms.type) <= 256
        assert scene.geoms.type[0] == PLANE
        assert {BOX, CAPSULE, ELLIPSOID} <= set(scene.geoms.type)
        assert np.mean(visible(scene.geoms)) > 0.6
        assert all(np.all(np.isfinite(a)) for a in jax.tree.leaves(scene.geoms))
        # Proper rotations, padding included: MuJoCo would normalise anything else.
        assert np.allclose(np.linalg.det(scene.geoms.rotation), 1.0, atol=1e-5)


def test_same_seed_same_city_other_seed_other_city(name: str) -> None:
    first, again, other = make_scene(name, 3), make_scene(name, 3), make_scene(name, 4)
    assert np.array_equal(first.geoms.position, again.geoms.position)
    shared = visible(first.geoms) & visible(other.geoms)
    moved = np.linalg.norm(np.asarray(first.geoms.position - other.geoms.position)[shared], axis=1)
    assert np.median(moved) > 5.0


def test_model_is_the_geoms(name: str) -> None:
    scene = make_scene(name, 1)
    data = mujoco.MjData(scene.model)
    mujoco.mj_kinematics(scene.model, data)
    assert tuple(scene.model.geom_type) == scene.geoms.type
    assert np.allclose(data.geom_xpos, scene.geoms.position, atol=1e-5)
    assert np.allclose(data.geom_xmat.reshape(-1, 3, 3), scene.geoms.rotation, atol=1e-6)
    assert np.allclose(scene.model.geom_size, scene.geoms.size, atol=1e-6)
    assert not np.any(scene.model.geom_contype)
    assert not np.any(scene.model.geom_conaffinity)
    model, placed = mjx_scene(scene)
    assert np.allclose(model.geom_quat, scene.model.geom_quat, atol=1e-6)
    assert np.allclose(placed.geom_xmat, scene.geoms.rotation)


def test_no_solid_floats_or_leaves_the_city(name: str) -> None:
    """Everything stands on the ground or on something below it, within the city's radius."""
    for seed in range(3):
        geoms = make_scene(name, seed).geoms
        keep = visible(geoms)
        keep[0] = False
        assert np.max(np.abs(np.asarray(geoms.position)[keep, :2])) < 200.0
        occupied, _ = occupancy(geoms, Grid((141, 141, 66), 2.0, (-140.0, -140.0, -1.0)))
        _, parts = ndimage.label(occupied, np.ones((3, 3, 3)))
        assert parts == 1


def test_no_two_solids_on_the_ground_stand_in_each_other(name: str) -> None:
    for seed in range(3):
        scene = make_scene(name, seed)
        model, data = scene.model, mujoco.MjData(scene.model)
        mujoco.mj_kinematics(model, data)
        # Party walls touch: a centimetre off each solid tells touching from overlap.
        model.geom_size[1:] = np.maximum(model.geom_size[1:] - 0.01, 1e-3)
        turned = data.geom_xmat.reshape(-1, 3, 3)
        reach = np.einsum("gj,gj->g", np.abs(turned[:, 2]), model.geom_size)
        reach[model.geom_type == CAPSULE] = model.geom_size[model.geom_type == CAPSULE, :2].sum(axis=1)
        standing = (np.abs(data.geom_xpos[:, 2] - reach) < 0.1) & (model.geom_type != ELLIPSOID)
        index = np.flatnonzero(standing & visible(scene.geoms) & (np.arange(model.ngeom) > 0))
        assert len(index) > 60
        for i, j in itertools.combinations(index, 2):
            gap = np.linalg.norm(data.geom_xpos[i] - data.geom_xpos[j])
            if gap < model.geom_rbound[i] + model.geom_rbound[j]:
                assert mujoco.mj_geomDistance(model, data, i, j, 1.0, None) > 0.0


def test_streets_are_one_connected_space(name: str) -> None:
    """At 9 m, clear of solids by 6 m, most of the free area is one piece that reaches all four sides."""
    grid = Grid((101, 101, 1), 2.0, (-100.0, -100.0, 9.0))
    for seed in range(6):
        occupied, _ = occupancy(make_scene(name, seed).geoms, grid)
        flat = occupied[:, :, 0]
        assert 0.05 < flat.mean() < 0.6
        clear = ndimage.distance_transform_edt(~flat, sampling=2.0) > 6.0
        labels, count = ndimage.label(clear)
        sizes = ndimage.sum_labels(clear, labels, np.arange(1, count + 1))
        main = labels == 1 + int(np.argmax(sizes))
        assert sizes.max() > 0.8 * sizes.sum()
        assert all(np.any(side) for side in (main[0], main[-1], main[:, 0], main[:, -1]))


def test_starts_clear_of_buildings_exist(name: str) -> None:
    """The closed-loop protocol needs points 3 to 15 m high, 10 m clear of buildings horizontally."""
    grid = Grid((101, 101, 7), 2.0, (-100.0, -100.0, 3.0))
    occupied, _ = occupancy(make_scene(name, 0).geoms, grid)
    clear = ndimage.distance_transform_edt(~np.any(occupied, axis=2), sampling=2.0) > 10.0
    assert clear.mean() > 0.02


@pytest.mark.large
def test_batch_of_scenes_is_one_vmapped_model(name: str) -> None:
    keys = jax.random.split(jax.random.key(7), 3)
    origin = jnp.array([1.0, 2.0, 30.0])
    rays = jax.random.normal(jax.random.key(1), (64, 3))
    rays = rays / jnp.linalg.norm(rays, axis=1, keepdims=True)
    model = mjx.put_model(make_scene(name, 0).model)
    data = mjx.make_data(model)

    cities = jax.jit(jax.vmap(partial(layout, name)))(keys)

    def cast(geoms: Geoms) -> jax.Array:
        return cast_rays_mjx(*place(model, data, geoms), origin, rays)

    batch, one = jax.jit(jax.vmap(cast))(cities), jax.jit(cast)
    for i, key in enumerate(keys):
        city = jax.jit(layout, static_argnums=0)(name, key)
        np.testing.assert_allclose(cities.position[i], city.position, atol=1e-4)
        np.testing.assert_allclose(cities.size[i], city.size, atol=1e-4)
        np.testing.assert_allclose(batch[i], one(jax.tree.map(lambda a, i=i: a[i], cities)), rtol=1e-5)
        # C MuJoCo, on the model written from this city alone.
        c_model = mujoco.MjModel.from_xml_string(scene_xml(city))
        c_data = mujoco.MjData(c_model)
        mujoco.mj_kinematics(c_model, c_data)
        start = np.asarray(origin, float)
        expected = [mujoco.mj_ray(c_model, c_data, start, r, None, True, -1, None) for r in np.asarray(rays, float)]
        expected = np.where(np.asarray(expected) < 0.0, np.inf, expected)
        assert np.sum(~np.isclose(batch[i], expected, rtol=1e-3)) <= 1
    assert not np.allclose(batch[0], batch[1])


def test_bad_input_is_named(name: str) -> None:
    with pytest.raises(ValueError, match="midtown, downtown, suburb, given 'atlantis'"):
        make_scene("atlantis", 0)
    with pytest.raises(ValueError, match="midtown, downtown, suburb, given 'atlantis'"):
        layout("atlantis", jax.random.key(0))
    for seed in (-1, 2**32):
        with pytest.raises(ValueError, match=f"0 to 4294967295, given {seed}"):
            make_scene(name, seed)
    assert len(make_scene(name, 2**32 - 1).geoms.type) > 0
    scene = make_scene(name, 0)
    batched = jax.tree.map(lambda a: a[None], scene.geoms)
    with pytest.raises(ValueError, match=r"expected shape \(g, 3\)"):
        scene_xml(batched)
    with pytest.raises(ValueError, match=r"expected shape \(g, 3\)"):
        occupancy(batched, Grid((3, 3, 3)))
    model = mjx.put_model(scene.model)
    fewer = scene.geoms.of_type(BOX)
    with pytest.raises(ValueError, match="types"):
        place(model, mjx.make_data(model), fewer)


def test_quaternions_turn_as_their_matrices(name: str) -> None:
    rng = np.random.default_rng(MAPS.index(name))
    matrices = Rotation.random(100, rng).as_matrix()
    # Half turns, where one component vanishes, included.
    half_turns = [np.diag(d) for d in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))]
    matrices = np.concatenate([matrices, half_turns])
    w, x, y, z = np.asarray(quaternion(jnp.asarray(matrices, jnp.float32))).T
    turned = Rotation.from_quat(np.stack([x, y, z, w], -1)).as_matrix()
    np.testing.assert_allclose(turned, matrices, atol=1e-6)
