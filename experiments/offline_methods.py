"""The planners of the offline experiments, by name: those of `maxjax.plan`, networks, and fast marching."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
from scipy import ndimage

import maxjax
from benchmarks.common.travel_time import as_potential, marching
from maxjax.compile.stage_timer import time_stage
from maxjax.nn.architecture import CONFIGS
from maxjax.nn.model import MAX_SWEEPS, network_potential, shipped_networks
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.path.route import Route, Routes, no_route, route_of
from maxjax.planning.planner import Planner
from maxjax.planning.problem.problem import Problem
from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.planning.run.longer_ascents import with_longer_ascents
from maxjax.planning.run.stages import STAGED, PotentialFn
from maxjax.ui.methods import ALIASES, METHODS, planner_named


def finder(method: str) -> Planner | str:
    """The planner that a name means, or why it cannot be had here.

    Raises:
        ValueError: for an unknown name.
    """
    if method == "fast marching":
        return FastMarching()
    if ALIASES.get(method, method) not in METHODS or method == "network":
        potential = network(method)
        return potential if isinstance(potential, str) else FieldPlanner(potential, focus=False, name=method)
    try:
        planner = planner_named(method)
    except ImportError as error:
        return str(error)
    return dataclasses.replace(planner, focus=False) if isinstance(planner, FieldPlanner) else planner


def network(method: str) -> PotentialFn | str:
    """The potential of a network, with sweeps or alone, or why it cannot be had here.

    Raises:
        ValueError: for an unknown name.
    """
    model, _, alone = method.partition(" ")
    model = "maxjax" if model == "network" else model
    if model not in CONFIGS or alone not in ("", "alone"):
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, fast marching or a network, given {method!r}")
    if model not in shipped_networks():
        return "no weights"
    return network_potential(model, 0 if alone else MAX_SWEEPS)


@dataclasses.dataclass(frozen=True)
class FastMarching:
    """The planner that descends scikit-fmm's travel time, as `FieldPlanner` climbs a potential."""

    name: ClassVar[str] = "fast marching"
    batched: ClassVar[bool] = False

    def route(self, problem: Problem) -> Route:
        """The descent from the start; raises an ImportError where scikit-fmm is missing."""
        blocked, goal = np.asarray(problem.blocked), tuple(int(i) for i in problem.goal_index)
        with time_stage("march"):
            labels, _ = ndimage.label(~blocked)
            component = np.asarray(labels == labels[goal])
            march = marching(component, goal)["scikit-fmm, fast marching"]
            if march is None:
                raise ImportError("fast marching needs scikit-fmm, from the extra bench: pip install 'maxjax[bench]'")
            log_phi = as_potential(march(), component, goal)

        def attempt(_: np.ndarray, settings: Ascent) -> Routes:
            path, arrived = STAGED.path(log_phi, problem, settings)
            route = route_of(np.asarray(path), certified=False) if arrived else no_route(maxjax.Status.PATH_STALLED)
            return Routes.of([route])

        return with_longer_ascents(attempt, 1, Ascent()).one(0)
