"""The planner that climbs a field: solve, ascend, pull taut.

    (blocked, price) → (σ, N) → log φ → ascent → string pulling → Route

N is the price on the lattice (`fields.price.lattice_price`), by which φ decays along an axis as the price says.

`FieldPlanner.route` makes one pure function of it, for `jit`, `vmap` and flights; as programs by themselves (`SOLVE`,
`ASCEND`, `TIGHTEN`) the steps are timed one by one (`planning.run.execution`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32, UInt

from maxjax.compile.lowering import materialise
from maxjax.compile.program import Program
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.conductivity import conductivity
from maxjax.fields.price import SCREENING_LENGTH, lattice_price
from maxjax.planning.path.ascent import Ascent, ascend
from maxjax.planning.path.line_of_sight import Sight, sight_of
from maxjax.planning.path.route import Route
from maxjax.planning.path.string_pulling import tighten
from maxjax.planning.problem.problem import Problem


@runtime_checkable
class PotentialLike(Protocol):
    """What the solver and a network return alike."""

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
    grid: Grid,
    potential: PotentialFn,
) -> PotentialLike:
    """The potential of the blocked voxels and a price."""
    sigma = materialise(conductivity(blocked, goal_index, grid))
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


def taut(
    codes: UInt[Array, "nx ny nz"], path: Float[Array, "t 3"], price: Float[Array, "nx ny nz"] | None, room: float
) -> Float[Array, "t 3"]:
    """`tighten`, by the fields of a `Sight`."""
    return tighten(Sight(codes, room), path, price)


SOLVE = Program("solve", solve, static=("grid", "potential"))
ASCEND = Program("ascend", climb, static=("settings", "room"))
TIGHTEN = Program("tighten", taut, static=("room",))


def potential_field(
    blocked: Bool[Array, "nx ny nz"],
    price: Float[Array, "nx ny nz"] | None,
    goal_index: Int32[Array, " 3"],
    grid: Grid,
    potential: PotentialFn,
) -> PotentialLike:
    """`solve` as a program by itself, which is compiled once for all maps of a shape."""
    field: PotentialLike = SOLVE(blocked, price, goal_index, grid=grid.unit, potential=potential)
    return field


@dataclasses.dataclass(frozen=True)
class FieldPlanner:
    """The planner that climbs a potential, whoever makes it; equal to any of the same fields.

    Attributes:
        potential: makes the field.
        ascent: settings of the ascent.
        focus: whether plans are made in windows of the map, where these prove the same
        (`planning.windows.focus_window`). name: of the planner.
    """

    potential: PotentialFn
    ascent: Ascent = Ascent()  # noqa: RUF009 (frozen)
    focus: bool = True
    name: str = "field"

    @property
    def batched(self) -> bool:
        """True: it is a pure function of arrays."""
        return True

    def route(self, problem: Problem, grid: Grid) -> Route:
        """A route; without one PATH_STALLED, or the status of the field or the problem."""
        field = solve(problem.blocked, problem.price, problem.goal_index, grid, self.potential)
        ends = problem.start, problem.goal
        path, arrived, sight = climb(field.log_phi, problem.blocked, *ends, self.ascent, problem.room)
        path = tighten(sight, path, problem.price)
        status = jnp.where(arrived, Status.OK, Status.PATH_STALLED)
        status = jnp.where(field.status != Status.OK, field.status, status)
        status = jnp.where(problem.status != Status.OK, problem.status, status)
        sound = problem.status == Status.OK
        return Route(path, status.astype(jnp.int32), field.certified & sound, geodesic=field.geodesic & sound)
