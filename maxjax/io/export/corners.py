"""Corners as an autopilot cuts them: where it may be on its way from each waypoint of a file to the next one.

An autopilot leaves a waypoint as soon as it is within its radius of it, and flies straight to the next one: not
from the waypoint, but from any place of the way to it that lies within the radius.

    S₀ = {w₀},    Sₖ = the parts within the radius of wₖ of the segments from Sₖ₋₁ to wₖ; {wₖ} where it rests
    flown = the segments from every place of Sₖ to wₖ₊₁

So a radius that holds several waypoints, as dense paths have them, is followed through all of them. ArduCopter also
blends legs: while one is braked out the next begins, and the curve misses the waypoint by at most the radius. With
steps b along the next leg and a before the end of this one,

    √a + √b ≤ √a₀,    a₀ = 4 r / |u₂ − u₁|,    no more than half of either leg

lies in two triangles that meet the bisector at the distance r of the waypoint.

Places are taken `_STEP` apart, so that what lies between two segments is known to half of it; `SLACK` is that, and what
digits may move a file. How the vehicle swings about its set-point is not part of this: the radius is for that.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float64, Int64

from maxjax.core.voxel_map import VoxelMap
from maxjax.io.export.autopilot import Autopilot
from maxjax.planning.mission import Mission
from maxjax.verification.polylines import Paths
from maxjax.verification.verifier import verify, verify_paths

SLACK = 0.1  # of the radius to keep [m]
_STEP = 0.1  # between places from which a waypoint is left [m]
_CELL = 0.025  # places nearer to one another than this are one [m]
_MOST = 4000  # places of one waypoint; where there are more, it is one to stop at

Points = Float64[np.ndarray, "_ 3"]
Segments = Float64[np.ndarray, "_ 2 3"]


@dataclasses.dataclass(frozen=True, eq=False)
class Waypoints:
    """The waypoints of a file.

    Attributes:
        places: in the map [m].
        holds: how long to hold at each [s].
        accepted: acceptance radius of each item [m].
        rise: the upright way to the first one, where there is a take-off.
        lands: whether the last one is left, to land.
        speeds: greatest horizontal one on the way to each [m/s]; NaN, or None: the autopilot's own.
    """

    places: Points
    holds: Float64[np.ndarray, " n"]
    accepted: Float64[np.ndarray, " n"]
    rise: Points | None = None
    lands: bool = False
    speeds: Float64[np.ndarray, " n"] | None = None

    @property
    def speeds_to(self) -> Float64[np.ndarray, " n"]:
        """The speeds, NaN where there are none."""
        return np.full(len(self.places), math.nan) if self.speeds is None else self.speeds


@dataclasses.dataclass(frozen=True, eq=False)
class _Flown:
    """Segments that may be flown, and why.

    Attributes:
        segments: start and end of each [m].
        corner: number of the waypoint whose corner makes each possible.
        leg: of the mission, whose radius each has to keep.
    """

    segments: Segments
    corner: Int64[np.ndarray, " n"]
    leg: Int64[np.ndarray, " n"]


def cut_corners(waypoints: Waypoints, mission: Mission, autopilot: Autopilot) -> tuple[dict[int, float], float]:
    """The waypoints whose corners, as an autopilot cuts them, lead too near to something.

    Args:
        waypoints: of a file, one for each point of the mission's path.
        mission: that it holds.
        autopilot: that flies it.

    Returns:
        Least clearance [m] of those that come nearer than their leg's radius, less `SLACK`, by number; 0 also where it
        leaves the map or comes onto what is closed, NaN where it has to be stopped at whatever is near. And the least
        clearance of all corners [m].
    """
    flown, crowded = _flown(waypoints, mission, autopilot)
    found, least = dict.fromkeys(crowded, math.nan), math.inf
    for number in np.unique(flown.leg).tolist():
        here = flown.leg == number
        clearance, passes = _kept(flown.segments[here], waypoints.places, mission, number)
        corner = flown.corner[here]
        least = min(least, float(clearance.min()))
        for k in np.unique(corner[~passes]).tolist():
            found[k] = min(found.get(k, math.inf), float(clearance[(corner == k) & ~passes].min()))
    return found, least


def _flown(waypoints: Waypoints, mission: Mission, autopilot: Autopilot) -> tuple[_Flown, list[int]]:
    """Ways beside the straight legs that may be flown, and waypoints with too many places to leave from."""
    places, last = waypoints.places, len(waypoints.places) - 1
    leg_of = np.searchsorted(mission.places, np.arange(last), side="right") - 1
    segments, corners, legs, crowded = list[Segments](), list[int](), list[int](), list[int]()

    def add(some: Segments, corner: int, leg: int) -> None:
        segments.append(some)
        corners.extend([corner] * len(some))
        legs.extend([leg] * len(some))

    starts = places[:1] if waypoints.rise is None else waypoints.rise[:1]
    for k in range(waypoints.rise is None, last):
        radius = autopilot.radius_of(float(waypoints.accepted[k]))
        starts = _left_from(starts, places[k], radius, autopilot.height_radius)
        if autopilot.rests(float(waypoints.holds[k])):
            starts = places[k : k + 1]
            continue
        if len(starts) > _MOST:
            crowded.append(k)
            starts = places[k : k + 1]
            continue
        add(np.stack([starts, np.broadcast_to(places[k + 1], starts.shape)], axis=1), k, int(leg_of[k]))
        if autopilot.name == "arducopter" and k > 0:
            for side, blend in enumerate(_blend(places[k - 1 : k + 2], radius)):
                add(blend, k, int(leg_of[k - 1 + side]))
    if waypoints.lands and not autopilot.rests(float(waypoints.holds[last])):
        crowded.append(last)
    flown = np.concatenate(segments) if segments else np.zeros((0, 2, 3))
    return _Flown(flown, np.array(corners, np.int64), np.array(legs, np.int64)), crowded


def _left_from(starts: Points, goal: Float64[np.ndarray, " 3"], radius: float, height: float | None) -> Points:
    """Places within the radii of a waypoint on the segments to it from some starts, the waypoint among them."""
    back = starts - goal
    if height is None:
        within = _share(np.linalg.norm(back, axis=1), radius)
    else:
        within = np.minimum(_share(np.hypot(back[:, 0], back[:, 1]), radius), _share(np.abs(back[:, 2]), height))
    reach = back * within[:, None]
    count = 1 + math.ceil(float(np.linalg.norm(reach, axis=1).max()) / _STEP)
    found = goal + (np.linspace(0.0, 1.0, count + 1)[:, None, None] * reach).reshape(-1, 3)
    cells = np.round((found - goal) / _CELL).astype(np.int64)
    cells -= cells.min(axis=0)
    _, first = np.unique(np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1)), return_index=True)
    kept: Points = found[first]
    return kept


def _share(distance: Float64[np.ndarray, " n"], radius: float) -> Float64[np.ndarray, " n"]:
    """The share of a way that lies within a radius of its end."""
    return np.asarray(np.minimum(1.0, radius / np.maximum(distance, 1e-12)))


def _blend(places: Float64[np.ndarray, "3 3"], radius: float) -> tuple[Segments, Segments]:
    """Segments from a waypoint that fill what two blended legs may reach, before its bisector and behind it."""
    before, here, after = places
    lengths = np.linalg.norm([here - before, after - here], axis=1)
    nothing = np.zeros((0, 2, 3))
    if lengths.min() < 1e-9:
        return nothing, nothing
    one, two = (here - before) / lengths[0], (after - here) / lengths[1]
    turn = float(np.linalg.norm(two - one))
    if turn < 1e-9:
        return nothing, nothing
    step = min(radius / turn, 0.5 * float(lengths.min()))
    middle = here + step * (two - one)
    ends = here - min(4.0 * step, 0.5 * lengths[0]) * one, here + min(4.0 * step, 0.5 * lengths[1]) * two
    found = []
    for end in ends:
        count = 1 + math.ceil(float(np.linalg.norm(end - middle)) / _STEP)
        rim = middle + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - middle)
        found.append(np.stack([np.broadcast_to(here, rim.shape), rim], axis=1))
    return found[0], found[1]


def _kept(
    segments: Segments, places: Points, mission: Mission, number: int
) -> tuple[Float64[np.ndarray, " n"], np.ndarray]:
    """Clearance of segments [m], and whether each keeps the radius of a leg outside its exemptions.

    Inside an exemption, the own distance of its end is kept where that is less.
    """
    leg = mission.legs[number]
    least = max(leg.radius - SLACK, 0.5 * _STEP)
    clearance, passes = _verdicts(segments, mission.map, least)
    ends = places[mission.places[number : number + 2]]
    # Where two legs' ends differ by what they were moved, the exemption covers both.
    joint = math.dist(mission.path[mission.places[number]], leg.path[0])
    for end, reach in zip(ends, leg.exemptions, strict=True):
        failed = np.flatnonzero(~passes)
        if reach <= 0.0 or not failed.size:
            continue
        own = verify(end[None], mission.map).clearance
        inner, outer = _cut(segments[failed], end, reach + joint)
        near, touches_not = _verdicts(inner, mission.map, 0.0)
        inside = touches_not & (near >= min(own, leg.radius) - SLACK)
        outside = np.ones(len(failed), bool)
        for part in outer:
            nothing = (part[:, 0] == part[:, 1]).all(axis=1)
            outside &= nothing | _verdicts(part, mission.map, least)[1]
        passes[failed] = inside & outside
    return clearance, passes


def _verdicts(segments: Segments, where: VoxelMap, radius: float) -> tuple[Float64[np.ndarray, " n"], np.ndarray]:
    """Clearance of segments [m], 0 where they leave the map or touch something, and whether each keeps a radius."""
    count = len(segments)
    paths = Paths(segments, np.full(count, 2, np.int64), np.zeros(count, np.int64))
    verdicts = verify_paths(paths, where, radius=radius)
    return np.nan_to_num(verdicts.clearance, nan=0.0, posinf=math.inf), verdicts.ok


def _cut(
    segments: Segments, centre: Float64[np.ndarray, " 3"], reach: float
) -> tuple[Segments, tuple[Segments, Segments]]:
    """Segments inside a ball, and those before and behind it; where there are none, a point of them."""
    start, step = segments[:, 0], segments[:, 1] - segments[:, 0]
    squared = np.maximum((step**2).sum(axis=1), 1e-18)
    middle = -((start - centre) * step).sum(axis=1) / squared
    nearest = start + middle[:, None] * step
    half = np.sqrt(np.maximum(reach**2 - ((nearest - centre) ** 2).sum(axis=1), 0.0) / squared)
    first, last = np.clip(middle - half, 0.0, 1.0), np.clip(middle + half, 0.0, 1.0)

    def part(low: np.ndarray, high: np.ndarray) -> Segments:
        return np.stack([start + low[:, None] * step, start + high[:, None] * step], axis=1)

    zero = np.zeros_like(first)
    return part(first, last), (part(zero, first), part(last, zero + 1.0))
