"""A mission as a TOML file: a map and options of `maxjax plan`, and waypoints in order.

    map = "quarter.geojson"        # beside this file, or a simulated city
    speed = 8.0                    # any option of `maxjax plan`, with _ for -
    return_to_start = true

    [[waypoint]]                   # the start
    at = [-75.0, 22.0, 5.0]

    [[waypoint]]
    at = [0.0, 60.0, 30.0]
    hover = 5.0                    # to rest there [s]
    speed = 4.0                    # of the leg that leads here; likewise radius and margin

Paths in it are relative to the file. All is checked before anything is planned.
"""

from __future__ import annotations

import dataclasses
import math
import os
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from maxjax.core.files import read_bytes
from maxjax.planning.mission import Waypoint
from maxjax.ui.cli.options import MissionOptions, PlanOptions
from maxjax.ui.methods import ALIASES, METHODS

_MOST_BYTES = 2**20
# What separates keys and values of TOML, texts and quoted keys taken out.
_STRUCTURE = re.compile(rb"[=\[\]{},\r\n#]")
_QUOTED = re.compile(rb'"(?:[^"\\\n]|\\.)*"|\'[^\'\n]*\'')
_OPTION = re.compile(r"--([a-z][a-z-]*)")
_MOST_DOTS = 64
_CITY = re.compile(r"\w+:\d+")

# What may stand in a file, by kind: options of `maxjax plan`, but its ends and its outputs.
NUMBERS = ("spacing", "radius", "margin", "ground", "speed", "floor", "ceiling", "ceiling_above_start")
VECTORS = {"bounds": 6, "center": 3, "place": 3}
WORDS: Mapping[str, tuple[str, ...]] = {
    "frame": ("map", "local-agl", "agl", "amsl"),
    "method": (*METHODS, *ALIASES),
    "below": ("closed", "open"),
    "unknown": ("occupied", "free"),
}
TEXTS = ("crs", "unit", "vertical_unit", "price", "autopilot")
WHOLE = ("band",)
LISTS: Mapping[str, type] = {"drop_class": int, "only": str}
FILES = ("map", "airspace")
FLAGS = ("return_to_start", "takeoff_and_landing", "params", "keep_radius")
_OF_WAYPOINTS = ("at", "hover", "speed", "radius", "margin")


@dataclasses.dataclass(frozen=True)
class Asked:
    """A mission as a file asks for it.

    Attributes:
        options: of its plans, `start` and `goal` the first and the last waypoint, `via` those in between.
        waypoints: in order, without the way back.
        partial: whether the legs before the first that fails are written.
    """

    options: PlanOptions
    waypoints: tuple[Waypoint, ...]
    partial: bool = False

    @classmethod
    def of(cls, options: PlanOptions) -> Asked:
        """The mission of the options of `maxjax plan`."""
        return cls(options, tuple(Waypoint(point) for point in (options.start, *options.via, options.goal)))


def read_mission(options: MissionOptions) -> Asked:
    """The mission of a file.

    Raises:
        ValueError: if it is not such a file, with what was expected and what was given.
        OSError: if it cannot be read.
    """
    content = _content(options.file)
    try:
        given: dict[str, Any] = {key: value_of(key, value) for key, value in content.items() if key != "waypoint"}
        if "map" not in given:
            raise ValueError("expected a map, as map = 'town.geojson', given none")
        waypoints = waypoints_of(content.get("waypoint"))
        first, *via, last = (waypoint.position for waypoint in waypoints)
    except ValueError as error:
        raise ValueError(f"{options.file}: {error}") from error
    beside = options.file.parent / given["map"]
    if os.path.exists(beside) or not _CITY.fullmatch(given["map"]):
        given["map"] = str(beside)
    if "airspace" in given:
        given["airspace"] = options.file.parent / given["airspace"]
    given |= {"start": first, "goal": last, "via": tuple(via)}
    for flag in ("takeoff_and_landing", "params", "keep_radius"):
        given[flag] = getattr(options, flag) or given.get(flag, False)
    if options.autopilot is not None:
        given["autopilot"] = options.autopilot
    planned = PlanOptions(**given, out=options.out, json=options.json, export=options.export)
    return Asked(planned, waypoints, options.partial)


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
        keys = [key for key in named if key in (*NUMBERS, *VECTORS, *WORDS, *TEXTS, *WHOLE, *LISTS)]
        if not keys:
            raise
        stand = "are keys of the file" if len(keys) > 1 else "is a key of the file"
        raise ValueError(f"{error} ({' and '.join(keys)} {stand}: {file})") from error


def _content(file: Path) -> dict[str, Any]:
    content = read_bytes(file, _MOST_BYTES)
    # A parser of TOML takes a time that grows with the square of a key's parts.
    if any(part.count(b".") > _MOST_DOTS for part in _STRUCTURE.split(_QUOTED.sub(b"q", content))):
        raise ValueError(f"{file}: expected keys of at most {_MOST_DOTS} parts, given more; no mission has such")
    try:
        return tomllib.loads(content.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError, ValueError) as error:
        raise ValueError(f"{file}: expected a mission as TOML: {error}") from error


def value_of(key: str, given: Any) -> Any:
    """The value of an option.

    Raises:
        ValueError: for an unknown key, or a value of another kind.
    """
    if key in NUMBERS:
        return _number(key, given)
    if key in VECTORS:
        return numbers_of(key, given, VECTORS[key])
    if key in WORDS:
        return _checked(key, given, lambda value: value in WORDS[key], "one of " + ", ".join(WORDS[key]))
    if key in (*TEXTS, *FILES):
        return _checked(key, given, lambda value: isinstance(value, str) and bool(value), "a text")
    if key in WHOLE:
        return _checked(key, given, _is_whole, "a whole number")
    if key in LISTS:
        kind = LISTS[key]
        expected = "whole numbers in brackets" if kind is int else "texts in brackets"
        return tuple(_checked(key, given, lambda values: _is_list(values, kind), expected))
    if key in FLAGS:
        return _checked(key, given, lambda value: isinstance(value, bool), "true or false")
    known = ", ".join(sorted([*NUMBERS, *VECTORS, *WORDS, *TEXTS, *WHOLE, *LISTS, *FILES, *FLAGS]))
    raise ValueError(f"{key}: expected one of {known}, or [[waypoint]]")


def waypoints_of(given: Any) -> tuple[Waypoint, ...]:
    """Waypoints of tables, the start first.

    Raises:
        ValueError: if there are none, with what was expected and what was given.
    """
    if not isinstance(given, list) or len(given) < 2 or not all(isinstance(table, dict) for table in given):
        raise ValueError("waypoint: expected at least two tables [[waypoint]], the start first, given " + _shown(given))
    found = []
    for number, table in enumerate(given):
        name = f"waypoint {number}"
        unknown = next((key for key in table if key not in _OF_WAYPOINTS), None)
        if unknown is not None:
            raise ValueError(f"{name}: expected the keys {', '.join(_OF_WAYPOINTS)}, given {unknown!r}")
        if "at" not in table:
            raise ValueError(f"{name}: expected at = [x, y, z], given none")
        numbers = {key: _number(f"{name}: {key}", value) for key, value in table.items() if key != "at"}
        if number == 0 and numbers.keys() - {"hover"}:
            raise ValueError(f"{name}: expected no {min(numbers.keys() - {'hover'})}: no leg leads to the start")
        x, y, z = numbers_of(f"{name}: at", table["at"], 3)
        try:
            found.append(Waypoint((x, y, z), **numbers))
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
    return tuple(found)


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
