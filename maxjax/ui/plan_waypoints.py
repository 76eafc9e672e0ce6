"""Waypoints of QGroundControl's `.plan` files: where a mission goes, which is then planned anew, leg by leg.

    NAV_TAKEOFF, NAV_WAYPOINT, NAV_LOITER_TIME, NAV_LAND   places, with times to hover
    DO_CHANGE_SPEED                                        the speed of the legs that follow
    surveys, corridors                                     the items that QGroundControl made of them

A mission begins above the planned home: at the height of its take-off, or, where heights count from home and it has no
take-off, at that of its first waypoint. A landing is upright, below a waypoint above its place. All other items are
counted in a note.
"""

from __future__ import annotations

import collections
import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from maxjax.core.files import MAX_TEXT_BYTES, FileError, parse_json, read_bytes
from maxjax.planning.waypoint import Waypoint

_WAYPOINT, _LOITER, _LAND, _TAKE_OFF, _SPEED = 16, 19, 21, 22, 178  # MAVLink's numbers
_FRAMES = {0: "amsl", 5: "amsl", 3: "home", 6: "home", 10: "agl", 11: "agl"}
_OVER_GROUND = (0.0, 1.0)  # of kinds of speed: others are those of climbs and descents
_MOST = 1e12  # of any number: whole ones of JSON may be too large to be one
_SAME = 1e-8  # between places [degrees] and heights [m]


@dataclasses.dataclass(frozen=True)
class PlanWaypoints:
    """What a `.plan` file says to visit.

    Attributes:
        frame: what its places are: amsl, agl, or home, whose heights count from the ground below the first one.
        waypoints: latitude, longitude [degrees] and height [m] each, the start first.
        lands: whether it ends with a landing below the last one.
        notes: sentences on what it has besides.
    """

    frame: str
    waypoints: tuple[Waypoint, ...]
    lands: bool
    notes: tuple[str, ...]


def read_plan_waypoints(file: Path) -> PlanWaypoints:
    """The waypoints of a `.plan` file.

    Raises:
        FileError: if it is none, its heights are of several kinds, or it has fewer than two places.
        OSError: if it cannot be read.
    """
    content = parse_json(read_bytes(file, MAX_TEXT_BYTES), file)
    mission = content.get("mission") if isinstance(content, dict) else None
    if not isinstance(mission, dict) or not isinstance(mission.get("items"), list):
        raise FileError(f"{file}: expected a .plan of QGroundControl with mission.items, given none")
    others = collections.Counter[str]()
    items = list(_simple(file, mission["items"], others))
    frames = {_FRAMES.get(frame, f"frame {frame}") for command, frame, _ in items if command != _SPEED}
    if len(frames) != 1 or not frames <= set(_FRAMES.values()):
        raise FileError(
            f"{file}: expected places in one frame, 0 (sea level), 3 (above home) or 10 (above ground), given "
            + (", ".join(sorted(frames)) or "no place")
        )
    (frame,) = frames
    home = _numbers(file, mission.get("plannedHomePosition"), 2, "plannedHomePosition")
    waypoints, lands = _visited(file, items, home, frame)
    if len(waypoints) < 2:
        raise FileError(f"{file}: expected two places or more, given {len(waypoints)}")
    counted = [f"{count} × {name}" for name, count in sorted(others.items())]
    notes = (f"what is not a place, a time to hover or a speed is left out: {', '.join(counted)}",) if counted else ()
    return PlanWaypoints(frame, tuple(waypoints), lands, notes)


def _simple(
    file: Path, items: Sequence[Any], others: collections.Counter[str]
) -> Iterator[tuple[int, int, tuple[float, ...]]]:
    """Command, frame and parameters of the items that are understood; the others are counted."""
    for item in items:
        kind = item.get("type") if isinstance(item, dict) else None
        if kind == "ComplexItem":
            style = item.get("TransectStyleComplexItem")
            inner = style.get("Items") if isinstance(style, dict) else None
            if isinstance(inner, list):
                yield from _simple(file, inner, others)
            else:
                others[f"{item.get('complexItemType', 'complex item')}"[:40]] += 1
        elif kind != "SimpleItem" or not isinstance(item.get("command"), int):
            raise FileError(f"{file}: expected items of the type SimpleItem or ComplexItem, given {str(item)[:60]}")
        elif item["command"] in (_WAYPOINT, _LOITER, _LAND, _TAKE_OFF, _SPEED):
            frame = item.get("frame")
            yield (
                item["command"],
                frame if isinstance(frame, int) else -1,
                _numbers(file, item.get("params"), 7, "params"),
            )
        else:
            others[f"command {item['command']}"] += 1


def _visited(
    file: Path, items: Sequence[tuple[int, int, tuple[float, ...]]], home: Sequence[float], frame: str
) -> tuple[list[Waypoint], bool]:
    """The waypoints, the start first, and whether the last one is landed below."""
    found, lands, speed = list[Waypoint](), False, None
    for command, _, params in items:
        if command == _SPEED:
            if params[0] in _OVER_GROUND:
                speed = params[1] if params[1] > 0.0 else None
            continue
        if lands:
            raise FileError(f"{file}: expected nothing after the landing, given command {command}; make two missions")
        north, east, height = params[4:]
        if command == _TAKE_OFF and found:
            raise FileError(f"{file}: expected a take-off first, given one after {len(found)} places")
        if not found and (command == _TAKE_OFF or frame == "home"):
            found.append(Waypoint((home[0], home[1], height)))
        if command in (_TAKE_OFF, _LAND) and math.hypot(north, east) == 0.0:
            north, east, _ = found[-1].position if found else (*home[:2], 0.0)
        if command == _LAND:
            lands, height = True, found[-1].position[2] if found else height
        hover = params[0] if command in (_WAYPOINT, _LOITER) and params[0] > 0.0 else None
        _add(found, Waypoint((north, east, height), hover=hover, speed=speed if found else None))
    return found, lands


def _add(found: list[Waypoint], waypoint: Waypoint) -> None:
    """Add a waypoint, to the one before where they are the same place."""
    if found and all(abs(a - b) <= _SAME for a, b in zip(found[-1].position, waypoint.position, strict=True)):
        hover = (found[-1].hover or 0.0) + (waypoint.hover or 0.0)
        found[-1] = dataclasses.replace(found[-1], hover=hover or None)
    else:
        found.append(waypoint)


def _numbers(file: Path, given: Any, count: int, name: str) -> tuple[float, ...]:
    """So many numbers at least; what a parameter leaves to the vehicle is 0."""
    values = [0.0 if value is None else value for value in given] if isinstance(given, list) else []
    if len(values) < count or not all(isinstance(value, int | float) and abs(value) < _MOST for value in values):
        raise FileError(f"{file}: {name}: expected {count} numbers, given {str(given)[:60]}")
    return tuple(map(float, values))


def plan_keys(file: Path, given: Mapping[str, Any]) -> dict[str, Any]:
    """The options of a mission whose waypoints are those of a `.plan` file.

    Args:
        file: of QGroundControl.
        given: options that the mission has besides.

    Raises:
        ValueError: where they say a frame, which the `.plan` does.
    """
    if "frame" in given:
        raise ValueError(f"frame: expected none beside waypoint = {file.name!r}, which says what its heights are")
    found = read_plan_waypoints(file)
    said = {
        "frame": found.frame,
        "waypoints": found.waypoints,
        "notes": tuple(f"{file.name}: {n}" for n in found.notes),
    }
    return {"takeoff_and_landing": True, **given, **said} if found.lands else {**given, **said}
