"""The verifier of every path: exact, in float64 NumPy, and independent of every planner and solver.

A path is the closed polyline through its points. It passes if it is finite, lies inside the map, and

    everywhere                touches no occupied voxel (`verification.contacts`)
    outside its exemptions    keeps `radius` to the cubes of occupied voxels, ground left out: a true distance
                              (`verification.clearance`); and touches no voxel within one voxel, between centres, of the
                              ground, unless the radius is 0
    inside one                keeps the end's own such distance where that is less (`verification.own_distance`); and
                              touches voxels beside the ground only if the end does

Its exemptions are balls around its first and its last point (`verification.exemptions`): the path is cut where it
enters and leaves them. The own distance of an end is measured here, whatever its planner took it to be.

**Tolerance.** Of a contact, doubt counts against the path: cubes are grown by the rounding that it may carry, which
`verification.contacts` states. Of the radius it counts for the path: a thousandth of a voxel and that rounding, by
which exemptions are larger and the distance that is kept may be shorter. Planning keeps half a voxel less
`planning.line_of_sight.TOUCH`, 2.5e-4 of a voxel, from the centre lines of blocked voxels, where the radius is half a
voxel. Length and clearance have no tolerance.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, Integer

from maxjax.core.grid import Grid, Index3, Point3
from maxjax.verification.clearance import clearances, distances_at
from maxjax.verification.contacts import contacts, tolerance_of
from maxjax.verification.exemptions import ZONES, Parts, cut
from maxjax.verification.own_distance import beside_ground, exempt_shortfall

# Radius of the balls around both ends [m] outside which a path cruises.
CRUISE = 10.0
# Of the radius, and of the balls [voxels].
_SLACK = 1e-3


@dataclasses.dataclass(frozen=True)
class Verification:
    """Verdict on a path.

    Attributes:
        ok: finite, inside, no forbidden voxel touched, and not too near. Nothing else makes a path safe.
        inside: the whole path lies in the volume of the grid.
        finite: no coordinate is NaN or infinite.
        first_hit: index of the first forbidden voxel that the path touches; None if there is none, or if the
            path is not inside.
        too_near: whether the path comes nearer to an occupied voxel, ground left out, than `radius`, or inside an
            exemption than the end's own distance if that is less.
        length: length of the path [m]; NaN unless finite.
        clearance: least distance from the path to the cube of an occupied voxel [m], ground left out: 0 on contact,
            infinite if no voxel is occupied, NaN unless inside.
        nearest: a point of the path that has this distance [m]; None unless it is finite.
        cruise_clearance: the least such distance outside the path's balls and those of `CRUISE` around both ends;
            `clearance` where it does not leave them.
        cruise_nearest: as `nearest`, of `cruise_clearance`.
        clearance_at: (t,) float64, such a distance from each point that the path was given by.
    """

    ok: bool
    inside: bool
    finite: bool
    first_hit: Index3 | None
    too_near: bool
    length: float
    clearance: float
    nearest: Point3 | None
    cruise_clearance: float
    cruise_nearest: Point3 | None
    clearance_at: Float64[np.ndarray, " t"] = dataclasses.field(compare=False)  # arrays have no single truth


# arguments: a public name; all that has a default is given by keyword
def verify(
    path: Float[np.ndarray, "t 3"],
    blocked: Bool[np.ndarray, "nx ny nz"] | None,
    occupied: Bool[np.ndarray, "nx ny nz"],
    grid: Grid,
    *,
    ground: Bool[np.ndarray, "nx ny nz"] | None = None,
    radius: float = 0.0,
    balls: tuple[float, float] = (0.0, 0.0),
) -> Verification:
    """Check a path against the voxels that it must not touch, and measure its length and clearance.

    Args:
        path: points in the world frame [m], ENU; one point, or the same point twice, is a legal path.
        blocked: further voxels that the path must not touch, wherever it is. None: there are none.
        occupied: occupied voxels (obstacles as seen).
        grid: where the voxels lie in the world.
        ground: voxels that are ground, whether `occupied` has them or not; clearance is not measured from them. None:
            there are none.
        radius: distance to keep outside the exemptions, and in one around an end that itself keeps it [m].
        balls: radii of the exemptions around the path's first and last point [m]; 0: none.

    Raises:
        ValueError: for a path that is not (t, 3) with t ≥ 1, for volumes that are not bool of the grid's
            shape, for a float32 path in a grid so far from the world's origin that float32 cannot tell its
            voxels apart, or for a radius or balls that are negative or not finite.
    """
    _check([path], grid, 3, blocked=blocked, occupied=occupied, ground=ground)
    one = [None if volume is None else volume[None] for volume in (blocked, ground)]
    ends, which = np.array([balls]), np.zeros(1, np.int64)
    return verify_batch([path], which, one[0], occupied[None], grid, ground=one[1], radius=radius, balls=ends)[0]


# arguments: those of `verify`, and the map of each path
def verify_batch(
    paths: Sequence[Float[np.ndarray, "_ 3"]],
    which: Integer[np.ndarray, " p"],
    blocked: Bool[np.ndarray, "m nx ny nz"] | None,
    occupied: Bool[np.ndarray, "m nx ny nz"],
    grid: Grid,
    *,
    ground: Bool[np.ndarray, "m nx ny nz"] | None = None,
    radius: float = 0.0,
    balls: Float[np.ndarray, "p 2"] | None = None,
) -> list[Verification]:
    """`verify` for many paths at once: most of what one costs is the same for a hundred.

    Args:
        paths: points in the world frame [m], ENU.
        which: map of each path.
        blocked, occupied, grid, ground, radius: as in `verify`; volumes for each map.
        balls: as in `verify`, for each path. None: there are none.

    Raises:
        ValueError: as `verify`, and unless every path has a map.
    """
    _check(paths, grid, 4, blocked=blocked, occupied=occupied, ground=ground)
    balls = _checked_balls(radius, balls, len(paths))
    if which.shape != (len(paths),) or (which.size and not 0 <= which.min() <= which.max() < len(occupied)):
        raise ValueError(f"which: expected the map, 0 to {len(occupied) - 1}, of {len(paths)} paths, given {which}")
    tolerance = _tolerances(paths, grid)
    if len(paths) == 0:
        return []
    lines = _Polylines.of(paths, grid, tolerance)
    own = np.where(balls > 0, balls / grid.spacing + (_SLACK + tolerance)[:, None], 0.0)
    parts, path_of = lines.cut(np.stack([own, np.maximum(own, CRUISE / grid.spacing)], axis=1))
    maps, kept, allowed = _Maps(occupied, ground, blocked), radius / grid.spacing, _SLACK + tolerance
    beside = beside_ground(lines.points[lines.ends], own > 0, allowed, which, (occupied, ground))
    apart = (kept > 0) & ~(parts.exempt & beside[path_of]).any(axis=1)
    first_hit = _first_hits(parts, path_of, tolerance, which, (maps, apart))
    least, places = clearances(parts, path_of, which, occupied, ground)
    at = _at_points(lines, which, occupied, ground)
    short = exempt_shortfall(parts, path_of, which, (occupied, ground), np.fmin(at[lines.ends], kept))
    too_near, at = np.maximum(short, kept - least[:, 1]) > allowed, grid.spacing * at
    least = np.where(lines.inside[:, None], grid.spacing * least, math.nan)
    places = np.array(grid.origin) + grid.spacing * (places - 0.5)
    cruise = (ZONES - 1) * np.isin(np.arange(len(paths)), path_of[parts.zone == ZONES - 1])
    return [
        Verification(
            ok=bool(lines.inside[k]) and k not in first_hit and not too_near[k],
            inside=bool(lines.inside[k]),
            finite=bool(lines.finite[k]),
            first_hit=first_hit.get(k),
            too_near=bool(too_near[k]),
            length=float(lines.lengths[k]),
            clearance=float(least[k, 0]),
            nearest=_point(places[k, 0]),
            cruise_clearance=float(least[k, cruise[k]]),
            cruise_nearest=_point(places[k, cruise[k]]),
            clearance_at=at[lines.first[k] : lines.last[k] + 1],
        )
        for k in range(len(paths))
    ]


def _tolerances(paths: Sequence[np.ndarray], grid: Grid) -> Float64[np.ndarray, " p"]:
    """Tolerance of each path [voxels], found once for each number format."""
    found = {dtype: tolerance_of(dtype, grid) for dtype in {path.dtype for path in paths}}
    return np.array([found[path.dtype] for path in paths])


def _at_points(
    lines: _Polylines,
    which: Integer[np.ndarray, " p"],
    occupied: Bool[np.ndarray, "m nx ny nz"],
    ground: Bool[np.ndarray, "m nx ny nz"] | None,
) -> Float64[np.ndarray, " n"]:
    """Distance at each point of the paths [voxels]; NaN for paths that are not inside."""
    at = np.full(len(lines.points), math.nan)
    here = lines.inside[lines.path_of]
    at[here] = distances_at(lines.points[here], which[lines.path_of[here]], occupied, ground)
    return at


def _first_hits(
    parts: Parts,
    path_of: Int64[np.ndarray, " k"],
    tolerance: Float64[np.ndarray, " p"],
    which: Integer[np.ndarray, " p"],
    kept: tuple[_Maps, Bool[np.ndarray, " k"]],
) -> dict[int, Index3]:
    """The first forbidden voxel of each path that touches one; `kept`: maps, and which parts keep off the ground."""
    maps, apart = kept

    def forbidden(part: Int64[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"]) -> Bool[np.ndarray, " c"]:
        return maps.forbidden(which[path_of[part]], voxels, apart[part])

    part, voxels = contacts(parts.start, parts.step, tolerance[path_of], maps.occupied.shape[1:], forbidden)
    backwards = zip(path_of[part[::-1]].tolist(), voxels[::-1].tolist(), strict=True)  # so that the first remains
    return {k: (x, y, z) for k, (x, y, z) in backwards}


def _point(place: Float64[np.ndarray, "3"]) -> Point3 | None:
    x, y, z = place.tolist()
    return None if math.isnan(x) else (x, y, z)


@dataclasses.dataclass(frozen=True)
class _Polylines:
    """Paths in index coordinates, their points in one row.

    Attributes:
        points: of all paths, one path after the other.
        path_of: path of each point.
        first, last: as `ends`.
        steps: from each point to the next of its path; nothing from the last.
        finite, inside: as in `Verification`.
        lengths: [m], NaN unless finite.
    """

    points: Float64[np.ndarray, "n 3"]
    path_of: Int64[np.ndarray, " n"]
    first: Int64[np.ndarray, " p"]
    last: Int64[np.ndarray, " p"]
    steps: Float64[np.ndarray, "n 3"]
    finite: Bool[np.ndarray, " p"]
    inside: Bool[np.ndarray, " p"]
    lengths: Float64[np.ndarray, " p"]

    @property
    def ends(self) -> Int64[np.ndarray, "p 2"]:
        """Which points each path begins and ends with."""
        return np.stack([self.first, self.last], axis=1)

    @classmethod
    def of(cls, paths: Sequence[np.ndarray], grid: Grid, tolerance: Float64[np.ndarray, " p"]) -> _Polylines:
        """Paths given in the world [m]; inside the map with that tolerance [voxels]."""
        local = np.concatenate(paths, dtype=np.float64) - np.array(grid.origin)
        sizes = np.array([len(path) for path in paths])
        last, path_of = np.cumsum(sizes) - 1, np.repeat(np.arange(len(paths)), sizes)
        first = last - sizes + 1
        grown = tolerance[path_of, None]
        with np.errstate(over="ignore", invalid="ignore"):  # infinite coordinates and lengths are verdicts, not errors
            points = local / grid.spacing + 0.5
            steps = np.zeros_like(points)
            np.subtract(points[1:], points[:-1], out=steps[:-1], where=(path_of[1:] == path_of[:-1])[:, None])
            lengths = np.add.reduceat(grid.spacing * np.linalg.norm(steps, axis=1), first)
        finite = np.logical_and.reduceat(np.isfinite(local).all(axis=1), first)
        within = ((points >= -grown) & (points <= np.array(grid.shape) + grown)).all(axis=1)
        inside = np.logical_and.reduceat(within, first)
        return cls(points, path_of, first, last, steps, finite, inside, np.where(finite, lengths, math.nan))

    def cut(self, radii: Float64[np.ndarray, "p 2 2"]) -> tuple[Parts, Int64[np.ndarray, " k"]]:
        """The paths that are inside, cut by levels of balls [voxels] around their first and last points.

        Returns:
            Their parts, and the path of each.
        """
        moves = (self.steps != 0).any(axis=1)
        moves[self.first] |= ~np.logical_or.reduceat(moves, self.first)  # a path that stays where it is: one segment
        moves &= self.inside[self.path_of]
        path_of = self.path_of[moves]
        centres = self.points[self.ends][path_of]
        parts = cut(self.points[moves], self.steps[moves], centres, radii[path_of])
        return parts, path_of[parts.segment]


@dataclasses.dataclass(frozen=True)
class _Maps:
    """The voxels of each map, as in `verify_batch`."""

    occupied: Bool[np.ndarray, "m nx ny nz"]
    ground: Bool[np.ndarray, "m nx ny nz"] | None
    blocked: Bool[np.ndarray, "m nx ny nz"] | None

    def forbidden(
        self, map_of: Integer[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"], apart: Bool[np.ndarray, " c"]
    ) -> Bool[np.ndarray, " c"]:
        """Which voxels must not be touched: those held; and, by what is kept `apart`, those beside ground."""
        held = _at(self.occupied, map_of, voxels)
        for volumes in (self.ground, self.blocked):
            if volumes is not None:
                held |= _at(volumes, map_of, voxels)
        if self.ground is not None:
            asked = np.flatnonzero(apart & ~held)
            held[asked] = _beside(self.ground, map_of[asked], voxels[asked])
        return held


def _flat(
    volumes: Bool[np.ndarray, "m nx ny nz"], map_of: Integer[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"]
) -> tuple[Bool[np.ndarray, " n"], Int64[np.ndarray, " c"]]:
    """Maps in one row, and where voxels are: NumPy takes by one index far faster than by four."""
    shared = volumes.strides[0] == 0  # one map, which a row of copies would multiply
    nx, ny, nz = volumes.shape[1:]
    x, y, z = voxels.T
    first = x if shared else map_of * nx + x
    return (volumes[0] if shared else volumes).reshape(-1), (first * ny + y) * nz + z


def _at(
    volumes: Bool[np.ndarray, "m nx ny nz"], map_of: Integer[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"]
) -> Bool[np.ndarray, " c"]:
    row, index = _flat(volumes, map_of, voxels)
    return np.take(row, index)


def _beside(
    ground: Bool[np.ndarray, "m nx ny nz"], map_of: Integer[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"]
) -> Bool[np.ndarray, " c"]:
    """Whether voxels have a face neighbour that is ground."""
    row, index = _flat(ground, map_of, voxels)
    beside = np.zeros(len(index), bool)
    for axis, step in enumerate((ground.shape[2] * ground.shape[3], ground.shape[3], 1)):
        at = voxels[:, axis]
        beside |= np.take(row, index - step, mode="clip") & (at > 0)
        beside |= np.take(row, index + step, mode="clip") & (at < ground.shape[1 + axis] - 1)
    return beside


def _checked_balls(radius: float, balls: Float[np.ndarray, "p 2"] | None, count: int) -> Float64[np.ndarray, "p 2"]:
    """The balls, or none; a `ValueError` unless they and the radius are distances [m], two balls for each path."""
    balls = np.zeros((count, 2)) if balls is None else balls.astype(np.float64)
    if not 0 <= radius < math.inf:
        raise ValueError(f"radius: expected a distance [m] of at least 0, given {radius}")
    if balls.shape != (count, 2) or not ((balls >= 0) & np.isfinite(balls)).all():
        raise ValueError(f"balls: expected two radii [m] of at least 0 for each of {count} paths, given {balls}")
    return balls


def _check(paths: Sequence[np.ndarray], grid: Grid, axes: int, **volumes: np.ndarray | None) -> None:
    """Raise a `ValueError` unless the paths are (t, 3) and the volumes bool of the grid's shape."""
    for path in paths:
        if path.ndim != 2 or path.shape[1] != 3 or len(path) == 0:
            raise ValueError(f"path: expected shape (t, 3) with t of at least 1, given {path.shape}")
    for name, volume in volumes.items():
        if volume is None:
            continue
        grid.check_volume(name, volume)
        if volume.ndim != axes or volume.dtype != np.bool_:
            raise ValueError(f"{name}: expected bool of shape {grid.shape}, given {volume.dtype} {volume.shape}")
