"""RRT* by OMPL: the rival that samples.

    repeat:  x_rand uniform in a box around the free voxels, or the goal with probability 0.05
             x_new  from the nearest vertex of the tree towards x_rand, at most a fifth of the box's diagonal away
             parent of x_new: the neighbour v with the least cost(v) + |x_new − v| whose edge is clear
             rewire: a neighbour that is reached at less cost through x_new becomes its child

(Karaman and Frazzoli, 2011; Sucan, Moll and Kavraki, OMPL, 2012.) Neighbours are the k nearest of n vertices,
k = 1.1 · 2⁴ (e + e/3) log n; edges are checked in the order of what they promise, until one is clear. The tree grows
for a number of iterations, whether or not there is a path yet. Its best path is handed out as it is, not shortened.

**Our reading.** The paper compares with "RRT*(3k)" and says no more: no step size, goal bias or radius. We take it as
3,000 iterations of `ompl::geometric::RRTstar` with the settings that OMPL chooses. Two things favour the peer: samples
come from the box that holds the free voxels (in a city, the ground fills the other half of the grid), and edges are
long: shorter ones, of 3 to 20 voxels, gave longer paths or none.

**Prices.** Where metres have a price, an edge costs ∫ n ds in place of its length, with the n of the voxel that holds
each half voxel of it. OMPL asks for the cost of every edge to a neighbour, a million times in 3,000 iterations.

**Which edges are clear.** OMPL checks an edge at states that are 1 % of the map apart, nearly two voxels, and would cut
corners. Here it is checked exactly, so every edge passes `verify` and no path has to be mended: it is cut into pieces
of at most a quarter of a voxel along each axis, and all voxels have to be free that the box around a piece meets, grown
by the room that a path keeps (`planning.path.line_of_sight`: none, which leaves at most two along each axis, or half a
voxel, which leaves three). That refuses what passes an edge of a blocked voxel, so grown, by less than a quarter. A
check is a dozen NumPy calls, called back from C++, and all of them are about half of the run time without a price: a
validator in C++ would at best halve it.

Positions are index coordinates (whole numbers at voxel centres).
"""

from __future__ import annotations

import dataclasses
import importlib.util
import math
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float, Float64

from maxjax.compile.stage_timer import time_stage
from maxjax.core.status import Status
from maxjax.planning.path.line_of_sight import TOUCH
from maxjax.planning.path.route import Route, no_route, route_of
from maxjax.planning.problem.problem import Problem

_PIECE = 0.25  # [voxels]

Point = Float64[np.ndarray, " 3"]
Volume = Float[np.ndarray, "nx ny nz"]


@dataclasses.dataclass(frozen=True)
class RRTStar:
    """The planner that grows a tree.

    Attributes:
        iterations: samples drawn; 3,000 in the paper.
        seed: the same seed gives the same path of the same problem. OMPL's generator is global to the process: plan
            with one thread at a time.

    Raises:
        ValueError: if a number is not positive.
        ImportError: if OMPL is missing, with the extra that brings it.
    """

    iterations: int = 3000
    seed: int = 1

    name: ClassVar[str] = "rrtstar"
    batched: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for name in ("iterations", "seed"):
            given = getattr(self, name)
            if not isinstance(given, int) or given < 1:
                raise ValueError(f"RRTStar.{name}: expected a positive whole number, given {given!r}")
        if importlib.util.find_spec("ompl") is None:
            raise ImportError("RRT* needs ompl, from the extra bench: pip install 'maxjax[bench]'")

    def route(self, problem: Problem) -> Route:
        """The best path of the tree; PATH_STALLED where it has not reached the goal."""
        from ompl import util

        with time_stage("search"):
            blocked = np.asarray(problem.blocked)
            ends = [np.asarray(end, np.float64) for end in (problem.start, problem.goal)]
            # OMPL has one generator of seeds, and complains when it is set anew, though it obeys.
            level = util.getLogLevel()
            util.setLogLevel(util.LogLevel.LOG_NONE)
            try:
                util.RNG.setSeed(self.seed)
                price = None if problem.price is None else np.asarray(problem.price, np.float64)
                path = _grow(blocked, ends, self.iterations, price, problem.room)
            finally:
                util.setLogLevel(level)
        if path is None:
            return no_route(Status.PATH_STALLED)
        # The ends as they came: float64 and back is exact.
        return route_of(path, certified=False)


def _grow(
    blocked: Bool[np.ndarray, "nx ny nz"],
    ends: list[Point],
    iterations: int,
    price: Volume | None = None,
    room: float = 0.0,
) -> Float64[np.ndarray, "t 3"] | None:
    """The best path of the tree after so many iterations; None where it has not reached the goal."""
    from ompl import base, geometric

    clear = line_of_sight(blocked, room)

    class Edges(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802
            return clear(_point(a), _point(b))

    space = base.RealVectorStateSpace(3)
    bounds = base.RealVectorBounds(3)
    for axis in range(3):
        free = np.flatnonzero(~blocked.all(axis=tuple(k for k in range(3) if k != axis)))
        bounds.setLow(axis, float(free[0]) - 0.5)
        bounds.setHigh(axis, float(free[-1]) + 0.5)
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    # The ends are free and edges are checked whole: no state has to be checked by itself.
    information.setStateValidityChecker(lambda _: True)
    information.setMotionValidator(Edges(information))
    information.setup()
    states = [space.allocState() for _ in ends]
    for state, end in zip(states, ends, strict=True):
        for axis in range(3):
            state[axis] = float(end[axis])
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(*states)
    problem.setOptimizationObjective(_objective(base, information, price))
    tree = geometric.RRTstar(information)
    tree.setProblemDefinition(problem)
    tree.setup()
    tree.solve(base.PlannerTerminationCondition(lambda: tree.numIterations() >= iterations))
    if not problem.hasExactSolution():
        return None
    return np.array([_point(state) for state in problem.getSolutionPath().getStates()])


def _point(state: Any) -> Point:
    return np.array([state[0], state[1], state[2]])


def _objective(base: Any, information: Any, price: Volume | None) -> Any:
    """The objective of the tree: lengths, or costs."""
    if price is None:
        return base.PathLengthOptimizationObjective(information)
    cost = cost_of_segments(price)

    # Its bound on what is to come is a length, which is a bound with prices too: they are at least 1.
    class Cost(base.PathLengthOptimizationObjective):  # type: ignore[misc]
        def motionCost(self, a: Any, b: Any) -> Any:  # noqa: N802
            return base.Cost(cost(_point(a), _point(b)))

    return Cost(information)


def cost_of_segments(price: Volume) -> Callable[[Point, Point], float]:
    """The function that gives ∫ n ds from a point of the grid to another [voxels], in pieces of at most half a voxel.

    Args:
        price: n of every voxel; that of a piece is that of the voxel its middle lies in.
    """
    n, (_, ny, nz) = price.astype(np.float64).reshape(-1), price.shape
    strides = np.array([ny * nz, nz, 1])
    middles = np.arange(4.0 * max(price.shape)) + 0.5

    def cost(a: Point, b: Point) -> float:
        move = b - a
        length = math.sqrt(move @ move)
        pieces = int(2 * length) + 1
        points = np.multiply.outer(middles[:pieces] / pieces, move)
        points += a
        points += 0.5
        return length * float(n.take(points.astype(np.intp) @ strides).sum()) / pieces

    return cost


def line_of_sight(blocked: Bool[np.ndarray, "nx ny nz"], room: float = 0.0) -> Callable[[Point, Point], bool]:
    """The function that tells whether every point of a closed segment is allowed.

    Args:
        blocked: voxels; those outside the grid count as blocked.
        room: a point is allowed if the voxels that meet the box of half this width around it are free: 0, the closed
            voxels that hold it, or 1/2, the open box.
    """
    # Bit i + w j + w² k of a voxel is set where the (1+i) x (1+j) x (1+k) box that starts there is not free, with the
    # greatest width w. What wraps around the padded volume is its padding.
    width = 3 if room else 2
    reach = room - TOUCH if room else TOUCH
    extents = [np.pad(blocked, 1, constant_values=True)]
    shape = extents[0].shape
    for axis in range(3):
        longer = [extents]
        for k in range(1, width):
            longer.append([a | np.roll(b, -k, axis) for a, b in zip(longer[-1], extents, strict=True)])
        extents = [extent for these in longer for extent in these]
    table = np.zeros(shape, np.uint32)
    for bit, extent in enumerate(extents):
        table |= extent.astype(np.uint32) << bit
    hits = table.reshape(-1)
    strides, variants = np.array([shape[1] * shape[2], shape[2], 1]), np.array([1, width, width**2])
    counts = np.arange(int(max(shape) / _PIECE) + 2.0)

    def clear(a: Point, b: Point) -> bool:
        move = b - a
        pieces = int(np.abs(move).max() / _PIECE) + 1
        # Voxel 0 is voxel 1 of the padded table.
        points = np.multiply.outer(move / pieces, counts[: pieces + 1]) + (a + 1.5)[:, None]
        low = (np.minimum(points[:, :-1], points[:, 1:]) - reach).astype(np.intp)
        high = (np.maximum(points[:, :-1], points[:, 1:]) + reach).astype(np.intp)
        return not (hits.take(strides @ low) >> variants @ (high - low) & 1).any()

    return clear
