"""A request as the text of a mission's file, which `maxjax mission` and `load_mission` read back as the same request.

What is as by default is left out. The map is named as it is in the request; a file of it lies beside the mission's.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from maxjax.planning.waypoint import Waypoint
from maxjax.ui.looks import waypoint_table
from maxjax.ui.request import Request
from maxjax.ui.request_files import KEYS

_NOT_SAID = ("map",)


def mission_text(request: Request) -> str:
    """The TOML of a mission.

    Args:
        request: with two waypoints at least, or one and a roof to land on.

    Raises:
        ValueError: for fewer waypoints.
    """
    if len(request.waypoints) < (1 if request.roofs else 2):
        raise ValueError(f"waypoints: expected two at least, the start first, given {len(request.waypoints)}")
    name = os.path.basename(request.map) if os.path.exists(request.map) else request.map
    lines = [f"map = {_value(name)}"]
    for field in dataclasses.fields(Request):
        given = getattr(request, field.name)
        if field.name in KEYS and field.name not in _NOT_SAID and given not in (field.default, None, ()):
            lines.append(f"{field.name} = {_value(given)}")
    return "\n".join([*lines, *(line for waypoint in request.waypoints for line in _table(waypoint))]) + "\n"


def _table(waypoint: Waypoint) -> Iterator[str]:
    yield ""
    yield "[[waypoint]]"
    for key, given in waypoint_table(waypoint).items():
        if given is not None:
            yield f"{'at' if key == 'position' else key} = {_value(given)}"


def _value(given: Any) -> str:
    """A value of TOML."""
    if isinstance(given, bool):
        return "true" if given else "false"
    if isinstance(given, str | Path):
        # A basic string of TOML is one of JSON, but for the character 127.
        return json.dumps(str(given), ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(given, tuple):
        return f"[{', '.join(map(_value, given))}]"
    return repr(given)
