"""What a page asks and what it is answered: a pure function of the map and the question.

(City, Question) ↦ Answer
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import time

import numpy as np
from jaxtyping import Float, UInt8

from maxjax.core.grid import Point3
from maxjax.core.status import Status
from maxjax.maps.airspace import Airspace
from maxjax.methods import method_named
from maxjax.planning.judge import verify
from maxjax.planning.mission import Mission, Waypoint, legs_of, plan_mission
from maxjax.planning.task import Distances, Task
from maxjax.view.city import City


@dataclasses.dataclass(frozen=True)
class Question:
    """What is to be planned.

    Attributes:
        waypoints: start, places to visit, goal [m].
        method: by name.
        radius, margin: [m].
        beside: whether A* plans the same.
        band: least and greatest height above ground [m]; None: any.
    """

    waypoints: tuple[Point3, ...]
    method: str = "solver"
    radius: float = 1.0
    margin: float = 8.0
    beside: bool = False
    band: tuple[float, float] | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Answer:
    """What was planned.

    Attributes:
        question: that was asked.
        mission: its plan; None where the question itself cannot be planned.
        beside: by A*; None where it was not asked for.
        clearance: at the points of `dense`, to the nearest obstacle [m].
        dense: points along the path, no farther apart than half a voxel [m].
        refusal: why the question cannot be planned; empty else.
        seconds: from question to answer.
    """

    question: Question
    mission: Mission | None
    beside: Mission | None
    dense: Float[np.ndarray, "n 3"]
    clearance: Float[np.ndarray, " n"]
    refusal: str
    seconds: float

    @property
    def ok(self) -> bool:
        """Whether there is a verified path."""
        return self.mission is not None and self.mission.status == Status.OK


def answer(city: City, question: Question) -> Answer:
    """Plan what is asked, by the method and, where wanted, by A* beside it."""
    began = time.perf_counter()
    nothing = np.zeros((0, 3)), np.zeros(0)
    try:
        mission = _planned(city, question, question.method)
        rival = _planned(city, question, "astar") if question.beside and question.method != "astar" else None
    except (ValueError, ImportError, MemoryError, RuntimeError) as error:
        return Answer(question, None, None, *nothing, str(error).partition("\n")[0], time.perf_counter() - began)
    along = nothing
    if mission.status == Status.OK:
        dense = refined(mission.path, 0.5 * city.grid.spacing)
        along = dense, verify(dense, None, city.occupied, city.grid, ground=city.ground).clearance_at
    return Answer(question, mission, rival, *along, "", time.perf_counter() - began)


def task_of(city: City, question: Question, ends: slice = slice(None)) -> Task:
    """The task of a question's legs, or of some of them, heights outside its band closed.

    Raises:
        ValueError: for distances or a band that the map cannot have.
    """
    starts, goals = legs_of([Waypoint(place) for place in question.waypoints])
    distances = Distances.of(question.radius, question.margin)
    task = Task.of(city.occupied, starts[ends], goals[ends], city.grid, distances, city.ground)
    return task if question.band is None else task.closing(_closed(city, question.band))


@functools.lru_cache(maxsize=8)
def _closed(city: City, band: tuple[float, float]) -> UInt8[np.ndarray, "nx ny nz"]:
    return Airspace(*band).closed(city.ground, city.grid)


def _planned(city: City, question: Question, method: str) -> Mission:
    chosen = method_named(method)
    places = [Waypoint(place) for place in question.waypoints]
    return plan_mission(task_of(city, question), places, chosen.finder(), chosen.name)


def refined(path: Float[np.ndarray, "t 3"], step: float) -> Float[np.ndarray, "n 3"]:
    """A polyline with further points, none farther than a step [m] from the next."""
    pieces = []
    for a, b in itertools.pairwise(path):
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / step)))
        pieces.append(np.linspace(a, b, count, endpoint=False))
    return np.concatenate([*pieces, path[-1:]])


def told(found: Answer) -> str:
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
        return "\n\n".join(lines)
    certified = all(leg.certified for leg in mission.legs)
    rows = [
        f"### Verified path{', certified' if certified else ''}",
        f"**{mission.length:.1f} m** long, **{mission.cruise_clearance:.1f} m** clear away from the ends, "
        f"{mission.clearance:.1f} m at the least; radius {mission.radius:g} m, "
        f"planned in {1e3 * mission.timings['total']:.0f} ms.",
    ]
    if found.beside is not None:
        rival = found.beside
        rows.append(
            f"A\\* beside it: {rival.length:.1f} m long, {rival.cruise_clearance:.1f} m clear away from the ends."
            if rival.status == Status.OK
            else f"A\\* beside it: no path, {rival.status.name}."
        )
    return "\n\n".join(rows)
