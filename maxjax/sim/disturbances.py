"""What a flight has to put up with: wind, a worse sensor, a pose that drifts, a planner that is late.

All of it is data: a batch of flights can have as many disturbances as it has flights, and zeros are a calm day. The key
of the flight decides the rest: which way the wind blows, when the sensor fails, where the pose drifts to.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from maxjax.core.streams import Stream, stream
from maxjax.sim.lidar import Lidar, Scan

# Mean wind speed that the intensities of `vehicle.Gusts` are stated for [m/s]; gusts scale with the mean wind.
GUST_REFERENCE_WIND = 10.0
# A blackout of the sensor begins this long after take-off [s].
_BLACKOUT = (2.0, 6.0)
# The pose drifts out to its greatest error and back in this time [s].
_DRIFT_PERIOD = 20.0

Number = Float[Array, "*batch"] | float


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Disturbances:
    """Strengths; each may be a number or an array with the flights' batch axes.

    Attributes:
        wind: mean speed of the wind [m/s], level, from a direction of the flight's own; with gusts in proportion.
        range_noise: standard deviation of measured distances [m], on top of the sensor's own.
        dropout: share of returns lost, on top of the sensor's own.
        dead_sector: width of a sector of azimuths without any returns, fixed to the vehicle [deg].
        blackout: how long no scan holds any return, some seconds after take-off [s].
        drift: greatest error of the believed position [m].
        latency: planning periods between a scan and the flight along the plan made from it, 0 or 1.
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
    """Velocity of the air without gusts, world frame [m/s]; the flight's key."""
    return disturbances.wind * _direction(stream(key, Stream.WIND_DIRECTION))


def pose_error(disturbances: Disturbances, key: PRNGKeyArray, time: Float[Array, ""]) -> Float[Array, "3"]:
    """Believed minus true position [m] at a time [s]; zero at take-off, `drift` at most; the flight's key."""
    phase = 0.5 - 0.5 * jnp.cos(2.0 * math.pi * time / _DRIFT_PERIOD)
    return disturbances.drift * phase * _direction(stream(key, Stream.DRIFT_DIRECTION))


def corrupt(
    scan: Scan,
    disturbances: Disturbances,
    lidar: Lidar,
    origin: Float[Array, "3"],
    key: PRNGKeyArray,
    draw: PRNGKeyArray,
    time: Float[Array, ""],
) -> Scan:
    """The scan as a worse sensor measures it.

    Args:
        scan: as `lidar.scan` gives it.
        disturbances: strengths.
        lidar: the sensor's model. Static.
        origin: of the rays [m].
        key: the flight's.
        draw: this scan's.
        time: since take-off [s].
    """
    noise_key, loss_key = jax.random.split(draw)
    sector_key, blackout_key = jax.random.split(stream(key, Stream.SENSOR_OUTAGE))
    columns = lidar.rays // lidar.channels
    azimuth = jnp.tile(jnp.arange(columns) / columns, lidar.channels)
    behind = jnp.mod(azimuth - jax.random.uniform(sector_key), 1.0)
    begun = time - jax.random.uniform(blackout_key, minval=_BLACKOUT[0], maxval=_BLACKOUT[1])
    lost: Bool[Array, " r"] = jax.random.uniform(loss_key, behind.shape) < disturbances.dropout
    lost |= behind < jnp.asarray(disturbances.dead_sector) / 360.0
    lost |= (begun >= 0.0) & (begun < disturbances.blackout)
    hit = scan.hit & ~lost
    distance = jnp.where(hit, scan.distance, 0.0)
    noisy = distance + disturbances.range_noise * jax.random.normal(noise_key, distance.shape)
    noisy = jnp.clip(noisy, 0.0, lidar.max_range)
    scale = jnp.where(distance > 0.0, noisy / jnp.where(distance > 0.0, distance, 1.0), 1.0)
    points = origin + (jnp.where(hit[:, None], scan.points, origin) - origin) * scale[:, None]
    return Scan(jnp.where(hit[:, None], points, jnp.nan), jnp.where(hit, noisy, jnp.inf), hit)
