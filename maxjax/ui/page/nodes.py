"""Nodes of a scene as plain data: names ↦ nodes, in the page's own frame [m].

    page = map − anchor        float32 in a browser: national coordinates would lose decimetres there

Functions of the state of a page make scenes (`ui.page.draw`); `ui.page.stage` shows them. So a test reads a scene
without a browser, and a page to share holds what a page in use does.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, UInt8, UInt32

from maxjax.core.grid import Grid, Point3
from maxjax.ui.page.colors import Rgb

Quaternion = tuple[float, float, float, float]
"""w, x, y, z."""


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """Triangles seen from one side, each point with its colour, which holds the light already.

    Attributes:
        points: [m].
        faces: of three points each, counter-clockwise as seen from outside.
        colors: at the points.
        opacity: 1: opaque.
    """

    points: Float[np.ndarray, "n 3"]
    faces: UInt32[np.ndarray, "m 3"]
    colors: UInt8[np.ndarray, "n 3"]
    opacity: float = 1.0


@dataclasses.dataclass(frozen=True, eq=False)
class Lines:
    """Segments between pairs of points, with a colour at each point.

    Attributes:
        points: [m].
        colors: at the points.
        width: on the screen [px].
    """

    points: Float[np.ndarray, "n 2 3"]
    colors: UInt8[np.ndarray, "n 2 3"]
    width: float


@dataclasses.dataclass(frozen=True, eq=False)
class Dots:
    """Points as dots.

    Attributes:
        points: [m].
        color: of all of them.
        size: [m].
        round: whether they are discs; else squares, which a browser draws faster.
    """

    points: Float[np.ndarray, "n 3"]
    color: Rgb
    size: float
    round: bool = False


@dataclasses.dataclass(frozen=True, eq=False)
class Picture:
    """An image in a plane.

    Attributes:
        pixels: the first row on top.
        width, height: [m].
        position: of its middle [m].
        turn: from x to the right, y down.
    """

    pixels: UInt8[np.ndarray, "h w 4"]
    width: float
    height: float
    position: Point3
    turn: Quaternion


@dataclasses.dataclass(frozen=True, eq=False)
class Ball:
    """A ball.

    Attributes:
        position: of its middle [m].
        radius: [m].
        color: of it.
        opacity: 1: opaque.
    """

    position: Point3
    radius: float
    color: Rgb
    opacity: float = 1.0


@dataclasses.dataclass(frozen=True, eq=False)
class Text:
    """A label that faces the camera.

    Attributes:
        position: of its lower edge's middle, of its upper one's where it hangs below [m].
        text: a few words.
        below: whether it hangs below its position; else it stands on it.
    """

    position: Point3
    text: str
    below: bool = False


Node = Surface | Lines | Dots | Picture | Ball | Text
Scene = Mapping[str, Node]


@dataclasses.dataclass(frozen=True)
class Frame:
    """The frame of a page: its origin in the map, below the middle of the map [m]."""

    anchor: Point3

    @classmethod
    def of(cls, grid: Grid) -> Frame:
        """The frame of a map: metres count from the middle of its lowest layer."""
        (x0, y0, z0), (x1, y1, _) = grid.lower, grid.upper
        return cls((0.5 * (x0 + x1), 0.5 * (y0 + y1), z0))

    def page(self, points: Float[np.ndarray, "*n 3"] | Point3) -> Float[np.ndarray, "*n 3"]:
        """Points of the map in the page, float64."""
        local: Float[np.ndarray, "*n 3"] = np.asarray(points, np.float64) - np.array(self.anchor)
        return local

    def map(self, points: Float[np.ndarray, "*n 3"] | Point3) -> Float[np.ndarray, "*n 3"]:
        """Points of the page in the map, float64."""
        world: Float[np.ndarray, "*n 3"] = np.asarray(points, np.float64) + np.array(self.anchor)
        return world


def point3(place: Float[np.ndarray, " 3"]) -> Point3:
    """Three coordinates as plain numbers."""
    x, y, z = np.asarray(place, np.float64).tolist()
    return x, y, z
