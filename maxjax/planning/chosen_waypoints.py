"""Waypoints with alternatives: of each the one that costs least to reach from the waypoint before it.

waypoint k:   argmin over its places of the cost of the way from the place taken of waypoint k − 1
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from maxjax.planning.planner import Planner
from maxjax.planning.problem.place_format import PlaceFormat
from maxjax.planning.problem.task import Task
from maxjax.planning.run.cheapest_goal import cheapest, costs_to
from maxjax.planning.waypoint import Waypoint

PLACES = PlaceFormat()


@dataclasses.dataclass(frozen=True, eq=False)
class WaypointChoice:
    """The choice of a waypoint among its alternatives.

    Attributes:
        number: of the waypoint, the start 0.
        places: it and its alternatives.
        costs: of the way to each [m at its price]; NaN where there is none.
        taken: number of the one that was taken.
    """

    number: int
    places: tuple[Waypoint, ...]
    costs: Float64[np.ndarray, " n"]
    taken: int

    @property
    def by_cost(self) -> tuple[int, ...]:
        """Numbers of those that can be reached, the cheapest first."""
        order = np.argsort(self.costs, kind="stable")
        return tuple(k for k in order.tolist() if math.isfinite(self.costs[k]))

    def describe(self, places: PlaceFormat = PLACES) -> str:
        """A sentence without its full stop, in the words of whoever gave the waypoints."""
        told = [
            f"{places.place(one.position)} {f'costs {cost:.1f} m' if math.isfinite(cost) else 'cannot be reached'}"
            for one, cost in zip(self.places, self.costs.tolist(), strict=True)
        ]
        others = "; ".join(text for k, text in enumerate(told) if k != self.taken)
        return f"waypoint {self.number} is the one of {len(told)} that was taken: {told[self.taken]}; {others}"

    def taking(self, k: int) -> WaypointChoice:
        """The same choice with another one taken."""
        return dataclasses.replace(self, taken=k)


def choose_waypoints(
    task: Task, waypoints: Sequence[Waypoint], planner: Planner
) -> tuple[tuple[Waypoint, ...], tuple[WaypointChoice, ...]]:
    """Waypoints without alternatives, and what was chosen.

    Args:
        task: of one map, with the mission's distances.
        waypoints: the start first.
        planner: as in `execution.plan_task`.

    Raises:
        ValueError: if the start has alternatives, or the distances of a leg cannot be kept.
    """
    if waypoints and waypoints[0].alternatives:
        raise ValueError(
            f"waypoint 0: expected a start without alternatives, given {len(waypoints[0].alternatives)}; they are for "
            "places to fly to"
        )
    found, choices = list[Waypoint](), list[WaypointChoice]()
    for number, waypoint in enumerate(waypoints):
        places = waypoint.choices
        if len(places) == 1:
            found.append(waypoint)
            continue
        kept = dataclasses.replace(task, distances=waypoint.distances(task.distances).within(task.grid))
        goals, start = np.array([one.position for one in places]), found[-1].position
        costs = costs_to(kept, start, goals, planner)
        choices.append(WaypointChoice(number, places, costs, cheapest(costs, start, goals)))
        found.append(places[choices[-1].taken])
    return tuple(found), tuple(choices)
