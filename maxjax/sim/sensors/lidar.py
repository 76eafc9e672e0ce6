"""A spinning multi-channel LiDAR: from a pose to points in the world frame.

    point = position + rotation · direction · (distance + noise)

Pattern: `channels` elevations spaced evenly from `elevation_min` to `elevation_max` (ends included), each
swept over rays / channels azimuths spaced evenly over the full turn; channel-major, azimuth counter-clockwise
from the sensor's x.

The default -45 to +45 degrees is the vertical field of view of a 90-degree short-range city LiDAR, level with the
vehicle. At 3 to 15 m above a street 20 m wide it covers the ground from a horizontal distance of 3 to 15 m on and
facades up to 10 m above the sensor on both sides of the street. A downward hemisphere would not cover bridges and
overhangs above, an upward one neither cars nor trees below. The cones above and below the vehicle are not covered. With
64 channels and 512 azimuths neighbouring rays are 1.4 and 0.7 degrees apart: at 80 m a distance of 2 m, the height of a
voxel, and of 1 m.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from maxjax.compile.lowering import matmul
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.movers import Moving
from maxjax.sim.worlds.raycast import cast_rays, cast_rays_moving


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Lidar:
    """Sensor model; static.

    Attributes:
        channels: elevations, 2 to 128.
        rays: rays a scan over all channels, a multiple of `channels`.
        elevation_min: lowest elevation [deg], sensor frame.
        elevation_max: highest elevation [deg].
        max_range: farthest return [m].
        range_noise: standard deviation of the measured distance [m].
        dropout: probability that a return is lost.
        turn: duration of a scan [s]; its columns are measured one after the other, the first one a turn before the
            last.
        width: of the field of view [deg], around the sensor's x; rays outside of it return nothing.
        reports_misses: whether the sensor tells a beam that met nothing from one that failed. Then a column without
            returns is clear; else it says nothing, for it may be blind.

    Raises:
        ValueError: for values outside these ranges.
    """

    channels: int = 64
    rays: int = 32768
    elevation_min: float = -45.0
    elevation_max: float = 45.0
    max_range: float = 100.0
    range_noise: float = 0.02
    dropout: float = 0.01
    turn: float = 0.1
    width: float = 360.0
    reports_misses: bool = False

    def __post_init__(self) -> None:
        if not 2 <= self.channels <= 128:
            raise ValueError(f"Lidar.channels: expected 2 to 128, given {self.channels}")
        if self.rays < self.channels or self.rays % self.channels:
            raise ValueError(f"Lidar.rays: expected a positive multiple of {self.channels} channels, given {self.rays}")
        if not -90.0 <= self.elevation_min < self.elevation_max <= 90.0:
            raise ValueError(
                "Lidar elevations: expected -90 <= elevation_min < elevation_max <= 90 [deg], given "
                f"{self.elevation_min} and {self.elevation_max}"
            )
        if not self.max_range > 0.0:
            raise ValueError(f"Lidar.max_range: expected a positive number of metres, given {self.max_range}")
        if not self.range_noise >= 0.0:
            raise ValueError(f"Lidar.range_noise: expected at least 0 m, given {self.range_noise}")
        if not 0.0 <= self.dropout <= 1.0:
            raise ValueError(f"Lidar.dropout: expected a probability, given {self.dropout}")
        if not self.turn > 0.0:
            raise ValueError(f"Lidar.turn: expected a positive number of seconds, given {self.turn}")
        if not 0.0 < self.width <= 360.0:
            raise ValueError(f"Lidar.width: expected an angle up to 360 degrees, given {self.width}")

    @property
    def columns(self) -> int:
        """Azimuths of a scan."""
        return self.rays // self.channels


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Scan:
    """One scan; batch axes lead.

    Attributes:
        points: returns in the world frame [m]; NaN where `hit` is False.
        distance: measured along each ray [m]; infinity where `hit` is False.
        hit: whether the ray returned: a surface within range, not dropped.
    """

    points: Float[Array, "*batch r 3"]
    distance: Float[Array, "*batch r"]
    hit: Bool[Array, "*batch r"]


def directions(lidar: Lidar) -> Float[Array, "r 3"]:
    """Unit vectors of all rays, sensor frame (x forward, y left, z up), channel by channel from below."""
    elevation = np.deg2rad(np.linspace(lidar.elevation_min, lidar.elevation_max, lidar.channels))[:, None]
    azimuth = 2.0 * np.pi * np.arange(lidar.columns)[None, :] / lidar.columns
    x, y = np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)
    z = np.broadcast_to(np.sin(elevation), x.shape)
    return jnp.asarray(np.stack([x, y, z], -1).reshape(-1, 3), jnp.float32)


def scan(
    geoms: Geoms,
    lidar: Lidar,
    position: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
    key: PRNGKeyArray,
    moving: Moving | None = None,
) -> Scan:
    """One scan from a pose; safe under `jit` and `vmap` over geoms, poses, keys and movers.

    Args:
        geoms: one scene.
        lidar: sensor model; static, registered as such for `jit`.
        position: of the sensor, world frame [m].
        rotation: sensor frame -> world frame.
        key: for range noise and dropout.
        moving: movers, and the time at which the scan ends: a ray meets them where they are when it is cast. The pose
            is that of all rays, as of a scan whose own motion was taken out.

    Returns:
        The scan, lidar.rays rays in the order of `directions`. A surface counts if it lies within
        `max_range`; its noisy distance is kept within [0, max_range].

    Raises:
        ValueError: for wrong shapes.
    """
    if position.shape != (3,) or rotation.shape != (3, 3):
        raise ValueError(
            "scan: expected position (3,) and rotation (3, 3), given "
            f"{position.shape} and {rotation.shape}; use vmap for batches"
        )
    rays = matmul(directions(lidar), rotation.T)
    distance = cast_rays(geoms, position, rays)
    if moving is not None:
        columns = jnp.swapaxes(rays.reshape(lidar.channels, lidar.columns, 3), 0, 1)
        nearer = cast_rays_moving(moving.movers, position, columns, cast_at(lidar, moving.time))
        distance = jnp.minimum(distance, nearer.T.reshape(-1))
    if lidar.width < 360.0:
        distance = jnp.where(np.tile(within_width(lidar), lidar.channels), distance, jnp.inf)
    key_noise, key_dropout = jax.random.split(key)
    lost = jax.random.bernoulli(key_dropout, lidar.dropout, distance.shape)
    hit = (distance <= lidar.max_range) & ~lost
    noise = lidar.range_noise * jax.random.normal(key_noise, distance.shape)
    measured = jnp.clip(jnp.where(hit, distance, 0.0) + noise, 0.0, lidar.max_range)
    points = jnp.where(hit[:, None], position + measured[:, None] * rays, jnp.nan)
    return Scan(points, jnp.where(hit, measured, jnp.inf), hit)


def cast_at(lidar: Lidar, end: Float[Array, ""]) -> Float[Array, " columns"]:
    """Times at which the columns of a scan are measured, if it ends at a time [s]."""
    return end + lidar.turn * (np.arange(1, lidar.columns + 1) / lidar.columns - 1.0)


def within_width(lidar: Lidar) -> Bool[np.ndarray, " columns"]:
    """Columns in the field of view."""
    azimuth = np.arange(lidar.columns) * 360.0 / lidar.columns
    within: Bool[np.ndarray, " columns"] = np.minimum(azimuth, 360.0 - azimuth) <= 0.5 * lidar.width
    return within
