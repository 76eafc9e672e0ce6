"""The stages from a problem to a route, each written once; what runs them composes them.

    (blocked, price) → σ, N → log φ → ascent → string pulling → Route
                       `solve`        `climb`  `tighten`

N is the price on the lattice (`fields.price.lattice_price`), by which φ decays along an axis as the price says. Before
them stands `problem.formulate`, behind them `path.route.complete_path`, which prices the path between its exact ends.

`FUSED` has the stages as functions, for one program of all: `jit`, `vmap`, chunks on a device, flights. `STAGED` has
each as a program by itself, timed by itself, as it suits a CPU.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.lowering import materialise
from maxjax.compile.program import Program
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.conductivity import conductivity
from maxjax.fields.price import SCREENING_LENGTH, lattice_price
from maxjax.planning.path.ascent import Ascent, ascend
from maxjax.planning.path.line_of_sight import Sight, sight_of
from maxjax.planning.path.string_pulling import tighten
from maxjax.planning.problem.problem import Problem


@runtime_checkable
class PotentialLike(Protocol):
    """Common result of the solver and of a network."""

    @property
    def log_phi(self) -> Array:
        """Logarithm of the potential, 0 at the goal; −inf where there is no conductor or no current."""
        ...

    @property
    def status(self) -> Array:
        """`Status` as int32."""
        ...

    @property
    def certified(self) -> Array:
        """Whether no voxel but the goal is a local maximum."""
        ...

    @property
    def geodesic(self) -> Array:
        """Whether it is the flood's own distance and not a solution."""
        ...


# (sigma, goal_index, price or None) ↦ PotentialLike: pure and hashable; pass the same function each time.
PotentialFn = Callable[[Array, Array, Array | None], PotentialLike]


def solve(
    blocked: Bool[Array, "nx ny nz"],
    price: Float[Array, "nx ny nz"] | None,
    goal_index: Int32[Array, " 3"],
    potential: PotentialFn,
) -> PotentialLike:
    """The potential of the blocked voxels and a price; it counts in voxels."""
    nx, ny, nz = blocked.shape
    sigma = materialise(conductivity(blocked, goal_index, Grid((nx, ny, nz), 1.0, (0.0, 0.0, 0.0))))
    return potential(sigma, goal_index, None if price is None else materialise(lattice_price(price, SCREENING_LENGTH)))


def climb(
    log_phi: Float[Array, "nx ny nz"],
    blocked: Bool[Array, "nx ny nz"],
    start: Float[Array, " 3"],
    goal: Float[Array, " 3"],
    settings: Ascent,
    room: float,
) -> tuple[Float[Array, "t 3"], Bool[Array, ""], Sight]:
    """Ascend the field; returns the path, whether it arrived, and the lines of sight."""
    sight = sight_of(blocked, room)
    path, arrived = ascend(log_phi, sight, ~blocked, start, goal, settings)
    return path, arrived, sight


def status_of_climb(problem: Any, field: Any, arrived: Any, xp: Any = jnp) -> Int32[Any, "*n"]:
    """Status of the problem, else of the field, else PATH_STALLED unless the ascent arrived; else OK.

    Args:
        problem, field: their statuses.
        arrived: whether the ascent did.
        xp: `numpy` for arrays on the host.
    """
    status = xp.where(arrived, Status.OK, Status.PATH_STALLED)
    status = xp.where(field != Status.OK, field, status)
    return xp.where(problem != Status.OK, problem, status).astype(xp.int32)


class Stages(NamedTuple):
    """The stages of a field planner: functions, or programs of them."""

    solve: Callable[..., PotentialLike]
    climb: Callable[..., tuple[Array, Array, Sight]]
    tighten: Callable[..., Array]

    def field(self, problem: Problem, potential: PotentialFn) -> PotentialLike:
        """The potential of a problem."""
        return self.solve(problem.blocked, problem.price, problem.goal_index, potential=potential)

    def path(
        self, log_phi: Float[Array, "nx ny nz"], problem: Problem, settings: Ascent
    ) -> tuple[Float[Array, "t 3"], Bool[Array, ""]]:
        """The path up a field, pulled taut, and whether it arrived."""
        ends = problem.start, problem.goal
        path, arrived, sight = self.climb(log_phi, problem.blocked, *ends, settings=settings, room=problem.room)
        return self.tighten(sight, path, problem.price), arrived


FUSED = Stages(solve, climb, tighten)
STAGED = Stages(
    Program("solve", solve, static=("potential",)),
    Program("ascend", climb, static=("settings", "room")),
    Program("tighten", tighten),
)


def potential_field(
    blocked: Bool[Array, "nx ny nz"],
    price: Float[Array, "nx ny nz"] | None,
    goal_index: Int32[Array, " 3"],
    potential: PotentialFn,
) -> PotentialLike:
    """`solve` as a program by itself, which is compiled once for all maps of a shape."""
    return STAGED.solve(blocked, price, goal_index, potential=potential)
