"""The ground at home, below the start, and at the goal: what heights in files count from, and where the vehicle stands.

height in a file = z − ground at home
"""

from __future__ import annotations

import math
from pathlib import Path

from maxjax.io.export.endings import FROM_HOME, ending_of, is_ned
from maxjax.io.export.items import Feet
from maxjax.io.export.read_back import Standing
from maxjax.io.export.setpoints import LocalOrigin
from maxjax.io.geo.earth import Earth
from maxjax.planning.mission import Mission


def standings_of(mission: Mission, earth: Earth | None, ground: float | None) -> tuple[Standing, ...]:
    """Where the vehicle may stand: where only voxels tell the ground, up to a voxel lower as well."""
    terrain = mission.map.terrain
    found = [Standing(earth, terrain, ground)]
    lower = terrain.at(*mission.path[0, :2].tolist()) - terrain.doubt
    if ground is None and terrain.doubt > 0.0 and not math.isnan(lower):
        found.append(Standing(earth, terrain, lower))
    return tuple(found)


def counts_from_home(file: Path) -> bool:
    """Whether heights in a file count from the ground at home."""
    ending = ending_of(file)
    return ending in FROM_HOME or is_ned(file)


def home_height(file: Path, mission: Mission, ground: float | None) -> float:
    """Height of the ground below the start [m]; raises a `ValueError` where it is unknown."""
    x, y, _ = mission.path[0].tolist()
    home = mission.map.terrain.at(x, y) if ground is None else ground
    if math.isnan(home):
        raise ValueError(f"{file}: expected a map with ground below the start; give its height, as ground=0.0")
    return home


def feet_of(file: Path, mission: Mission, ground: float | None, landing: bool) -> Feet:
    """Where the ground is, and the roof that a mission ends on; raises a `ValueError` where that is unknown."""
    home, goal, lands = home_height(file, mission, ground), mission.landing_height, mission.touchdown is not None
    if landing and math.isnan(goal):
        raise ValueError(f"{file}: expected a map with ground below the goal, to land there; load it with ground=…")
    return Feet(home, goal if landing or lands else None, takes_off=landing)


def origin_of(file: Path, mission: Mission, ground: float | None, earth: Earth | None) -> LocalOrigin | None:
    """Where NED counts from, home; None for a file that is none."""
    x, y, _ = mission.path[0].tolist()
    return LocalOrigin((x, y, home_height(file, mission, ground)), earth) if counts_from_home(file) else None
