"""What a vehicle flies of the set-points p of an autopilot whose clock waits for it: position x, velocity v.

    a = p″ + 2 (e + p′ − v) + ∫(e + p′ − v) dt,   e = p − x      asked for; the gains are ArduCopter's defaults
    v′ = a, twice delayed by the response of the lean,  − (d₁ + d₂ |v|) v        drag of the air
    dT/dt → ¹/₂₀ + (v − e)·p′ / |p′|²  in [0, 1], within acceleration / jerk     the clock T of the set-points

The integral holds the lean that drag asks for. It lets go of it slowly, so that a vehicle that brakes runs over its
set-point and cuts corners by half a metre less than that does. Drag is that of a small quadrotor, which 45 degrees of
lean hold at 15 m/s, half of it in proportion to the speed and half to its square. Still air.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.blended_legs import Targets, Vectors, blended_legs, duration_of, targets_of
from maxjax.io.export.corners import Waypoints
from maxjax.io.export.px4_pace import px4_duration

_STEP = 0.02  # [s]
_SHOWN = 5  # steps between points of a track
TRACK_STEP = _STEP * _SHOWN
"""Time between points of a track [s]."""
_AFTER = 3.0  # how long a vehicle is looked at after its last set-point [s]
_GAIN, _INTEGRAL = 2.0, 1.0  # of the velocity; that of the position is 1 [1/s]
_DRAG = 0.325, 0.0215  # [1/s], [1/m]
_HEADROOM = 0.05  # of the clock
_MOST = 4  # of the steps that the set-points take: a vehicle that needs more never arrives


@dataclasses.dataclass(frozen=True, eq=False)
class FlownTrack:
    """A flight from the first waypoint to the last one.

    Attributes:
        duration: [s]; infinite where the vehicle cannot follow.
        points: of the vehicle [m].
        swing: how far it is from its set-point, at most [m].
        timed: whether the points are 0.1 s apart; else they are the ends of straight lines.
    """

    duration: float
    points: Vectors
    swing: float
    timed: bool = True


def set_point_duration(waypoints: Waypoints, autopilot: Autopilot) -> float:
    """How long an autopilot's set-points take from the first waypoint to the last one [s], if the vehicle keeps up."""
    places, holds = waypoints.places, waypoints.holds
    if autopilot.name == "px4":
        return px4_duration(places, waypoints.speeds_to, holds, waypoints.accepted, autopilot)
    return duration_of(blended_legs(places, waypoints.speeds_to, holds, autopilot))


def fly_track(waypoints: Waypoints, autopilot: Autopilot) -> FlownTrack:
    """The track of an autopilot from waypoint to waypoint, from rest at the first one.

    That of PX4 are the straight lines: how it cuts corners, `io.export.corners` bounds.
    """
    places = np.asarray(waypoints.places, np.float64)
    if autopilot.name == "px4":
        return FlownTrack(set_point_duration(waypoints, autopilot), places, 0.0, timed=False)
    legs = blended_legs(places, waypoints.speeds_to, waypoints.holds, autopilot)
    if not legs:
        return FlownTrack(0.0, places[:1], 0.0, timed=False)
    lag = _STEP / max(autopilot.mission.response, 2.0 * _STEP)
    patience = min(1.0, _STEP * autopilot.mission.jerk / autopilot.mission.acceleration)
    return _follow(targets_of(places[0], legs, _STEP), lag, patience)


def _follow(targets: Targets, lag: float, patience: float) -> FlownTrack:
    """The track of a vehicle: lag and patience are the shares of a step of its response and of its clock's."""
    end, last = float(targets.times[-1]), len(targets.times) - 1
    position, velocity = targets.position[0].copy(), np.zeros(3)
    held, first, second = np.zeros(3), np.zeros(3), np.zeros(3)
    pace, clock, took, swing = 1.0, 0.0, math.inf, 0.0
    points = [position]
    for step in range(1, _MOST * (last + math.ceil(_AFTER / _STEP))):
        k = min(int(clock / _STEP + 0.5), last)
        aim = targets.velocity[k]
        off = targets.position[k] - position
        wrong = aim - velocity + off
        held = held + _INTEGRAL * _STEP * wrong
        first = first + lag * (targets.acceleration[k] + _GAIN * wrong + held - first)
        second = second + lag * (first - second)
        drag = _DRAG[0] + _DRAG[1] * float(velocity @ velocity) ** 0.5
        velocity = velocity + _STEP * (second - drag * velocity)
        position = position + _STEP * velocity
        squared = float(aim @ aim)
        keeps = _HEADROOM + float(aim @ (velocity - off)) / squared if squared > 1e-12 else 1.0
        pace += patience * (min(max(keeps, 0.0), 1.0) - pace)
        clock += pace * _STEP
        took = min(took, step * _STEP) if clock >= end else math.inf
        swing = max(swing, float(off @ off))
        if step % _SHOWN == 0:
            points.append(position)
        if clock >= end + _AFTER:
            break
    return FlownTrack(took, np.array(points), swing**0.5)
