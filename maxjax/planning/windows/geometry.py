"""Where a way of some cost can lie, and what proves that it is the cheapest; the same arithmetic in NumPy and JAX.

    |x − s| + |x − g| ≤ C        for every point x of a way from s to g that costs no more than C
    |s' − g|                     the least cost of a way over a face, with s' the image of s mirrored at the face

as no metre costs less than 1. A path of cost C, found in a window, is the cheapest of the whole map if C is at most the
bound: the least of these over all faces that a way can cross.

Positions are index coordinates of the map (whole numbers at voxel centres), costs and bounds [voxels]. Batch axes lead.
The last argument of each function is `numpy` or `jax.numpy`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from maxjax.core.grid import Index3
from maxjax.core.status import Status

# What the cheapest way is taken to cost, in terms of the straight line, and by what that grows where ends are not
# joined.
GUESS, GROWTH = 1.25, 1.6
# Such faults of an end are plain in any window that holds it.
LOCAL = (Status.START_OCCUPIED, Status.GOAL_OCCUPIED)

Reals = Float[Any, "..."]
Flags = Bool[Any, "..."]
# Of three numbers each, as shapes and corners are.
Triples = Int[Any, "*b 3"]
Ends = Float[Any, "*b 2 3"]


def worthwhile(shapes: Index3 | Triples, whole: Index3) -> Bool[np.ndarray, "*n"]:
    """Whether windows of such shapes have less than half of the voxels of a whole map."""
    return np.asarray(2 * np.prod(np.asarray(shapes), axis=-1) < math.prod(whole))


def guess_costs(ends: Ends, xp: Any) -> Reals:
    """First guesses of what the cheapest ways cost."""
    return GUESS * xp.linalg.norm(ends[..., 1, :] - ends[..., 0, :], axis=-1)


def ends_inside(ends: Ends, limits: Int[Any, " 3"], xp: Any) -> Flags:
    """Whether both ends lie in voxels of a map of this shape, and are not one point; NaN lies nowhere."""
    voxels = xp.floor(ends + 0.5)
    within = ((voxels >= 0) & (voxels < limits)).all(axis=(-2, -1))
    return within & (ends[..., 0, :] != ends[..., 1, :]).any(axis=-1)


def ellipsoid_box(ends: Ends, costs: Reals, limits: Int[Any, " 3"], xp: Any) -> tuple[Triples, Triples]:
    """The lowest and the highest voxels of a map of this shape that ellipsoids with these foci meet."""
    middle, chord = 0.5 * (ends[..., 0, :] + ends[..., 1, :]), ends[..., 1, :] - ends[..., 0, :]
    across = xp.maximum(costs**2 - (chord**2).sum(axis=-1), 0.0) / 4
    # Along each axis: a² u² + b² (1 − u²) with the half axes a² = b² + |chord|²/4 and b, u the chord's direction.
    half = xp.sqrt(across[..., None] + chord**2 / 4)
    low, high = xp.floor(middle - half).astype(int), xp.ceil(middle + half).astype(int)
    return xp.clip(low, 0, limits - 1), xp.clip(high, 0, limits - 1)


def centre(low: Triples, high: Triples, sizes: Triples, limits: Int[Any, " 3"], xp: Any) -> Triples:
    """Lowest voxels of windows with these boxes in their middle, within the map where it is large enough."""
    return xp.clip((low + high + 1 - sizes) // 2, 0, xp.maximum(limits - sizes, 0))


def costs_over_faces(ends: Ends, corners: Triples, sizes: Triples, xp: Any) -> Float[Any, "*b 2 3"]:
    """The least cost of a way over the lower and the upper face along each axis, by its voxels' centres."""
    start, goal = ends[..., :1, None, :], ends[..., 1:, None, :]
    faces = xp.stack([corners, corners + sizes - 1], axis=-2)[..., None, :]
    mirrored = 2 * faces - start
    return xp.linalg.norm(xp.where(np.eye(3, dtype=bool), mirrored, start) - goal, axis=-1)


def path_costs(path: Float[Any, "*b t 3"], costs: Reals, xp: Any) -> Reals:
    """Costs of paths; without a price, where that is 0, a metre costs 1."""
    return xp.where(costs > 0, costs, xp.linalg.norm(xp.diff(path, axis=-2), axis=-1).sum(axis=-1))


def is_proved(status: Int[Any, "..."], costs: Reals, bounds: Reals) -> Flags:
    """Whether windows with these bounds prove what they show: that a path is the cheapest, or what is wrong locally."""
    start, goal = LOCAL
    return (status == start) | (status == goal) | ((status == Status.OK) & (costs <= bounds))


def next_costs(status: Int[Any, "..."], costs: Reals, tried: Reals, xp: Any) -> Reals:
    """The costs whose windows are the next to look at, after those that were tried found paths of these costs."""
    return xp.where(status == Status.OK, xp.maximum(costs, tried), GROWTH * tried)
