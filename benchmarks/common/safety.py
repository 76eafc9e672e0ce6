"""How safe a path is, how safe it could have been, and what the cheapest way costs; judged without maxjax.

    clearance   least distance from a point of the path to the cube of a solid voxel (ground left out)
    cruise      the same over the points farther than `AWAY` from both ends
    a way       26-neighbour path that cuts no corner; with clearance c, its voxels and the middles of its steps keep c,
                except within `AWAY` of the ends
    cost        ∫ n ds of a polyline, n trilinear between voxel centres; along a step its length times the mean of n

Lengths are in voxels, points in index coordinates (whole numbers at voxel centres). Ways run from the exact start to
the exact goal, over any of the 27 voxels around an end that a straight step may reach.

**Distances.** The point of a cube that is nearest to a voxel's centre, or to the middle of a step, has half-integer
coordinates, so SciPy's transform on a lattice twice as fine is exact there. From any other point, the distances to a
cube and to its centre differ by at most √3/2: nearest centres of a k-d tree, more of them until none is left that could
be nearer.

**Fast marching** on voxels of 2 m finds times that are high by a hundredth in the mean, as it turns corners late.

**Windows.** A price is at least 1, so a path of cost B stays in the ellipsoid |x − start| + |x − goal| ≤ B. Searching
that ellipsoid alone finds the optimum, if what it finds costs no more than B; else B is raised to it, and one more
search does.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable

import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

AWAY = 10.0  # what is closer to an end is not away from it [m]

_SAMPLE = 0.05  # spacing of samples along a path [voxels]
_HALF_DIAGONAL = np.sqrt(3) / 2
_FALL = 3.0  # of the exponential price, over the margin
_FRONT = 3.0  # radius of the ball that a front starts from, at most [voxels]
_SLACK = 1.02  # of the ellipsoid that a front is followed in
_AXES = [step for step in itertools.product((-1, 0, 1), repeat=3) if step > (0, 0, 0)]


@dataclasses.dataclass(frozen=True)
class Walls:
    """A map, with what many judgements share.

    Attributes:
        occupied: voxels, ground included.
        ground: those that are ground; a path keeps off them and their six neighbours.
        spacing: of the voxels [m].
    """

    occupied: np.ndarray
    ground: np.ndarray
    spacing: float

    @functools.cached_property
    def free(self) -> np.ndarray:
        """Voxels that a path may enter."""
        return np.asarray(~(self.occupied | ndimage.binary_dilation(self.ground)))

    @functools.cached_property
    def labels(self) -> np.ndarray:
        """Number of the component of each free voxel; steps that cut no corner join what faces join."""
        labels, _ = ndimage.label(self.free)
        return np.asarray(labels)

    @functools.cached_property
    def halves(self) -> np.ndarray:
        """Distance to the solids [voxels] on the lattice twice as fine: voxel i is point 2 i + 1 along an axis."""
        solid = self.occupied & ~self.ground
        shape = tuple(2 * n + 1 for n in solid.shape)
        if not solid.any():
            return np.full(shape, np.inf, np.float32)
        filled = np.zeros(shape, bool)
        for offset in itertools.product(range(3), repeat=3):
            window = tuple(slice(o, o + 2 * n - 1, 2) for o, n in zip(offset, solid.shape, strict=True))
            filled[window] |= solid
        # Which voxel is nearest, in whole numbers: SciPy's own distances from it take twice as long.
        nearest = ndimage.distance_transform_edt(~filled, return_distances=False, return_indices=True)
        squared = sum(
            (own - other) ** 2 for own, other in zip(np.ogrid[tuple(map(slice, shape))], nearest, strict=True)
        )
        return np.asarray(0.5 * np.sqrt(squared, dtype=np.float32))

    @property
    def distance(self) -> np.ndarray:
        """Distance from each voxel's centre to the solids [voxels]."""
        return self.halves[1::2, 1::2, 1::2]

    @functools.cached_property
    def _faces(self) -> tuple[np.ndarray, cKDTree | None]:
        """Centres of the solid voxels that have a face, and their tree."""
        solid = self.occupied & ~self.ground
        centres = np.argwhere(solid & ~ndimage.binary_erosion(solid, border_value=1))
        return centres, cKDTree(centres) if len(centres) else None

    def distance_at(self, points: np.ndarray) -> np.ndarray:
        """Distance [voxels] from points outside the solids (p, 3) to their cubes (p,); 0 on a face."""
        centres, tree = self._faces
        best = np.full(len(points), np.inf)
        if tree is None:
            return best
        waiting, k = np.arange(len(points)), 8
        while waiting.size:
            k = min(k, len(centres))
            reach, nearest = (np.reshape(x, (len(waiting), k)) for x in tree.query(points[waiting], k))
            gaps = np.maximum(np.abs(points[waiting, None] - centres[nearest]) - 0.5, 0)
            best[waiting] = np.sqrt(np.einsum("pki,pki->pk", gaps, gaps)).min(axis=1)
            settled = (reach[:, -1] - _HALF_DIAGONAL >= best[waiting]) | (k == len(centres))
            waiting, k = waiting[~settled], 4 * k
        return best


def price(distance: np.ndarray, margin: float, shape: str, height: float) -> np.ndarray:
    """The price n ≥ 1 at a distance from the walls, 1 from the margin on, 1 + height on a wall.

    Args:
        distance, margin: in one unit.
        shape: `quadratic`, `exponential` or `speed`.
        height: of the rise.
    """
    part = np.clip(distance / margin, 0, 1) if margin else np.ones_like(distance)
    if shape == "quadratic":
        return np.asarray(1 + height * (1 - part) ** 2)
    if shape == "exponential":
        return np.asarray(1 + height * np.expm1(_FALL * (1 - part)) / np.expm1(_FALL))
    if shape == "speed":
        return np.asarray(1 / np.maximum(part, 1 / (1 + height)))
    raise ValueError(f"shape: expected quadratic, exponential or speed, given {shape!r}")


def samples(path: np.ndarray, spacing: float = _SAMPLE) -> tuple[np.ndarray, np.ndarray]:
    """Middles of equal pieces of each segment, at most `spacing` long, and the pieces' lengths [voxels]."""
    step = np.diff(path, axis=0)
    length = np.linalg.norm(step, axis=1)
    count = np.maximum(np.ceil(length / spacing), 1).astype(int)
    segment = np.repeat(np.arange(len(step)), count)
    place = np.arange(len(segment)) - (np.cumsum(count) - count)[segment] + 0.5
    return path[:-1][segment] + (place / count[segment])[:, None] * step[segment], (length / count)[segment]


@dataclasses.dataclass(frozen=True)
class Kept:
    """What a path keeps, in voxels.

    Attributes:
        least: over the whole path.
        cruise: away from the ends; infinite where nothing of it is.
        outside: outside balls around the ends.
        mean: over its length.
        occupied: whether it enters an occupied voxel, ground included, or leaves the map.
        below: whether it enters a voxel that is not free, outside these balls.
    """

    least: float
    cruise: float
    outside: float
    mean: float
    occupied: bool
    below: bool


def kept(walls: Walls, path: np.ndarray, balls: tuple[float, float] = (0.0, 0.0)) -> Kept:
    """Sample a path (t, 3) densely.

    Args:
        walls: the map.
        path: start first, goal last.
        balls: radii around start and goal [voxels].
    """
    middles, pieces = samples(path)
    points = np.concatenate([path, middles])
    index = np.floor(points + 0.5).astype(int)
    inside = np.all((index >= 0) & (index < walls.occupied.shape), axis=1)
    occupied = np.ones(len(points), bool)
    occupied[inside] = walls.occupied[tuple(index[inside].T)]
    free = np.zeros(len(points), bool)
    free[inside] = walls.free[tuple(index[inside].T)]
    distance = np.where(occupied, 0.0, walls.distance_at(points))
    ends = np.linalg.norm(points[:, None] - path[[0, -1]], axis=-1)
    away = ends.min(axis=1) > AWAY / walls.spacing
    outside = np.all(ends > balls, axis=1)
    return Kept(
        float(distance.min()),
        float(distance[away].min(initial=np.inf)),
        float(distance[outside].min(initial=np.inf)),
        float(np.average(np.minimum(distance[len(path) :], 1e6), weights=pieces)) if pieces.sum() else distance[0],
        bool(occupied.any()),
        bool((~free & outside).any()),
    )


def cost(path: np.ndarray, prices: np.ndarray) -> float:
    """∫ n ds along a polyline (t, 3) [voxels], n trilinear between the centres of the voxels."""
    points, pieces = samples(path)
    return float(pieces @ ndimage.map_coordinates(prices, points.T, order=1, mode="nearest"))


@dataclasses.dataclass(frozen=True)
class _Window:
    """The voxels of an ellipsoid around two ends: a box of the map, and which of the box."""

    low: np.ndarray
    box: tuple[slice, slice, slice]
    inside: np.ndarray


def _window(shape: tuple[int, ...], start: np.ndarray, goal: np.ndarray, bound: float) -> _Window:
    """The ellipsoid |x − start| + |x − goal| ≤ bound, with the voxels around the ends."""
    middle, along = 0.5 * (start + goal), goal - start
    straight = float(np.linalg.norm(along))
    bound = max(bound, straight + 2.0)
    along = along / max(straight, 1e-9)
    half = 0.5 * np.sqrt(bound**2 * along**2 + (bound**2 - straight**2) * (1 - along**2)) + 2
    low = np.maximum(np.floor(middle - half), 0).astype(int)
    high = np.minimum(np.ceil(middle + half) + 1, shape).astype(int)
    axes = np.ogrid[tuple(slice(a, b) for a, b in zip(low, high, strict=True))]
    sums = sum(np.sqrt(sum((x - e) ** 2 for x, e in zip(axes, end, strict=True))) for end in (start, goal))
    box = (slice(low[0], high[0]), slice(low[1], high[1]), slice(low[2], high[2]))
    return _Window(low, box, np.asarray(sums <= bound))


def _half_window(window: _Window) -> tuple[slice, ...]:
    """The box on the lattice twice as fine, from the first voxel's centre to the last's."""
    return tuple(slice(2 * s.start + 1, 2 * s.stop) for s in window.box)


def _search(
    free: np.ndarray,
    open_halves: np.ndarray | None,
    prices: np.ndarray | None,
    ends: tuple[np.ndarray, np.ndarray],
    window: _Window,
) -> float:
    """Cost of the cheapest way within a window; infinite if there is none. Arrays are the window's."""
    nodes = free & window.inside
    if open_halves is not None:
        nodes &= open_halves[::2, ::2, ::2]
    number = np.cumsum(nodes.ravel()).reshape(nodes.shape) - 1
    count = int(nodes.sum())
    rows, columns, weights = [], [], []
    for step in _AXES:
        source = tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip(step, free.shape, strict=True))
        target = tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in zip(step, free.shape, strict=True))
        legal = nodes[source] & nodes[target]
        for part in itertools.product(*({0, s} for s in step)):
            if part not in ((0, 0, 0), step):
                legal &= free[tuple(slice(c.start + p, c.stop + p) for c, p in zip(source, part, strict=True))]
        if open_halves is not None:
            middle = tuple(slice(2 * c.start + s, 2 * c.stop - 1 + s, 2) for c, s in zip(source, step, strict=True))
            legal &= open_halves[middle]
        rows.append(number[source][legal])
        columns.append(number[target][legal])
        length = np.sqrt(np.count_nonzero(step))
        mean = 1.0 if prices is None else 0.5 * (prices[source][legal] + prices[target][legal])
        weights.append(np.broadcast_to(length * mean, rows[-1].shape))
    for k, end in enumerate(ends):
        near, price_there = _around(free, nodes, end), 1.0 if prices is None else _interpolated(prices, end)
        rows.append(number[tuple(near.T)])
        columns.append(np.full(len(near), count + k))
        length = np.linalg.norm(near - end, axis=1)
        weights.append(length * (1.0 if prices is None else 0.5 * (prices[tuple(near.T)] + price_there)) + 1e-12)
    row, column, weight = (np.concatenate(x) for x in (rows, columns, weights))
    graph = sparse.csr_array((weight, (row, column)), shape=(count + 2, count + 2))
    return float(np.asarray(dijkstra(graph, directed=False, indices=np.array([count])))[0, count + 1])


def _around(free: np.ndarray, nodes: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The nodes (k, 3) around an end that a straight step reaches without cutting a corner."""
    own = np.floor(end + 0.5).astype(int)
    found = []
    for step in itertools.product((-1, 0, 1), repeat=3):
        at = own + step
        if np.all((at >= 0) & (at < free.shape)) and nodes[tuple(at)]:
            span = tuple(slice(min(a, b), max(a, b) + 1) for a, b in zip(own, at, strict=True))
            if free[span].all():
                found.append(at)
    return np.array(found, int).reshape(-1, 3)


def _interpolated(prices: np.ndarray, point: np.ndarray) -> float:
    return float(ndimage.map_coordinates(prices, point[:, None], order=1, mode="nearest")[0])


def way(walls: Walls, start: np.ndarray, goal: np.ndarray, clearance: float = 0.0, most: float = np.inf) -> float:
    """Length of the shortest way with a clearance [voxels]; infinite where there is none, or none within `most`.

    Args:
        walls: the map.
        start, goal: index coordinates.
        clearance: kept away from the ends [voxels]; near them, ways may use all unoccupied voxels.
        most: the longest of interest [voxels].
    """

    def search(window: _Window) -> float:
        inner = (np.arange(s.start, s.stop - 0.5, 0.5) for s in window.box)  # centres and middles between them
        axes = np.ix_(*(x[x <= s.stop - 1] for x, s in zip(inner, window.box, strict=True)))
        away = [sum((x - e) ** 2 for x, e in zip(axes, end, strict=True)) for end in (start, goal)]
        near = np.minimum(*away) <= (AWAY / walls.spacing) ** 2
        free = walls.free[window.box] | (near[::2, ::2, ::2] & ~walls.occupied[window.box])
        halves = (walls.halves[_half_window(window)] >= clearance - 1e-4) | near if clearance else None
        moved = start - window.low, goal - window.low
        return _search(free, halves, None, moved, window)

    return _least(search, walls.occupied.shape, start, goal, most)


def cheapest(walls: Walls, start: np.ndarray, goal: np.ndarray, prices: np.ndarray) -> float:
    """Cost of the cheapest way [voxels]; infinite where there is none.

    Args:
        walls: the map.
        start, goal: index coordinates.
        prices: n of every voxel, at least 1.
    """

    def search(window: _Window) -> float:
        moved = start - window.low, goal - window.low
        return _search(walls.free[window.box], None, prices[window.box].astype(np.float64), moved, window)

    return _least(search, prices.shape, start, goal, np.inf)


def _least(
    search: Callable[[_Window], float], shape: tuple[int, ...], start: np.ndarray, goal: np.ndarray, most: float
) -> float:
    """The least that `search` finds in ever larger windows, once it fits the window it was found in."""
    bound = 1.2 * float(np.linalg.norm(goal - start)) + 4.0
    largest = 2.0 * float(np.linalg.norm(shape))
    while True:
        bound = min(bound, most)
        found = search(_window(shape, start, goal, bound))
        if found <= bound or bound >= most:
            return found if found <= most else np.inf
        if bound >= largest:
            return found
        bound = found + 1e-6 if np.isfinite(found) else 1.6 * bound


def marched(walls: Walls, start: np.ndarray, goal: np.ndarray, prices: np.ndarray, bound: float) -> float:
    """Travel time from goal to start at speed 1/n by second-order fast marching [voxels]; NaN if it does not arrive.

    The front starts where straight rays from the goal cost τ, in a ball that no wall reaches if there is room.

    Args:
        walls: the map.
        start, goal: index coordinates.
        prices: n of every voxel, at least 1.
        bound: cost of some path, which bounds the window.
    """
    import skfmm  # an extra

    window = _window(prices.shape, start, goal, _SLACK * bound)
    free = walls.free[window.box]
    local, source, sink = prices[window.box].astype(np.float64), goal - window.low, start - window.low
    axes = np.ogrid[tuple(map(slice, free.shape))]
    distance = np.sqrt(sum((x - e) ** 2 for x, e in zip(axes, source, strict=True)))
    reach = float(np.clip(distance[~free].min(initial=np.inf) - 1, 1, _FRONT))
    rays = distance * _interpolated(local, source)
    near = np.argwhere(distance <= reach + 2)
    rays[tuple(near.T)] = _straight(local, source, near)
    own = tuple(np.floor(source + 0.5).astype(int))
    tau = max(reach * float(local[distance <= reach + 1].min()), 1.05 * rays[own])
    time = skfmm.travel_time(np.ma.MaskedArray(rays - tau, ~(free & window.inside)), 1 / local, order=2)
    time = np.ma.filled(time, np.nan)
    base = np.clip(np.floor(sink).astype(int), 0, np.array(free.shape) - 2)
    corners = base + np.array(list(np.ndindex(2, 2, 2)))
    times = time[tuple(corners.T)]
    if np.isfinite(times).all():
        return float(ndimage.map_coordinates(times.reshape(2, 2, 2), (sink - base)[:, None], order=1)[0] + tau)
    near = _around(free, np.isfinite(time), sink)
    if not len(near):
        return np.nan
    return float((time[tuple(near.T)] + _straight(local, sink, near)).min() + tau)


def _straight(prices: np.ndarray, end: np.ndarray, voxels: np.ndarray) -> np.ndarray:
    """∫ n ds along the straight segments from a point to voxels (k, 3) [voxels]."""
    share = (np.arange(16) + 0.5) / 16
    points = end + share[:, None] * (voxels - end)[:, None]
    along = ndimage.map_coordinates(prices, points.reshape(-1, 3).T, order=1, mode="nearest").reshape(-1, 16)
    return np.asarray(np.linalg.norm(voxels - end, axis=1) * along.mean(axis=1))
