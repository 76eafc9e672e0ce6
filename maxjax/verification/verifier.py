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

from maxjax.core.grid import Index3, Point3
from maxjax.core.voxel_map import VoxelMap, checked_map
from maxjax.verification.clearance import clearances, distances_at
from maxjax.verification.contacts import contacts, tolerance_of
from maxjax.verification.exemptions import ZONES, Parts
from maxjax.verification.own_distance import beside_ground, exempt_shortfall
from maxjax.verification.polylines import Paths, Polylines

# Distance from both ends [m] beyond which a path cruises.
CRUISE = 10.0
# Of the radius, and of the exemptions [voxels].
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
        cruise_clearance: the least such distance outside the exemptions and farther than `CRUISE` from both ends;
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
    exemptions: tuple[float, float] = (0.0, 0.0),
    blocked: Bool[np.ndarray, "nx ny nz"] | None = None,
) -> Verification:
    """Verify a path in a map, and measure its length and clearance.

    Args:
        path: points in the world frame [m], ENU; one point, or the same point twice, is a legal path.
        where: the map. Clearance is not measured from its ground, nor from what is closed.
        radius: distance to keep outside the exemptions, and in one around an end that itself keeps it [m].
        exemptions: radii of the exemptions around the path's first and last point [m]; 0: none.
        blocked: further voxels that the path must not touch, wherever it is. None: there are none.

    Raises:
        ValueError: if the path is not (t, 3) with t ≥ 1, the map is no single `VoxelMap`, `blocked` is not bool of its
            shape, the path is float32 in a grid so far from the world's origin that float32 cannot tell its voxels
            apart, or a radius is negative or not finite.
    """
    single, paths = checked_map(where), Paths.of([np.asarray(path)])
    if single.batch is not None:
        raise ValueError(f"map: expected one map, given a batch of {single.batch}; take one, as map[0]")
    further = None if blocked is None else np.asarray(blocked)[None]
    return verify_paths(paths, single, radius=radius, exemptions=np.array([exemptions]), blocked=further)[0]


def verify_paths(
    paths: Paths,
    where: VoxelMap,
    *,
    radius: float = 0.0,
    exemptions: Float[np.ndarray, "p 2"] | None = None,
    blocked: Bool[np.ndarray, "m nx ny nz"] | None = None,
) -> Verdicts:
    """`verify` for many paths at once: most of what one costs is the same for a hundred.

    Args:
        paths: in the world frame [m], ENU.
        where: one map for all paths, or a batch of maps.
        radius: as in `verify`.
        exemptions: as in `verify`, for each path. None: there are none.
        blocked: as in `verify`, for each map.

    Raises:
        ValueError: as `verify`, and unless every path has a map.
    """
    maps, grid, count, which = _Maps.of(where, blocked), where.grid, len(paths), paths.map_of
    exemptions = _checked_exemptions(radius, exemptions, count)
    if which.shape != (count,) or (which.size and not 0 <= which.min() <= which.max() < len(maps.occupied)):
        raise ValueError(f"map_of: expected the map, 0 to {len(maps.occupied) - 1}, of {count} paths, given {which}")
    lines = Polylines.of(paths, grid, tolerance_of(paths.points.dtype, grid))
    kept, allowed = radius / grid.spacing, np.full(count, _SLACK + lines.tolerance)
    own = np.where(exemptions > 0, exemptions / grid.spacing + allowed[:, None], 0.0)
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
        counts=paths.counts,
    )


def _at_points(lines: Polylines, which: Integer[np.ndarray, " p"], maps: _Maps) -> Float64[np.ndarray, " n"]:
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


def _checked_exemptions(
    radius: float, exemptions: Float[np.ndarray, "p 2"] | None, count: int
) -> Float64[np.ndarray, "p 2"]:
    """The exemptions, or none; a `ValueError` unless they and the radius are distances [m], two for each path."""
    exemptions = np.zeros((count, 2)) if exemptions is None else exemptions.astype(np.float64)
    if not 0 <= radius < math.inf:
        raise ValueError(f"radius: expected a distance [m] of at least 0, given {radius}")
    if exemptions.shape != (count, 2) or not ((exemptions >= 0) & np.isfinite(exemptions)).all():
        raise ValueError(
            f"exemptions: expected two radii [m] of at least 0 for each of {count} paths, given {exemptions}"
        )
    return exemptions
