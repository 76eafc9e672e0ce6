"""The rest of a plan, for a vehicle on its way and a map that has changed.

    nearest point q of the path to the vehicle x, on its edge (p_i, p_i+1)
    remainder = x, p_i+1, p_i+2, …, g     or, where that does not pass,        x, q, p_i+1, p_i+2, …, g

It ends at the goal g that is asked for, straight on from the plan's own goal where the two differ. The remainder is as
good as any plan: the verifier passes it in the new map, from where the vehicle is, or there is none. The exemption
around an end is what the ball around the plan's own end leaves of a ball around it, never more.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float64

from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.plan import Plan
from maxjax.verification.verifier import verify


def remainder(
    plan: Plan, start: Float64[np.ndarray, " 3"], goal: Float64[np.ndarray, " 3"], where: VoxelMap
) -> Plan | None:
    """The rest of a plan, verified in a map; None where that does not pass.

    Args:
        plan: one that is OK.
        start: where the vehicle is [m], ENU.
        goal: where it shall end [m], the plan's own or one beside it.
        where: the map, one.

    Returns:
        A plan with the length, clearances and exemptions of what is left. Its cost is NaN, since nothing was priced.
    """
    ahead, beside = _ahead(plan.path, start)
    if math.dist(plan.path[-1], goal) > 0.0:
        ahead = np.vstack([ahead, goal])
    exemptions = (
        max(plan.exemptions[0] - math.dist(start, plan.path[0]), 0.0),
        max(plan.exemptions[1] - math.dist(goal, plan.path[-1]), 0.0),
    )
    for path in (np.vstack([start, ahead]), np.vstack([start, beside, ahead])):
        verdict = verify(path, where, radius=plan.radius, exemptions=exemptions)
        if verdict.ok:
            return dataclasses.replace(
                plan,
                path=path,
                length=verdict.length,
                clearance=verdict.clearance,
                cruise_clearance=verdict.cruise_clearance,
                clearance_at=verdict.clearance_at,
                exemptions=exemptions,
                cost=math.nan,
                stats=dataclasses.replace(plan.stats, ratio=math.nan),
                timings={},
                map=where,
            )
    return None


def _ahead(
    path: Float64[np.ndarray, "t 3"], start: Float64[np.ndarray, " 3"]
) -> tuple[Float64[np.ndarray, "r 3"], Float64[np.ndarray, " 3"]]:
    """The points of a path that lie ahead of a place beside it, and the point of the path nearest to the place."""
    low, step = path[:-1], np.diff(path, axis=0)
    squared = np.maximum((step**2).sum(axis=1), np.finfo(np.float64).tiny)
    along = np.clip(((start - low) * step).sum(axis=1) / squared, 0.0, 1.0)
    nearest = low + along[:, None] * step
    edge = int(((nearest - start) ** 2).sum(axis=1).argmin())
    return path[edge + 1 :], nearest[edge]
