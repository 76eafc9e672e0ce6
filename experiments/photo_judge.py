"""Photos and flights judged by other means than those that made them: projection, C MuJoCo's rays, true distances.

seen       a point is within the photo, the pixels beside it, cast back onto the surface's plane, are no farther apart
           than the resolution, and no triangle hides it
clearance  least distance from a polyline to triangles: halves of a segment of length l with distances d_a, d_b at its
           ends are looked at while (d_a + d_b − l)/2 is below the least that is known
hits       straight legs that pass through a triangle, by rays
"""

from __future__ import annotations

import importlib
import itertools
import math
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int64

from benchmarks.common.mesh_rays import MeshRays
from maxjax.inspection.capture import Capture
from maxjax.inspection.face_points import halve
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.scenery import TOUCH
from maxjax.inspection.target_surface import Surface
from maxjax.inspection.views import Views

_EXACT = 1e-3  # of a clearance [m]
_LONGEST = 4.0  # of a segment, and of the edges of triangles, at first [m]


def count_photos(
    views: Views, surface: Surface, rays: MeshRays, camera: Camera, capture: Capture
) -> Int64[np.ndarray, " n"]:
    """How many photos show each point of a surface."""
    counts = np.zeros(len(surface), np.int64)
    for place, yaw, pitch in zip(views.position, views.yaw.tolist(), views.pitch.tolist(), strict=True):
        framed = np.flatnonzero(_framed(place, (yaw, pitch), surface, camera, capture))
        counts[framed[~rays.hides(place, surface.points[framed], TOUCH)]] += 1
    return counts


def _framed(
    place: Float64[np.ndarray, "3"], angles: tuple[float, float], surface: Surface, camera: Camera, capture: Capture
) -> Bool[np.ndarray, " n"]:
    """Which points are within a photo, seen straight and finely enough."""
    yaw, pitch = angles
    limits = capture.limits(camera)
    across, upwards = camera.half_tangents
    forward = np.array([math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch)])
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    up = np.cross(right, forward)
    way, normal = surface.points - place, surface.normals
    depth, away = way @ forward, -np.einsum("nk,nk->n", way, normal)
    oblique = away / np.linalg.norm(way, axis=1) < math.cos(math.radians(limits.incidence))
    near = np.flatnonzero((depth > 0.0) & ~oblique)
    pixel = np.stack([way[near] @ right / depth[near], way[near] @ up / depth[near]], axis=1)
    near, pixel = (one[(np.abs(pixel) <= (across, upwards)).all(axis=1)] for one in (near, pixel))
    corners = []
    for step in ((0.0, 0.0), (2.0 * across / camera.pixels[0], 0.0), (0.0, 2.0 * upwards / camera.pixels[1])):
        u, v = (pixel + step).T[:, :, None]
        ray = forward + u * right + v * up
        corners.append(ray * (-away[near] / np.einsum("nk,nk->n", ray, normal[near]))[:, None])
    side = np.maximum(*(np.linalg.norm(corner - corners[0], axis=1) for corner in corners[1:]))
    found = np.zeros(len(surface), bool)
    found[near[side <= limits.resolution]] = True
    return found


def find_clearance(path: Float64[np.ndarray, "t 3"], triangles: Float64[np.ndarray, "n 3 3"]) -> float:
    """Least distance from a polyline to triangles, to a millimetre [m]; infinite without any."""
    if not len(triangles):
        return math.inf
    near, points = _Triangles(triangles), _cut(path)
    a, b = points[:-1], points[1:]
    at, least = near.distances(points, math.inf)
    d_a, d_b = at[:-1], at[1:]
    while True:
        nearer = 0.5 * (d_a + d_b - np.linalg.norm(b - a, axis=1)) < least - _EXACT
        if not nearer.any():
            return least
        a, b, d_a, d_b = a[nearer], b[nearer], d_a[nearer], d_b[nearer]
        middle = 0.5 * (a + b)
        d, least = near.distances(middle, least)
        a, b = np.concatenate([a, middle]), np.concatenate([middle, b])
        d_a, d_b = np.concatenate([d_a, d]), np.concatenate([d, d_b])


def _cut(path: Float64[np.ndarray, "t 3"]) -> Float64[np.ndarray, "s 3"]:
    """A polyline with more points, none far from the next."""
    found = [path[:1]]
    for a, b in itertools.pairwise(path):
        count = max(1, math.ceil(float(np.linalg.norm(b - a)) / _LONGEST))
        found.append(a + np.arange(1, count + 1)[:, None] / count * (b - a))
    return np.concatenate(found)


class _Triangles:
    """Triangles to which distances are asked for, in pieces whose corners lie no farther from their middle than so."""

    def __init__(self, triangles: Float64[np.ndarray, "n 3 3"]) -> None:
        from scipy.spatial import cKDTree

        self._pieces, _ = halve(triangles, np.zeros(len(triangles), np.int64), _LONGEST)
        middle = self._pieces.mean(axis=1)
        self._reach = float(np.linalg.norm(self._pieces - middle[:, None], axis=2).max())
        self._tree = cKDTree(middle)

    def distances(self, points: Float64[np.ndarray, "p 3"], least: float) -> tuple[Float64[np.ndarray, " p"], float]:
        """Distances of points to the nearest triangle [m], or bounds from below that are no less than the least.

        Args:
            points: [m].
            least: distance that is known of other points [m].

        Returns:
            The distances, and the least of these and of the one that was known.
        """
        to_middle = np.asarray(self._tree.query(points)[0])
        found = np.maximum(to_middle - self._reach, 0.0)
        for k in np.argsort(found):
            if found[k] > least:
                break
            rows = self._tree.query_ball_point(points[k], to_middle[k] + self._reach + _EXACT)
            found[k] = _to_triangles(points[k], self._pieces[rows]).min()
            least = min(least, float(found[k]))
        return found, least


def _to_triangles(point: Float64[np.ndarray, "3"], corners: Float64[np.ndarray, "n 3 3"]) -> Float64[np.ndarray, " n"]:
    """Distance from a point to triangles [m]."""
    closest_point: Any = importlib.import_module("trimesh.triangles").closest_point
    nearest = closest_point(corners, np.broadcast_to(point, (len(corners), 3)))
    return np.asarray(np.linalg.norm(nearest - point, axis=1))


def count_hits(path: Float64[np.ndarray, "t 3"], rays: MeshRays) -> int:
    """How many straight legs of a polyline pass through a triangle."""
    legs = [(a, b) for a, b in itertools.pairwise(path) if float(np.linalg.norm(b - a)) > _EXACT]
    return sum(bool(rays.hides(a, b[None], 0.0)[0]) for a, b in legs)
