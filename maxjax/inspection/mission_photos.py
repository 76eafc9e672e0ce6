"""The photos that a mission takes, where it is flown as planned: at waypoints, and by the distance flown between them.

A trigger by distance takes a photo where it begins, and then whenever the vehicle has moved by so much in plan, as
autopilots measure it. The heading is that of the leg, along its course or as its waypoint says, the gimbal's as it was
turned last.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float64

from maxjax.inspection.views import Views
from maxjax.planning.look import AimedLook
from maxjax.planning.mission import Mission, looks_of
from maxjax.planning.waypoint import Waypoint

_UPRIGHT = 1e-3  # horizontal way below which a leg has no course [m]


@dataclasses.dataclass(frozen=True)
class _Photo:
    position: Float64[np.ndarray, "3"]
    yaw: float
    pitch: float


def photos_of(mission: Mission) -> Views:
    """The photos of a mission; none of one without a path."""
    leads_to = np.searchsorted(mission.places, np.arange(len(mission.path)))
    return photos_along(mission.path, looks_of(mission), [mission.waypoints[k] for k in leads_to.tolist()])


def photos_along(
    path: Float64[np.ndarray, "n 3"], looks: Mapping[int, AimedLook], aims: Sequence[Waypoint] = ()
) -> Views:
    """The photos along a path.

    Args:
        path: as flown [m].
        looks: what is done with the camera at some of its points, by number.
        aims: of each point, the waypoint that the way to it leads to; none: the nose points along the course.
    """
    found = list(_photos(path, looks, aims))
    return Views(
        np.array([photo.position for photo in found]).reshape(-1, 3),
        np.array([photo.yaw for photo in found], np.float64),
        np.array([photo.pitch for photo in found], np.float64),
    )


def _photos(
    path: Float64[np.ndarray, "n 3"], looks: Mapping[int, AimedLook], aims: Sequence[Waypoint]
) -> Iterator[_Photo]:
    courses, pitch, every, since = _courses(path), 0.0, 0.0, 0.0

    def heading(place: Float64[np.ndarray, "3"], k: int, course: float) -> float:
        """At a place on the way to a point."""
        asked = float(aims[k].yaw_from(place[None])[0]) if aims else math.nan
        return course if math.isnan(asked) else asked

    for k, point in enumerate(path):
        look = looks.get(k, AimedLook())
        pitch = pitch if look.pitch is None else look.pitch
        ahead = courses[min(k, len(courses) - 1)] if courses else 0.0
        yaw = heading(point, k, ahead) if look.yaw is None else look.yaw
        begins = look.every is not None and look.every > 0.0
        if look.every is not None:
            every, since = look.every, 0.0
        if look.photo or begins:
            yield _Photo(point, yaw, pitch)
        if every > 0.0 and k + 1 < len(path):
            way = path[k + 1] - point
            length = math.hypot(way[0], way[1])
            for share in _shares(length, every, since):
                place = point + share * way
                yield _Photo(place, heading(place, k + 1, courses[k]), pitch)
            since = math.fmod(since + length + 1e-9, every) if length > 0 else since


def _shares(length: float, every: float, since: float) -> Sequence[float]:
    """Where along a leg photos are taken, as shares of it: so far after the last one that lay behind."""
    if length <= _UPRIGHT:
        return ()
    return [float(d) / length for d in np.arange(every - since, length + 1e-9, every)]


def _courses(path: Float64[np.ndarray, "n 3"]) -> list[float]:
    """Course of each leg [rad]; an upright one has that of the one before, the first ones that of the first level."""
    ways = np.diff(path, axis=0)
    found: list[float | None] = []
    for x, y, _ in ways.tolist():
        upright = math.hypot(x, y) <= _UPRIGHT
        found.append((found[-1] if found else None) if upright else math.atan2(y, x))
    first = next((course for course in found if course is not None), 0.0)
    return [first if course is None else course for course in found]
