"""Missions by name (`maxjax.methods`): waypoints are checked once, as a `Task` of one problem a leg."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Array, Bool

from maxjax.airspace.airspace import Airspace
from maxjax.api import DISTANCES, in_airspace, on_one_map
from maxjax.core.grid import Grid, Point3
from maxjax.fields.price import Price
from maxjax.methods import method_named
from maxjax.planning import mission
from maxjax.planning.mission import Mission, Waypoint, legs_of
from maxjax.planning.task import Distances, Task, points_of


# arguments: a public name; all that has a default is given by keyword
def plan_mission(
    occupied: Bool[Array | np.ndarray, "nx ny nz"],
    waypoints: Sequence[Waypoint | Sequence[float]],
    grid: Grid = Grid(),  # noqa: B008 (frozen)
    *,
    return_to_start: bool = False,
    method: str = "solver",
    radius: float = DISTANCES.radius,
    margin: float = DISTANCES.margin,
    price: Price = DISTANCES.price,
    ground: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
    airspace: Airspace | None = None,
) -> Mission:
    """Plan a path through waypoints in order, leg by leg, and verify it as a whole.

    Legs of one goal and the same distances share a field where the map is solved as a whole (`plan_fleet`).

    Args:
        occupied, grid, method, radius, margin, price, ground, airspace: as in `plan`.
        waypoints: at least two, the start first: `Waypoint`, or three coordinates [m].
        return_to_start: whether a last leg leads back to the first waypoint.

    Returns:
        A `Mission`. Its status is OK only if every leg is and the whole path was verified; `Mission.failed` numbers the
        legs that are not. Waypoints in obstacles, outside the map, out of reach or equal to the one before have the
        statuses of `plan`.

    Raises:
        ValueError: as `plan`, for fewer than two waypoints, or for what is none.
    """
    chosen = method_named(method)
    places = [given if isinstance(given, Waypoint) else Waypoint(_place(given)) for given in waypoints]
    if return_to_start and places:
        places.append(Waypoint(places[0].position))
    distances = Distances.of(radius, margin, price)
    task = Task.of(occupied, *legs_of(places), grid, distances, ground)
    return mission.plan_mission(in_airspace(on_one_map(task), airspace), places, chosen.finder(), chosen.name)


def _place(given: Sequence[float]) -> Point3:
    x, y, z = points_of("waypoints", given, (3,)).tolist()
    return x, y, z
