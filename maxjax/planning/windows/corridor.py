"""Corridor: a route too long for any window, coarse to fine.

    guide → hand-overs along it → legs in windows → hand-overs in the middle of the legs → … → one route

The guide is the cheapest path on the lattice of voxels (`planning.windows.lattice_guide`). Without a compiled A* it is
the cheapest of several routes in coarse maps, whose voxels are occupied if any of their f³ voxels is, or if more than
half of them are. A guide only says which way to go. Legs are planned and certified on the map itself, each in a window
of its own (`planning.windows.focus_window`). A hand-over on the guide costs a detour, so the legs are planned again
from middle to middle, which pulls the route taut across it. The verifier then passes or refuses the whole path, on the
whole map.

What is proved for a leg holds for its window. That no way along other streets is cheaper is known as far as the guide's
cost tells: `PlanStats.ratio` is the route's over it (over the straight line, with a coarse guide).
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import operator

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from maxjax.compile.stage_timer import recording
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.path.route import Route, Routes, equal_shares
from maxjax.planning.problem.task import Task
from maxjax.planning.windows.focus_window import SHAPES, round_up
from maxjax.planning.windows.geometry import ellipsoid_box, guess_costs
from maxjax.planning.windows.growth import FinderOf, find_in_windows
from maxjax.planning.windows.lattice_guide import Show, lattice_path

# Voxels of a coarse map that is solved as a whole, and the length of a leg [voxels].
_COARSE, _LEG = 2**21, 36
# Times that the legs are planned, the first time between points of the coarse path.
_PASSES = 3
# A hand-over may be this far from a lattice path [voxels], and from a coarse path [coarse voxels].
_BESIDE, _ASIDE = 1.0, 2.0
# What a route may cost, in terms of the straight line or of the guide, without a look at others or a warning.
NEARLY = 1.2
_ONLY = np.arange(1)

Points = Float64[np.ndarray, "_ 3"]
Volume = Bool[np.ndarray, "nx ny nz"]


def find_in_corridor(task: Task, finder_of: FinderOf, show: Show) -> Routes:
    """The route of the only problem of a task, in a corridor of windows.

    Args:
        task: whose map is too large to be solved as a whole.
        finder_of: a task ↦ what finds the routes of windows of its maps.
        show: the only problem of what a device is shown.

    Returns:
        A route; any status but OK says nothing about the map.
    """
    task = dataclasses.replace(task, map=task.map_at(0), map_of=np.zeros(1, np.int64))
    with recording() as recorder:
        guide = lattice_path(task, show)
    spent = Routes.blank(1).add_seconds(_ONLY, equal_shares(recorder, 1))
    if guide is not None:
        route, spent = _along(task, task.grid.to_metres(guide.points), _BESIDE, finder_of, spent)
        if route is not None:
            spacing = task.grid.spacing
            return spent.put(_ONLY, Routes(route, ratio=np.array([_cost(route, spacing) / (spacing * guide.cost)])))
    return _coarsely(task, finder_of, spent)


def _coarsely(task: Task, finder_of: FinderOf, spent: Routes) -> Routes:
    """The cheapest of the routes that paths in coarse maps guide to; the first that is nearly straight will do."""
    best, least = None, math.inf
    straight_line = float(np.linalg.norm(task.goals[0] - task.starts[0]))
    for share, factor in itertools.product((0.0, 0.5), _factors(task)):
        coarse_map = coarsen_task(task, share, factor)
        guide = _guide(coarse_map, finder_of)
        spent = spent.add_seconds(_ONLY, guide.timings)
        if not guide.ok.all():
            continue
        points = coarse_map.grid.to_metres(_path(guide, 0))
        route, spent = _along(task, points, _ASIDE * factor, finder_of, spent)
        if route is not None and (cost := _cost(route, task.grid.spacing)) < least:
            best, least = route, cost
            if least <= NEARLY * straight_line:
                break
    if best is None:
        return spent
    return spent.put(_ONLY, Routes(best, ratio=np.array([least / straight_line])))


def _along(task: Task, guide: Points, reach: float, finder_of: FinderOf, spent: Routes) -> tuple[Route | None, Routes]:
    """The route that a path [m] guides to, hand-overs so far beside it [voxels]; and the seconds that it took."""
    points = _handovers(task, guide, reach)
    for k in range(1, _PASSES + 1):
        legs = _legs(task, points, finder_of)
        spent = spent.add_seconds(_ONLY, {name: np.nansum(s, keepdims=True) for name, s in legs.timings.items()})
        if not _sound(legs):
            return None, spent
        points = _between(task, legs, 0.5 * (k % 2))
    return _join(legs), spent


def _cost(route: Route, spacing: float) -> float:
    """Cost of the only route [m]; its length where nothing is priced."""
    return float(route.cost[0]) or spacing * _length(np.asarray(route.path[0], np.float64))


def _legs(task: Task, points: Points, finder_of: FinderOf) -> Routes:
    """Routes from each point to the next."""
    some = task.with_ends(points[:-1], points[1:])
    return find_in_windows(some, finder_of(some), _nothing)


def _sound(legs: Routes) -> bool:
    """Whether all legs have a path, and none needs an exemption where it is handed over."""
    inner = np.concatenate([legs.route.exemptions[:-1, 1], legs.route.exemptions[1:, 0]])
    return bool(legs.ok.all() and not inner.any())


def _path(routes: Routes, k: int) -> Points:
    """One of the paths, index coordinates, without repeated points."""
    path: Points = np.asarray(routes.route.path[k], np.float64)
    distinct: Points = path[np.concatenate([[True], (path[1:] != path[:-1]).any(axis=1)])]
    return distinct


def _factors(task: Task) -> list[int]:
    """f: the least at which a window of the coarse map holds the way, and that at which it is solved as a whole."""
    shape = np.array(task.grid.shape)
    low, high = ellipsoid_box(task.index, guess_costs(task.index, np), shape, np)
    window = math.ceil(((high - low + 1) / np.array(SHAPES[-1])).max())
    whole = math.ceil((math.prod(task.grid.shape) / _COARSE) ** (1 / 3))
    return sorted({max(factor, 2) for factor in (min(window, whole), whole)})


def _guide(coarse_map: Task, finder_of: FinderOf) -> Routes:
    """The route in a coarse map (`coarsen_task`)."""
    finder = finder_of(coarse_map)
    small = math.prod(coarse_map.grid.shape) <= 2 * _COARSE
    return find_in_windows(coarse_map, finder, (lambda whole: finder.find(round_up(whole))) if small else _nothing)


def coarsen_task(task: Task, share: float, factor: int) -> Task:
    """A task in voxels of `factor`³ voxels, occupied where more than this share is; the ends stand in free ones."""
    occupied, ground = (coarsen(volume, factor, share) for volume in (task.barred, task.kept_off))
    fine = task.grid
    x, y, z = (o + fine.spacing * (factor - 1) / 2 for o in fine.origin)
    grid = Grid(occupied.shape, factor * fine.spacing, (x, y, z))
    for end in task.index[0]:
        _open(occupied, np.floor((end + 0.5) / factor).astype(int), task.barred, factor)
    where = VoxelMap(occupied, ground & occupied, None, grid)
    price = None if task.price is None else coarsen_price(task.price, factor)
    return dataclasses.replace(task, map=where, price=price)


def coarsen_price(price: Float32[np.ndarray, "nx ny nz"], factor: int) -> Float32[np.ndarray, "mx my mz"]:
    """Mean price in voxels of `factor`³ voxels; 1 beyond the map."""
    filled = np.pad(price, [(0, -n % factor) for n in price.shape], constant_values=1.0)
    x, y, z = (n // factor for n in filled.shape)
    mean: Float32[np.ndarray, "mx my mz"] = filled.reshape(x, factor, y, factor, z, factor).mean(axis=(1, 3, 5))
    return mean


def _nothing(task: Task) -> Routes:
    """No routes: what no window answers."""
    return Routes.blank(len(task))


def coarsen(volume: Volume, factor: int, share: float) -> Bool[np.ndarray, "mx my mz"]:
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
    occupied[around] &= ~coarsen(~held, factor, 0.0)


def _handovers(task: Task, guide: Points, reach: float) -> Points:
    """Points of a coarse path [m] about a leg apart, moved to where the map has most room, so far away [voxels]."""
    count = max(round(_length(guide) / (_LEG * task.grid.spacing)), 1)
    on_path = _at(guide, np.arange(1, count) / count)
    kept = [task.starts[0], *(_roomy(task, point, reach) for point in on_path), task.goals[0]]
    return np.array(kept)


def _roomy(task: Task, point: Float64[np.ndarray, " 3"], reach: float) -> Float64[np.ndarray, " 3"]:
    """The centre of the voxel near a point [m] that is farthest from what is occupied, for how far it is away."""
    grid, origin = task.grid, np.array(task.grid.origin)
    index = (point - origin) / grid.spacing
    margin = task.distances.margin / grid.spacing
    around = math.ceil(reach + margin) + 1
    low = np.maximum(np.round(index).astype(int) - around, 0)
    box = task.barred[tuple(slice(a, int(i) + around + 1) for a, i in zip(low.tolist(), np.round(index), strict=True))]
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


def _length(path: Points) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _between(task: Task, legs: Routes, shift: float) -> Points:
    """The ends, and hand-overs on the path of these legs, the first of them this part of a leg from the start."""
    path = task.grid.to_metres(_whole_path(legs))
    count = max(round(_length(path) / (_LEG * task.grid.spacing)), 1)
    shares = (np.arange(count) + shift) / count
    return np.concatenate([task.starts[:1], _at(path, shares[shares > 0]), task.goals[:1]])


def _whole_path(legs: Routes) -> Points:
    """The path of all legs, index coordinates."""
    return np.concatenate([_path(legs, 0), *(_path(legs, k)[1:] for k in range(1, len(legs)))])


def _join(legs: Routes) -> Route:
    """The legs as one route, in a batch of one."""
    route = legs.route
    return Route(
        _whole_path(legs)[None],
        np.full(1, int(Status.OK), np.int32),
        np.array([route.certified.all()]),
        exemptions=np.array([[route.exemptions[0, 0], route.exemptions[-1, 1]]], np.float32),
        geodesic=np.array([route.geodesic.any()]),
        cost=np.array([route.cost.sum()]),
    )
