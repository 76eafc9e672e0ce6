"""Where a mission ends that may end at several places: at that of least cost which its battery lasts to.

places of the last waypoint by the cost of the way to them  →  the first whose flight is within the battery
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from maxjax.core.status import Status
from maxjax.energy.split_flights import BatteryFlight, Supply, weigh_flight
from maxjax.planning.mission import Mission, plan_mission
from maxjax.planning.planner import Planner
from maxjax.planning.problem.task import Task
from maxjax.planning.waypoint import Waypoint, legs_of
from maxjax.trajectories.limits import FlightLimits


def ends_there(waypoints: Sequence[Waypoint]) -> bool:
    """Whether a mission has an end of its own: a roof, or one of several places; it is not split over home."""
    return len(waypoints[-1].choices) > 1 or waypoints[-1].touchdown is not None


def end_within_battery(
    mission: Mission, task: Task, planner: Planner, limits: FlightLimits, supply: Supply
) -> BatteryFlight:
    """The mission to the place of least cost, of those of its last waypoint, that the battery lasts to.

    Args:
        mission: as planned, to the place that costs least.
        task: with its map and distances.
        planner: as in `planning.mission.plan_mission`.
        limits: of the trajectory.
        supply: airframe, battery and wind.

    Returns:
        The flight; where the battery lasts to none of them, that of the mission as planned.

    Raises:
        ValueError: if the wind, or the flight in it, is faster than the airframe.
    """
    first = weigh_flight(mission, limits, supply)
    last = [choice for choice in mission.choices if choice.number == len(mission.waypoints) - 1]
    if first.status != Status.CANNOT_RETURN or not last:
        return first
    (choice,) = last
    for k in choice.by_cost[1:]:
        stops = [*mission.waypoints[:-1], choice.places[k]]
        other = plan_mission(task.with_ends(*legs_of(stops)), stops, planner)
        choices = (*mission.choices[:-1], choice.taking(k))
        flight = weigh_flight(dataclasses.replace(other, choices=choices), limits, supply)
        if flight.status == Status.OK:
            return flight
    return first
