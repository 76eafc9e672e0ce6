"""Waypoint files "QGC WPL 110": one mission item a line, home first, tabs between.

number  current  frame  command  param1 … param4  latitude  longitude  height  autocontinue
"""

from __future__ import annotations

from maxjax.io.export.items import WAYPOINT, Items
from maxjax.io.export.mission_item import GLOBAL, Item


def waypoint_text(mission: Items) -> str:
    """The text of a `.waypoints` file."""
    home = Item(WAYPOINT, GLOBAL, (0.0, 0.0, 0.0, 0.0, *mission.home))
    lines = ["QGC WPL 110"]
    for number, item in enumerate((home, *mission.items)):
        *params, latitude, longitude, height = (0.0 if value is None else value for value in item.params)
        fields = [str(number), str(int(number == 0)), str(item.frame), str(item.command)]
        fields += [f"{value:.8g}" for value in params]
        fields += [f"{latitude:.10f}", f"{longitude:.10f}", f"{height:.6f}", "1"]
        lines.append("\t".join(fields))
    return "\n".join(lines) + "\n"
