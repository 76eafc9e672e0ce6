"""A path in time: position, velocity, acceleration and heading as smooth functions, from rest to rest.

Position and heading are uniform cubic B-splines over one row of times (`trajectories.spline`): twice continuously
differentiable, with limits that hold at every time because they hold for their control points. World frame ENU [m];
yaw counts from east to north, anticlockwise seen from above [rad], and goes on beyond ±π rather than to jump.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float64
from numpy.typing import ArrayLike

from maxjax.core.grid import Point3
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan
from maxjax.trajectories import spline
from maxjax.trajectories.limits import FlightLimits


@dataclasses.dataclass(frozen=True)
class Motion:
    """A trajectory at some times; one row a time.

    Attributes:
        time: (t,) since its start [s].
        position: (t, 3) [m], ENU.
        velocity: (t, 3) [m/s].
        acceleration: (t, 3) [m/s²].
        jerk: (t, 3) [m/s³]; constant between neighbouring control points.
        yaw: (t,) heading [rad], from east to north.
        yaw_rate: (t,) [rad/s].
    """

    time: Float64[np.ndarray, " t"]
    position: Float64[np.ndarray, "t 3"]
    velocity: Float64[np.ndarray, "t 3"]
    acceleration: Float64[np.ndarray, "t 3"]
    jerk: Float64[np.ndarray, "t 3"]
    yaw: Float64[np.ndarray, " t"]
    yaw_rate: Float64[np.ndarray, " t"]


@dataclasses.dataclass(frozen=True, eq=False)
class Trajectory:
    """A plan in time.

    Attributes:
        origin: where it starts [m], ENU.
        control: (n, 3) control points of the position, relative to the origin [m].
        headings: (n,) control points of the yaw [rad].
        step: time between control points [s].
        limits: that it keeps.
        radius: distance to obstacles that it keeps outside the exemptions [m], as its plan.
        exemptions: radii in which it does not [m], one around each waypoint of `passes`; 0: none.
        clearance: least distance to the cube of an occupied voxel [m], ground left out, to a millimetre.
        rests: (k,) times at which it rests between start and goal [s], where asked or where no rounded corner is clear.
        passes: (w,) times at which it is at the waypoints of its mission, or nearest to them [s]; it leaves one that it
            hovers at later. Of a plan: start and goal.
        plan: that it times, or the mission.
    """

    origin: Point3
    control: Float64[np.ndarray, "n 3"]
    headings: Float64[np.ndarray, " n"]
    step: float
    limits: FlightLimits
    radius: float
    exemptions: tuple[float, ...]
    clearance: float
    rests: Float64[np.ndarray, " k"]
    passes: Float64[np.ndarray, " w"]
    plan: Plan | Mission = dataclasses.field(repr=False)

    @property
    def map(self) -> VoxelMap:
        """That the plan was verified in."""
        return self.plan.map

    @property
    def duration(self) -> float:
        """Time from start to goal [s]."""
        return spline.duration(self.control, self.step)

    def at(self, time: ArrayLike) -> Motion:
        """Where it is and how it moves at some times.

        Args:
            time: (t,) [s], not falling; before 0 it rests at its start, after `duration` at its goal.

        Raises:
            ValueError: for times that are not finite, not in a row, or run backwards.
        """
        times = np.asarray(time, np.float64)
        if times.ndim != 1 or not np.isfinite(times).all():
            raise ValueError(f"time: expected a row of finite numbers [s], given {time!r}")
        falls = np.flatnonzero(np.diff(times) < 0.0)
        if falls.size:
            k = int(falls[0])
            raise ValueError(
                f"time: expected times that do not fall, given {times[k]} s and then {times[k + 1]} s; sort them"
            )
        position, velocity, acceleration, jerk = (
            spline.evaluate(self.control, self.step, times, order) for order in range(4)
        )
        outside = (times < 0.0) | (times > self.duration)
        yaw, rate = (spline.evaluate(self.headings, self.step, times, order) for order in range(2))
        for derivative in (velocity, acceleration, jerk, rate):
            derivative[outside] = 0.0
        return Motion(times, np.array(self.origin) + position, velocity, acceleration, jerk, yaw, rate)

    def sampled(self, every: float) -> Motion:
        """`at` times that are `every` [s] apart, from 0 on, and at the duration.

        Raises:
            ValueError: unless `every` is a positive finite number.
        """
        if not 0.0 < every < np.inf:
            raise ValueError(f"every: expected a positive number of seconds, given {every}")
        times = every * np.arange(int(np.ceil(self.duration / every)))
        return self.at(np.append(times[times < self.duration], self.duration))
