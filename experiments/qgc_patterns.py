"""QGroundControl's patterns for photographs, written anew from its user guide: a structure scan and a survey.

    structure scan   laps around an outline, a scan distance away; H/h layers, rounded up, over a height H, h the height
                     of a photo less its front lap; photos a photo's width less its side lap apart, straight inwards
    survey           transects across a polygon, a photo's width less its side lap apart, at one altitude; photos
                     straight down, a photo's height less its front lap apart

(docs.qgroundcontrol.com, QGC user guide, Plan View: "Structure Scan" and "Survey".) Both know the structure or the
area that a user draws, and nothing that stands around it. A vehicle rises above its home, goes over at the altitude of
entrance, and comes back the same way.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from jaxtyping import Float64

from maxjax.core.grid import Point3
from maxjax.inspection.capture import Capture
from maxjax.inspection.mission_photos import photos_along
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.sweep import Sweep
from maxjax.inspection.views import Views
from maxjax.io.geo.rings import signed_area
from maxjax.planning.look import AimedLook

LOWEST = 3.0
"""Of a lap above the ground: a user sets the scan's bottom so [m]."""
_BEFORE = 3  # points of a path before the pattern: home, above it, and above the pattern's first

Outline = Float64[np.ndarray, "k 2"]


@dataclasses.dataclass(frozen=True, eq=False)
class Pattern:
    """What a pattern makes a vehicle fly.

    Attributes:
        path: (t, 3) from home back to it [m].
        photos: in the order in which they are taken.
        speed: that the shutter allows on it [m/s].
    """

    path: Float64[np.ndarray, "t 3"]
    photos: Views
    speed: float


def scan_structure(outline: Outline, heights: Point3, home: Point3, camera: Camera, capture: Capture) -> Pattern:
    """A structure scan, from the top down.

    Args:
        outline: of the structure in plan [m].
        heights: of the ground, and of the bottom and the top of what is scanned [m].
        home: where the vehicle begins and ends [m].
        camera: on a gimbal, its width level.
        capture: distance, front lap (sideways) and side lap (forward).
    """
    ground, bottom, top = heights
    trigger, layer = capture.steps(camera)
    lap = _lap(outline, capture.distance, home)
    count = max(1, math.ceil((top - bottom) / layer - 1e-9))
    levels = bottom + (np.arange(count)[::-1] + 0.5) * (top - bottom) / count
    levels = np.maximum(levels, ground + LOWEST)
    laps = np.concatenate([np.column_stack([lap, np.full(len(lap), level)]) for level in levels])
    path = _from_home(laps, home, top + capture.distance)
    begins = _BEFORE + len(lap) * np.arange(count)
    looks = dict[int, AimedLook]()
    for k in begins.tolist():
        looks |= {k: AimedLook(pitch=0.0, every=trigger), k + len(lap) - 1: AimedLook(every=0.0)}
    photos = photos_along(path, looks)
    # Laps are flown clockwise: the structure is to the right of each leg.
    return Pattern(path, dataclasses.replace(photos, yaw=photos.yaw - 0.5 * math.pi), camera.fastest(trigger))


def survey_polygon(outline: Outline, ground: float, home: Point3, camera: Camera, sweep: Sweep) -> Pattern:
    """A survey whose transects run north and south.

    Args:
        outline: of the area [m].
        ground: at home, from which the altitude counts [m].
        home: where the vehicle begins and ends [m].
        camera: straight down, its height along the course.
        sweep: distance above the ground, overlaps, room to turn.
    """
    every, apart = sweep.every(camera), sweep.apart(camera)
    low, high = outline.min(axis=0), outline.max(axis=0)
    count = max(1, math.ceil((high[0] - low[0]) / apart - 1e-9))
    found, marks = list[np.ndarray](), list[int]()
    for k, x in enumerate(0.5 * (low[0] + high[0]) + apart * (np.arange(count) - 0.5 * (count - 1))):
        ends = _crossings(outline, float(x))
        if ends is None:
            continue
        south, north = ends
        line = np.array([[x, south - sweep.turn], [x, south], [x, north], [x, north + sweep.turn]])
        marks.append(_BEFORE + 4 * len(found))
        found.append(line if k % 2 == 0 else line[::-1])
    altitude = ground + sweep.distance
    plan = np.concatenate(found)
    path = _from_home(np.column_stack([plan, np.full(len(plan), altitude)]), home, altitude)
    looks = dict[int, AimedLook]()
    for k in marks:
        looks |= {k + 1: AimedLook(pitch=-0.5 * math.pi, every=every), k + 2: AimedLook(every=0.0)}
    return Pattern(path, photos_along(path, looks), min(sweep.speed, camera.fastest(every)))


def _lap(outline: Outline, distance: float, home: Point3) -> Outline:
    """The way around an outline, clockwise, first corner last again, from the corner nearest to home on."""
    import shapely

    ring = np.asarray(shapely.Polygon(outline).buffer(distance, join_style="mitre").exterior.coords)[:-1]
    ring = ring[::-1] if signed_area(ring) > 0.0 else ring
    first = int(np.linalg.norm(ring - np.array(home[:2]), axis=1).argmin())
    return np.roll(ring, -first, axis=0)[[*range(len(ring)), 0]]


def _from_home(points: Float64[np.ndarray, "n 3"], home: Point3, altitude: float) -> Float64[np.ndarray, "t 3"]:
    """A pattern with the way there and back at an altitude."""
    first, last = points[[0, -1], :2].tolist()
    there, back = (home, (*home[:2], altitude), (*first, altitude)), ((*last, altitude), (*home[:2], altitude), home)
    return np.concatenate([there, points, back])


def _crossings(outline: Outline, x: float) -> tuple[float, float] | None:
    """The first and the last place at which a line from south to north crosses an outline; None where it does not."""
    found = []
    for a, b in itertools.pairwise([*outline, outline[0]]):
        if (a[0] <= x) != (b[0] <= x):
            found.append(float(a[1] + (x - a[0]) / (b[0] - a[0]) * (b[1] - a[1])))
    return (min(found), max(found)) if found else None
