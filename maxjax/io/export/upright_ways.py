"""The upright ways of a flight: from the ground to its start, and from its end to the ground or to a roof."""

from __future__ import annotations

import numpy as np

from maxjax.core.status import Closure
from maxjax.core.voxel_map import VoxelMap
from maxjax.io.export.read_back import Lines, Points
from maxjax.planning.mission import Mission
from maxjax.verification.verdicts import Verification
from maxjax.verification.verifier import verify


def upright(line: Points, mission: Mission, leg: int) -> Verification:
    """Verdict on a rise to the first leg or a descent from the last one: neither ground nor altitude band count.

    Nor does the roof that a mission ends on, where it is clear around the place: the descent ends there.
    """
    where, plan = mission.map, mission.legs[leg]
    ground, lowest = np.asarray(where.ground), where.grid.lower[2]
    if leg and mission.touchdown is not None:
        x, y, z = mission.path[-1].tolist()
        ground, lowest = ground | mission.touchdown.surface(where, (x, y, z)), mission.touchdown.height
    obstacles = VoxelMap(np.asarray(where.occupied) & ~ground, np.zeros_like(ground), None, where.grid)
    if where.closed is not None:
        areas = np.where(np.asarray(where.closed) == Closure.AREA, np.uint8(Closure.AREA), np.uint8(Closure.OPEN))
        obstacles = obstacles.closing(areas)
    # Below the map's lowest layer is ground.
    clipped = np.column_stack([line[:, :2], np.maximum(line[:, 2], lowest)])
    # A rise ends where the plan starts, a descent begins where it ends.
    exemptions = (plan.exemptions[1], 0.0) if leg else (0.0, plan.exemptions[0])
    return verify(clipped, obstacles, radius=plan.radius, exemptions=exemptions)


def landing_fault(lines: Lines, mission: Mission, away: float) -> str:
    """What is wrong with the landing that a file has items for, in words; empty where nothing is."""
    roof = mission.touchdown
    if roof is None or lines.holds is None:
        return ""
    if lines.descent is None:
        return f"it does not land on the roof at {roof.height:.2f} m"
    off = float(lines.descent[-1, 2]) - roof.height
    return "" if abs(off) <= away else f"it lands {abs(off):.2f} m {'above' if off > 0 else 'below'} the roof"
