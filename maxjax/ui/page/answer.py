"""Answers of a page: a pure function of the map and what is asked, whose stops are places of the map.

(City, Request) ↦ Answer
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import time

import numpy as np
from jaxtyping import Float

from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap
from maxjax.energy.split_flights import BatteryFlight, weigh_flight
from maxjax.io.airspace.airspace import Airspace, Reasons
from maxjax.planning.mission import Mission, plan_mission
from maxjax.planning.problem.occupied_end import find_occupied_end, open_sentence
from maxjax.planning.problem.place_format import PlaceFormat
from maxjax.planning.problem.task import Task
from maxjax.planning.waypoint import legs_of
from maxjax.ui.energy_rows import leg_energies
from maxjax.ui.methods import planner_named
from maxjax.ui.page.page_map import Band, City
from maxjax.ui.request import Request
from maxjax.verification.verifier import verify

# Statuses of a start and of a goal that a rule of the air closes.
CLOSED_ENDS = (
    (Status.START_IN_CLOSED_AREA, Status.START_OUTSIDE_BAND),
    (Status.GOAL_IN_CLOSED_AREA, Status.GOAL_OUTSIDE_BAND),
)


@dataclasses.dataclass(frozen=True, eq=False)
class Answer:
    """An answer: the mission that was asked for, or why there is none.

    Attributes:
        request: what was asked.
        mission: its plan; None where the request itself cannot be planned.
        beside: by A*; None where it was not asked for.
        clearance: at the points of `dense`, to the nearest obstacle [m].
        dense: points along the path, no farther apart than half a voxel [m].
        refusal: why the request cannot be planned, or what is in the way of an end; empty else.
        seconds: from request to answer.
        flight: the mission in time with its energy; None where no battery is given, or there is no path.
    """

    request: Request
    mission: Mission | None
    beside: Mission | None
    dense: Float[np.ndarray, "n 3"]
    clearance: Float[np.ndarray, " n"]
    refusal: str
    seconds: float
    flight: BatteryFlight | None = None

    @property
    def ok(self) -> bool:
        """Whether there is a verified path."""
        return self.mission is not None and self.mission.status == Status.OK

    @property
    def verified(self) -> Mission:
        """The mission of an answer that is OK; raises a ValueError for any other."""
        if self.mission is None or not self.ok:
            raise ValueError(f"expected an answer with a verified path, given none: {self.refusal or 'no path'}")
        return self.mission


def answer(city: City, request: Request) -> Answer:
    """Plan what is asked, by the method and, where wanted, by A* beside it."""
    began = time.perf_counter()
    nothing = np.zeros((0, 3)), np.zeros(0)
    try:
        mission = _planned(city, request, request.method)
        rival = _planned(city, request, "astar") if request.beside and request.method != "astar" else None
        supply = request.supply
        flight = None if supply is None else weigh_flight(mission, request.limits, supply)
    except (ValueError, ImportError, MemoryError, RuntimeError) as error:
        return Answer(request, None, None, *nothing, str(error).partition("\n")[0], time.perf_counter() - began)
    along = nothing
    if mission.status == Status.OK:
        dense = densify(mission.path, 0.5 * city.grid.spacing)
        along = dense, verify(dense, city.voxels).clearance_at
    why = _closed_end(city, request, mission)
    return Answer(request, mission, rival, *along, why, time.perf_counter() - began, flight)


def task_of(city: City, request: Request, ends: slice = slice(None)) -> Task:
    """The task of a request's legs, or of some of them, with what the rules of the air close.

    Raises:
        ValueError: for distances or rules that the map cannot have.
    """
    starts, goals = legs_of(request.stops)
    where = close_air(city, request.altitudes, city.highest(request.places[0]))
    return Task.of(where, starts[ends], goals[ends], request.distances)


def close_air(city: City, band: Band, highest: float | None) -> VoxelMap:
    """The map with what the rules of the air close.

    Args:
        city: the map, with its areas.
        band: least and greatest height above ground [m].
        highest: greatest z [m]; None: any.

    Raises:
        ValueError: for rules that the map cannot have.
    """
    if (*band, highest) == (None, None, None) and not city.areas:
        return city.voxels
    return city.voxels.closing(_closed(city, band, highest))


@functools.lru_cache(maxsize=8)
def _closed(city: City, band: Band, highest: float | None) -> Reasons:
    return Airspace(*band, highest, city.areas).closed_over(city.terrain)


def _closed_end(city: City, request: Request, mission: Mission) -> str:
    """The obstacle at the end of a leg that failed for it, and a free place; empty where there is none."""
    for k in mission.failed[:1]:
        for end, statuses in enumerate(CLOSED_ENDS):
            if mission.legs[k].status in statuses:
                place = np.array(request.places[k + end])
                x, y, z = np.floor((place - city.grid.lower) / city.grid.spacing).astype(int).tolist()
                rules = Airspace(*request.altitudes, city.highest(request.places[0]), city.areas)
                where = task_of(city, request, slice(k, k + 1)).map_at(0)
                heights = open_sentence(where, request.places[k + end], PlaceFormat())
                why = " and ".join(rules.reasons_at((x, y, z), city.terrain))
                return f"It lies {why}. {heights[0].upper()}{heights[1:]}."
            if mission.legs[k].status == (Status.START_OCCUPIED, Status.GOAL_OCCUPIED)[end]:
                stands = find_occupied_end(city.voxels, request.places[k + end], mission.legs[k].radius)
                return "" if stands is None else f"{stands.describe(PlaceFormat(terrain=city.terrain))}."
    return ""


def _planned(city: City, request: Request, method: str) -> Mission:
    return plan_mission(task_of(city, request), request.flown, planner_named(method))


def densify(path: Float[np.ndarray, "t 3"], step: float) -> Float[np.ndarray, "n 3"]:
    """A polyline with further points, none farther than a step [m] from the next."""
    pieces = []
    for a, b in itertools.pairwise(path):
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / step)))
        pieces.append(np.linspace(a, b, count, endpoint=False))
    return np.concatenate([*pieces, path[-1:]])


def describe_answer(found: Answer) -> str:
    """An answer in words: Markdown, a headline and the figures."""
    if found.mission is None:
        return f"### Cannot be planned\n{found.refusal}"
    mission = found.mission
    if not found.ok:
        failed = mission.failed
        leg = f" (leg {failed[0] + 1} of {len(mission.legs)})" if failed and len(mission.legs) > 1 else ""
        lines = [f"### No path{leg}", f"**{mission.status.name}** {mission.status.advice}"]
        if failed and mission.status == Status.NO_SAFE_PATH:
            lines.append(f"At most a radius of {mission.legs[failed[0]].radius:g} m joins them.")
        if found.refusal:
            lines.append(found.refusal)
        return "\n\n".join(lines)
    certified = all(leg.certified for leg in mission.legs)
    rows = [
        f"### Verified path{', certified' if certified else ''}",
        f"**{mission.length:.1f} m** long, **{mission.cruise_clearance:.1f} m** clear away from the ends, "
        f"{mission.clearance:.1f} m at the least; radius {mission.radius:g} m, "
        f"planned in {1e3 * mission.timings['total']:.0f} ms.",
    ]
    rows += _legs(found, mission) if found.request.is_mission else []
    rows += [] if found.flight is None else [f"Battery: {describe_battery(found.flight)}."]
    rows += [f"**Radius not kept:** {one}." for one in mission.near]
    if found.beside is not None:
        rival = found.beside
        rows.append(
            f"A\\* beside it: {rival.length:.1f} m long, {rival.cruise_clearance:.1f} m clear away from the ends."
            if rival.status == Status.OK
            else f"A\\* beside it: no path, {rival.status.name}."
        )
    return "\n\n".join(rows)


def describe_battery(flight: BatteryFlight) -> str:
    """What a battery says of a flight, without its full stop; empty where none is given."""
    if flight.verdict is None:
        return ""
    said = flight.verdict.describe()
    return said if flight.verdict.status == Status.OK else f"**{flight.verdict.status.name}** {said}"


def _legs(found: Answer, mission: Mission) -> list[str]:
    """A line for each leg."""
    rows, energies = [], leg_energies(found.flight, found.request.supply)
    for k, (leg, stop) in enumerate(zip(mission.legs, mission.waypoints[1:], strict=True), 1):
        words = [f"{leg.length:.1f} m"]
        words += [f"at most {stop.speed:g} m/s"] if stop.speed is not None else []
        words += [f"hovers {stop.hover:g} s"] if stop.hover is not None else []
        words += [f"radius {leg.radius:g} m"] if stop.radius is not None else []
        energy = energies(k - 1)
        words += [f"{energy['energy']:.1f} Wh, {100.0 * energy['charge']:.0f} % left"] if energy else []
        rows.append(f"{k}. {', '.join(words)}")
    return ["\n".join(rows)]
