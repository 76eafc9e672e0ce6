"""RRT* by OMPL: the rival that samples.

    repeat:  x_rand uniform in a box around the free voxels, or the goal with probability 0.05
             x_new  from the nearest vertex of the tree towards x_rand, at most a fifth of the box's diagonal away
             parent of x_new: the neighbour v with the least cost(v) + |x_new − v| whose edge is clear
             rewire: a neighbour that is reached at less cost through x_new becomes its child

(Karaman and Frazzoli, 2011; Sucan, Moll and Kavraki, OMPL, 2012.) Neighbours are the k nearest of n vertices,
k = 1.1 (e + e/3) log n; edges are checked in the order of what they promise, until one is clear. The tree grows for a
number of iterations, whether or not there is a path yet. Its best path is handed out as it is, not shortened.

**Our reading.** The paper compares with "RRT*(3k)" and says no more: no step size, goal bias or radius. We take it as
3,000 iterations of `ompl::geometric::RRTstar` with the settings that OMPL chooses. Two things favour the peer: samples
come from the box that holds the free voxels (in a city, the ground fills the other half of the grid), and edges are
long: shorter ones, of 3 to 20 voxels, gave longer paths or none.

**What an edge costs.** OMPL checks an edge at states that are 1 % of the map apart, nearly two voxels, and would cut
corners. Here it is checked exactly, so every edge passes `verify` and no path has to be mended: it is cut into pieces
of at most a quarter of a voxel along each axis, and all voxels of the block that a piece spans (at most two along each
axis) have to be free. That refuses what passes an edge of a blocked voxel by less than a quarter. A check is a dozen
NumPy calls, called back from C++, and all of them are about half of the run time: a validator in C++ would at best
halve it.

Positions are index coordinates (whole numbers at voxel centres).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.problem import Problem
from maxjax.planning.recorder import timed
from maxjax.planning.route import PathFinder, Route, failed, found
from maxjax.planning.sight import TOUCH

_PIECE = 0.25  # [voxels]

Point = Float64[np.ndarray, " 3"]


def rrt_star(iterations: int = 3000, seed: int = 1) -> PathFinder:
    """The path finder that grows a tree.

    Args:
        iterations: samples drawn; 3,000 in the paper.
        seed: positive. The same seed gives the same path of the same problem. OMPL's generator is global to the
            process: plan with one thread at a time.

    Returns:
        A `PathFinder`; its route is PATH_STALLED where the tree has not reached the goal, and its call raises
        ImportError where OMPL is missing (`methods.method_named` asks for it before anything is planned).
    """

    def find(problem: Problem, grid: Grid) -> Route:
        from ompl import base, geometric, util

        with timed("search"):
            blocked = np.asarray(problem.blocked)
            ends = [np.asarray(end, np.float64) for end in (problem.start, problem.goal)]
            # OMPL has one generator of seeds, and complains when it is set anew, though it obeys.
            level = util.getLogLevel()
            util.setLogLevel(util.LogLevel.LOG_NONE)
            try:
                util.RNG.setSeed(seed)
                path = _grow(base, geometric, blocked, ends, iterations)
            finally:
                util.setLogLevel(level)
        if path is None:
            return failed(Status.PATH_STALLED)
        # The ends as they came: float64 and back is exact.
        return found(path, certified=False)

    return find


def _grow(
    base: Any,
    geometric: Any,
    blocked: Bool[np.ndarray, "nx ny nz"],
    ends: list[Point],
    iterations: int,
) -> Float64[np.ndarray, "t 3"] | None:
    """The best path of the tree after so many iterations; None where it has not reached the goal."""
    clear = line_of_sight(blocked)

    class Edges(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802
            return clear(np.array([a[0], a[1], a[2]]), np.array([b[0], b[1], b[2]]))

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
    problem.setOptimizationObjective(base.PathLengthOptimizationObjective(information))
    tree = geometric.RRTstar(information)
    tree.setProblemDefinition(problem)
    tree.setup()
    tree.solve(base.PlannerTerminationCondition(lambda: tree.numIterations() >= iterations))
    if not problem.hasExactSolution():
        return None
    found = problem.getSolutionPath().getStates()
    return np.array([[state[axis] for axis in range(3)] for state in found])


def line_of_sight(blocked: Bool[np.ndarray, "nx ny nz"]) -> Callable[[Point, Point], bool]:
    """The function that tells whether the closed segment between two points of the grid touches free voxels only.

    Args:
        blocked: voxels; those outside the grid count as blocked.
    """
    # Bit i + 2 j + 4 k of a voxel is set where the (1+i) x (1+j) x (1+k) box that starts there is not free. What
    # wraps around the padded volume is its padding.
    extents = [np.pad(blocked, 1, constant_values=True)]
    shape = extents[0].shape
    for axis in range(3):
        extents += [extent | np.roll(extent, -1, axis) for extent in extents]
    table = np.zeros(shape, np.uint8)
    for bit, extent in enumerate(extents):
        table |= extent.astype(np.uint8) << bit
    hits = table.reshape(-1)
    strides, variants = np.array([shape[1] * shape[2], shape[2], 1]), np.array([1, 2, 4])
    counts = np.arange(int(max(shape) / _PIECE) + 2.0)

    def clear(a: Point, b: Point) -> bool:
        move = b - a
        pieces = int(np.abs(move).max() / _PIECE) + 1
        # Voxel 0 is voxel 1 of the padded table.
        points = np.multiply.outer(move / pieces, counts[: pieces + 1]) + (a + 1.5)[:, None]
        low = (np.minimum(points[:, :-1], points[:, 1:]) - TOUCH).astype(np.intp)
        high = (np.maximum(points[:, :-1], points[:, 1:]) + TOUCH).astype(np.intp)
        return not (hits.take(strides @ low) >> variants @ (high - low) & 1).any()

    return clear
