"""Files of a request: a mission as TOML, and the JSON that `maxjax plan` and `maxjax mission` write.

    map = "quarter.geojson"        # beside this file, or a simulated city
    speed = 8.0                    # any option of `maxjax plan`, with _ for -
    return_to_start = true

    [[waypoint]]                   # the start
    at = [-75.0, 22.0, 5.0]

    [[waypoint]]
    at = [0.0, 60.0, 30.0]
    hover = 5.0                    # to rest there [s]
    speed = 4.0                    # of the leg that leads here; likewise radius and margin
    alternatives = [[9.0, 9.0, 5.0]]   # other places; the one that costs least to reach is flown to
    heading = 90.0                 # of the nose on that leg and at rest here, clockwise from north; or
    look_at = [10.0, 55.0, 20.0]   # a point of interest

`waypoint = "way.plan"` in place of the tables takes the waypoints of a file of QGroundControl (`ui.plan_waypoints`).
Paths in it are relative to the file. All is checked before anything is planned; what a file says that is no option is
refused, so that nothing is planned by other rules than the file has.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from maxjax.core.files import read_bytes, read_text
from maxjax.planning.waypoint import Waypoint
from maxjax.ui.looks import LOOK_KEYS, look_of
from maxjax.ui.methods import ALIASES, METHODS, is_import_path
from maxjax.ui.option_groups import Point3
from maxjax.ui.plan_waypoints import plan_keys
from maxjax.ui.request import Request

_MOST_BYTES = 2**20
# What separates keys and values of TOML, texts and quoted keys taken out.
_STRUCTURE = re.compile(rb"[=\[\]{},\r\n#]")
_QUOTED = re.compile(rb'"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'')
_OPTION = re.compile(r"--([a-z][a-z-]*)")
_MOST_DOTS = 64
_CITY = re.compile(r"\w+:\d+")

# What a file cannot say: stops stand in tables of their own, and where an answer goes is said by whoever asks.
_OTHERS = ("waypoints", "out", "json", "export", "partial", "beside", "notes")


def _without_none(hint: Any) -> Any:
    """The type of an option that may be left out."""
    kinds = get_args(hint)
    return next(kind for kind in kinds if kind is not NoneType) if NoneType in kinds else hint


_HINTS = get_type_hints(Request)
KEYS: Mapping[str, Any] = {
    field.name: _without_none(_HINTS[field.name]) for field in dataclasses.fields(Request) if field.name not in _OTHERS
}
"""Options that may stand in a file, and their types."""
_OF_WAYPOINTS = ("at", "hover", "speed", "radius", "margin", "heading", "look_at", "alternatives", *LOOK_KEYS)
_OF_START = ("hover", "heading", "look_at", *LOOK_KEYS)  # keys that the start may have, to which no leg leads
_ROOFS = {"land_on", "land_at"}  # keys that say where a mission ends without a waypoint there
# What a plan.json says of the map beside the options: what came of them.
_FOUND = ("grid", "returns")


def load_mission(file: str | os.PathLike[str]) -> Request:
    """The request of a mission's TOML file: its map, its waypoints, and every option that it names.

    Raises:
        ValueError: if it is not such a file, with what was expected and what was given.
        OSError: if it cannot be read.
    """
    file = Path(file)
    content = _toml(file)
    try:
        given: dict[str, Any] = {key: value_of(key, value) for key, value in content.items() if key != "waypoint"}
        if "map" not in given:
            raise ValueError("expected a map, as map = 'town.geojson', given none")
        given |= _waypoint_keys(file, content.get("waypoint"), given)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error
    beside = file.parent / given["map"]
    if os.path.exists(beside) or not _CITY.fullmatch(given["map"]):
        given["map"] = str(beside)
    if "airspace" in given:
        given["airspace"] = file.parent / given["airspace"]
    return Request(**given)


def _waypoint_keys(file: Path, said: Any, given: Mapping[str, Any]) -> dict[str, Any]:
    """The options that the waypoints of a mission's file are: its tables, or a `.plan` of QGroundControl."""
    if isinstance(said, str):
        return plan_keys(file.parent / said, given)
    return {"waypoints": waypoints_of(said, 1 if given.keys() & _ROOFS else 2)}


def read_plan(file: Path) -> Request | None:
    """The request that a plan.json or mission.json answers; None for other JSON, as that of a map.

    Its files are looked for where they were, then beside it.

    Raises:
        ValueError: for a plan by options that are none.
    """
    try:
        content = json.loads(read_text(file))
    except (ValueError, RecursionError):
        return None  # the reader of maps says what is wrong
    if not isinstance(content, dict) or not isinstance(content.get("configuration"), dict):
        return None
    try:
        return _of_configuration(content["configuration"], file.parent)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error


def _of_configuration(configuration: Mapping[str, Any], folder: Path) -> Request:
    kept = {name: value for name, value in configuration.items() if name not in _FOUND and value not in (None, [])}
    if "map" not in kept:
        raise ValueError("expected the plan of a map, given one without configuration.map")
    ends = {name: kept.pop(name) for name in ("start", "goal", "via", "waypoints") if name in kept}
    unknown = min(kept.keys() - KEYS.keys(), default=None)
    if unknown is not None:
        raise ValueError(f"expected a plan by options of maxjax plan, given one by {unknown!r} as well; open its map")
    given = {name: value_of(name, value) for name, value in kept.items()}
    for name in ("map", "airspace"):
        beside = os.path.join(folder, os.path.basename(given.get(name, "")))
        if name in given and not os.path.exists(given[name]) and os.path.isfile(beside):
            given[name] = type(given[name])(beside)
    if "waypoints" in ends:
        return Request(**given, waypoints=_written_waypoints(ends["waypoints"], 1 if given.keys() & _ROOFS else 2))
    via = ends.get("via", [])
    between = [point_of("via", place) for place in (via if isinstance(via, list) else [via])]
    places = [point_of(name, ends[name]) for name in ("start", "goal") if name in ends]
    if len(places) == 1:
        raise ValueError("start and goal: expected both or none, given one")
    places[1:1] = between if places else []
    return Request.between(given.pop("map"), *places, **given)


def _written_waypoints(given: Any, least: int) -> tuple[Waypoint, ...]:
    """Those of a mission.json, which says None for what a mission's file leaves out."""
    names, tables = {"position": "at"}, []
    for table in given if isinstance(given, list) else [given]:
        pairs = table.items() if isinstance(table, dict) else []
        tables.append({names.get(key, key): value for key, value in pairs if value is not None})
    return waypoints_of(tables, least)


@contextmanager
def options_as_keys(file: Path) -> Iterator[None]:
    """Say of options that an error within names where they stand: a mission's file has them as keys.

    Raises:
        ValueError: in place of one that names such options.
    """
    try:
        yield
    except ValueError as error:
        named = dict.fromkeys(name.replace("-", "_") for name in _OPTION.findall(str(error)))
        keys = [key for key in named if key in KEYS]
        if not keys:
            raise
        stand = "are keys of the file" if len(keys) > 1 else "is a key of the file"
        raise ValueError(f"{error} ({' and '.join(keys)} {stand}: {file})") from error


def _toml(file: Path) -> dict[str, Any]:
    content = read_bytes(file, _MOST_BYTES)
    # A parser of TOML takes a time that grows with the square of a key's parts.
    if any(part.count(b".") > _MOST_DOTS for part in _STRUCTURE.split(_QUOTED.sub(b"q", content))):
        raise ValueError(f"{file}: expected keys of at most {_MOST_DOTS} parts, given more; no mission has such")
    try:
        return tomllib.loads(content.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError, ValueError) as error:
        raise ValueError(f"{file}: expected a mission as TOML: {error}") from error


def value_of(key: str, given: Any) -> Any:
    """The value of an option, as its type says.

    Raises:
        ValueError: for an unknown key, or a value of another kind.
    """
    if key not in KEYS:
        raise ValueError(f"{key}: expected one of {', '.join(sorted(KEYS))}, or [[waypoint]]")
    hint = KEYS[key]
    parts = get_args(hint)
    if key == "method":
        names = (*METHODS, *ALIASES)
        return _checked(key, given, lambda name: name in names or is_import_path(name), "one of " + ", ".join(names))
    if get_origin(hint) is Literal:
        return _checked(key, given, lambda value: value in parts, "one of " + ", ".join(parts))
    if get_origin(hint) is tuple and parts[-1] is Ellipsis:
        expected = "whole numbers in brackets" if parts[0] is int else "texts in brackets"
        given = [given] if key == "land_on" and isinstance(given, str) else given
        return tuple(_checked(key, given, lambda values: _is_list(values, parts[0]), expected))
    if get_origin(hint) is tuple:
        return numbers_of(key, given, len(parts))
    if hint is float:
        return _number(key, given)
    if hint is int:
        return _checked(key, given, _is_whole, "a whole number")
    if hint is bool:
        return _checked(key, given, lambda value: isinstance(value, bool), "true or false")
    text = _checked(key, given, lambda value: isinstance(value, str) and bool(value), "a text")
    return hint(text)


def waypoints_of(given: Any, least: int = 2) -> tuple[Waypoint, ...]:
    """Waypoints of so many tables at least, the start first.

    Raises:
        ValueError: if there are none, with what was expected and what was given.
    """
    if not isinstance(given, list) or len(given) < least or not all(isinstance(table, dict) for table in given):
        count = "two tables" if least > 1 else "one table"
        raise ValueError(f"waypoint: expected at least {count} [[waypoint]], the start first, given {_shown(given)}")
    found = []
    for number, table in enumerate(given):
        name = f"waypoint {number}"
        unknown = next((key for key in table if key not in _OF_WAYPOINTS), None)
        if unknown is not None:
            raise ValueError(f"{name}: expected the keys {', '.join(_OF_WAYPOINTS)}, given {unknown!r}")
        if "at" not in table:
            raise ValueError(f"{name}: expected at = [x, y, z], given none")
        if number == 0 and table.keys() - {"at", *_OF_START}:
            raise ValueError(f"{name}: expected no {min(table.keys() - {'at', *_OF_START})}: no leg leads to the start")
        given = {key: _own(f"{name}: {key}", key, value) for key, value in table.items() if key != "at"}
        place = point_of(f"{name}: at", table["at"])
        try:
            own = {key: value for key, value in given.items() if key not in LOOK_KEYS}
            found.append(Waypoint(place, **own, look=look_of(given)))
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    return tuple(found)


def _own(name: str, key: str, value: Any) -> Any:
    """The value of a waypoint's key."""
    if key == "photo":
        return _checked(name, value, lambda given: isinstance(given, bool), "true or false")
    if key == "alternatives":
        places = _checked(name, value, lambda given: isinstance(given, list), "places in brackets, as [[x, y, z]]")
        return tuple(point_of(name, place) for place in places)
    return point_of(name, value) if key == "look_at" else _number(name, value)


def _checked(name: str, given: Any, fits: Callable[[Any], bool], expected: str) -> Any:
    try:
        if fits(given):
            return given
    except TypeError:  # an array is in no list of words
        pass
    raise ValueError(f"{name}: expected {expected}, given {_shown(given)}")


def _number(name: str, given: Any) -> float:
    return float(_checked(name, given, _is_number, "a finite number"))


def numbers_of(name: str, given: Any, count: int) -> tuple[float, ...]:
    """So many numbers of a list.

    Raises:
        ValueError: where these are none.
    """

    def fits(values: Any) -> bool:
        return isinstance(values, list) and len(values) == count and all(map(_is_number, values))

    return tuple(float(value) for value in _checked(name, given, fits, f"{count} finite numbers in brackets"))


def point_of(name: str, given: Any) -> Point3:
    """A place of a list; raises a ValueError where it is none."""
    x, y, z = numbers_of(name, given, 3)
    return x, y, z


def _is_number(given: Any) -> bool:
    if isinstance(given, bool) or not isinstance(given, int | float):
        return False
    return math.isfinite(given) if isinstance(given, float) else abs(given) < 2**1000


def _is_whole(given: Any) -> bool:
    return isinstance(given, int) and not isinstance(given, bool)


def _is_list(given: Any, kind: type) -> bool:
    return isinstance(given, list) and all(isinstance(v, kind) and not isinstance(v, bool) for v in given)


def _shown(given: Any) -> str:
    text = repr(given)
    return text if len(text) <= 60 else text[:57] + "..."
