"""Disturbances of a flight: wind, a degraded sensor, drift of the estimated position, latency of the planner.

    air velocity       = wind · e_w + gusts (`vehicle.gust`, scaled by wind / 10 m/s)
    position estimate  = position + drift · e_d · ½ (1 − cos(2π t / 20 s))
    range              = measured range + noise · N(0, 1),    lost with probability `dropout` or in an outage

Strengths are arrays, so that each flight of a batch has its own; zeros are calm. The key of the flight determines the
level directions e_w and e_d, the azimuth of the dead sector and the time of the blackout.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from maxjax.core.rng_streams import Stream, stream
from maxjax.sim.sensors.lidar import Lidar, Scan

# Mean wind speed that the intensities of `vehicle.Gusts` are stated for [m/s]; gusts scale with the mean wind.
GUST_REFERENCE_WIND = 10.0
# The blackout of the sensor starts this long after take-off, uniformly distributed [s].
_BLACKOUT = (2.0, 6.0)
# The position error grows to its maximum and returns to zero in this time [s].
_DRIFT_PERIOD = 20.0

Number = Float[Array, "*batch"] | float


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Disturbances:
    """Strengths; each may be a number or an array with the flights' batch axes.

    Attributes:
        wind: mean speed of the wind [m/s], level, in a random direction; gusts scale with it.
        range_noise: standard deviation of measured distances [m], on top of the sensor's own.
        dropout: share of returns lost, on top of the sensor's own.
        dead_sector: width of a sector of azimuths without any returns, fixed to the vehicle [deg].
        blackout: duration of an interval without any returns, some seconds after take-off [s].
        drift: greatest error of the estimated position [m].
        latency: planning periods between a scan and the flight along the plan computed from it, 0 or 1.
    """

    wind: Number = 0.0
    range_noise: Number = 0.0
    dropout: Number = 0.0
    dead_sector: Number = 0.0
    blackout: Number = 0.0
    drift: Number = 0.0
    latency: Number = 0.0


# The trial sets of the closed-loop tables, by name.
SETS: dict[str, Disturbances] = {
    "calm": Disturbances(),
    "wind": Disturbances(wind=10.0),
    "noise": Disturbances(range_noise=0.2),
    "dropout": Disturbances(dropout=0.5),
    "dead-sector": Disturbances(dead_sector=90.0),
    "blackout": Disturbances(blackout=1.0),
    "drift": Disturbances(drift=1.0),
    "latency": Disturbances(latency=1.0),
}


def _direction(key: PRNGKeyArray) -> Float[Array, "3"]:
    """A level unit vector."""
    angle = jax.random.uniform(key, maxval=2.0 * math.pi)
    return jnp.stack([jnp.cos(angle), jnp.sin(angle), jnp.zeros(())])


def mean_wind(disturbances: Disturbances, key: PRNGKeyArray) -> Float[Array, "3"]:
    """Air velocity without gusts, world frame [m/s]; the flight's key."""
    return disturbances.wind * _direction(stream(key, Stream.WIND_DIRECTION))


def position_error(disturbances: Disturbances, key: PRNGKeyArray, time: Float[Array, ""]) -> Float[Array, "3"]:
    """Estimated minus true position [m] at a time [s]; zero at take-off, `drift` at most; the flight's key."""
    phase = 0.5 - 0.5 * jnp.cos(2.0 * math.pi * time / _DRIFT_PERIOD)
    return disturbances.drift * phase * _direction(stream(key, Stream.DRIFT_DIRECTION))


def scan_error(drift: float, range_noise: float, lidar: Lidar, seconds: float) -> float:
    """How far returns of two scans may be apart at most by drift and added noise [m], the sensor's own noise left out.

    Args:
        drift: greatest error of the estimated position [m]; its rate is at most π drift / 20 s.
        range_noise: on top of the sensor's own [m], taken for three standard deviations.
        lidar: the sensor's model.
        seconds: between the scans at most [s].
    """
    noise = math.hypot(lidar.range_noise, range_noise) - lidar.range_noise
    return drift * min(1.0, math.pi * seconds / _DRIFT_PERIOD) + 3.0 * noise


def outage(disturbances: Disturbances, lidar: Lidar, key: PRNGKeyArray, time: Float[Array, ""]) -> Bool[Array, " r"]:
    """Rays without returns because the sensor fails: its dead sector, and all of them in the blackout.

    Args:
        disturbances: strengths.
        lidar: the sensor's model. Static.
        key: the flight's.
        time: since take-off [s].
    """
    sector_key, blackout_key = jax.random.split(stream(key, Stream.SENSOR_OUTAGE))
    columns = lidar.rays // lidar.channels
    azimuth = jnp.tile(jnp.arange(columns) / columns, lidar.channels)
    from_edge = jnp.mod(azimuth - jax.random.uniform(sector_key), 1.0)
    dark_for = time - jax.random.uniform(blackout_key, minval=_BLACKOUT[0], maxval=_BLACKOUT[1])
    dead = from_edge < jnp.asarray(disturbances.dead_sector) / 360.0
    return dead | ((dark_for >= 0.0) & (dark_for < disturbances.blackout))


def degrade(
    scan: Scan,
    disturbances: Disturbances,
    lidar: Lidar,
    origin: Float[Array, "3"],
    failed: Bool[Array, " r"],
    key: PRNGKeyArray,
) -> Scan:
    """The scan with more noise and fewer returns.

    Args:
        scan: as `lidar.scan` returns it.
        disturbances: strengths.
        lidar: the sensor's model. Static.
        origin: of the rays [m].
        failed: rays without returns, from `outage`.
        key: this scan's.
    """
    noise_key, dropout_key = jax.random.split(key)
    dropped = jax.random.uniform(dropout_key, scan.hit.shape) < disturbances.dropout
    hit = scan.hit & ~(dropped | failed)
    distance = jnp.where(hit, scan.distance, 0.0)
    noisy = distance + disturbances.range_noise * jax.random.normal(noise_key, distance.shape)
    noisy = jnp.clip(noisy, 0.0, lidar.max_range)
    scale = jnp.where(distance > 0.0, noisy / jnp.where(distance > 0.0, distance, 1.0), 1.0)
    points = origin + (jnp.where(hit[:, None], scan.points, origin) - origin) * scale[:, None]
    return Scan(jnp.where(hit[:, None], points, jnp.nan), jnp.where(hit, noisy, jnp.inf), hit)
