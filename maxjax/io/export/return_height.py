"""The least height at which a return to launch is clear from everywhere on a mission.

    upright from a place of the path to the height, level and straight to home, upright down to home

The level parts of all places together are the triangles of home and each segment of the path. At a height H they keep
the radius r from a column whose highest voxel ends at t, at the horizontal distance h < r of them, where

    H ≥ t + √(r² − h²)

and above ground they keep one voxel, where h is less than a voxel. The least such H is exact. Whoever is above it
already returns where it is, over all of that as well.

The climb is clear whatever the height, or it is for none: where something stands above a place of the path.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.core.grid import Grid, Point3
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.mission import Mission
from maxjax.verification.polylines import Paths
from maxjax.verification.verifier import verify_paths

_EVERY = 0.25  # between places from which the climb is judged [voxels]
_ALLOWED = 2e-3  # of a distance to keep, as the verifier allows it, and rounding [voxels]


@dataclasses.dataclass(frozen=True)
class ReturnHeight:
    """Where a return to launch is clear.

    Attributes:
        height: the least that is, in the map's coordinates [m]; −∞ where nothing stands on the way from anywhere.
        top: upper face of what asks for it [m].
        over: middle of that column, x and y [m].
        origin: a place of the path whose way back leads there [m].
        covered: places of the path with something above them, from which no height is clear [m].
        places: of the path for which the climb was judged.
    """

    height: float
    top: float
    over: tuple[float, float]
    origin: Point3
    covered: tuple[Point3, ...]
    places: int


def return_height(mission: Mission) -> ReturnHeight:
    """The least height of a return to launch; home lies below the first point of the path."""
    where, path = mission.map, mission.path
    obstacles = np.asarray(where.occupied) & ~np.asarray(where.ground)
    tops = [_tops(volume, where.grid) for volume in (obstacles, np.asarray(where.ground))]
    best, asked = -math.inf, (math.nan, (math.nan, math.nan), 0)
    for leg, plan in enumerate(mission.legs):
        for k in range(*mission.places[leg : leg + 2].tolist()):
            corners = np.stack([path[0, :2], path[k, :2], path[k + 1, :2]])
            for solid, top in enumerate(tops):
                kept = where.grid.spacing if solid else plan.radius
                found = _least(corners, top, where.grid, kept, level=bool(solid))
                if found[0] > best:
                    best, asked = found[0], (found[1], found[2], k)
    covered, count = _covered(mission)
    top_of, over, k = asked
    origin = _origin_of(path[0], path[k : k + 2], np.array(over)) if math.isfinite(best) else tuple(path[0].tolist())
    return ReturnHeight(best, top_of, over, origin, covered, count)


def _tops(volume: Bool[np.ndarray, "nx ny nz"], grid: Grid) -> Float64[np.ndarray, "nx ny"]:
    """Upper face of the highest voxel of each column [m]; −∞ where it has none."""
    above = volume.shape[2] - volume[:, :, ::-1].argmax(axis=2)
    return np.asarray(np.where(volume.any(axis=2), grid.lower[2] + grid.spacing * above, -math.inf))


def _least(
    corners: Float64[np.ndarray, "3 2"], tops: Float64[np.ndarray, "nx ny"], grid: Grid, kept: float, *, level: bool
) -> tuple[float, float, tuple[float, float]]:
    """Least height over a triangle [m], upper face and middle of the column that asks for it.

    Args:
        corners: of the triangle [m].
        tops: of the columns.
        grid: of them.
        kept: distance to keep [m].
        level: whether it counts upwards, from everything that is horizontally nearer; else it is a true distance.
    """
    low, edge = np.array(grid.lower[:2]), grid.spacing
    first = np.floor((corners.min(axis=0) - kept - low) / edge).astype(int)
    last = np.ceil((corners.max(axis=0) + kept - low) / edge).astype(int)
    i0, j0 = np.clip(first, 0, tops.shape).tolist()
    i1, j1 = np.clip(last, 0, tops.shape).tolist()
    i, j = np.nonzero(np.isfinite(tops[i0:i1, j0:j1]))
    if not i.size:
        return -math.inf, math.nan, (math.nan, math.nan)
    top = tops[i0 + i, j0 + j]
    middles = low + edge * (np.column_stack([i0 + i, j0 + j]) + 0.5)
    apart = _distances(corners, middles, 0.5 * edge)
    rise = np.full_like(apart, kept) if level else np.sqrt(np.maximum(kept**2 - apart**2, 0.0))
    needed = np.where((apart < kept) | (apart == 0.0), top + rise, -math.inf)
    at = int(needed.argmax())
    x, y = middles[at].tolist()
    return float(needed[at]), float(top[at]), (x, y)


def _distances(
    corners: Float64[np.ndarray, "3 2"], middles: Float64[np.ndarray, "n 2"], half: float
) -> Float64[np.ndarray, " n"]:
    """Distance between a triangle and squares about some points [m]; 0 where they meet."""
    squares = middles[:, None] + half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    edges = np.roll(corners, -1, axis=0) - corners
    length = np.maximum((edges**2).sum(axis=1), 1e-18)
    aside = squares[:, :, None] - corners
    share = np.clip((aside * edges).sum(axis=-1) / length, 0.0, 1.0)
    to_edges = np.linalg.norm(aside - share[..., None] * edges, axis=-1).min(axis=(1, 2))
    outside = np.maximum(np.abs(corners - middles[:, None]) - half, 0.0)
    to_squares = np.linalg.norm(outside, axis=-1).min(axis=1)
    # Two convex shapes are apart where a line along one of their edges parts them.
    normals = np.concatenate([np.eye(2), np.column_stack([-edges[:, 1], edges[:, 0]])])
    one, other = corners @ normals.T, squares @ normals.T
    meets = ((other.max(axis=1) >= one.min(axis=0)) & (other.min(axis=1) <= one.max(axis=0))).all(axis=1)
    return np.where(meets, 0.0, np.minimum(to_edges, to_squares))


def _origin_of(
    home: Float64[np.ndarray, " 3"], segment: Float64[np.ndarray, "2 3"], over: Float64[np.ndarray, " 2"]
) -> Point3:
    """A place of a segment whose way home leads nearest by a point."""
    places = segment[0] + np.linspace(0.0, 1.0, 101)[:, None] * (segment[1] - segment[0])
    back = home[:2] - places[:, :2]
    share = ((over - places[:, :2]) * back).sum(axis=1) / np.maximum((back**2).sum(axis=1), 1e-18)
    apart = np.linalg.norm(places[:, :2] + np.clip(share, 0.0, 1.0)[:, None] * back - over, axis=1)
    x, y, z = places[int(apart.argmin())].tolist()
    return x, y, z


def _covered(mission: Mission) -> tuple[tuple[Point3, ...], int]:
    """Places of the path with something above them, and how many were judged.

    A climb keeps the radius of its leg, or the distance that the path itself has there where that is less.
    """
    where, spacing = mission.map, mission.map.grid.spacing
    found, count = list[Point3](), 0
    roofless = VoxelMap(np.asarray(where.occupied), np.asarray(where.ground), None, where.grid)
    ceiling = where.grid.upper[2] - 1e-6 * spacing
    for leg, plan in enumerate(mission.legs):
        line = mission.leg_path(leg)
        pieces = [max(1, math.ceil(length / (_EVERY * spacing))) for length in _lengths(line)]
        places = np.concatenate(
            [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(line[:-1], line[1:], pieces, strict=True)]
            + [line[-1:]]
        )
        up = np.stack([places, np.column_stack([places[:, :2], np.maximum(places[:, 2], ceiling)])], axis=1)
        climbs = verify_paths(
            Paths(up, np.full(len(up), 2, np.int64), np.zeros(len(up), np.int64)), roofless, radius=0.0
        )
        kept = np.fmin(plan.radius, climbs.clearance_at[:, 0])
        clear = climbs.ok & (climbs.clearance >= kept - _ALLOWED * spacing)
        found += [(x, y, z) for x, y, z in places[~clear].tolist()]
        count += len(places)
    return tuple(found), count


def _lengths(line: Float64[np.ndarray, "n 3"]) -> list[float]:
    return [float(length) for length in np.linalg.norm(np.diff(line, axis=0), axis=1)]
