"""What a trajectory takes out of a battery, leg by leg.

    E(t) = take-off + ∫ P dt,   P of the velocity through the air: that over ground less the wind's

Take-off and landing are upright, from the ground below the start and to that below the goal, where the map knows it, or
to the roof that a mission ends on; at `RISE` and `SINK`, the speeds of autopilots near the ground. Hovers are part of
the trajectory, and count with the leg that leads to them.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float64

from maxjax.energy.airframe import Airframe
from maxjax.energy.battery import Battery
from maxjax.energy.power import power
from maxjax.energy.wind import Wind
from maxjax.planning.mission import Mission
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.trajectory import Motion, Trajectory

RISE, SINK = 1.0, 0.5  # of take-off and landing [m/s]
_EVERY = 0.05  # [s]
_HOUR = 3600.0
_AT_REST = 1e-3  # below which a vehicle hovers [m/s]

Rows = Float64[np.ndarray, " t"]


@dataclasses.dataclass(frozen=True, eq=False)
class Consumption:
    """Energy of a flight; one row a time, 0.05 s apart.

    Attributes:
        time: since the trajectory's start [s].
        power: out of the battery [W].
        energy: taken until then, the take-off with it [Wh].
        back: that it takes from there to stop, to fly the same way back, without hovers, and to land at the start [Wh].
        takeoff, landing: [Wh]; 0 where the map knows no ground there.
        legs: of each leg with the hover at its end [Wh], without take-off and landing.
        airspeed: greatest one [m/s].
    """

    time: Rows
    power: Rows
    energy: Rows
    back: Rows
    takeoff: float
    landing: float
    legs: Float64[np.ndarray, " k"]
    airspeed: float

    @property
    def total(self) -> float:
        """From the ground to the ground [Wh]."""
        return float(self.energy[-1]) + self.landing

    def charge(self, battery: Battery) -> Rows:
        """State of charge over time, a share; negative where the battery is empty before."""
        left: Rows = 1.0 - self.energy / battery.capacity
        return left

    def charge_after(self, battery: Battery) -> Float64[np.ndarray, " k"]:
        """State of charge at the end of each leg, a share; that of the last one on the ground."""
        taken = self.takeoff + np.cumsum(self.legs)
        taken[-1] = self.total
        left: Float64[np.ndarray, " k"] = 1.0 - taken / battery.capacity
        return left


def measure_consumption(trajectory: Trajectory, airframe: Airframe, wind: Wind | None = None) -> Consumption:
    """Energy along a trajectory.

    Args:
        trajectory: of a plan or a mission.
        airframe: that flies it.
        wind: over its time. None: there is none.

    Raises:
        ValueError: if the wind, or the trajectory in it, is faster than the airframe.
    """
    wind = Wind.calm() if wind is None else wind
    if wind.strongest >= airframe.airspeed:
        raise ValueError(
            f"wind: expected less than the {airframe.airspeed:g} m/s that {airframe.name} flies, given "
            f"{wind.strongest:g} m/s; it would be carried away"
        )
    motion = trajectory.sampled(_EVERY)
    air = wind.at(motion.time)
    through = motion.velocity - air
    fastest = float(np.linalg.norm(through, axis=1).max())
    if fastest > airframe.airspeed:
        raise ValueError(
            f"airspeed: expected at most {airframe.airspeed:g} m/s of {airframe.name}, this flight asks for "
            f"{fastest:.1f} m/s; give a lower speed, or wait for less wind"
        )
    taken = power(airframe, through, motion.acceleration)
    takeoff, landing, home = _upright(trajectory, airframe, wind)
    energy = takeoff + _integral(motion.time, taken)
    return Consumption(
        motion.time,
        taken,
        energy,
        home + _way_back(airframe, motion, air, trajectory.limits),
        takeoff,
        landing,
        np.diff(np.interp(_ends(trajectory), motion.time, energy)),
        fastest,
    )


def _way_back(airframe: Airframe, motion: Motion, air: Float64[np.ndarray, "t 3"], limits: FlightLimits) -> Rows:
    """Energy of the way back from each place to the start [Wh].

    Per second of the way there, backwards, slower where the airframe could not keep its speed; and of the turn: to
    brake, and to come back to where that began, takes 2 (v / a + a / j), at the greatest power of the way and a hover.
    """
    speed, blows = np.linalg.norm(motion.velocity, axis=1), np.linalg.norm(air, axis=1)
    share = np.minimum((airframe.airspeed - blows) / np.maximum(speed, 1e-9), 1.0)[:, None]
    taken = power(airframe, -share * motion.velocity - air, motion.acceleration)
    there = power(airframe, motion.velocity - air, motion.acceleration)
    still = power(airframe, -air, np.zeros_like(air))
    calm = power(airframe, np.zeros((1, 3)), np.zeros((1, 3)))
    moves = speed > _AT_REST
    turn = np.where(moves, 2.0 * (speed / limits.acceleration + limits.acceleration / limits.jerk), 0.0)
    flown = _integral(motion.time, np.where(moves, taken / share[:, 0], 0.0))
    found: Rows = flown + turn * np.maximum.reduce([taken, there, still, np.broadcast_to(calm, still.shape)]) / _HOUR
    return found


def _integral(time: Rows, watts: Rows) -> Rows:
    """∫ P dt from the first time on [Wh], by trapezoids."""
    parts = 0.5 * (watts[1:] + watts[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(parts)]) / _HOUR


def _ends(trajectory: Trajectory) -> Rows:
    """When each leg ends, the hover after it over, and the start [s]."""
    passes = trajectory.passes
    waypoints = trajectory.plan.waypoints if isinstance(trajectory.plan, Mission) else ()
    hovers = [waypoint.hover or 0.0 for waypoint in waypoints] or [0.0] * len(passes)
    ends = passes + np.array(hovers)
    ends[0], ends[-1] = 0.0, trajectory.duration
    found: Rows = np.minimum(ends, trajectory.duration)
    return found


def _upright(trajectory: Trajectory, airframe: Airframe, wind: Wind) -> tuple[float, float, float]:
    """Energy of take-off, of landing at the goal and of landing at the start [Wh]."""
    start, goal = trajectory.at([0.0, trajectory.duration]).position
    first, last = wind.at(np.array([0.0, trajectory.duration]))
    plan = trajectory.plan
    roof = plan.touchdown if isinstance(plan, Mission) else None
    end = _height(trajectory, goal) if roof is None else float(goal[2]) - roof.height
    heights = [_height(trajectory, start), end, _height(trajectory, start)]
    speeds = RISE, -SINK, -SINK
    up, down, home = (
        upright_energy(airframe, speed, height, air)
        for speed, height, air in zip(speeds, heights, (first, last, last), strict=True)
    )
    return up, down, home


def _height(trajectory: Trajectory, place: Float64[np.ndarray, "3"]) -> float:
    """Above the ground [m]; 0 where the map knows none."""
    x, y, z = place.tolist()
    ground = trajectory.map.terrain.at(x, y)
    return max(z - ground, 0.0) if np.isfinite(ground) else 0.0


def upright_energy(airframe: Airframe, speed: float, height: float, air: Float64[np.ndarray, "3"]) -> float:
    """Energy of a way straight up or down [Wh].

    Args:
        airframe: that flies.
        speed: upwards, negative: downwards [m/s].
        height: of the way [m].
        air: velocity of the air, ENU [m/s].
    """
    taken = power(airframe, np.array([[0.0, 0.0, speed]]) - air, np.zeros((1, 3)))
    return float(taken[0]) * height / abs(speed) / _HOUR
