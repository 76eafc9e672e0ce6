"""The surface that is to be seen: points on façades and roofs with their areas and outward normals.

    façade:  |n_z| < 1/2          roof:  n_z ≥ 1/2          what looks down more than that is left out

True faces where the map's file has them, else sides of voxels. What is no surface of the city is left out, and its area
told: what lies in another part, below the ground, or right behind something that stands against it.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float64, Int64

from maxjax.core.voxel_map import VoxelMap
from maxjax.inspection.face_points import points_on
from maxjax.inspection.scenery import Scenery
from maxjax.inspection.targets import Chosen, Target, choose
from maxjax.inspection.upright_lines import count_above
from maxjax.inspection.voxel_faces import voxel_faces
from maxjax.io.geo.triangles import area_normals
from maxjax.io.kinds.faces import Faces, faces_of
from maxjax.io.load import LoadedMap

_LEVEL = 0.5  # vertical share of a normal, from which on a face is a roof, or looks down
_AGAINST = 0.3  # how near something stands that covers a wall [m]
_OFF = 0.02  # by which a point is moved off its face to ask what is there [m]
_MOST = 40_000  # points; more are spread wider
_ARRAYS = ("points", "normals", "areas", "part")
GROUND = -1
"""Number of the part of points on the ground."""


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """Points that stand for a surface.

    Attributes:
        points: (n, 3) [m], ENU.
        normals: (n, 3) outward unit vectors.
        areas: (n,) that each stands for [m²].
        part: (n,) number of the part that each is on; -1 on the ground.
        names: of the parts, the file's.
        covered: area left out, since no air is before it [m²].
        name: of what it is the surface of, in words.
    """

    points: Float64[np.ndarray, "n 3"]
    normals: Float64[np.ndarray, "n 3"]
    areas: Float64[np.ndarray, " n"]
    part: Int64[np.ndarray, " n"]
    names: tuple[str, ...]
    covered: float = 0.0
    name: str = ""

    def __len__(self) -> int:
        return len(self.points)

    @property
    def area(self) -> float:
        """Of all of it [m²]."""
        return float(self.areas.sum())

    @property
    def roof(self) -> Bool[np.ndarray, " n"]:
        """Which points are on roofs, or on the ground."""
        return np.asarray(self.normals[:, 2] >= _LEVEL)

    def joined(self, other: Surface) -> Surface:
        """The points of both, by the names of this one."""
        points, normals, areas, part = (np.concatenate([getattr(self, name), getattr(other, name)]) for name in _ARRAYS)
        return dataclasses.replace(self, points=points, normals=normals, areas=areas, part=part)

    def some(self, rows: np.ndarray) -> Surface:
        """Some of its points, by their numbers or a mask."""
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        return dataclasses.replace(self, **arrays)


def city_faces(where: VoxelMap) -> Faces:
    """Faces of a city: those of the map's file, else the sides of its voxels."""
    contents = where.file.contents if isinstance(where, LoadedMap) else None
    return voxel_faces(where) if contents is None else faces_of(contents)


def surface_of(where: VoxelMap, faces: Faces, scenery: Scenery, target: Target, apart: float) -> Surface:
    """The surface of a target.

    Args:
        where: the map.
        faces: of the city.
        scenery: of the city.
        target: as in `inspection.targets`.
        apart: distance between neighbouring points, about [m]; larger where these would be too many.

    Raises:
        ValueError: as `targets.choose`; if nothing of it lies within the map, or air is before none of it.
    """
    chosen = choose(faces, target)
    whole = _points(where, faces, chosen, apart)
    if not len(whole):
        low, high = (np.round(corner, 1).tolist() for corner in (where.grid.lower, where.grid.upper))
        raise ValueError(f"target: expected façades or roofs within the map, {low} to {high}, given {chosen.name}")
    free = ~(_within(whole, faces) | _below_ground(whole, faces) | _against(whole, scenery))
    if not free.any():
        raise ValueError(f"target: expected something with air before it, and {chosen.name} has none: it is covered")
    return dataclasses.replace(whole.some(free), covered=whole.area - whole.some(free).area)


def area_surface(
    where: VoxelMap, faces: Faces, scenery: Scenery, outline: Float64[np.ndarray, "k 2"], apart: float
) -> Surface:
    """Roofs and ground within an outline; arguments and errors as of `surface_of`."""
    chosen = Chosen(np.ones(len(faces.triangles), bool), outline, None, f"an area of {len(outline)} corners")
    roofs = _points(where, faces, chosen, apart)
    ground = _ground_triangles(where, faces)
    low, high = outline.min(axis=0) - apart, outline.max(axis=0) + apart
    near = ((ground[:, :, :2].max(axis=1) >= low) & (ground[:, :, :2].min(axis=1) <= high)).all(axis=1)
    points, normals, areas, of = points_on(ground[near], np.full(int(near.sum()), GROUND), apart)
    kept = chosen.holds(points) & where_is(points, where)
    rows = (points[kept], normals[kept], areas[kept], of[kept])
    both = roofs.some(roofs.roof).joined(Surface(*rows, faces.names))
    if not len(both):
        sides = (np.round(corner, 1).tolist() for corner in (where.grid.lower, where.grid.upper))
        raise ValueError(f"area: expected ground or roofs within the map, {' to '.join(map(str, sides))}, given none")
    free = ~(_within(both, faces) | _against(both, scenery))
    return dataclasses.replace(both.some(free), covered=both.area - both.some(free).area)


def _ground_triangles(where: VoxelMap, faces: Faces) -> Float64[np.ndarray, "t 3 3"]:
    """Those of the file, else two a column at its height."""
    if len(faces.terrain):
        return faces.terrain
    heights, grid = where.terrain.heights, where.grid
    columns = np.argwhere(~np.isnan(heights))
    low = np.array(grid.lower[:2]) + grid.spacing * columns
    z = heights[tuple(columns.T)]
    a, b, c, d = (
        np.column_stack([low + grid.spacing * np.array(corner), z]) for corner in ((0, 0), (1, 0), (1, 1), (0, 1))
    )
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def where_is(points: Float64[np.ndarray, "n 3"], where: VoxelMap) -> Bool[np.ndarray, " n"]:
    """Which points lie in a map, in plan."""
    low, high = np.array(where.grid.lower[:2]), np.array(where.grid.upper[:2])
    return np.asarray(((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1))


def _points(where: VoxelMap, faces: Faces, chosen: Chosen, apart: float) -> Surface:
    """Points on the chosen façades and roofs that lie in the map."""
    triangles, part = faces.triangles[chosen.faces], faces.part[chosen.faces]
    low, high = np.array(where.grid.lower), np.array(where.grid.upper)
    near = ((triangles.max(axis=1) >= low) & (triangles.min(axis=1) <= high)).all(axis=1)
    triangles, part = triangles[near], part[near]
    doubtful = ~faces.closed[part]
    triangles[doubtful] = _towards_air(triangles[doubtful], where)
    size = 0.5 * np.linalg.norm(area_normals(triangles), axis=1)
    apart = max(apart, float(np.sqrt(size.sum() / _MOST)))
    points, normals, areas, of = points_on(triangles, part, apart)
    kept = chosen.holds(points) & ((points >= low) & (points <= high)).all(axis=1) & (normals[:, 2] > -_LEVEL)
    whole = Surface(points, normals, areas, of, faces.names, name=chosen.name)
    return whole.some(kept)


def _towards_air(triangles: Float64[np.ndarray, "n 3 3"], where: VoxelMap) -> Float64[np.ndarray, "n 3 3"]:
    """Triangles of parts that do not close, turned to the side where the map is free; level ones upwards."""
    normal = area_normals(triangles)
    unit = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    middle, step = triangles.mean(axis=1), 0.9 * where.grid.spacing
    before, behind = (_occupied(middle + way * step * unit, where) for way in (1.0, -1.0))
    level = np.abs(unit[:, 2]) >= _LEVEL
    wrong = np.where(level, unit[:, 2] < 0, before & ~behind)
    return np.where(wrong[:, None, None], triangles[:, ::-1], triangles)


def _occupied(points: Float64[np.ndarray, "n 3"], where: VoxelMap) -> Bool[np.ndarray, " n"]:
    index = np.floor((points - np.array(where.grid.lower)) / where.grid.spacing).astype(np.int64)
    inside = ((index >= 0) & (index < where.grid.shape)).all(axis=1)
    i, j, k = np.where(inside[:, None], index, 0).T
    return np.asarray(inside & np.asarray(where.occupied)[i, j, k])


def _within(surface: Surface, faces: Faces) -> Bool[np.ndarray, " n"]:
    """Which points, moved off their faces, lie inside a part: an odd number of its faces is above, or any if open."""
    points = surface.points + _OFF * surface.normals + 1e-4 * np.array([1.0, 0.618, 0.0])
    found = np.zeros(len(points), bool)
    low, high = points.min(axis=0), points.max(axis=0)
    tall = faces.triangles[:, :, 2].max(axis=1) >= low[2]
    beside = ((faces.triangles.max(axis=1) >= low) & (faces.triangles.min(axis=1) <= high))[:, :2].all(axis=1) & tall
    for part in np.unique(faces.part[beside]).tolist():
        above = count_above(points, faces.triangles[beside & (faces.part == part)])
        found |= above % 2 == 1 if faces.closed[part] else above > 0
    return found


def _below_ground(surface: Surface, faces: Faces) -> Bool[np.ndarray, " n"]:
    points = surface.points + _OFF * surface.normals
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    flat = faces.terrain[:, :, :2]
    near = ((flat.max(axis=1) >= low) & (flat.min(axis=1) <= high)).all(axis=1)
    return np.asarray(count_above(points, faces.terrain[near]) > 0)


def _against(surface: Surface, scenery: Scenery) -> Bool[np.ndarray, " n"]:
    """Before which points something stands right there."""
    ahead = scenery.first_hits(surface.points + _OFF * surface.normals, surface.normals, _AGAINST)
    return np.asarray(ahead < _AGAINST)
