"""A mission split into flights that a battery lasts for, each from home over some of the places, in order, and back.

    home → places i … j − 1 → home,   j the largest that the battery allows;  then on with place j

Each flight is planned, verified and timed as any mission is, and its energy is that of its own trajectory. The places
are those of the mission; the way from the last place of a flight to the first of the next is flown over home.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from maxjax.core.status import Status
from maxjax.energy.airframe import Airframe
from maxjax.energy.battery import Battery
from maxjax.energy.consumption import Consumption, measure_consumption
from maxjax.energy.point_of_no_return import BatteryVerdict, judge_battery
from maxjax.energy.wind import Wind
from maxjax.planning.mission import Mission, plan_mission
from maxjax.planning.planner import Planner
from maxjax.planning.problem.task import Task
from maxjax.planning.waypoint import Waypoint, legs_of
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.mission_schedule import schedule_mission
from maxjax.trajectories.trajectory import Trajectory


@dataclasses.dataclass(frozen=True, eq=False)
class Supply:
    """What flies, on what, in which wind.

    Attributes:
        airframe: with its payload.
        battery: full before each flight.
        wind: the same in each flight.
    """

    airframe: Airframe
    battery: Battery
    wind: Wind = dataclasses.field(default_factory=Wind.calm)


@dataclasses.dataclass(frozen=True, eq=False)
class BatteryFlight:
    """A flight, and what the battery says of it.

    Attributes:
        mission: from home; its status says whether it was planned.
        trajectory: of it; None where it was not.
        taken: its energy; None likewise, and where nothing is known of what flies it.
        verdict: of the battery; None likewise.
    """

    mission: Mission
    trajectory: Trajectory | None = None
    taken: Consumption | None = None
    verdict: BatteryVerdict | None = None

    @property
    def status(self) -> Status:
        """Of the plan, then of the battery."""
        return self.mission.status if self.verdict is None else self.verdict.status


def weigh_flight(mission: Mission, limits: FlightLimits, supply: Supply | None) -> BatteryFlight:
    """A mission in time, with its energy where it is known what flies it.

    Raises:
        ValueError: if the wind, or the flight in it, is faster than the airframe.
    """
    if mission.status != Status.OK:
        return BatteryFlight(mission)
    trajectory = schedule_mission(mission, limits)
    if supply is None:
        return BatteryFlight(mission, trajectory)
    taken = measure_consumption(trajectory, supply.airframe, supply.wind)
    return BatteryFlight(mission, trajectory, taken, judge_battery(trajectory, taken, supply.battery))


class _Flights:
    """Flights over parts of a row of places, each planned once."""

    def __init__(
        self, task: Task, waypoints: Sequence[Waypoint], planner: Planner, limits: FlightLimits, supply: Supply
    ) -> None:
        self.task, self.planner, self.limits, self.supply = task, planner, limits, supply
        self.home = Waypoint(waypoints[0].position)
        returns = waypoints[-1].position == self.home.position
        self.back = waypoints[-1] if returns else self.home
        self.places = tuple(waypoints[1 : len(waypoints) - returns])
        self._known: dict[tuple[int, int], BatteryFlight] = {}

    def over(self, first: int, last: int) -> BatteryFlight:
        """From home over the places from first to before last, and back."""
        if (first, last) not in self._known:
            stops = [self.home, *self.places[first:last], self.back]
            mission = plan_mission(self.task.with_ends(*legs_of(stops)), stops, self.planner)
            self._known[first, last] = weigh_flight(mission, self.limits, self.supply)
        return self._known[first, last]

    def longest_from(self, first: int) -> tuple[int, BatteryFlight]:
        """Where the longest flight ends that the battery lasts for, and that flight; the shortest one where none does.

        By halves: more places take more energy.
        """
        low, high = first + 1, len(self.places)
        if self.over(first, high).status == Status.OK:
            return high, self.over(first, high)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self.over(first, middle).status == Status.OK else (low, middle)
        return low, self.over(first, low)


def split_mission(
    task: Task, waypoints: Sequence[Waypoint], planner: Planner, limits: FlightLimits, supply: Supply
) -> tuple[BatteryFlight, ...]:
    """Flights that visit all places in order, each within the battery.

    Args:
        task: the mission's, with its map and distances.
        waypoints: home first; a last one at home is the way back.
        planner: as in `planning.mission.plan_mission`.
        limits: of the trajectories.
        supply: airframe, battery and wind.

    Returns:
        The flights. Where a place and back is too far for the battery, or is not reached, the last one is the flight
        to it, whose status says so.

    Raises:
        ValueError: if the wind, or a flight in it, is faster than the airframe.
    """
    flights, first, found = _Flights(task, waypoints, planner, limits, supply), 0, list[BatteryFlight]()
    while first < len(flights.places):
        first, flight = flights.longest_from(first)
        found.append(flight)
        if flight.status != Status.OK:
            break
    return tuple(found)
