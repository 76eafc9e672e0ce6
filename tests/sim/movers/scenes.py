"""Scripted scenes for a small sensor: ground, a wall, and movers in front of it."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import fields
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from maxjax.sim.movers.perception import process_scan
from maxjax.sim.movers.reachable_sets import Bounds, Tracks
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.sensors.lidar import Lidar, Scan, scan
from maxjax.sim.worlds.geoms import BOX, SPHERE, Geoms, concatenate, ground_plane
from maxjax.sim.worlds.movers import Movers, Moving, straight

LIDAR = Lidar(channels=32, rays=8192, elevation_min=-30.0, elevation_max=30.0)
SIGHT = TrackingSettings(lidar=LIDAR, bounds=Bounds(8.0, 2.0, 1.0), slots=6, detections=8, points=1024)
AT = np.array([0.0, 0.0, 4.0])


def box(center: Sequence[float], half: Sequence[float]) -> Geoms:
    return Geoms(jnp.array([center], jnp.float32), jnp.eye(3)[None], jnp.array([half], jnp.float32), (BOX,))


CITY = concatenate([ground_plane(), box([16.0, 0.0, 6.0], [1.0, 30.0, 6.0]), box([-8.0, 6.0, 3.0], [2.0, 2.0, 3.0])])


def spheres(place: np.ndarray, velocity: np.ndarray, radius: float = 0.45) -> Movers:
    count = len(place)
    size = jnp.tile(jnp.array([[radius, 0.0, 0.0]]), (count, 1))
    solids = Geoms(jnp.zeros((count, 3)), jnp.broadcast_to(jnp.eye(3), (count, 3, 3)), size, (SPHERE,) * count)
    return straight(solids, jnp.asarray(place, jnp.float32), jnp.asarray(velocity, jnp.float32))


def pose(k: int, speed: float) -> tuple[jax.Array, jax.Array]:
    """Where a vehicle is at look k that flies along y, turning and tilting; at rest, it hovers level."""
    t = 0.1 * k
    angles = np.array([0.6 * np.sin(t), 0.12 * np.sin(2.0 * t), 0.15 * np.sin(3.0 * t)]) * min(speed, 1.0)
    rotation = Rotation.from_euler("ZYX", angles).as_matrix()
    place = AT + np.array([0.0, speed * t, 0.0])
    return jnp.asarray(place, jnp.float32), jnp.asarray(rotation, jnp.float32)


@functools.partial(jax.jit, static_argnums=1)
def fast_scan(geoms: Geoms, lidar: Lidar, where: tuple, key: jax.Array, moving: Moving | None = None) -> Scan:
    return scan(geoms, lidar, *where, key, moving)


fast_look = jax.jit(process_scan)


def arrays(tracks: Tracks) -> SimpleNamespace:
    """Tracks in NumPy."""
    return SimpleNamespace(**{field.name: np.asarray(getattr(tracks, field.name)) for field in fields(tracks)})
