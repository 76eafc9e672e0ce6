"""The options that `maxjax plan` and `maxjax mission` share: where what was planned goes, and for whom."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import tyro

_Flag = tyro.conf.FlagCreatePairsOff[bool]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Where a plan or a mission goes.

    Attributes:
        out: Folder for plan.json, path.csv and plan.png; of a mission for mission.json, path.csv and mission.png.
        json: Print the content of plan.json or mission.json, and nothing else, on stdout.
        export: Files to write the plan to, for other programs: .plan (QGroundControl), .waypoints (WPL 110), .geojson,
            .kml, .csv and _ned.csv (set-points), .tum, .rosbag (a folder).
        takeoff_and_landing: Begin .plan and .waypoints with a take-off to the start, and end them with a landing.
        autopilot: Whom .plan and .waypoints are for, px4 or arducopter, with parameters as arducopter:WPNAV_RADIUS=50;
            by default they are judged for both.
        params: Write the parameters that .plan and .waypoints rely on beside them.
        keep_radius: Refuse a waypoint that stands nearer to an obstacle than the radius.
    """

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR", help_behavior_hint="")] = None
    json: _Flag = False
    export: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE ...", help_behavior_hint="")] = ()
    takeoff_and_landing: _Flag = False
    autopilot: Annotated[str | None, tyro.conf.arg(metavar="NAME", help_behavior_hint="")] = None
    params: _Flag = False
    keep_radius: _Flag = False
