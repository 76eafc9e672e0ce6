"""The planner that climbs a field: the stages of `planning.run.stages` as one pure function, for `jit` and `vmap`."""

from __future__ import annotations

import dataclasses

from maxjax.core.status import Status
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.path.route import Route
from maxjax.planning.problem.problem import Problem
from maxjax.planning.run.stages import FUSED, PotentialFn, status_of_climb


@dataclasses.dataclass(frozen=True)
class FieldPlanner:
    """The planner that climbs a potential, whoever makes it; equal to any of the same fields.

    Attributes:
        potential: makes the field.
        ascent: settings of the ascent.
        focus: whether plans are made in windows of the map, where these prove the same
            (`planning.windows.focus_window`).
        name: of the planner.
    """

    potential: PotentialFn
    ascent: Ascent = Ascent()  # noqa: RUF009 (frozen)
    focus: bool = True
    name: str = "field"

    @property
    def batched(self) -> bool:
        """True: it is a pure function of arrays."""
        return True

    def with_ascent(self, ascent: Ascent) -> FieldPlanner:
        """The same planner with another ascent."""
        return dataclasses.replace(self, ascent=ascent)

    def route(self, problem: Problem) -> Route:
        """A route; without one PATH_STALLED, or the status of the field or the problem."""
        field = FUSED.field(problem, self.potential)
        path, arrived = FUSED.path(field.log_phi, problem, self.ascent)
        status, sound = status_of_climb(problem.status, field.status, arrived), problem.status == Status.OK
        return Route(path, status, field.certified & sound, geodesic=field.geodesic & sound)
