"""Places to photograph a surface from, and what cannot be seen from any of them.

    c = p + a · m,  looking along −m       p a point of the surface, m its normal, turned by up to 50°, a a distance

Points p lie a part of the photos' step apart. Where the straight view at the distance asked for is free it is taken;
else views that are turned aside, or nearer, or farther, in this order. Points that are not seen often enough by then
are aimed at themselves, from all sides. Views that the gimbal cannot take are turned to where it can.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float64, Int64

from maxjax.inspection.capture import Capture
from maxjax.inspection.free_space import FreeSpace
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.target_surface import Surface
from maxjax.inspection.views import Views

Reason = Literal["hidden", "no room", "closed", "missed"]

# Turns of the normal about the vertical and about the horizontal [deg], and shares of the distance, dearest last.
_TURNS = sorted(itertools.product((0, 25, -25, 50, -50), repeat=2), key=lambda turn: math.hypot(*turn))
_SHARES = (1.0, 0.8, 1.25, 0.6, 0.45)
_FIRST = 3  # views of a point whose straight one is not free
_SPACING = 0.5  # of the smaller step between photos
_MOST = 6000  # points that are aimed at, at first
_SAME_PLACE, _SAME_WAY = 0.25, 10.0  # of the spacing, and degrees: views nearer than both are one
_APART = 0.6  # between the places of photos, at least: programs take no waypoints that are nearer [m]


@dataclasses.dataclass(frozen=True, eq=False)
class Aim:
    """How points of a surface are aimed at.

    Attributes:
        surface: that is to be seen.
        free: where a vehicle may hover.
        camera: that takes the photos.
        capture: what they are to be like.
    """

    surface: Surface
    free: FreeSpace
    camera: Camera
    capture: Capture

    @property
    def spacing(self) -> float:
        """Between points that are aimed at [m]."""
        step = _SPACING * min(self.capture.steps(self.camera))
        return max(step, math.sqrt(self.surface.area / _MOST))

    def first_views(self) -> Views:
        """Views of points all over the surface."""
        anchors = spread(self.surface, self.spacing)
        rank = self._ranked(anchors)
        straight = rank[:, 0] == 0
        kept = np.where(straight[:, None], np.arange(rank.shape[1]) == 0, np.arange(rank.shape[1]) < _FIRST)
        return self._views(anchors, np.where(kept, rank, -1))

    def more_views(self, missing: Bool[np.ndarray, " n"], given: Views) -> Views:
        """Views from all sides of points that are not seen often enough, from other places than given ones."""
        from scipy.spatial import cKDTree  # a quarter of a second that most commands can do without

        rows = np.flatnonzero(missing)
        anchors = rows[spread(self.surface.some(rows), self.spacing)]
        found = self._views(anchors, self._ranked(anchors))
        if not len(given) or not len(found):
            return found
        return found.some(np.asarray(cKDTree(given.position).query(found.position)[0]) > _APART)

    def reasons(self, unseen: Int64[np.ndarray, " u"]) -> list[Reason]:
        """Why points are seen from nowhere that may be flown to."""
        places = self._places(unseen)
        flat = places.reshape(-1, 3)
        shape = places.shape[:2]
        free, closed = (np.any(held.reshape(shape), axis=1) for held in (self.free.holds(flat), self.free.closed(flat)))
        known: list[Reason] = ["no room", "closed", "hidden"]
        return [known[k] for k in np.where(free, 2, np.where(closed, 1, 0)).tolist()]

    def _places(self, anchors: Int64[np.ndarray, " a"]) -> Float64[np.ndarray, "a c 3"]:
        """Where views of points may be taken from, in order of preference."""
        normals = _turned(self.surface.normals[anchors])
        reach = self.capture.distance * np.array(_SHARES)[:, None]
        places: Float64[np.ndarray, "a t s 3"] = self.surface.points[anchors, None, None] + reach * normals[:, :, None]
        return places.reshape(len(anchors), len(_TURNS) * len(_SHARES), 3)

    def _ranked(self, anchors: Int64[np.ndarray, " a"]) -> Int64[np.ndarray, "a c"]:
        """Numbers of the places of each point that are free, fine and oblique enough, in order; −1 beyond them."""
        places = self._places(anchors)
        share, turn = np.tile(_SHARES, len(_TURNS)), np.repeat([math.hypot(*turn) for turn in _TURNS], len(_SHARES))
        limits, cosine = self.capture.limits(self.camera), np.cos(np.radians(turn))
        side = self.camera.ground_sample_distance(self.capture.distance) * share / np.maximum(cosine, 1e-9)
        fits = (side <= limits.resolution * (1 + 1e-9)) & (turn <= limits.incidence)
        fits &= share * self.capture.distance > self.free.radius
        free = self.free.holds(places.reshape(-1, 3)).reshape(places.shape[:2]) & fits
        number = np.where(free, np.arange(free.shape[1]), free.shape[1])
        ordered = np.sort(number, axis=1)
        return np.where(ordered < free.shape[1], ordered, -1)

    def _views(self, anchors: Int64[np.ndarray, " a"], rank: Int64[np.ndarray, "a c"]) -> Views:
        """Views of points from the places of some numbers, those that are nearly the same once."""
        row, column = np.nonzero(rank >= 0)
        # The best of each point first.
        order = np.lexsort((row, column))
        row, number = row[order], rank[row, column][order]
        position = self._places(anchors)[row, number]
        views = Views.towards(position, self.surface.points[anchors][row] - position)
        low, high = np.radians(self.camera.gimbal)
        views = dataclasses.replace(views, pitch=np.clip(views.pitch, low, high))
        return views.some(_different(views, _SAME_PLACE * self.spacing))


def spread(surface: Surface, apart: float) -> Int64[np.ndarray, " a"]:
    """Numbers of points that lie about so far apart [m]: one a cell and direction, nearest to the middle."""
    low = surface.points.min(axis=0)
    cell = np.floor((surface.points - low) / apart + 0.5)
    key = np.concatenate([cell, np.round(2.0 * surface.normals)], axis=1).astype(np.int64)
    _, group = np.unique(key, axis=0, return_inverse=True)
    group = group.reshape(-1)
    weight = np.bincount(group, surface.areas)
    middle = np.stack([np.bincount(group, surface.areas * side) / weight for side in surface.points.T], axis=1)
    off = np.linalg.norm(surface.points - middle[group], axis=1)
    order = np.lexsort((off, group))
    return order[np.r_[True, group[order][1:] != group[order][:-1]]]


def _turned(normals: Float64[np.ndarray, "a 3"]) -> Float64[np.ndarray, "a t 3"]:
    """Normals turned in all ways: about the vertical and up or down; level ones about two axes in their plane."""
    level = np.abs(normals[:, 2]) > 0.99
    side = np.cross(np.where(level[:, None], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]), normals)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(normals, side)
    turns = np.tan(np.radians(np.array(_TURNS)))
    found = normals[:, None] + turns[:, :1] * side[:, None] + turns[:, 1:] * other[:, None]
    return np.asarray(found / np.linalg.norm(found, axis=2, keepdims=True))


def _different(views: Views, apart: float) -> Int64[np.ndarray, " k"]:
    """Numbers of views without those that are nearly the same as an earlier one, or from the same place."""
    from scipy.spatial import cKDTree  # a quarter of a second that most commands can do without

    reach = max(apart, _APART)
    pairs = cKDTree(views.position).query_pairs(reach, output_type="ndarray") if len(views) else np.zeros((0, 2), int)
    forward, first, second = views.axes[:, 2], pairs[:, 0], pairs[:, 1]
    alike = np.einsum("nk,nk->n", forward[first], forward[second]) >= math.cos(math.radians(_SAME_WAY))
    alike |= np.linalg.norm(views.position[first] - views.position[second], axis=1) <= _APART
    kept = np.ones(len(views), bool)
    for one, other in sorted(map(tuple, pairs[alike].tolist())):
        kept[other] &= not kept[one]
    return np.flatnonzero(kept)
