"""How movers are watched for: the sensor, what movers are assumed to keep, and the sizes of what is remembered."""

from __future__ import annotations

import dataclasses
import math

import jax

from maxjax.sim.movers.reachable_sets import Bounds
from maxjax.sim.sensors.lidar import Lidar


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class TrackingSettings:
    """Settings of perception among movers; static.

    Attributes:
        lidar: the sensor's model.
        bounds: what movers are assumed to keep.
        reach: beyond this distance nothing is taken for a mover [m]: beams are too far apart.
        floor: returns below this height are the ground's [m].
        near: a mover that is confirmed nearer than this is flagged [m].
        slots: tracks at most.
        detections: in a scan at most; nearest first.
        points: returns of movers in a scan at most; nearest first.
        images: range images remembered.
        apart: least time between two of them [s].
        pose_error: of one scan against another, at most, the sensor's own noise left out [m].
        misses: looks in a row after which a track in plain view, but not seen, is given up.
        lost: half width of a set beyond which it says nothing any more [m].
        rest: a track slower than `still` for so long has stopped [s].
        still: see `rest` [m/s].

    Raises:
        ValueError: for a number that is not positive and finite (`pose_error`: below 0).
    """

    lidar: Lidar = Lidar()  # noqa: RUF009 (frozen)
    bounds: Bounds = Bounds()  # noqa: RUF009 (frozen)
    reach: float = 45.0
    floor: float = 0.2
    near: float = 10.0
    slots: int = 32
    detections: int = 48
    points: int = 4096
    images: int = 6
    apart: float = 0.2
    pose_error: float = 0.0
    misses: int = 8
    lost: float = 6.0
    rest: float = 1.5
    still: float = 0.3

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            least = 0.0 if name == "pose_error" else math.ulp(0.0)
            if not isinstance(value, (Lidar, Bounds)) and not least <= value < math.inf:
                expected = "at least 0" if name == "pose_error" else "above 0"
                raise ValueError(f"TrackingSettings.{name}: expected a finite number, {expected}, given {value!r}")
