"""Triangles by the LiDAR's ray caster against C MuJoCo's rays on the same mesh."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from benchmarks.common.mesh_rays import MeshRays
from maxjax.sim.worlds.raycast import cast_rays
from maxjax.sim.worlds.triangle_geoms import triangle_geoms


def scene(rng: np.random.Generator) -> np.ndarray:
    """A tower with a dome and a slanting roof, and slivers."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=4.0)
    tower = trimesh.creation.box((6.0, 9.0, 20.0))
    roof = trimesh.creation.cone(radius=5.0, height=6.0)
    slivers = rng.uniform(-15.0, 15.0, (20, 1, 3)) + rng.uniform(-0.05, 0.05, (20, 3, 3)) + np.eye(3) * 2.0
    for mesh, shift in ((ball, (12.0, 3.0, 4.0)), (tower, (0.0, 0.0, 10.0)), (roof, (0.0, 0.0, 20.0))):
        mesh.apply_translation(shift)
    return np.concatenate([ball.triangles, tower.triangles, roof.triangles, slivers])


def test_rays_agree_with_c_mujoco() -> None:
    """From within and from outside, on both sides of faces: as MuJoCo has it, to a millimetre."""
    rng = np.random.default_rng(0)
    corners = scene(rng)
    geoms, oracle = triangle_geoms(corners, 512), MeshRays(corners)
    cast = jax.jit(cast_rays)
    differ = total = hits = 0
    for origin in ([30.0, 5.0, 12.0], [0.0, 0.0, 10.0], [12.0, 3.0, 4.0], [-20.0, -8.0, 30.0]):
        rays = rng.normal(size=(400, 3))
        rays[:200] = corners.mean(axis=1)[rng.integers(0, len(corners), 200)] - origin
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        given = np.asarray(cast(geoms, jnp.asarray(origin, jnp.float32), jnp.asarray(rays, jnp.float32)))
        expected = oracle.first_hits(np.array(origin), origin + rays)
        both = np.isfinite(given) & np.isfinite(expected)
        gap = np.where(both, np.abs(np.where(both, given, 0.0) - np.where(both, expected, 0.0)), 0.0)
        differ += int(((np.isfinite(given) != np.isfinite(expected)) | (gap > 1e-3)).sum())
        hits, total = hits + int(both.sum()), total + len(rays)
    assert hits > 0.4 * total
    assert differ <= 0.003 * total


def test_no_ray_slips_through_a_seam() -> None:
    """Rays at the edges and corners that triangles of a closed ball share all meet it."""
    ball = trimesh.creation.icosphere(subdivisions=2, radius=30.0)
    corners = np.asarray(ball.triangles)
    shares = np.random.default_rng(1).uniform(size=(len(corners), 1))
    edges = shares * corners[:, 0] + (1.0 - shares) * corners[:, 1]
    rays = np.concatenate([edges, corners.reshape(-1, 3)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    found = cast_rays(triangle_geoms(corners, len(corners)), jnp.zeros(3), jnp.asarray(rays, jnp.float32))
    assert np.isfinite(np.asarray(found)).all()


def test_padding_is_met_by_no_ray() -> None:
    """Neither what fills up a set nor a triangle without an area."""
    flat = np.array([[[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]])
    rays = np.random.default_rng(2).normal(size=(500, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    found = cast_rays(triangle_geoms(flat, 8), jnp.zeros(3), jnp.asarray(rays, jnp.float32))
    assert not np.isfinite(np.asarray(found)).any()
    with pytest.raises(ValueError, match="at least 1"):
        triangle_geoms(flat, 0)
