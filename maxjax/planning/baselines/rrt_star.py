"""RRT* by OMPL: the rival that samples.

    repeat:  x_rand uniform in the box of the free voxels, or the goal with probability 0.05
             x_new  from the nearest vertex of the tree towards x_rand, at most `reach` far
             parent of x_new: the neighbour v with the least cost(v) + |x_new − v| whose edge is clear
             rewire: a neighbour reached at less cost through x_new becomes its child

(Karaman and Frazzoli, 2011; Sucan, Moll and Kavraki, OMPL, 2012). Neighbours are the k nearest,
k = ⌈1.1 (e + e/3) ln n⌉ for n vertices; the edges of the cheapest are checked first. The tree stops after a number of
iterations, whether or not a path was found, and the path is its best one, not shortened afterwards.

**What is ours.** The paper compares with "RRT*(3k)" and says nothing else of it. Our reading: 3,000 iterations of
OMPL's `geometric::RRTstar`, all settings as they come with OMPL but for two in the peer's favour: samples come from the
box that holds all free voxels (in a city the ground fills half of the grid), and `reach` (see `rrt_star`).

**What edges cost.** OMPL checks an edge by sampling states 1 % of the map apart, about two voxels: that flies through
walls. Here an edge is checked exactly, in one NumPy expression, as in `planning.sight`: it is cut into pieces of at
most a quarter of a voxel along each axis, and all voxels (at most two along each axis) that bound a piece must be free.
So every edge of the tree passes `verify`, and nothing has to be mended. It refuses edges that pass within a quarter of
a voxel of a blocked edge or corner. A check takes about 15 µs, and the call from C++ to Python is part of it; about
9,000 of them are a third of the run time. A validator in C++ would save that much and no more.

Positions are index coordinates (whole numbers at voxel centres).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.planner import NO_PATH, PathFinder, Route, Stopwatch
from maxjax.planning.problem import Problem
from maxjax.planning.sight import TOUCH

_PIECE = 0.25  # [voxels]
_MISSING = "method 'rrtstar' needs OMPL, from the extra bench: pip install 'maxjax[bench]'"

Point = Float64[np.ndarray, " 3"]


def rrt_star(iterations: int = 3000, reach: float | None = None, seed: int = 1) -> PathFinder:
    """The path finder that grows a tree.

    Args:
        iterations: samples drawn; 3,000 in the paper.
        reach: longest edge [voxels]; None: a fifth of the diagonal of the sampled box, OMPL's choice.
        seed: positive. The same seed gives the same path of the same problem. OMPL's generator is global to the
            process: plan with one thread at a time.

    Returns:
        A `PathFinder`; its route is PATH_STALLED where the tree has not reached the goal, and its call raises
        ImportError where OMPL is missing.
    """

    def find(problem: Problem, grid: Grid, watch: Stopwatch) -> Route:
        try:
            from ompl import base, geometric, util
        except ImportError as error:
            raise ImportError(_MISSING) from error
        with watch.stage("search"):
            blocked = np.asarray(problem.blocked)
            ends = [np.asarray(end, np.float64) for end in (problem.start, problem.goal)]
            # OMPL has one generator of seeds, and complains when it is set anew, though it obeys.
            level = util.getLogLevel()
            util.setLogLevel(util.LogLevel.LOG_NONE)
            try:
                util.RNG.setSeed(seed)
                path = _grow(base, geometric, blocked, ends, iterations, reach)
            finally:
                util.setLogLevel(level)
        if path is None:
            return Route(NO_PATH, Status.PATH_STALLED, certified=False)
        # The ends as they came: float64 and back is exact.
        return Route(path.astype(np.float32), Status.OK, certified=False)

    return find


def _grow(
    base: Any,
    geometric: Any,
    blocked: Bool[np.ndarray, "nx ny nz"],
    ends: list[Point],
    iterations: int,
    reach: float | None,
) -> Float64[np.ndarray, "t 3"] | None:
    """The best path of the tree after so many iterations; None where it has not reached the goal."""
    clear = sight(blocked)

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
    if reach is not None:
        tree.setRange(reach)
    tree.setProblemDefinition(problem)
    tree.setup()
    tree.solve(base.PlannerTerminationCondition(lambda: tree.numIterations() >= iterations))
    if not problem.hasExactSolution():
        return None
    found = problem.getSolutionPath().getStates()
    return np.array([[state[axis] for axis in range(3)] for state in found])


def sight(blocked: Bool[np.ndarray, "nx ny nz"]) -> Callable[[Point, Point], bool]:
    """The function that tells whether the closed segment between two points of the grid touches free voxels only.

    Args:
        blocked: voxels; those outside the grid count as blocked.
    """
    # Bit i + 2 j + 4 k of a voxel is set where the (1+i) x (1+j) x (1+k) block that starts there is not free.
    filled = np.pad(blocked, (1, 2), constant_values=True)
    shape = tuple(n + 2 for n in blocked.shape)
    table = np.zeros(shape, np.uint8)
    for bit in range(8):
        for corner in range(8):
            if corner & ~bit == 0:
                i, j, k = (corner >> axis & 1 for axis in range(3))
                table |= filled[i : i + shape[0], j : j + shape[1], k : k + shape[2]].astype(np.uint8) << bit
    hits = table.reshape(-1)
    strides = np.array([shape[1] * shape[2], shape[2], 1])
    variants = np.array([1, 2, 4])

    def clear(a: Point, b: Point) -> bool:
        pieces = int(np.abs(b - a).max() / _PIECE) + 1
        # Voxel 0 is voxel 1 of the padded table.
        points = a + 1.5 + np.linspace(0, 1, pieces + 1)[:, None] * (b - a)
        low = (np.minimum(points[:-1], points[1:]) - TOUCH).astype(np.int64)
        extent = (np.maximum(points[:-1], points[1:]) + TOUCH).astype(np.int64) - low
        return not (hits[low @ strides] >> (extent @ variants) & 1).any()

    return clear
