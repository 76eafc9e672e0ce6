"""From the state of a page to its scene: the map, its ends, and what was planned."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float, UInt8

from maxjax.core.grid import Grid, Point3
from maxjax.core.status import Status
from maxjax.ui.page.answer import Answer
from maxjax.ui.page.colors import CLEARANCES, EARTH, EARTH_AT_NIGHT, GOAL, RETURN, RIVAL, START, VIA, Rgb, ramp
from maxjax.ui.page.nodes import Ball, Dots, Frame, Lines, Node, Scene, Surface, Text, point3
from maxjax.ui.page.page_map import City
from maxjax.ui.page.surface import split_surface, surface

END = 1.6
"""Radius of the ball at an end [m]."""

THROUGH = 0.25
"""Opacity of see-through buildings."""

_MOST_POINTS = 200_000
_PATH, _RIVAL = 6.0, 4.0  # widths [px]


def city_scene(
    city: City, opacity: float = 1.0, hiding: Bool[np.ndarray, "nx ny"] | None = None, *, dark: bool = False
) -> Scene:
    """The map: its obstacles coloured by height, its ground, its points.

    Args:
        city: the map.
        opacity: of its obstacles; 1: opaque.
        hiding: columns whose obstacles are see-through whatever the opacity (`ui.page.camera.hiding`); None: none.
        dark: whether the page is dark.
    """
    scene: dict[str, Node] = {**ground_scene(city, dark=dark)}
    whole = city_surface(city)
    through, others = (None, whole) if hiding is None else split_surface(whole, city.grid, city.frame, hiding)
    if len(others.points):
        scene["/map/obstacles"] = dataclasses.replace(others, opacity=opacity)
    if through is not None and len(through.points):
        scene["/map/through"] = dataclasses.replace(through, opacity=THROUGH)
    if city.points is not None and len(city.points):
        some = city.points[:: -(-len(city.points) // _MOST_POINTS)]
        scene["/map/points"] = Dots(city.frame.page(some), RETURN, 0.25)
    return scene


@functools.lru_cache(maxsize=4)
def city_surface(city: City) -> Surface:
    """The obstacles of a map, opaque."""
    return surface(city.occupied & ~city.ground, city.grid, city.frame, hidden_by=city.occupied)


def ground_scene(city: City, *, dark: bool) -> Scene:
    """The ground, or a plate below the map that has none, in a colour that suits the page."""
    return {"/map/ground": _ground(city, EARTH_AT_NIGHT if dark else EARTH)}


@functools.lru_cache(maxsize=4)
def _ground(city: City, color: Rgb) -> Surface:
    if city.ground.any():
        return surface(city.ground, city.grid, city.frame, color)
    (nx, ny, _), spacing, (x, y, z) = city.grid.shape, city.grid.spacing, city.grid.origin
    plate = Grid((nx, ny, 1), spacing, (x, y, z - spacing))
    return surface(np.ones(plate.shape, bool), plate, city.frame, color)


def end_name(k: int, count: int) -> str:
    """The name of waypoint k of so many."""
    return "start" if k == 0 else "goal" if k == count - 1 else f"waypoint {k}"


def root_of(name: str) -> str:
    """The node of a waypoint, by what it is called."""
    return f"/ends/{name.replace(' ', '_')}"


def end_scene(root: str, name: str, at: Point3 = (0.0, 0.0, 0.0), high: float = 2 * END) -> Scene:
    """A waypoint and its name, below a node `root`, at a place in that node's frame, the name so high above it [m]."""
    color = {"start": START, "goal": GOAL}.get(name, VIA)
    below = name == "goal"  # else it would hide the start's name where a mission returns to its start
    words = Text((at[0], at[1], at[2] + (-2 * END if below else high)), name, below)
    return {f"{root}/ball": Ball(at, END, color), f"{root}/name": words}


def ends_scene(waypoints: Sequence[Point3], frame: Frame) -> Scene:
    """Start, places to visit and goal, each with its name."""
    names = [end_name(k, len(waypoints)) for k in range(len(waypoints))]
    places = [point3(frame.page(place)) for place in waypoints]
    return together(*(end_scene(root_of(name), name, at) for name, at in zip(names, places, strict=True)))


def answer_scene(found: Answer, frame: Frame) -> Scene:
    """The path, coloured by clearance up to the margin, and that of A*."""
    scene: dict[str, Node] = {}
    if found.ok:
        part = np.minimum(found.clearance, found.request.margin) / max(found.request.margin, 1e-9)
        scene["/plan/path"] = _line(frame.page(found.dense), ramp(CLEARANCES, part), _PATH)
    if found.beside is not None and found.beside.status == Status.OK:
        path = frame.page(found.beside.path)
        scene["/plan/astar"] = plain_line(path, RIVAL, _RIVAL)
    return scene


def plain_line(points: Float[np.ndarray, "n 3"], color: Rgb, width: float) -> Lines:
    """A polyline of one colour, in the page's frame."""
    return _line(points, np.broadcast_to(np.array(color, np.uint8), (len(points), 3)), width)


def _line(points: Float[np.ndarray, "n 3"], colors: UInt8[np.ndarray, "n 3"], width: float) -> Lines:
    pairs = np.stack([points[:-1], points[1:]], axis=1)
    return Lines(pairs, np.ascontiguousarray(np.stack([colors[:-1], colors[1:]], axis=1)), width)


def together(*scenes: Mapping[str, Node]) -> Scene:
    """Several scenes as one; a later one's node takes the place of an earlier one's of the same name."""
    whole: dict[str, Node] = {}
    for scene in scenes:
        whole |= scene
    return whole
