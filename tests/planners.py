"""Planners and plans as tests make them."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from maxjax import Distances, Plan, Status, VoxelMap
from maxjax.planning.path.route import Route
from maxjax.planning.plan import no_plans
from maxjax.planning.problem.problem import Problem
from maxjax.planning.problem.task import Task


@dataclasses.dataclass(frozen=True)
class ByFunction:
    """The planner that a function is, called on the host."""

    find: Callable[[Problem], Route]
    name: str = "test"
    batched: bool = False

    def route(self, problem: Problem) -> Route:
        """What the function finds."""
        return self.find(problem)


def bare_plan(where: VoxelMap, path: np.ndarray, distances: Distances = Distances(), **changes: Any) -> Plan:  # noqa: B008
    """A plan of a path, as if it had been found and verified."""
    points = np.asarray(path, np.float64)
    ends = (points[:1], points[-1:]) if len(points) else (np.zeros((1, 3)), np.ones((1, 3)))
    (nothing,) = no_plans(Task.of(where, *ends, distances), Status.OK, "field")
    return dataclasses.replace(nothing, **{"path": points, **changes})


def unchecked(cls: type[Any], **fields: Any) -> Any:
    """A frozen dataclass as users make it: checked by itself alone, not by the run-time type checks of the tests."""
    made = object.__new__(cls)
    defaults = {field.name: field.default for field in dataclasses.fields(cls)}
    for name, value in (defaults | fields).items():
        object.__setattr__(made, name, value)
    inspect.unwrap(cls.__post_init__)(made)
    return made
