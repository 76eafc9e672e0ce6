"""The methods of planning: one list for the API, the command line, campaigns and experiments.

solver     climbs the exact conduction potential
network    climbs a predicted one, improved until it is certified
astar      searches the dilated grid
rrtstar    samples it (OMPL's, extra `bench`)
apf        descends an artificial potential field
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from maxjax.planning.method import Method

if TYPE_CHECKING:
    from maxjax.planning.route import PathFinder

# Each path finder is imported when it is asked for: names and labels are wanted without JAX, for `maxjax --help`.


def _solver() -> PathFinder:
    from maxjax.planning.field_planner import Climb
    from maxjax.solvers.potential import solve_potential

    return Climb(solve_potential)


def _network() -> PathFinder:
    from maxjax.nn.model import network_potential
    from maxjax.planning.field_planner import Climb

    return Climb(network_potential(), focused=False)  # trained on whole maps


def _astar() -> PathFinder:
    from maxjax.baselines.astar_finder import search

    return search


def _astar_in_flight() -> PathFinder:
    from maxjax.baselines.astar_finder import search_in_flight

    return search_in_flight


def _rrtstar() -> PathFinder:
    from maxjax.baselines.rrt_star import rrt_star

    return rrt_star()


def _apf() -> PathFinder:
    from maxjax.baselines.apf import apf

    return apf


METHODS: Mapping[str, Method] = {
    method.name: method
    for method in (
        Method("solver", "maxjax", _solver, climbs=True, in_flight=_solver),
        Method("network", "maxjax, network", _network, climbs=True, in_flight=_network),
        Method("astar", "A*", _astar, in_flight=_astar_in_flight),
        Method("rrtstar", "RRT*", _rrtstar, needs="ompl", extra="bench"),
        Method("apf", "APF", _apf),
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
