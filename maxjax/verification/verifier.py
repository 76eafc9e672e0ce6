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
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, Integer

from maxjax.core.grid import Grid, Index3, Point3
from maxjax.core.voxel_map import VoxelMap, checked_map
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


@dataclasses.dataclass(frozen=True, eq=False)
class Verdicts:
    """Verdicts on paths, as arrays over them; attributes as in `Verification`.

    Attributes:
        ok, inside, finite, too_near: (p,) bool.
        first_hit: (p, 3) int64; −1 where there is none.
        length, clearance, cruise_clearance: (p,) float64 [m].
        nearest, cruise_nearest: (p, 3) float64 [m]; NaN where there is none.
        clearance_at: (p, t) float64 [m]; NaN beyond a path.
        counts: (p,) how many points each path has.
    """

    ok: Bool[np.ndarray, " p"]
    inside: Bool[np.ndarray, " p"]
    finite: Bool[np.ndarray, " p"]
    first_hit: Int64[np.ndarray, "p 3"]
    too_near: Bool[np.ndarray, " p"]
    length: Float64[np.ndarray, " p"]
    clearance: Float64[np.ndarray, " p"]
    nearest: Float64[np.ndarray, "p 3"]
    cruise_clearance: Float64[np.ndarray, " p"]
    cruise_nearest: Float64[np.ndarray, "p 3"]
    clearance_at: Float64[np.ndarray, "p t"]
    counts: Int64[np.ndarray, " p"]

    @classmethod
    def joined(cls, parts: Sequence[Verdicts]) -> Verdicts:
        """Verdicts on several lots of paths of one padded length."""
        names = [field.name for field in dataclasses.fields(cls)]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def __len__(self) -> int:
        return len(self.ok)

    def __iter__(self) -> Iterator[Verification]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k: int) -> Verification:
        x, y, z = self.first_hit[k].tolist()
        return Verification(
            ok=bool(self.ok[k]),
            inside=bool(self.inside[k]),
            finite=bool(self.finite[k]),
            first_hit=None if x < 0 else (x, y, z),
            too_near=bool(self.too_near[k]),
            length=float(self.length[k]),
            clearance=float(self.clearance[k]),
            nearest=_point(self.nearest[k]),
            cruise_clearance=float(self.cruise_clearance[k]),
            cruise_nearest=_point(self.cruise_nearest[k]),
            clearance_at=self.clearance_at[k, : self.counts[k]].copy(),
        )


def verify(
    path: Float[np.ndarray, "t 3"],
    where: VoxelMap,
    *,
    radius: float = 0.0,
    balls: tuple[float, float] = (0.0, 0.0),
    blocked: Bool[np.ndarray, "nx ny nz"] | None = None,
) -> Verification:
    """Verify a path in a map, and measure its length and clearance.

    Args:
        path: points in the world frame [m], ENU; one point, or the same point twice, is a legal path.
        where: the map. Clearance is not measured from its ground, nor from what is closed.
        radius: distance to keep outside the exemptions, and in one around an end that itself keeps it [m].
        balls: radii of the exemptions around the path's first and last point [m]; 0: none.
        blocked: further voxels that the path must not touch, wherever it is. None: there are none.

    Raises:
        ValueError: if the path is not (t, 3) with t ≥ 1, the map is no single `VoxelMap`, `blocked` is not bool of its
            shape, the path is float32 in a grid so far from the world's origin that float32 cannot tell its voxels
            apart, or a radius or a ball is negative or not finite.
    """
    single = checked_map(where)
    points = np.asarray(path)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise ValueError(f"path: expected shape (t, 3) with t of at least 1, given {points.shape}")
    if single.batch is not None:
        raise ValueError(f"map: expected one map, given a batch of {single.batch}; take one, as map[0]")
    further = None if blocked is None else np.asarray(blocked)[None]
    return verify_paths(
        points[None], np.array([len(points)]), single, radius=radius, balls=np.array([balls]), blocked=further
    )[0]


def verify_paths(  # noqa: PLR0913 (those of `verify`, and the map of each path)
    points: Float[np.ndarray, "p t 3"],
    counts: Int64[np.ndarray, " p"],
    where: VoxelMap,
    *,
    map_of: Integer[np.ndarray, " p"] | None = None,
    radius: float = 0.0,
    balls: Float[np.ndarray, "p 2"] | None = None,
    blocked: Bool[np.ndarray, "m nx ny nz"] | None = None,
) -> Verdicts:
    """`verify` for many paths at once: most of what one costs is the same for a hundred.

    Args:
        points: of the paths in the world frame [m], ENU, each filled up to one length.
        counts: how many points each has.
        where: one map for all paths, or a batch of maps.
        map_of: which of several maps each path is in. None: there is one.
        radius: as in `verify`.
        balls: as in `verify`, for each path. None: there are none.
        blocked: as in `verify`, for each map.

    Raises:
        ValueError: as `verify`, and unless every path has a map.
    """
    maps, grid, count = _Maps.of(where, blocked), where.grid, len(points)
    which = np.zeros(count, np.int64) if map_of is None else map_of
    balls = _checked_balls(radius, balls, count)
    if which.shape != (count,) or (which.size and not 0 <= which.min() <= which.max() < len(maps.occupied)):
        raise ValueError(f"map_of: expected the map, 0 to {len(maps.occupied) - 1}, of {count} paths, given {which}")
    lines = _Polylines.of(points, counts, grid, tolerance_of(points.dtype, grid))
    kept, allowed = radius / grid.spacing, np.full(count, _SLACK + lines.tolerance)
    own = np.where(balls > 0, balls / grid.spacing + allowed[:, None], 0.0)
    parts, path_of = lines.cut(np.stack([own, np.maximum(own, CRUISE / grid.spacing)], axis=1))
    volumes = maps.occupied, maps.ground
    beside = beside_ground(lines.points[lines.ends], own > 0, allowed, which, volumes)
    apart = (kept > 0) & ~(parts.exempt & beside[path_of]).any(axis=1)
    first_hit = _first_hits(parts, path_of, lines.tolerance, which, (maps, apart))
    least, places = clearances(parts, path_of, which, *volumes)
    at = _at_points(lines, which, maps)
    short = exempt_shortfall(parts, path_of, which, volumes, np.fmin(at[lines.ends], kept))
    too_near = np.maximum(short, kept - least[:, 1]) > allowed
    least = np.where(lines.inside[:, None], grid.spacing * least, math.nan)
    places = np.array(grid.origin) + grid.spacing * (places - 0.5)
    each = np.arange(count)
    cruise = (ZONES - 1) * np.isin(each, path_of[parts.zone == ZONES - 1])
    return Verdicts(
        ok=lines.inside & (first_hit[:, 0] < 0) & ~too_near,
        inside=lines.inside,
        finite=lines.finite,
        first_hit=first_hit,
        too_near=too_near,
        length=lines.lengths,
        clearance=least[:, 0],
        nearest=places[:, 0],
        cruise_clearance=least[each, cruise],
        cruise_nearest=places[each, cruise],
        clearance_at=lines.spread(grid.spacing * at),
        counts=counts,
    )


def stacked(paths: Sequence[Float[np.ndarray, "_ 3"]]) -> tuple[Float[np.ndarray, "p t 3"], Int64[np.ndarray, " p"]]:
    """Paths as one array, each filled up with zeros, and how many points each has: what `verify_paths` takes."""
    counts = np.array([len(path) for path in paths], np.int64)
    dtype = np.result_type(*paths) if len(paths) else np.float64
    points = np.zeros((len(paths), max(counts, default=1), 3), dtype)
    for row, path in zip(points, paths, strict=True):
        row[: len(path)] = path
    return points, counts


def _at_points(lines: _Polylines, which: Integer[np.ndarray, " p"], maps: _Maps) -> Float64[np.ndarray, " n"]:
    """Distance at each point of the paths [voxels]; NaN for paths that are not inside."""
    at = np.full(len(lines.points), math.nan)
    here = lines.inside[lines.path_of]
    at[here] = distances_at(lines.points[here], which[lines.path_of[here]], maps.occupied, maps.ground)
    return at


def _first_hits(
    parts: Parts,
    path_of: Int64[np.ndarray, " k"],
    tolerance: float,
    which: Integer[np.ndarray, " p"],
    kept: tuple[_Maps, Bool[np.ndarray, " k"]],
) -> Int64[np.ndarray, "p 3"]:
    """The first forbidden voxel of each path, −1 where it touches none.

    Args:
        parts: of the paths.
        path_of: path of each part.
        tolerance: by which voxels are larger [voxels].
        which: map of each path.
        kept: the maps, and which parts keep off what is beside the ground.
    """
    maps, apart = kept

    def forbidden(part: Int64[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"]) -> Bool[np.ndarray, " c"]:
        return maps.forbidden(which[path_of[part]], voxels, apart[part])

    grown = np.full(len(path_of), tolerance)
    part, voxels = contacts(parts.start, parts.step, grown, maps.occupied.shape[1:], forbidden)
    first = np.full((len(which), 3), -1, np.int64)
    first[path_of[part[::-1]]] = voxels[::-1]  # so that the first remains
    return first


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
        tolerance: of all paths [voxels].
        width: to which paths are filled up.
    """

    points: Float64[np.ndarray, "n 3"]
    path_of: Int64[np.ndarray, " n"]
    first: Int64[np.ndarray, " p"]
    last: Int64[np.ndarray, " p"]
    steps: Float64[np.ndarray, "n 3"]
    finite: Bool[np.ndarray, " p"]
    inside: Bool[np.ndarray, " p"]
    lengths: Float64[np.ndarray, " p"]
    tolerance: float
    width: int

    @property
    def ends(self) -> Int64[np.ndarray, "p 2"]:
        """Which points each path begins and ends with."""
        return np.stack([self.first, self.last], axis=1)

    @classmethod
    def of(
        cls, points: Float[np.ndarray, "p t 3"], counts: Int64[np.ndarray, " p"], grid: Grid, tolerance: float
    ) -> _Polylines:
        """Paths given in the world [m]; inside the map with that tolerance [voxels]."""
        used = np.arange(points.shape[1]) < counts[:, None]
        local = points[used].astype(np.float64) - np.array(grid.origin)
        last, path_of = np.cumsum(counts) - 1, np.repeat(np.arange(len(counts)), counts)
        first = last - counts + 1
        with np.errstate(over="ignore", invalid="ignore"):  # infinite coordinates and lengths are verdicts, not errors
            index = local / grid.spacing + 0.5
            steps = np.zeros_like(index)
            np.subtract(index[1:], index[:-1], out=steps[:-1], where=(path_of[1:] == path_of[:-1])[:, None])
            lengths = np.add.reduceat(grid.spacing * np.linalg.norm(steps, axis=1), first)
        finite = np.logical_and.reduceat(np.isfinite(local).all(axis=1), first)
        within = ((index >= -tolerance) & (index <= np.array(grid.shape) + tolerance)).all(axis=1)
        inside = np.logical_and.reduceat(within, first)
        lengths = np.where(finite, lengths, math.nan)
        return cls(index, path_of, first, last, steps, finite, inside, lengths, tolerance, points.shape[1])

    def spread(self, values: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, "p t"]:
        """A value of each point, in rows by path, NaN beyond."""
        rows = np.full((len(self.first), self.width), math.nan)
        rows[np.arange(self.width) < (self.last - self.first + 1)[:, None]] = values
        return rows

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


@dataclasses.dataclass(frozen=True, eq=False)
class _Maps:
    """The voxels of each map: what is touched by nothing, what is kept off, and what else is blocked."""

    occupied: Bool[np.ndarray, "m nx ny nz"]
    ground: Bool[np.ndarray, "m nx ny nz"]
    blocked: Bool[np.ndarray, "m nx ny nz"] | None

    @classmethod
    def of(cls, where: VoxelMap, blocked: Bool[np.ndarray, "m nx ny nz"] | None) -> _Maps:
        """Those of a map, or of a batch; raises a `ValueError` for others of another shape."""
        volumes = [np.asarray(volume) for volume in (where.barred, where.kept_off)]
        occupied, ground = (volume if volume.ndim == 4 else volume[None] for volume in volumes)
        if blocked is not None:
            where.grid.check_volume("blocked", blocked)
            if blocked.ndim != 4 or blocked.dtype != np.bool_:
                raise ValueError(
                    f"blocked: expected bool of shape {where.grid.shape}, given {blocked.dtype} {blocked.shape[1:]}"
                )
        return cls(occupied, ground, blocked)

    def forbidden(
        self, map_of: Integer[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"], apart: Bool[np.ndarray, " c"]
    ) -> Bool[np.ndarray, " c"]:
        """Which voxels must not be touched: those held; and, by what is kept `apart`, those beside ground."""
        held = _at(self.occupied, map_of, voxels)
        if self.blocked is not None:
            held |= _at(self.blocked, map_of, voxels)
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
