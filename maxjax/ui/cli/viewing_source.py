"""Sources of `maxjax view`: a map, a plan.json or mission.json, or a mission's TOML file, as options and waypoints.

Options of the command line that are not their defaults take the place of those in the file. What a file was made by and
the page does not know is refused: a page never plans by other rules than the file it shows.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from maxjax.core.files import read_text
from maxjax.planning.mission import Waypoint
from maxjax.ui.cli.mission_file import Asked, numbers_of, read_mission, value_of, waypoints_of
from maxjax.ui.cli.options import MissionOptions, PlanOptions, ReadOptions, RouteOptions, ViewOptions

_ENDS = ("start", "goal")
# What a plan.json says of the map beside the options: what came of them.
_FOUND = ("grid", "returns")


@dataclasses.dataclass(frozen=True)
class Opened:
    """The first state of a page.

    Attributes:
        options: those of the page, with the file's.
        waypoints: with their details, as the file has them; empty: ends and places of the options.
        back: whether the way leads back to the start.
        speed: greatest on the way [m/s]; None: that of the flight limits.
    """

    options: ViewOptions
    waypoints: tuple[Waypoint, ...] = ()
    back: bool = False
    speed: float | None = None

    def asked(self) -> Asked:
        """As `maxjax mission` has it; start and goal are given.

        Raises:
            ValueError: where they are not.
        """
        options = self.options
        if options.start is None or options.goal is None:
            raise ValueError("--start and --goal: expected both or none, given one")
        given = common_options(options) | {"start": options.start, "goal": options.goal, "return_to_start": self.back}
        planned = PlanOptions(**given if self.speed is None else {**given, "speed": self.speed})
        return Asked(planned, self.waypoints) if self.waypoints else Asked.of(planned)


def common_options(options: RouteOptions) -> dict[str, Any]:
    """The options that plan and page have in common, by name, the ends left out."""
    return {name: getattr(options, name) for name in _names() if name not in _ENDS}


def _names() -> list[str]:
    return [field.name for kind in (RouteOptions, ReadOptions) for field in dataclasses.fields(kind)]


def open_source(options: ViewOptions) -> Opened:
    """The source that options name, opened.

    Raises:
        ValueError, OSError: for a file that cannot be used.
    """
    path = Path(options.map)
    if path.suffix.lower() == ".toml":
        asked = read_mission(MissionOptions(path))
        return _of_mission(options, asked)
    if path.suffix.lower() != ".json" or not path.is_file():
        return Opened(options)
    try:
        content = json.loads(read_text(path))
    except (ValueError, RecursionError):
        return Opened(options)  # the reader of maps says what is wrong
    if not isinstance(content, dict) or not isinstance(content.get("configuration"), dict):
        return Opened(options)
    try:
        return _of_plan(options, content["configuration"], path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _of_mission(options: ViewOptions, asked: Asked) -> Opened:
    given = {**common_options(asked.options), "start": asked.options.start, "goal": asked.options.goal}
    return Opened(_merged(options, given), asked.waypoints, asked.options.return_to_start, asked.options.speed)


def _of_plan(options: ViewOptions, configuration: Mapping[str, Any], path: Path) -> Opened:
    """The options of a plan.json or mission.json; its files are looked for where they were, then beside it."""
    kept = {name: value for name, value in configuration.items() if name not in _FOUND and value not in (None, [])}
    if "map" not in kept:
        raise ValueError("expected the plan of a map, given one without configuration.map")
    unknown = min(kept.keys() - {*_names(), *_ENDS, "waypoints", "return_to_start", "speed"}, default=None)
    if unknown is not None:
        raise ValueError(f"expected a plan by options of maxjax plan, given one by {unknown!r} as well; open its map")
    waypoints = _waypoints(kept.pop("waypoints", None))
    given = {name: _value(name, value) for name, value in kept.items()}
    for name in ("map", "airspace"):
        beside = os.path.join(path.parent, os.path.basename(given.get(name, "")))
        if name in given and not os.path.exists(given[name]) and os.path.isfile(beside):
            given[name] = beside
    if "airspace" in given:
        given["airspace"] = Path(given["airspace"])
    back, speed = bool(given.pop("return_to_start", False)), given.pop("speed", None)
    if waypoints:
        first, *via, last = (waypoint.position for waypoint in waypoints)
        given |= {"start": first, "goal": last, "via": tuple(via)}
    return Opened(_merged(options, given), waypoints, back, speed)


def _value(name: str, value: Any) -> Any:
    if name in _ENDS:
        return numbers_of(name, value, 3)
    if name == "via" and isinstance(value, list):
        return tuple(numbers_of(name, place, 3) for place in value)
    return value_of(name, value)


def _waypoints(given: Any) -> tuple[Waypoint, ...]:
    """Those of a mission.json, which says None for what a mission's file leaves out."""
    if given is None:
        return ()
    names, tables = {"position": "at"}, []
    for table in given if isinstance(given, list) else [given]:
        pairs = table.items() if isinstance(table, dict) else []
        tables.append({names.get(key, key): value for key, value in pairs if value is not None})
    return waypoints_of(tables)


def _merged(options: ViewOptions, given: dict[str, Any]) -> ViewOptions:
    """The options of a file, but for those of the command line that are not their defaults."""
    defaults = {field.name: field.default for field in dataclasses.fields(options)}
    own = {name for name in given if name != "map" and getattr(options, name) != defaults[name]}
    for name in ("start", "goal", "via"):
        if getattr(options, name) != defaults[name] and name in given:
            raise ValueError(f"--{name}: {options.map} has its own waypoints; drag them on the page")
    return dataclasses.replace(options, **{name: value for name, value in given.items() if name not in own})
