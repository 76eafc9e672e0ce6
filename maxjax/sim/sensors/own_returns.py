"""Returns of a sensor of one's own, as a scan of the modelled one: the nearest return in each pixel of the range image.

    cloud → nearest return of each pixel;    nearer than the least range, or within the airframe → blind

A blind beam measured the vehicle itself: it says nothing of what is behind that, neither that something stands there
nor that it is free. It has the distance 0, as a beam that returned at once. What falls into no pixel is counted by why.
On the host, in NumPy: a cloud may have any number of points, and nothing is compiled. Frame: sensor.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from jaxtyping import Bool, Float32, Int64, Real

from maxjax.sim.sensors.lidar import Lidar, directions, within_width

Component = Float32[np.ndarray, " n"]
Box = tuple[tuple[float, float, float], tuple[float, float, float]]


@dataclasses.dataclass(frozen=True)
class ReturnCounts:
    """What became of the returns of a scan; together they are all of it.

    Attributes:
        seen: nearest in their pixel.
        behind: in a pixel with a nearer one.
        own: nearer than the least range, or within the airframe.
        outside: outside the field of view.
        beyond: further away than the modelled sensor measures.
        missing: no numbers, or at the sensor itself, as sensors write a beam without a return.
    """

    seen: int
    behind: int
    own: int
    outside: int
    beyond: int
    missing: int


@dataclasses.dataclass(frozen=True)
class Airframe:
    """What a sensor sees of the vehicle that carries it; static.

    Attributes:
        least: distance within which all returns are the vehicle's own [m].
        box: least and greatest coordinates of a box around the vehicle, in the frame of the sensor [m]; None: none.

    Raises:
        ValueError: for a distance that is no positive number, or a box that holds nothing.
    """

    least: float = 0.3
    box: Box | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.least < math.inf:
            raise ValueError(f"Airframe.least: expected a positive number of metres, given {self.least!r}")
        if self.box is not None and not (np.diff(np.asarray(self.box, float), axis=0) > 0.0).all():
            raise ValueError(f"Airframe.box: expected least and greatest coordinates [m], given {self.box!r}")

    def holds(self, x: Component, y: Component, z: Component) -> Bool[np.ndarray, " n"]:
        """Which points are the vehicle's own, by their coordinates [m]."""
        own: Bool[np.ndarray, " n"] = x * x + y * y + z * z < self.least**2
        if self.box is not None:
            within = [(c >= low) & (c <= high) for c, low, high in zip((x, y, z), *self.box, strict=True)]
            own = own | (within[0] & within[1] & within[2])
        return own


def project_returns(
    returns: Real[np.ndarray, "n 3"] | Real[np.ndarray, " n"], lidar: Lidar, airframe: Airframe
) -> tuple[Float32[np.ndarray, " r"], ReturnCounts]:
    """Distances along the rays of the modelled sensor, in the order of `sim.sensors.lidar.directions`, and counts.

    Args:
        returns: points in the frame of the sensor, in any order (n, 3) [m], or the distance of each ray in that order
            (r,) [m]. NaN, infinity, a distance of 0 and the point (0, 0, 0) are beams without a return.
        lidar: the sensor's model. Points are taken to lie on the ray of their pixel.
        airframe: what is the vehicle's own.

    Returns:
        Infinity where nothing was measured, and 0 where the vehicle itself was.

    Raises:
        ValueError: for distances that are not one a ray.
    """
    if returns.ndim == 1 and len(returns) != lidar.rays:
        raise ValueError(f"returns: expected points (n, 3) or {lidar.rays} distances, given {returns.shape}")
    distances = np.full(lidar.rays, np.inf, np.float32)
    with np.errstate(invalid="ignore", over="ignore"):
        if returns.ndim == 1:
            x, y, z = _rays(lidar) * returns.astype(np.float32)
        else:
            x, y, z = np.ascontiguousarray(returns.astype(np.float32).T)
        far = np.sqrt(x * x + y * y + z * z)
        there = np.isfinite(far) & (far > 0.0)
        if returns.ndim == 1:
            there &= returns > 0.0
            pixel, viewed = np.arange(lidar.rays), np.tile(within_width(lidar), lidar.channels)
        else:
            pixel, viewed = _pixels(x, y, z, np.where(there, far, 1.0), lidar)
        own = there & airframe.holds(x, y, z)
        beyond = there & ~own & (far > lidar.max_range)
    inside = there & viewed
    seen, blind = inside & ~own & ~beyond, pixel[inside & own]
    np.minimum.at(distances, pixel[seen], far[seen])
    kept = int(np.isfinite(distances).sum())
    distances[blind[np.isinf(distances[blind])]] = 0.0
    counts = ReturnCounts(
        seen=kept,
        behind=int(seen.sum()) - kept,
        own=int(own.sum()),
        outside=int((there & ~viewed & ~own & ~beyond).sum()),
        beyond=int(beyond.sum()),
        missing=len(far) - int(there.sum()),
    )
    return distances, counts


def _pixels(
    x: Component, y: Component, z: Component, far: Component, lidar: Lidar
) -> tuple[Int64[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Numbers of the rays nearest to points, and which points lie in the field of view; of NaN anything."""
    low, high = math.radians(lidar.elevation_min), math.radians(lidar.elevation_max)
    row = (np.arcsin(np.clip(z / far, -1.0, 1.0)) - low) * ((lidar.channels - 1) / (high - low))
    column = np.arctan2(y, x) * (lidar.columns / (2.0 * np.pi))
    i, j = (np.floor(np.nan_to_num(one) + 0.5).astype(np.int64) for one in (row, column))
    j %= lidar.columns
    inside: Bool[np.ndarray, " n"] = (i >= 0) & (i < lidar.channels) & within_width(lidar)[j]
    return np.clip(i, 0, lidar.channels - 1) * lidar.columns + j, inside


@functools.cache
def _rays(lidar: Lidar) -> Float32[np.ndarray, "3 r"]:
    """Unit vectors of all rays, as `sim.sensors.lidar.directions`, on the host."""
    return np.ascontiguousarray(np.asarray(directions(lidar)).T)
