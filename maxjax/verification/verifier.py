"""The verifier of every path: exact, in float64 NumPy, and independent of every planner and solver.

A path is the closed polyline through its points. It passes if it is finite, lies inside the map, and

    everywhere                touches no occupied voxel (`verification.contacts`)
    outside its exemptions    keeps `radius` to the cubes of occupied voxels, ground left out: a true distance
                              (`verification.clearance`); and touches no voxel within one voxel, between centres, of the
                              ground, unless the radius is 0
    inside one                keeps the end's own such distance where that is less (`verification.own_distance`); and
                              touches voxels beside the ground only if the end does

Its exemptions are balls around its first and its last point (`verification.exempt_parts`): the path is cut where it
enters and leaves them. The own distance of an end is measured here, whatever its planner took it to be.

**Tolerance.** Of a contact, doubt counts against the path: cubes are grown by the rounding that it may carry, which
`verification.contacts` states. Of the radius it counts for the path: a thousandth of a voxel and that rounding, by
which exemptions are larger and the distance that is kept may be shorter. Planning keeps half a voxel less
`planning.path.line_of_sight.TOUCH`, 2.5e-4 of a voxel, from the centre lines of blocked voxels, where the radius is
half a voxel. Length and clearance have no tolerance.

`plain_verdicts` below is the verifier; where there is a compiler, `verifier.cpp` gives the same verdicts in a fraction
of the time (`verification.compiled`), path by path by the same operations, so that no plan depends on which was asked.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Array, Bool, Float, Float64, Int64, Integer

from maxjax.core.voxel_map import VoxelMap, check_single_map
from maxjax.verification import compiled
from maxjax.verification.asked import Asked
from maxjax.verification.clearance import clearances, distances_at
from maxjax.verification.contacts import contacts
from maxjax.verification.exempt_parts import ZONES, Parts
from maxjax.verification.own_distance import beside_ground, exempt_shortfall
from maxjax.verification.polylines import Paths, Polylines
from maxjax.verification.verdicts import Verdicts, Verification
from maxjax.verification.volumes import Volumes


def verify(
    path: Float[np.ndarray, "t 3"],
    where: VoxelMap,
    *,
    radius: float = 0.0,
    exemptions: tuple[float, float] = (0.0, 0.0),
    blocked: Bool[Array | np.ndarray, "nx ny nz"] | None = None,
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
    single, paths = check_single_map(where), Paths.of([np.asarray(path)])
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
        ValueError: as `verify`, and unless every path has a map and 1 to t points.
    """
    asked = Asked.of(paths, where, radius, exemptions, blocked)
    library = compiled.at_hand()
    return plain_verdicts(asked) if library is None else compiled.compiled_verdicts(asked, library)


def plain_verdicts(asked: Asked) -> Verdicts:
    """The verdicts in NumPy: what the compiled ones are measured by, and all there is without a compiler."""
    paths, grid, kept = asked.paths, asked.grid, asked.kept
    count, which = len(paths), paths.map_of
    lines = Polylines.of(paths, grid, asked.tolerance)
    allowed = np.full(count, asked.allowed)
    own = np.where(asked.exemptions > 0, asked.exemptions / grid.spacing + allowed[:, None], 0.0)
    parts, path_of = lines.cut(np.stack([own, np.maximum(own, asked.cruise)], axis=1))
    volumes = asked.volumes.occupied, asked.volumes.ground
    beside = beside_ground(lines.points[lines.ends], own > 0, allowed, which, volumes)
    apart = (kept > 0) & ~(parts.exempt & beside[path_of]).any(axis=1)
    first_hit = _first_hits(parts, path_of, lines.tolerance, which, (asked.volumes, apart))
    least, places = clearances(parts, path_of, which, *volumes)
    at = _at_points(lines, which, asked.volumes)
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


def _at_points(lines: Polylines, which: Integer[np.ndarray, " p"], maps: Volumes) -> Float64[np.ndarray, " n"]:
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
    kept: tuple[Volumes, Bool[np.ndarray, " k"]],
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
