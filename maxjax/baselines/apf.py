"""The artificial potential field (Khatib, 1986): the rival without a solve, and with local minima.

    attraction  U_a = |x − x_g|² / 2 D   within D of the goal, |x − x_g| − D / 2 beyond     (a unit force far away)
    repulsion   U_r = η / 2 (1 / d − 1 / d₀)²   where d < d₀, d(x) the distance to the nearest obstacle
                + η_n n(x)                              where metres have a price n
    descent     x ← x − α ∇(U_a + U_r)

Nothing joins the two: where the attraction of the goal and the repulsion of a wall cancel, the descent ends, and that
is not the goal. It is reported as PATH_STALLED and not mended; ways out (random walks, wall following) are other
planners.

**Distance.** An exact Euclidean transform, from centre to centre less half a voxel, interpolated: the distance to the
voxels' cubes themselves feels every step of a stair, and strands on walls that are not aligned with the grid.

**Safety.** A step is at most half of the room: the exact distance to the nearest cube, or half a voxel where that is
less. The eight voxels around x hold every cube that is so close, so no step touches a blocked voxel.

Positions are index coordinates (whole numbers at voxel centres); the obstacles are those of the dilated grid.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float64, Int64

from maxjax.baselines.rrt_star import line_of_sight
from maxjax.compile.stage_timer import time_stage
from maxjax.core.status import Status
from maxjax.planning.path.route import Route, no_route, route_of
from maxjax.planning.problem.problem import Problem

# The best of what was tried on the training map (d₀ 1 to 5, η 0.001 to 10, D 0.5 to 5): 20 of 30 problems. More
# repulsion only stalls sooner: the distance that a flight needs is in the dilated grid already.
_CONIC = 1.0  # D [voxels]
_REACH = 1.0  # d₀ [voxels]
_REPULSION = 0.03  # η [voxels³]: a wall straight in front holds the descent 0.3 voxels before it
_PRICED = 0.1  # η_n [voxels]: with 0.3 half of 40 problems arrive, with this 28, without prices 29
_RATE = 0.1  # α [voxels]
_STEPS = 8000
# Without progress of a voxel in so many steps, it is stuck.
_PATIENCE = 500
_EDGE = 1e-3  # kept from the outer faces of the map [voxels]
_CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))
_SIGNS = 2.0 * _CORNERS - 1
# Which components of a step survive: all, then two, then one.
_MASKS = sorted(_CORNERS[1:], key=lambda mask: -mask.sum())

Volume = Float64[np.ndarray, "nx ny nz"]
Point = Float64[np.ndarray, " 3"]


@dataclasses.dataclass(frozen=True)
class APF:
    """The planner that descends an artificial potential field."""

    name: ClassVar[str] = "apf"
    batched: ClassVar[bool] = False

    def route(self, problem: Problem) -> Route:
        """The descent from start to goal; PATH_STALLED where it gets stuck."""
        with time_stage("distance"):
            distance = distance_field(np.asarray(problem.blocked))
        with time_stage("descend"):
            start, goal = (np.asarray(end, np.float64) for end in (problem.start, problem.goal))
            price = None if problem.price is None else np.asarray(problem.price, np.float64)
            clear = line_of_sight(np.asarray(problem.blocked), problem.room) if problem.room else None
            path = descend(distance, start, goal, price, clear)
        if path is None:
            return no_route(Status.PATH_STALLED)
        return route_of(path, certified=False)


def distance_field(blocked: Bool[np.ndarray, "nx ny nz"]) -> Volume:
    """Distance from each voxel's centre to the nearest blocked centre, less half a voxel; negative where blocked."""
    from scipy import ndimage  # for this rival alone; the command line answers without

    if not blocked.any():
        return np.full(blocked.shape, np.inf)
    return np.asarray(ndimage.distance_transform_edt(~blocked)) - 0.5


def look(distance: Volume, x: Point) -> tuple[float, Point, float]:
    """The distance at a point, its gradient, and the room around it: the radius of a ball that is free [voxels]."""
    value, gradient, corners, values = trilinear(distance, x)
    gaps = np.maximum(np.abs(x - corners) - 0.5, 0)
    room = float(np.sqrt(np.where(values < 0, np.einsum("ki,ki->k", gaps, gaps), 0.25).min()))
    # Where cubes meet, what is interpolated may be off by half a voxel; the room is exact there, and positive.
    d = room if room < 0.5 else max(value, 0.5)
    return d, gradient, room


def trilinear(volume: Volume, x: Point) -> tuple[float, Point, Int64[np.ndarray, "8 3"], Float64[np.ndarray, " 8"]]:
    """Value and gradient at a point, and the eight voxels around it with their values."""
    base = np.clip(np.floor(x).astype(int), 0, np.array(volume.shape) - 2)
    corners = base + _CORNERS
    values = volume[tuple(corners.T)]
    share = np.where(_CORNERS, np.clip(x - base, 0, 1), np.clip(1 - (x - base), 0, 1))
    u, v, w = share.T
    if np.isinf(values[0]):
        return np.inf, np.zeros(3), corners, values
    return float(values @ (u * v * w)), values @ (_SIGNS * np.stack([v * w, u * w, u * v], axis=1)), corners, values


def descend(
    distance: Volume,
    start: Point,
    goal: Point,
    price: Volume | None = None,
    clear: Callable[[Point, Point], bool] | None = None,
) -> Float64[np.ndarray, "t 3"] | None:
    """The path to the goal; None where the descent gets stuck.

    Args:
        distance: from `distance_field`.
        start, goal: index coordinates.
        price: n of every voxel, whose slope repels as well. None: there is none.
        clear: whether a step may be taken; one that may not loses components until it may. None: all may.
    """
    low, high = -0.5 + _EDGE, np.array(distance.shape) - 0.5 - _EDGE
    path, x = [start], start
    for step in range(_STEPS):
        towards = goal - x
        left = float(np.linalg.norm(towards))
        d, gradient, room = look(distance, x)
        if left <= room / 2:
            return np.stack([*path, goal])
        force = towards / max(left, _CONIC)
        if price is not None:
            force = force - _PRICED * trilinear(price, x)[1]
        if d < _REACH:
            force = force + _REPULSION * (1 / d - 1 / _REACH) / d**2 * gradient
        move = _RATE * force
        size = float(np.linalg.norm(move))
        if size > room / 2:
            move *= room / 2 / size
        if clear is not None:
            move = next((mask * move for mask in _MASKS if clear(x, x + mask * move)), 0 * move)
        x = np.clip(x + move, low, high)
        path.append(x)
        if step >= _PATIENCE and np.linalg.norm(x - path[-_PATIENCE]) < 1:
            return None
    return None
