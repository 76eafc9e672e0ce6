"""Missions: waypoints in order, a plan for each leg between them, and a verdict on the whole.

    waypoints → legs; those of one goal share its field → paths end to end → verifier → Mission

The verifier sees the whole path once more: it has to be one line, to touch nothing, and to keep each leg's own radius
on it. A mission is OK only if all of that holds; what is wrong with a leg stays with this leg.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float64, Int64

from maxjax.compile.stage_timer import recording, sum_reports, time_stage
from maxjax.core.grid import Point3
from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.chosen_waypoints import WaypointChoice, choose_waypoints
from maxjax.planning.look import AimedLook
from maxjax.planning.plan import Plan
from maxjax.planning.planner import Planner, field_climber
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.place_format import PlaceFormat
from maxjax.planning.problem.task import Task
from maxjax.planning.run.cheapest_goal import LARGEST_SHARED
from maxjax.planning.run.execution import plan_task
from maxjax.planning.run.shared_goal import plan_to_goal
from maxjax.planning.touchdown import Touchdown
from maxjax.planning.waypoint import Waypoint, legs_of
from maxjax.verification.verifier import verify

_NEARLY = 2e-3  # by which a radius is still kept, as the verifier allows it [voxels]


@dataclasses.dataclass(frozen=True)
class NearWaypoint:
    """A waypoint that stands nearer to an obstacle than the radius, so that the path does, too, around it.

    Attributes:
        number: of the waypoint, the start 0.
        position: [m].
        clearance: its distance to the obstacle [m].
        radius: that was to be kept [m].
        hover: how long the mission hovers there [s]; None: not at all.
    """

    number: int
    position: Point3
    clearance: float
    radius: float
    hover: float | None

    def __str__(self) -> str:
        return self.describe(PlaceFormat())

    def describe(self, places: PlaceFormat) -> str:
        """A sentence without its full stop, in the words of whoever gave the waypoint."""
        x, y, z = np.round(self.position, 3).tolist()
        hovers = f", and the mission hovers there for {self.hover:g} s" if self.hover else ""
        what = "the start" if self.number == 0 else f"waypoint {self.number}"
        return (
            f"{what} {places.place((x, y, z))} stands {self.clearance:.2f} m from an obstacle, nearer than the radius "
            f"of {self.radius:g} m, which is not kept around it{hovers}"
        )


@dataclasses.dataclass(frozen=True)
class Mission:
    """Plans from waypoint to waypoint, verified one by one and as a whole.

    Attributes:
        status: OK if every leg is and the whole path passed the verifier; else that of the first leg that failed.
        waypoints: in order, the start first; the leg k leads from waypoint k to waypoint k + 1.
        legs: plans.
        path: (t, 3) float64 [m], ENU, over all legs; empty unless OK.
        places: index in the path of each waypoint; empty unless OK.
        length: of the path [m]; NaN unless OK.
        clearance: least distance from the path to the cube of an occupied voxel [m], ground left out; NaN unless OK.
        timings: seconds by stage, as in `Plan`, over all legs, and `verify`.
        map: that it was planned and verified in.
        choices: which of several places each waypoint with alternatives is.
    """

    status: Status
    waypoints: tuple[Waypoint, ...]
    legs: tuple[Plan, ...]
    path: Float64[np.ndarray, "t 3"]
    places: Int64[np.ndarray, " w"]
    length: float
    clearance: float
    timings: Mapping[str, float]
    map: VoxelMap = dataclasses.field(repr=False)
    choices: tuple[WaypointChoice, ...] = ()

    @classmethod
    def of_plan(cls, plan: Plan) -> Mission:
        """The mission of one leg that a plan is; of a plan without a path, one without waypoints."""
        ends = plan.path[[0, -1]].tolist() if len(plan.path) else []
        waypoints = tuple(Waypoint((x, y, z)) for x, y, z in ends)
        places = np.array([0, len(plan.path) - 1] if ends else [], np.int64)
        return cls(
            plan.status, waypoints, (plan,), plan.path, places, plan.length, plan.clearance, plan.timings, plan.map
        )

    @property
    def failed(self) -> tuple[int, ...]:
        """Numbers of the legs that are not OK, from 0 on."""
        return tuple(k for k, leg in enumerate(self.legs) if leg.status != Status.OK)

    @property
    def radius(self) -> float:
        """The least that a leg keeps [m]."""
        return min(leg.radius for leg in self.legs)

    @property
    def cruise_clearance(self) -> float:
        """The least of the legs' [m]; NaN unless all are OK."""
        return float(np.min([leg.cruise_clearance for leg in self.legs]))

    @property
    def near(self) -> tuple[NearWaypoint, ...]:
        """The waypoints at which a path that is OK comes nearer to an obstacle than the radius of its leg."""
        found = dict[Point3, NearWaypoint]()
        for k, leg in enumerate(self.legs if self.status == Status.OK else ()):
            for end, reach in ((0, leg.exemptions[0]), (-1, leg.exemptions[1])):
                x, y, z = leg.path[end].tolist()
                own, number = float(leg.clearance_at[end]), k - end
                short = reach > 0.0 and own < leg.radius - _NEARLY * self.map.grid.spacing
                if short and ((x, y, z) not in found or found[x, y, z].radius < leg.radius):
                    found[x, y, z] = NearWaypoint(number, (x, y, z), own, leg.radius, self.waypoints[number].hover)
        return tuple(found.values())

    @property
    def touchdown(self) -> Touchdown | None:
        """What it ends on; None: nothing, or the ground."""
        return self.waypoints[-1].touchdown if self.waypoints else None

    @property
    def landing_height(self) -> float:
        """Of what is below its end [m]: what it lands on, else the ground; NaN where that is unknown."""
        x, y, _ = self.path[-1].tolist()
        return self.map.terrain.at(x, y) if self.touchdown is None else self.touchdown.height

    def leg_path(self, k: int) -> Float64[np.ndarray, "s 3"]:
        """The part of the path from waypoint k to waypoint k + 1."""
        return self.path[self.places[k] : self.places[k + 1] + 1]


def plan_legs(task: Task, distances: Sequence[Distances], planner: Planner) -> list[Plan]:
    """Plans of the legs of a mission.

    Args:
        task: one problem a leg, on one map.
        distances: of each leg.
        planner: as in `execution.plan_task`.
    """
    small = math.prod(task.grid.shape) <= LARGEST_SHARED
    climber = field_climber(planner) if small else None
    groups: dict[tuple[object, ...], list[int]] = {}
    for k, (kept, goal) in enumerate(zip(distances, task.goals.tolist(), strict=True)):
        groups.setdefault((kept, *goal), []).append(k)
    alone: dict[Distances, list[int]] = {}
    found: dict[int, Plan] = {}
    for together in groups.values():
        kept = distances[together[0]]
        if climber is not None and climber.focus and len(together) > 1:
            some = dataclasses.replace(task.some(np.array(together)), distances=kept)
            found.update(zip(together, plan_to_goal(some, climber), strict=True))
        else:
            alone.setdefault(kept, []).extend(together)
    for kept, legs in alone.items():
        some = dataclasses.replace(task.some(np.array(legs)), distances=kept)
        found.update(zip(legs, plan_task(some, planner), strict=True))
    return [found[k] for k in range(len(distances))]


def plan_mission(task: Task, waypoints: Sequence[Waypoint], planner: Planner) -> Mission:
    """Plan and verify a mission.

    Args:
        task: one problem a leg, from each waypoint to the next one, on one map, with the mission's distances.
        waypoints: at least two; of one with alternatives that which costs least to reach is taken.
        planner: as in `execution.plan_task`.

    Raises:
        ValueError: if the distances of a leg cannot be kept, the start has alternatives, or it lands before its end.
    """
    waypoints, choices = choose_waypoints(task, waypoints, planner)
    if choices:
        task = task.with_ends(*legs_of(waypoints))
    early = next((k for k, waypoint in enumerate(waypoints[:-1]) if waypoint.touchdown is not None), None)
    if early is not None:
        raise ValueError(
            f"waypoint {early}: expected a landing on a roof at the last waypoint only, which is {len(waypoints) - 1}; "
            "leave out what follows, or the way back to the start"
        )
    distances = [waypoint.distances(task.distances).within(task.grid) for waypoint in waypoints[1:]]
    legs = plan_legs(task, distances, planner)
    spent = functools.reduce(sum_reports, (leg.timings for leg in legs))
    return dataclasses.replace(join_legs(waypoints, legs, task, spent), choices=choices)


def join_legs(waypoints: Sequence[Waypoint], legs: Sequence[Plan], task: Task, spent: Mapping[str, float]) -> Mission:
    """The mission of some legs, verified.

    Args:
        waypoints: one more than legs.
        legs: their plans.
        task: the map.
        spent: seconds on the plans.
    """
    failed = next((leg.status for leg in legs if leg.status != Status.OK), Status.OK)
    nothing = Mission(
        failed,
        tuple(waypoints),
        tuple(legs),
        np.zeros((0, 3)),
        np.zeros(0, np.int64),
        length=math.nan,
        clearance=math.nan,
        timings=spent,
        map=task.map,
    )
    if failed != Status.OK:
        return nothing
    parts, places = [legs[0].path], [0, len(legs[0].path) - 1]
    for leg in legs[1:]:
        # Ends on the face of an occupied voxel are moved off it, each leg's by itself.
        same = int(np.array_equal(parts[-1][-1], leg.path[0]))
        parts.append(leg.path[same:])
        places.append(places[-1] + len(leg.path) - same)
    path = np.concatenate(parts)
    whole = dataclasses.replace(nothing, path=path, places=np.array(places))
    with recording() as recorder, time_stage("verify"):
        verdict = verify(path, task.map)
        kept = verdict.ok and all(_keeps(whole, k, task) for k in range(len(legs)))
    spent = sum_reports(spent, recorder.report())
    if not kept:
        return dataclasses.replace(nothing, status=Status.PATH_IN_COLLISION, timings=spent)
    return dataclasses.replace(whole, length=verdict.length, clearance=verdict.clearance, timings=spent)


def _keeps(whole: Mission, k: int, task: Task) -> bool:
    """Whether a leg keeps its radius on the joined path, outside its exemptions."""
    leg, path = whole.legs[k], whole.leg_path(k)
    # Where two legs' ends differ by what they were moved, the exemption covers both.
    joint = math.dist(path[0], leg.path[0])
    start, goal = (reach + joint if reach else 0.0 for reach in leg.exemptions)
    return verify(path, task.map, radius=leg.radius, exemptions=(start, goal)).ok


def first_legs(mission: Mission, task: Task) -> Mission | None:
    """The mission as far as its first leg that failed, verified; None where the first one did."""
    count = next(iter(mission.failed), len(mission.legs))
    if count == 0:
        return None
    return join_legs(mission.waypoints[: count + 1], mission.legs[:count], task, mission.timings)


def looks_of(mission: Mission) -> dict[int, AimedLook]:
    """Looks of a mission's waypoints with their headings, by number of the path's point."""
    found = dict[int, AimedLook]()
    for place, waypoint in zip(mission.places.tolist(), mission.waypoints, strict=False):
        if waypoint.look is not None:
            yaw = float(waypoint.yaw_from(np.array([waypoint.position]))[0])
            own = waypoint.look
            found[place] = AimedLook(None if math.isnan(yaw) else yaw, own.pitch, own.photo, own.every)
    return found
