"""An inspection drawn: the building by the photos that show it, where they are taken from, and the flights.

The surface is that of the building's faces, in pieces; each has the count of the nearest of the points that were
counted, on a face of its direction. The building's voxels, which hold its faces within, are left out of the map.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float, UInt8

from maxjax.core.voxel_map import VoxelMap
from maxjax.inspection.face_points import halve
from maxjax.inspection.inspection import Inspection
from maxjax.inspection.seen_area import Coverage
from maxjax.inspection.target_surface import city_faces
from maxjax.inspection.targets import Target, choose
from maxjax.io.geo.triangles import Triangles, area_normals
from maxjax.ui.page.colors import FAILED, FLIGHTS, NO_SURFACE, PHOTO, PHOTOS, START, html_color, ramp
from maxjax.ui.page.controls import color_bar, legend_box
from maxjax.ui.page.draw import END, plain_line
from maxjax.ui.page.nodes import Ball, Dots, Frame, Lines, Node, Scene, Surface, Text, point3
from maxjax.ui.page.page_map import City

_MOST = 20_000  # pieces of a surface, about
_SUN, _SHADE = np.array([-0.5, -0.8, 1.2]) / math.sqrt(2.33), 0.25  # towards it, and how much darker it is elsewhere
_DOT, _LOOK = 0.6, 2.5  # size of a viewpoint, and length of its line of sight [m]
_LINE, _SIGHT = 4.0, 2.0  # widths [px]
_BESIDE = 0.02  # how far beside a face its columns are asked for [m]


@dataclasses.dataclass(frozen=True, eq=False)
class PhotographedFaces:
    """The faces of an inspected building, in pieces.

    Attributes:
        pieces: (n, 3, 3) corners, outward [m].
        photos: (n,) that show each; NaN where no photo is asked for, since no air is before it or it looks down.
    """

    pieces: Triangles
    photos: Float[np.ndarray, " n"]

    @classmethod
    def of(cls, where: VoxelMap, target: Target, coverage: Coverage) -> PhotographedFaces:
        """Those of a target in a map, by the points of its surface."""
        from scipy.spatial import cKDTree

        surface, faces = coverage.surface, city_faces(where)
        triangles = faces.triangles[choose(faces, target).faces]
        low, high = np.array(where.grid.lower), np.array(where.grid.upper)
        triangles = triangles[((triangles.max(axis=1) >= low) & (triangles.min(axis=1) <= high)).all(axis=1)]
        apart = math.sqrt(surface.area / len(surface))
        size = 0.5 * float(np.linalg.norm(area_normals(triangles), axis=1).sum())
        pieces, _ = halve(triangles, np.zeros(len(triangles), np.int64), max(apart, 2.0 * math.sqrt(size / _MOST)))
        normal = _unit_normals(pieces)
        # Directions count as metres, so that a point around the corner is farther than one on the same face.
        weight = 4.0 * apart
        tree = cKDTree(np.concatenate([surface.points, weight * surface.normals], axis=1))
        middle, best = _longest_middles(pieces), []
        for side in (1.0, -1.0):  # of parts that do not close, the file's order may be either
            best.append(tree.query(np.concatenate([middle, side * weight * normal], axis=1)))
        turned = np.asarray(best[1][0] < best[0][0])
        away, nearest = (np.where(turned, there, here) for here, there in zip(*best, strict=True))
        pieces = np.where(turned[:, None, None], pieces[:, ::-1], pieces)
        return cls(pieces, np.where(away <= 2.0 * apart, coverage.counts[nearest], np.nan))


def _longest_middles(triangles: Triangles) -> Float[np.ndarray, "n 3"]:
    """Middles of the longest edges: both halves of a rectangle have one, and so one colour."""
    following = np.roll(triangles, -1, axis=1)
    longest = np.linalg.norm(following - triangles, axis=2).argmax(axis=1)
    rows = np.arange(len(triangles))
    return np.asarray(0.5 * (triangles[rows, longest] + following[rows, longest]))


def _unit_normals(triangles: Triangles) -> Float[np.ndarray, "n 3"]:
    normal = area_normals(triangles)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12))


def most_photos(coverage: Coverage) -> int:
    """Photos from which on the colour is the last one."""
    return max(int(np.percentile(coverage.counts, 98)), coverage.wanted, 2)


def inspection_scene(faces: PhotographedFaces, inspection: Inspection, frame: Frame) -> Scene:
    """An inspected building, its viewpoints with lines of sight, and the flights."""
    photos = inspection.photos
    places = frame.page(photos.position)
    scene: dict[str, Node] = {
        "/inspection/surface": _surface(faces, most_photos(inspection.coverage), frame),
        "/inspection/places": Dots(places, PHOTO, _DOT, round=True),
        "/inspection/sights": _sights(places, places + _LOOK * photos.axes[:, 2]),
    }
    for k, mission in enumerate(inspection.missions):
        if len(mission.path):
            line = plain_line(frame.page(mission.path), FLIGHTS[k % len(FLIGHTS)], _LINE)
            home = point3(frame.page(mission.path[0]))
            scene[f"/inspection/flight_{k + 1}"] = line
            scene[f"/inspection/home_{k + 1}"] = Ball(home, END, START)
            scene[f"/inspection/home_{k + 1}/name"] = Text((0.0, 0.0, 2.0 * END), "home")
    return scene


def _surface(faces: PhotographedFaces, most: int, frame: Frame) -> Surface:
    """The pieces in the colours of their photos, a little darker away from the sun."""
    colors = photo_colors(faces.photos, most)
    light = 1.0 - _SHADE * (1.0 - np.maximum(_unit_normals(faces.pieces) @ _SUN, 0.0))
    shaded = np.round(colors * light[:, None]).astype(np.uint8)
    count = len(faces.pieces)
    points = frame.page(faces.pieces.reshape(-1, 3)).astype(np.float32)
    return Surface(points, np.arange(3 * count, dtype=np.uint32).reshape(-1, 3), np.repeat(shaded, 3, axis=0))


def photo_colors(photos: Float[np.ndarray, " n"], most: int) -> UInt8[np.ndarray, "n 3"]:
    """Colours of numbers of photos: seen by none, by one up to `most` of them, and where none is asked for (NaN)."""
    colors = ramp(PHOTOS, (photos - 1.0) / (most - 1.0))
    colors[photos == 0.0] = FAILED
    colors[np.isnan(photos)] = NO_SURFACE
    return colors


def _sights(places: Float[np.ndarray, "n 3"], ends: Float[np.ndarray, "n 3"]) -> Lines:
    colors = np.broadcast_to(np.array(PHOTO, np.uint8), (len(places), 2, 3))
    return Lines(np.stack([places, ends], axis=1), np.ascontiguousarray(colors), _SIGHT)


def inspection_legend(faces: PhotographedFaces, coverage: Coverage) -> str:
    """What the colours of an inspection mean, as HTML; those that it has not are left out."""
    marks = [("●", PHOTO, "photos"), ("━━", FLIGHTS[0], "flight")]
    marks += [("■", FAILED, "on no photo")] if (faces.photos == 0.0).any() else []
    marks += [("■", NO_SURFACE, "covered, or looks down")] if np.isnan(faces.photos).any() else []
    words = " ".join(f'<b style="color:{html_color(color)}">{sign}</b> {word}' for sign, color, word in marks)
    bar = color_bar(PHOTOS, "on 1 photo", f"{most_photos(coverage)} and more")
    return legend_box([bar, f'<div style="margin-top:4px">{words}</div>'])


def without_building(city: City, faces: PhotographedFaces) -> City:
    """The map without the voxels of a building, for drawing: those of the columns that its faces touch or enclose."""
    from scipy.ndimage import binary_fill_holes

    grid = city.grid
    pieces, _ = halve(faces.pieces, np.zeros(len(faces.pieces), np.int64), grid.spacing)
    # On all sides of a face's corners: a wall between two columns makes voxels of both occupied.
    around = np.array([(x, y) for x in (-_BESIDE, _BESIDE) for y in (-_BESIDE, _BESIDE)])
    places = (pieces.reshape(-1, 1, 3)[:, :, :2] + around).reshape(-1, 2)
    column = np.floor((places - np.array(grid.lower[:2])) / grid.spacing).astype(np.int64)
    inside = ((column >= 0) & (column < np.array(grid.shape[:2]))).all(axis=1)
    passed: Bool[np.ndarray, "nx ny"] = np.zeros(grid.shape[:2], bool)
    passed[tuple(column[inside].T)] = True
    left = city.occupied & (city.ground | ~binary_fill_holes(passed)[:, :, None])
    return dataclasses.replace(city, voxels=VoxelMap.on(grid, left, city.ground), measured=city.terrain)
