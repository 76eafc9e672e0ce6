"""Both ray casters against C MuJoCo: every map, misses, origins inside solids, parallel rays."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maxjax.sim.sensors.lidar import Lidar, directions
from maxjax.sim.worlds.geoms import BOX, CAPSULE, ELLIPSOID, PLANE, SPHERE, Geoms
from maxjax.sim.worlds.mjx_model import cast_rays_mjx, mjx_scene
from maxjax.sim.worlds.raycast import cast_rays
from maxjax.sim.worlds.scenes import MAPS, make_scene, scene_xml

RANGE = 100.0
TOLERANCE = 1e-3


def by_mujoco(model: mujoco.MjModel, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """C `mj_ray`, ray by ray; infinity on a miss."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    origin, rays = origin.astype(float), rays.astype(float)
    found = np.array([mujoco.mj_ray(model, data, origin, ray, None, True, -1, None) for ray in rays])
    return np.where(found < 0.0, np.inf, found)


def cut(distance: np.ndarray) -> np.ndarray:
    distance = np.asarray(distance, float)
    return np.where(distance > RANGE, np.inf, distance)


def disagreements(given: np.ndarray, expected: np.ndarray) -> int:
    """Rays within range whose hit differs, or whose distance does by more than the tolerance."""
    given, expected = cut(given), cut(expected)
    both = np.isfinite(given) & np.isfinite(expected)
    gap = np.zeros_like(expected)
    gap[both] = np.abs(given[both] - expected[both])
    return int(np.sum((np.isfinite(given) != np.isfinite(expected)) | (gap > TOLERANCE)))


@pytest.mark.large
# Suburb has every kind of solid; the others by night.
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name == "suburb" else pytest.mark.nightly) for name in MAPS]
)
def test_full_scans_agree_with_c_mujoco(name: str) -> None:
    """32,768 rays from turned sensors, above streets and inside buildings.

    Over 60 poses a map (5.9 million rays in all) the fused kernel differed in one ray and `mjx.ray` in 246;
    the bounds a scan leave room for other hardware's rounding.
    """
    fused, mapped = jax.jit(cast_rays), jax.jit(cast_rays_mjx)
    rng = np.random.default_rng(0)
    misses = 0
    for seed in range(3):
        scene = make_scene(name, seed)
        model, data = mjx_scene(scene)
        rotation = Rotation.random(rng=rng).as_matrix()
        rays = directions(Lidar()) @ jnp.asarray(rotation.T, jnp.float32)
        origin = np.array([*rng.uniform(-100.0, 100.0, 2), rng.uniform(3.0, 15.0)], np.float32)
        expected = by_mujoco(scene.model, origin, np.asarray(rays))
        misses += int(np.sum(np.isinf(cut(expected))))
        assert disagreements(fused(scene.geoms, origin, rays), expected) <= 2
        assert disagreements(mapped(model, data, origin, rays), expected) <= 20
    assert misses > 0


def all_types() -> Geoms:
    turn = Rotation.from_euler("xyz", [20.0, -35.0, 50.0], degrees=True).as_matrix()
    rotation = np.stack([np.eye(3), turn, turn, np.eye(3), turn])
    position = [[0.0, 0.0, 0.0], [6.0, 0.0, 3.0], [-6.0, 1.0, 4.0], [0.0, 7.0, 3.0], [0.0, -7.0, 4.0]]
    size = [[0.0, 0.0, 1.0], [1.5, 2.0, 1.0], [2.0, 1.0, 1.5], [1.2, 1.5, 0.0], [1.7, 0.0, 0.0]]
    types = (PLANE, BOX, ELLIPSOID, CAPSULE, SPHERE)
    return Geoms(*(jnp.asarray(np.asarray(a), jnp.float32) for a in (position, rotation, size)), types)


def test_every_type_from_outside_inside_and_below() -> None:
    geoms = all_types()
    model = mujoco.MjModel.from_xml_string(scene_xml(geoms))
    fused = jax.jit(cast_rays)
    rng = np.random.default_rng(3)
    rays = rng.normal(size=(600, 3))
    # Axis-parallel rays meet slabs and the capsule's axis in parallel.
    rays = np.concatenate([rays, np.eye(3), -np.eye(3)])
    rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
    middles = np.asarray(geoms.position)[1:]
    for origin in [
        *middles,
        *(middles + 0.2),
        [0.0, 0.0, 2.0],
        [0.0, 0.0, -2.0],
        [0.1, 7.1, 5.0],
        [0.0, 7.0, 9.0],
    ]:
        start = np.asarray(origin, np.float32)
        expected = by_mujoco(model, start, rays)
        given = np.asarray(fused(geoms, jnp.asarray(start), jnp.asarray(rays)), float)
        assert np.array_equal(np.isinf(given), np.isinf(expected))
        hit = np.isfinite(expected)
        np.testing.assert_allclose(given[hit], expected[hit], atol=1e-4, rtol=1e-5)


def test_the_ground_is_met_from_above_only() -> None:
    plane = Geoms(jnp.zeros((1, 3)), jnp.eye(3)[None], jnp.array([[0.0, 0.0, 1.0]]), (PLANE,))
    down, up, level = [0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]
    rays = jnp.array([down, up, level])
    assert np.array_equal(cast_rays(plane, jnp.array([0.0, 0.0, 2.0]), rays), [2.0, np.inf, np.inf])
    assert np.all(np.isinf(cast_rays(plane, jnp.array([0.0, 0.0, -2.0]), rays)))
    assert np.array_equal(cast_rays(plane, jnp.zeros(3), rays), [0.0, np.inf, np.inf])


def test_nothing_compiles_twice_and_jit_equals_eager() -> None:
    traces = 0

    def counted(geoms: Geoms, origin: jax.Array, rays: jax.Array) -> jax.Array:
        nonlocal traces
        traces += 1
        return cast_rays(geoms, origin, rays)

    compiled = jax.jit(counted)
    rays = directions(Lidar(channels=32, rays=64))
    origin = jnp.array([0.0, 0.0, 40.0])
    scenes = [make_scene("downtown", seed).geoms for seed in range(3)]
    distances = [compiled(geoms, origin, rays) for geoms in scenes]
    assert traces == 1
    np.testing.assert_allclose(distances[0], cast_rays(scenes[0], origin, rays), rtol=1e-5)


def test_memory_is_of_order_rays() -> None:
    """Temporaries of some 30 floats a ray, whatever the number of geoms; `mjx.ray` takes 2,600."""
    geoms = make_scene("downtown", 0).geoms
    rays = directions(Lidar())

    def cast(position: jax.Array, rotation: jax.Array, size: jax.Array, rays: jax.Array) -> jax.Array:
        return cast_rays(Geoms(position, rotation, size, geoms.type), jnp.zeros(3), rays)

    compiled = jax.jit(cast).lower(geoms.position, geoms.rotation, geoms.size, rays).compile()
    assert compiled.memory_analysis().temp_size_in_bytes < 40 * 4 * len(rays)


def test_wrong_shapes_are_named() -> None:
    geoms = all_types()
    batched = jax.tree.map(lambda a: a[None], geoms)
    with pytest.raises(ValueError, match=r"expected geoms \(g, 3\)"):
        cast_rays(batched, jnp.zeros(3), jnp.eye(3))
