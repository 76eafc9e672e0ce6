"""The set-points of ArduCopter's AUTO: legs from rest to rest, the next of which begins while the present one ends.

    target(t) = w₀ + Σ uₖ sₖ(t − tₖ)        uₖ: direction of a leg,  sₖ: its S-curve (`io.export.s_curve`)

The next leg begins as soon as the present one brakes and has no more time left than the next one accelerates for, and
the sum half-way through that time, its corner, is

    nearer to the waypoint than its radius, slower than either leg's greatest speed, and
    accelerated by less than in corners horizontally, than either leg vertically

So two legs at most are in motion at a time: the one before has ended when a leg has accelerated, and that brakes later.
Where it never holds, the leg ends at rest, as it does at a waypoint with a hold.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float64

from maxjax.io.export.autopilot import Autopilot, MissionLimits
from maxjax.io.export.s_curve import LegLimits, SCurve, Vector

_STEP = 0.01  # between times at which a leg may begin [s]
_NOTHING = 1e-6  # shorter legs are none [m]
_FASTEST_RESPONSE = 0.1  # that ArduCopter counts with [s]

Vectors = Float64[np.ndarray, "_ 3"]


@dataclasses.dataclass(frozen=True, eq=False)
class Leg:
    """A straight way between two waypoints in motion.

    Attributes:
        motion: along it.
        direction: of it, a unit vector.
        speed: greatest along it [m/s].
        start: when it begins [s].
    """

    motion: SCurve
    direction: Float64[np.ndarray, " 3"]
    speed: float
    start: float = 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Targets:
    """Set-points in time.

    Attributes:
        times: [s], evenly spaced.
        position, velocity, acceleration: [m], [m/s], [m/s²], ENU.
    """

    times: Vector
    position: Vectors
    velocity: Vectors
    acceleration: Vectors


def blended_legs(places: Vectors, speeds: Vector, holds: Vector, autopilot: Autopilot) -> list[Leg]:
    """The legs between waypoints with the times at which they begin.

    Args:
        places: of the waypoints [m].
        speeds: greatest horizontal one on the way to each [m/s]; NaN: the autopilot's own.
        holds: at each [s].
        autopilot: whose limits and radius count.
    """
    legs, waits = list[Leg](), 0.0
    for k in range(len(places) - 1):
        way = places[k + 1] - places[k]
        waits += autopilot.holds(float(holds[k])) if autopilot.rests(float(holds[k])) else 0.0
        if np.linalg.norm(way) < _NOTHING:
            continue
        leg = _leg(way, float(speeds[k + 1]), autopilot.mission)
        blends = bool(legs) and waits == 0.0
        start = legs[-1].start + _begins(legs[-1], leg, autopilot) if blends else duration_of(legs) + waits
        legs.append(dataclasses.replace(leg, start=start))
        waits = 0.0
    return legs


def _leg(way: Float64[np.ndarray, " 3"], speed: float, limits: MissionLimits) -> Leg:
    length = float(np.linalg.norm(way))
    direction = way / length
    level, up = math.hypot(direction[0], direction[1]), float(direction[2])
    speed = limits.speed if math.isnan(speed) else speed
    fastest = min(_along(level, speed), _along(abs(up), limits.ascent if up > 0.0 else limits.descent))
    hardest = min(_along(level, limits.acceleration), _along(abs(up), limits.vertical_acceleration))
    # Half of the snap with which the lean can follow.
    snap = 0.25 * math.pi * limits.jerk / max(limits.response, _FASTEST_RESPONSE)
    return Leg(SCurve.of(length, LegLimits(fastest, hardest, limits.jerk, snap)), direction, fastest)


def _along(share: float, limit: float) -> float:
    """Greatest magnitude of which a share is within a limit."""
    return limit / share if share > 1e-9 else math.inf


def _begins(leg: Leg, after: Leg, autopilot: Autopilot) -> float:
    """When the next leg begins, from the start of this one on [s]; at its end where nothing else is possible."""
    one, two, limits = leg.motion, after.motion, autopilot.mission
    times = np.arange(max(one.brakes, one.duration - two.accelerates), one.duration, _STEP)
    half = 0.5 * (one.duration - times)
    here, there = one.at(times + half), two.at(half)
    apart = np.outer(here[0] - one.length, leg.direction) + np.outer(there[0], after.direction)
    velocity = np.outer(here[1], leg.direction) + np.outer(there[1], after.direction)
    acceleration = np.outer(here[2], leg.direction) + np.outer(there[2], after.direction)
    fits = (
        (np.linalg.norm(apart, axis=1) < autopilot.corner_radius)
        & (np.linalg.norm(velocity, axis=1) < min(leg.speed, after.speed))
        & (np.hypot(acceleration[:, 0], acceleration[:, 1]) < limits.corner_acceleration)
        & (np.abs(acceleration[:, 2]) < limits.vertical_acceleration)
    )
    return float(times[fits.argmax()]) if fits.any() else one.duration


def duration_of(legs: list[Leg]) -> float:
    """When the last leg ends [s]."""
    return legs[-1].start + legs[-1].motion.duration if legs else 0.0


def targets_of(origin: Float64[np.ndarray, " 3"], legs: list[Leg], step: float) -> Targets:
    """The set-points of some legs, a step apart [s], until the last one has ended."""
    times = np.arange(math.ceil(duration_of(legs) / step) + 1) * step
    position = np.tile(np.asarray(origin, np.float64), (len(times), 1))
    velocity, acceleration = np.zeros_like(position), np.zeros_like(position)
    for leg in legs:
        first, last = np.searchsorted(times, [leg.start, leg.start + leg.motion.duration])
        way, speed, hardness = leg.motion.at(times[first:last] - leg.start)
        position[first:last] += np.outer(way, leg.direction)
        velocity[first:last] += np.outer(speed, leg.direction)
        acceleration[first:last] += np.outer(hardness, leg.direction)
        position[last:] += leg.motion.length * leg.direction
    return Targets(times, position, velocity, acceleration)
