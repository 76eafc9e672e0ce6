"""Photographs: a building of 30 x 20 x 60 m, a hectare from above, and 50 places for 5 vehicles.

    python -m benchmarks.inspection            # two CPU cores: 5 minutes, most of it compiling
    python -m benchmarks.inspection --tiny     # a small building, a small area, 8 places for 2 vehicles

A building is looked at from 8 m with overlaps of 0.6 and 0.5, which asks for 4 photos of each point: near 400
viewpoints, chosen, ordered, planned, certified and verified. The hectare lies about the middle of
`docs/samples/quarter.geojson`, and is surveyed from 50 m. The 50 places are drawn in the free air of that map, 3 to 35
metres above the ground; costs between them are found around its houses, and each round is planned and verified.

Beside it stands OR-Tools, where it is installed: its guided local search on the same costs for as many seconds as
`rival_seconds` says, from its own first solution. A row tells both costs; the building's round is its own problem, that
of the places minimises the longest round.

Expected: the building within 20 s, the hectare within 10 s, the places within 60 s; the rounds within 5 % of OR-Tools'.
"""

from __future__ import annotations

import dataclasses
import importlib
import time
from pathlib import Path
from typing import Any

import numpy as np

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, package, save
from maxjax.inspection.free_space import FreeSpace
from maxjax.inspection.inspect_target import plan_round
from maxjax.inspection.leg_costs import TimeCost, costs_between
from maxjax.inspection.sharing import Sharing, share_places
from maxjax.inspection.tour import round_cost, shortest_round
from maxjax.inspection.views import Views
from maxjax.io.kinds.footprints import Footprint, Footprints
from maxjax.io.load import map_of
from maxjax.io.window import Window

QUARTER = Path(__file__).parents[1] / "docs" / "samples" / "quarter.geojson"
CAMERA = "DJI M3E"
DISTANCES = maxjax.Distances(radius=1.5)


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        building: length, width and height [m].
        overlap: of its photos.
        area: side of the square that is surveyed [m].
        places, vehicles: that share them.
        rival_seconds: for OR-Tools, where it is installed; 0: without it.
        seed: of the places.
        out: where the JSON goes.
    """

    building: tuple[float, float, float] = (30.0, 20.0, 60.0)
    overlap: tuple[float, float] = (0.6, 0.5)
    area: float = 100.0
    places: int = 50
    vehicles: int = 5
    rival_seconds: int = 60
    seed: int = 0
    out: Path = RESULTS


TINY = Config((10.0, 8.0, 9.0), (0.3, 0.3), 30.0, places=8, vehicles=2, rival_seconds=1)


def main(config: Config) -> list[Row]:
    """Measure all three, twice each, so that compiling is known, and write the rows."""
    rows = [*_building(config), *_area(config), *_places(config)]
    save("inspection", config, rows, config.out)
    return rows


def _twice(what: Any) -> tuple[Any, float, float]:
    """What a function gives, and seconds of its first and of its second call."""
    seconds = []
    for _ in range(2):
        begin = time.perf_counter()
        found = what()
        seconds.append(time.perf_counter() - begin)
    return found, seconds[0], seconds[1]


def _building(config: Config) -> list[Row]:
    length, width, height = config.building
    outline = np.array([[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]])
    model = Footprints((Footprint((outline,), 0.0, height, "building"),), np.zeros((0, 3, 3)), "a building")
    room = 30.0
    city = map_of(model, Window(1.0, (-room, -room, -1.0, length + room, width + room, height + 20.0), ground=0.0))
    capture = maxjax.Capture(8.0, config.overlap)
    found, first, second = _twice(
        lambda: maxjax.inspect(city, "building", CAMERA, capture=capture, distances=DISTANCES)
    )
    row = _row("building", found, first, second)
    row |= {"viewpoints": len(found.photos), "least": found.least, "tried": found.tried}
    free = FreeSpace.of(city, DISTANCES.radius)
    home = np.array([found.mission.waypoints[0].position])
    costs = costs_between(np.concatenate([home, found.photos.position]), free, TimeCost())
    begin = time.perf_counter()
    own = round_cost(costs, shortest_round(costs))
    round_row: dict[str, Any] = {
        "what": "round through the viewpoints",
        "seconds": time.perf_counter() - begin,
        "cost_s": own,
    }
    return [row, round_row | _rival(costs, 1, config)]


def _area(config: Config) -> list[Row]:
    half = 0.5 * config.area
    reach = half + 90.0
    city = maxjax.load_map(QUARTER, spacing=2.0, bounds=(-reach, -reach, -2.0, reach, reach, 110.0))
    area = [(-half, -half), (half, -half), (half, half), (-half, half)]
    sweep = maxjax.Sweep(distance=50.0)
    found, first, second = _twice(lambda: maxjax.survey(city, area, CAMERA, sweep=sweep, distances=DISTANCES))
    return [_row("area", found, first, second) | {"photos": len(found.photos)}]


def _places(config: Config) -> list[Row]:
    city = maxjax.load_map(QUARTER, spacing=2.0)
    free = FreeSpace.of(city, DISTANCES.radius)
    voxels = np.argwhere(free.free & (np.arange(city.grid.shape[2]) < 18))
    rng = np.random.default_rng(config.seed)
    chosen = voxels[rng.choice(len(voxels), config.places + 1, replace=False)]
    places = np.array(city.grid.origin) + city.grid.spacing * chosen
    views = Views.towards(places[1:], np.tile([1.0, 0.0, 0.0], (config.places, 1)))
    homes = (tuple(places[0].tolist()),)

    def planned() -> tuple[Any, ...]:
        costs = costs_between(places, free, TimeCost(stay=2.0))
        rounds = share_places(Sharing(costs, 1, (0,) * config.vehicles))
        return costs, rounds, [plan_round(city, views, one, homes, DISTANCES) for one in rounds]

    (costs, rounds, missions), first, second = _twice(planned)
    row: dict[str, Any] = {
        "what": f"{config.places} places for {config.vehicles} vehicles",
        "first_s": first,
        "seconds": second,
        "ok": all(mission.status == maxjax.Status.OK for mission in missions),
        "length_m": sum(mission.length for mission in missions),
        "cost_s": max(one.cost for one in rounds),
    }
    return [row | _rival(costs, config.vehicles, config)]


def _row(what: str, found: maxjax.Inspection, first: float, second: float) -> dict[str, Any]:
    return {
        "what": what,
        "first_s": first,
        "seconds": second,
        "ok": found.status == maxjax.Status.OK,
        "share": found.coverage.share(),
        "share_wanted": found.coverage.share(found.coverage.wanted),
        "area_m2": found.coverage.surface.area,
        "length_m": found.length,
    }


def _rival(costs: np.ndarray, vehicles: int, config: Config) -> dict[str, Any]:
    """Cost of the longest round by OR-Tools; nothing where it is missing."""
    if not config.rival_seconds or package("ortools") is None:
        return {"ortools_cost_s": None}
    pywrapcp: Any = importlib.import_module("ortools.constraint_solver.pywrapcp")
    kinds: Any = importlib.import_module("ortools.constraint_solver.routing_enums_pb2")
    manager = pywrapcp.RoutingIndexManager(len(costs), vehicles, 0)
    model = pywrapcp.RoutingModel(manager)
    matrix = np.round(1e3 * costs).astype(int).tolist()
    transit = model.RegisterTransitMatrix(matrix)
    model.SetArcCostEvaluatorOfAllVehicles(transit)
    model.AddDimension(transit, 0, 10**9, True, "cost")
    if vehicles > 1:
        model.GetDimensionOrDie("cost").SetGlobalSpanCostCoefficient(100)
    settings = pywrapcp.DefaultRoutingSearchParameters()
    settings.first_solution_strategy = kinds.FirstSolutionStrategy.PARALLEL_CHEAPEST_INSERTION
    settings.local_search_metaheuristic = kinds.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    settings.time_limit.seconds = config.rival_seconds
    solution = model.SolveWithParameters(settings)
    longest = 0.0
    for vehicle in range(vehicles):
        at, spent = model.Start(vehicle), 0.0
        while not model.IsEnd(at):
            following = solution.Value(model.NextVar(at))
            spent += float(costs[manager.IndexToNode(at), manager.IndexToNode(following)])
            at = following
        longest = max(longest, spent)
    return {"ortools_cost_s": longest, "ortools_seconds": config.rival_seconds}


if __name__ == "__main__":
    main(configured(TINY))
