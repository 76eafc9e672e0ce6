"""The planner of this package: `Field`, which climbs the exact conduction potential.

The others: `nn.network.Network` climbs a predicted one; `baselines` has the rivals `AStar`, `RRTStar` and `APF`.
`methods` gives them the names of the command line.
"""

from __future__ import annotations

import dataclasses
import functools

from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.planning.run.stages import PotentialFn
from maxjax.solvers.medium import Solver
from maxjax.solvers.potential import solve_potential
from maxjax.solvers.screened import Screened


@dataclasses.dataclass(frozen=True, kw_only=True)
class Field(FieldPlanner):
    """Climb the exact conduction potential, with a certificate that the ascent arrives.

    Attributes:
        solver: of the potential, with its tolerance and caps, as `maxjax.Screened(tolerance=1e-4)`.

    Raises:
        ValueError: if the solver is none.
    """

    potential: PotentialFn = dataclasses.field(init=False, repr=False)
    name: str = dataclasses.field(default="field", init=False)
    solver: Solver = Screened()  # noqa: RUF009 (frozen)

    def __post_init__(self) -> None:
        if isinstance(self.solver, type) or not hasattr(self.solver, "stages"):
            raise ValueError(f"Field.solver: expected a solver, as maxjax.Screened(), given {self.solver!r}")
        object.__setattr__(self, "potential", _solving(self.solver))


@functools.cache
def _solving(solver: Solver) -> PotentialFn:
    """`solve_potential` by a solver; the same function each time, for the caches of programs."""
    return solve_potential if solver == Screened() else functools.partial(solve_potential, solver=solver)
