"""What a vehicle on board is told of movers with each scan: who is there, which motion to fly, and what is flagged.

    set-point at time t = the motion that is flown then, t − its start later

Frame: world, ENU; times are those of the scans.
"""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Float64, Real

from maxjax.compile.executable import Stored
from maxjax.sim.movers.motions import MotionPrimitive, at
from maxjax.sim.sensors.own_returns import ReturnCounts

# Times that a program takes at once.
_AT_ONCE = 64


@dataclasses.dataclass(frozen=True, eq=False)
class SensorScan:
    """A scan of a vehicle's own sensor, and where the vehicle was at its end.

    Attributes:
        returns: points in the frame of the sensor, in any order (n, 3) [m], or the distance of each ray (r,) [m] in the
            order of `maxjax.sim.sensors.lidar.directions`. NaN, infinity, a distance of 0 and the point (0, 0, 0) are
            beams without a return.
        position: of the sensor, world frame [m]. NaN: unknown.
        rotation: sensor frame -> world frame. NaN: unknown.
        velocity: of the vehicle, world frame [m/s].
        time: of the end of the scan [s], by a clock that goes on from call to call.
    """

    returns: Real[Array | np.ndarray, "n 3"] | Real[Array | np.ndarray, " r"]
    position: Real[Array | np.ndarray, " 3"]
    rotation: Real[Array | np.ndarray, "3 3"]
    velocity: Real[Array | np.ndarray, " 3"]
    time: float


@dataclasses.dataclass(frozen=True, eq=False)
class MotionSamples:
    """Set-points of a motion: positions [m], velocities [m/s] and accelerations [m/s²], world frame."""

    positions: Float64[np.ndarray, "n 3"]
    velocities: Float64[np.ndarray, "n 3"]
    accelerations: Float64[np.ndarray, "n 3"]


@dataclasses.dataclass(frozen=True, eq=False)
class CommittedMotion:
    """The motion to fly, at any time.

    Attributes:
        begins: when the motion that was chosen last begins [s]; until then those before it are flown.
        ends: when it comes to rest [s].
        verified: until when it is verified [s]; at `begins` or before: it is not, and `TRAPPED` is up.
        pieces: motions and when each begins [s], in the order of time; in a frame of their own.
        origin: of that frame [m].
    """

    begins: float
    ends: float
    verified: float
    pieces: tuple[tuple[float, MotionPrimitive], ...] = dataclasses.field(repr=False)
    origin: Float64[np.ndarray, " 3"] = dataclasses.field(repr=False)

    def at(self, times: Real[np.ndarray, " n"] | float) -> MotionSamples:
        """Set-points at times [s]; before the first of what is known its start, after the end rest. Compiles nothing.

        Raises:
            ValueError: for times that are not finite.
        """
        asked = np.atleast_1d(np.asarray(times, np.float64))
        if asked.ndim != 1 or not np.isfinite(asked).all():
            raise ValueError(f"times: expected finite numbers [s] in one row, given {times!r}")
        begin = np.array([start for start, _ in self.pieces])
        piece = np.maximum(np.searchsorted(begin, asked, side="right") - 1, 0)
        leaves = [
            np.stack(x) for x in zip(*(map(np.asarray, jax.tree.leaves(one)) for _, one in self.pieces), strict=True)
        ]
        since = np.maximum(asked - begin[piece], 0.0).astype(np.float32)
        found = []
        for first in range(0, max(len(asked), 1), _AT_ONCE):
            rows = np.pad(piece[first : first + _AT_ONCE], (0, _AT_ONCE))[:_AT_ONCE]
            some = np.pad(since[first : first + _AT_ONCE], (0, _AT_ONCE))[:_AT_ONCE]
            *given, times_since = jax.device_put([*(x[rows] for x in leaves), some])
            motion = jax.tree.unflatten(jax.tree.structure(self.pieces[0][1]), given)
            found.append([np.asarray(x, np.float64) for x in SAMPLED(motion, times_since)])
        place, velocity, acceleration = (np.concatenate(x)[: len(asked)] for x in zip(*found, strict=True))
        return MotionSamples(place + self.origin, velocity, acceleration)


@dataclasses.dataclass(frozen=True, eq=False)
class Traffic:
    """Movers around a vehicle at the end of a scan, and its motion among them; n of them are followed.

    Attributes:
        places, velocities: best estimates [m], [m/s]: for labels, never for proofs.
        least, greatest: coordinates of boxes that hold their bodies [m], as far as they keep their bounds.
        confirmed: which motions keep away from. Of others too little was seen, or they never moved.
        rests: which have come to rest: the map has them, too.
        motion: to fly.
        flags: names of assumptions that fail: those of `maxjax.sim.movers.among.Flag`, and POSE, BLIND and CLOCK.
        returns: what became of the returns of the scan.
        clear: length of `Replanned.plan` that movers leave clear within the horizon of motions [m], whatever the speed;
            infinity: all that can be reached until then. NaN without a plan.
    """

    places: Float64[np.ndarray, "n 3"]
    velocities: Float64[np.ndarray, "n 3"]
    least: Float64[np.ndarray, "n 3"]
    greatest: Float64[np.ndarray, "n 3"]
    confirmed: Bool[np.ndarray, " n"]
    rests: Bool[np.ndarray, " n"]
    motion: CommittedMotion
    flags: frozenset[str]
    returns: ReturnCounts
    clear: float


def _at(motion: MotionPrimitive, time: Float[Array, " n"]) -> tuple[Array, Array, Array]:
    return at(motion, time)


SAMPLED = Stored("samples of a motion", _at)
"""Place, velocity and acceleration of motions at times, so many at once."""
