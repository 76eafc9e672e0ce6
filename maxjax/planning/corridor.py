"""Corridor: a route too long for any window, coarse to fine.

    coarse map → plan → hand-overs along it → legs in windows → hand-overs in the middle of the legs → … → one path

A coarse voxel is occupied if any of its f³ voxels is, so that a coarse path has room; where that joins nothing, if more
than half of them are. Its plan only says which way to go. Legs are planned, certified and judged on the map itself,
each in a window of its own (`planning.focus_window`). A hand-over that was put on the coarse path costs a detour, so
the legs are planned again from middle to middle, which pulls the route taut across it. The judge then passes or refuses
the whole path, on the whole map.

What is proved for a leg holds for its window; that no way along other streets is cheaper is not proved.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import operator

import numpy as np
from jaxtyping import Bool, Float64, Int64

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.focus_window import SHAPES, PlanViews, ellipsoid_box, in_windows, rounded, straight
from maxjax.planning.plan import Plan, judged, no_plan
from maxjax.planning.route import Route
from maxjax.planning.task import Task
from maxjax.programs.stage_timer import added

# Voxels of a coarse map that is solved as a whole, and the length of a leg [voxels].
_COARSE, _LEG = 2**21, 36
# Times that the legs are planned, the first time between points of the coarse path.
_PASSES = 3
# A hand-over may be this far from the coarse path, in coarse voxels.
_ASIDE = 2.0

Points = Float64[np.ndarray, "t 3"]
Volume = Bool[np.ndarray, "nx ny nz"]


def in_corridor(task: Task, plan: PlanViews) -> Plan:
    """The plan of the only problem of a task, in a corridor of windows.

    Args:
        task: whose map is too large to be solved as a whole.
        plan: plans of what a device is shown.

    Returns:
        A plan, OK only for a path that the judge passed; any other status says nothing about the map.
    """
    spent: dict[str, float] = {}
    (found,) = _nothing(task)
    for share, factor in itertools.product((0.0, 0.5), _factors(task)):
        guide = _guide(task, share, factor, plan)
        spent = added(spent, guide.timings)
        if guide.status != Status.OK:
            continue
        points = _handovers(task, guide, _ASIDE * factor)
        for k in range(1, _PASSES + 1):
            legs = _legs(task, points, plan)
            spent = functools.reduce(added, (leg.timings for leg in legs), spent)
            if any(leg.status != Status.OK for leg in legs):
                break
            points = _between(task, legs, 0.5 * (k % 2))
        else:
            found = _joined(task, legs)
        if found.status == Status.OK:
            break
    return dataclasses.replace(found, timings=spent)


def _legs(task: Task, points: Points, plan: PlanViews) -> list[Plan]:
    """Plans from each point to the next."""
    starts, goals = points[:-1], points[1:]
    some = dataclasses.replace(task, starts=starts, goals=goals, map_of=np.zeros(len(starts), np.int64))
    return in_windows(some, plan, _nothing)


def _factors(task: Task) -> list[int]:
    """f: the least at which a window of the coarse map holds the way, and that at which it is solved as a whole."""
    shape = np.array(task.occupied.shape)
    low, high = ellipsoid_box(task.index[0], straight(task.index[0]), shape)
    window = math.ceil(((high - low + 1) / np.array(SHAPES[-1])).max())
    whole = math.ceil((task.occupied.size / _COARSE) ** (1 / 3))
    return sorted({max(factor, 2) for factor in (min(window, whole), whole)})


def _guide(task: Task, share: float, factor: int, plan: PlanViews) -> Plan:
    """The plan in a coarse map (`coarse_task`)."""
    some = coarse_task(task, share, factor)
    small = some.occupied.size <= 2 * _COARSE
    (found,) = in_windows(some, plan, (lambda whole: plan([rounded(whole)])[0]) if small else _nothing)
    return found


def coarse_task(task: Task, share: float, factor: int) -> Task:
    """A task in voxels of `factor`³ voxels, occupied where more than this share is; the ends stand in free ones."""
    occupied, ground = (coarse(volume, factor, share) for volume in (task.occupied, task.ground))
    fine = task.grid
    x, y, z = (o + fine.spacing * (factor - 1) / 2 for o in fine.origin)
    grid = Grid(occupied.shape, factor * fine.spacing, (x, y, z))
    for end in task.index[0]:
        _open(occupied, np.floor((end + 0.5) / factor).astype(int), task.occupied, factor)
    return dataclasses.replace(task, occupied=occupied, ground=ground & occupied, grid=grid)


def _nothing(task: Task) -> list[Plan]:
    """No plans: what no window answers."""
    return [no_plan(Status.NO_VALID_PATH, "", task.distances)] * len(task)


def coarse(volume: Volume, factor: int, share: float) -> Bool[np.ndarray, "mx my mz"]:
    """Voxels of `factor`³ voxels of which more than this share is in a volume; beyond it nothing is."""
    counts = np.zeros([-(-n // factor) for n in volume.shape], np.uint16)
    for offset in itertools.product(range(factor), repeat=3):
        part = volume[tuple(slice(k, None, factor) for k in offset)]
        counts[tuple(map(slice, part.shape))] += part
    more: Bool[np.ndarray, "mx my mz"] = counts > share * factor**3
    return more


def _open(occupied: Volume, index: Int64[np.ndarray, " 3"], fine: Bool[np.ndarray, "fx fy fz"], factor: int) -> None:
    """Free the coarse voxels around an end that have any room in them: the end stands in one."""
    low = [max(i - 1, 0) for i in index.tolist()]
    around = tuple(slice(a, i + 2) for a, i in zip(low, index.tolist(), strict=True))
    held = fine[tuple(slice(a * factor, (i + 2) * factor) for a, i in zip(low, index.tolist(), strict=True))]
    occupied[around] &= ~coarse(~held, factor, 0.0)


def _handovers(task: Task, guide: Plan, reach: float) -> Points:
    """Points of a coarse path about a leg apart, moved to where the map has most room, so far away [voxels] at most."""
    length = _LEG * task.grid.spacing
    count = max(round(guide.length / length), 1)
    on_path = _at(guide.path, np.arange(1, count) / count)
    kept = [task.starts[0], *(_roomy(task, point, reach) for point in on_path), task.goals[0]]
    return np.array(kept)


def _roomy(task: Task, point: Float64[np.ndarray, " 3"], reach: float) -> Float64[np.ndarray, " 3"]:
    """The centre of the voxel near a point [m] that is farthest from what is occupied, for how far it is away."""
    grid, origin = task.grid, np.array(task.grid.origin)
    index = (point - origin) / grid.spacing
    margin = task.distances.margin / grid.spacing
    around = math.ceil(reach + margin) + 1
    low = np.maximum(np.round(index).astype(int) - around, 0)
    box = task.occupied[
        tuple(slice(a, int(i) + around + 1) for a, i in zip(low.tolist(), np.round(index), strict=True))
    ]
    from scipy import ndimage  # a quarter of a second that a plan in one window can do without

    room = np.minimum(ndimage.distance_transform_edt(~box), margin + 1) if box.any() else np.full(box.shape, margin)
    away = functools.reduce(
        operator.add,
        np.ix_(*((np.arange(n) + a - i) ** 2 for n, a, i in zip(box.shape, low.tolist(), index.tolist(), strict=True))),
    )
    score = np.where((away <= reach**2) & ~box, room - 0.5 * np.sqrt(away), -np.inf)
    best = np.array(np.unravel_index(np.argmax(score), box.shape))
    centre: Float64[np.ndarray, " 3"] = origin + grid.spacing * (low + best)
    return centre


def _at(path: Points, shares: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, "n 3"]:
    """Points of a path at these shares of its length."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    return np.stack([np.interp(shares * along[-1], along, path[:, k]) for k in range(3)], axis=1)


def _between(task: Task, legs: list[Plan], shift: float) -> Points:
    """The ends, and hand-overs on the path of these legs, the first of them this part of a leg from the start."""
    path = _whole(legs)
    count = max(round(sum(leg.length for leg in legs) / (_LEG * task.grid.spacing)), 1)
    shares = (np.arange(count) + shift) / count
    return np.concatenate([path[:1], _at(path, shares[shares > 0]), path[-1:]])


def _whole(legs: list[Plan]) -> Points:
    """The path of all legs [m]."""
    return np.concatenate([legs[0].path, *(leg.path[1:] for leg in legs[1:])])


def _joined(task: Task, legs: list[Plan]) -> Plan:
    """The legs as one plan, if the judge passes it."""
    grid = task.grid
    route = Route(
        (_whole(legs) - np.array(grid.origin)) / grid.spacing,
        np.asarray(Status.OK, np.int32),
        np.asarray(all(leg.certified for leg in legs)),
        balls=np.array([legs[0].balls[0], legs[-1].balls[1]], np.float32),
        geodesic=np.asarray(any(leg.potential == "geodesic" for leg in legs)),
        cost=np.asarray(sum(leg.cost for leg in legs), np.float32),
    )
    (plan,) = judged([route], task, legs[0].method)
    return plan
