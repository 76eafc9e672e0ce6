"""From a mission to one trajectory: stretches between waypoints at rest, each scheduled by itself, end to end.

    mission → stretches → trajectory of each (`trajectories.schedule`) → pauses between them → Trajectory

It rests at a waypoint where that is asked for, where the path turns back by more than 120 degrees, where the waypoint
has an exemption, and where the radius changes: on both sides of a rest the verifier is asked about one radius. All
other waypoints are flown through, within `FlightLimits.deviation` of them.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from jaxtyping import Float64

from maxjax.core.status import Status
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan
from maxjax.trajectories import spline
from maxjax.trajectories.clear_curve import ClearCurve
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.schedule import schedule_plan
from maxjax.trajectories.trajectory import Trajectory
from maxjax.trajectories.yaw_profile import Aim, headings

_TURNED_BACK = math.cos(math.radians(120.0))
_ABOUT = 5.0  # [m]; rounded corners make a way this much shorter at most


def schedule_mission(mission: Mission, limits: FlightLimits) -> Trajectory:
    """The trajectory of a mission; see `maxjax.trajectory`.

    Raises:
        ValueError: for a mission that is not OK.
    """
    if mission.status != Status.OK:
        raise ValueError(f"mission: expected one that is OK, given {mission.status.name}: {mission.status.advice}")
    rests = [0, *(k for k in range(1, len(mission.legs)) if _is_rest(mission, k)), len(mission.legs)]
    parts = []
    for first, last in itertools.pairwise(rests):
        plan = _stretch(mission, first, last)
        parts.append(schedule_plan(plan, limits, {}, ClearCurve.of(plan), _speeds(mission, first, last, limits)))
    return _end_to_end(mission, rests, parts)


def _is_rest(mission: Mission, k: int) -> bool:
    before, after = mission.legs[k - 1], mission.legs[k]
    if mission.waypoints[k].hover is not None or before.radius != after.radius:
        return True
    if before.exemptions[1] > 0.0 or after.exemptions[0] > 0.0 or not np.array_equal(before.path[-1], after.path[0]):
        return True
    arrives, leaves = before.path[-1] - before.path[-2], after.path[1] - after.path[0]
    return bool(arrives @ leaves < _TURNED_BACK * np.linalg.norm(arrives) * np.linalg.norm(leaves))


def _stretch(mission: Mission, first: int, last: int) -> Plan:
    """The plan from one waypoint to another, over all legs in between."""
    legs = mission.legs[first:last]
    path = mission.path[mission.places[first] : mission.places[last] + 1]
    at = np.concatenate([legs[0].clearance_at, *(leg.clearance_at[1:] for leg in legs[1:])])
    return dataclasses.replace(
        legs[0],
        path=path,
        # The end of the leg before comes first where its own begins aside from it.
        clearance_at=np.pad(at, (len(path) - len(at), 0), "edge"),
        exemptions=(legs[0].exemptions[0], legs[-1].exemptions[1]),
    )


def _speeds(mission: Mission, first: int, last: int, limits: FlightLimits) -> Float64[np.ndarray, " e"]:
    """Greatest speed on each edge of a stretch [m/s]."""
    asked = [waypoint.speed or limits.speed for waypoint in mission.waypoints[first + 1 : last + 1]]
    return np.repeat(np.minimum(asked, limits.speed), np.diff(mission.places[first : last + 1]))


def _end_to_end(mission: Mission, rests: list[int], parts: list[Trajectory]) -> Trajectory:
    """One trajectory of some that begin and end at rest, with the longest of their steps: it keeps all limits."""
    step, first = max(part.step for part in parts), parts[0]
    hovers = [math.ceil((waypoint.hover or 0.0) / step) for waypoint in mission.waypoints]
    control = np.repeat(first.control[:1], hovers[0] + 3, axis=0)
    stops, passes = [], [np.zeros(1)]
    for part, start, goal in zip(parts, rests[:-1], rests[1:], strict=True):
        leaves, slower = spline.duration(control, step), step / part.step
        stops.append(leaves + slower * part.rests)
        passes.append(leaves + slower * _passes(mission, start, goal, part))
        # A part and what is there already have three equal control points at the rest, of which one set stays.
        shifted = part.control[3:] + (control[-1] - part.control[0])
        control = np.concatenate([control, shifted, np.repeat(shifted[-1:], hovers[goal], axis=0)])
        stops.append(passes[-1][-1:])
    aims = _aims(mission, np.concatenate(passes), hovers, step)
    return dataclasses.replace(
        first,
        control=control,
        headings=headings(control + np.array(first.origin), step, first.limits.yaw_rate, aims),
        step=step,
        radius=mission.radius,
        exemptions=tuple(_exemption(mission, k) for k in range(len(mission.waypoints))),
        clearance=float(np.min([part.clearance for part in parts])),
        rests=np.concatenate(stops[:-1]),
        passes=np.concatenate(passes),
        plan=mission,
    )


def _aims(mission: Mission, passes: Float64[np.ndarray, " w"], hovers: list[int], step: float) -> list[Aim]:
    """Where the nose points on the way to each waypoint; the start has its own while the vehicle rests there."""
    pairs = zip(mission.waypoints, passes.tolist(), hovers, strict=True)
    return [Aim(waypoint, at + step * hover, waypoint.hover is not None) for waypoint, at, hover in pairs]


def _exemption(mission: Mission, k: int) -> float:
    """Radius of the exemption around a waypoint, in which the legs to and from it need not keep theirs [m]."""
    before = mission.legs[k - 1].exemptions[1] if k > 0 else 0.0
    if k == len(mission.legs) or mission.legs[k].exemptions[0] == 0.0:
        return before
    # The leg from here may begin aside from where the one before ends.
    after = mission.legs[k]
    return max(before, after.exemptions[0] + math.dist(mission.path[mission.places[k]], after.path[0]))


def _passes(mission: Mission, first: int, last: int, part: Trajectory) -> Float64[np.ndarray, " w"]:
    """Times of a stretch at which it is nearest to each of its waypoints but the first, in order [s]."""
    path = mission.path[mission.places[first] : mission.places[last] + 1]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    motion = part.sampled(part.step)
    flown = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(motion.position, axis=0), axis=1))])
    found = []
    for place in mission.places[first + 1 : last] - mission.places[first]:
        # A path may come by more than once: about as far along the way as the plan has it.
        off = np.abs(flown * (along[-1] / flown[-1]) - along[place])
        away = np.linalg.norm(motion.position - path[place], axis=1)
        found.append(motion.time[np.argmin(np.where(off <= max(_ABOUT, off.min()), away, math.inf))])
    return np.array([*found, part.duration])
