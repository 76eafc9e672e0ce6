"""The methods of planning: one list for the API, the command line, campaigns and experiments.

solver     climbs the exact conduction potential
network    climbs a predicted one, improved until it is certified
astar      searches the dilated grid
rrtstar    samples it (OMPL's, extra `bench`)
apf        descends an artificial potential field
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from maxjax.nn.model import network_potential
from maxjax.planning.baselines.apf import apf
from maxjax.planning.baselines.astar_finder import search, search_in_flight
from maxjax.planning.baselines.rrt_star import rrt_star
from maxjax.planning.climb import Climb
from maxjax.planning.method import Method
from maxjax.planning.route import PathFinder
from maxjax.solvers.potential import solve_potential


def _solver() -> PathFinder:
    return Climb(solve_potential)


def _network() -> PathFinder:
    return Climb(network_potential())


METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        Method("solver", "maxjax", _solver, climbs=True, in_flight=_solver),
        Method("network", "maxjax, network", _network, climbs=True, in_flight=_network),
        Method("astar", "A*", lambda: search, in_flight=lambda: search_in_flight),
        Method("rrtstar", "RRT*", rrt_star, needs="ompl", extra="bench"),
        Method("apf", "APF", lambda: apf),
    )
}


def method_named(name: Any) -> Method:
    """The method of this name, ready to plan.

    Raises:
        ValueError: for an unknown name, or a network whose weights are missing.
        ImportError: where a package that it needs is missing.
    """
    if not isinstance(name, str) or name not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, given {name!r}")
    METHODS[name].check()
    return METHODS[name]
