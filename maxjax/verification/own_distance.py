"""Smaller distances near the ends: own distances of the ends, and the parts of the path that are exempt.

    kept(x) = radius                                            outside the exemptions
              min over the exemptions that hold x of k_e        inside,   k_e = min(radius, distance of the end e)

and likewise beside the ground: a part may touch a voxel there where an exemption holds it whose end touches one, too.

Coordinates are index coordinates u, in which voxel i is the closed cube [i, i + 1].
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64, Int64, Integer

from maxjax.verification.clearance import clearances
from maxjax.verification.exempt_parts import Parts

_FACES = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))


def exempt_shortfall(
    parts: Parts,
    path_of: Int64[np.ndarray, " k"],
    which: Integer[np.ndarray, " p"],
    maps: tuple[Bool[np.ndarray, "m nx ny nz"], Bool[np.ndarray, "m nx ny nz"] | None],
    kept: Float64[np.ndarray, "p 2"],
) -> Float64[np.ndarray, " p"]:
    """By how much each path comes nearer to obstacles inside its exemptions than it may; −∞ where it has none.

    Args:
        parts, path_of, which: as in `clearances`.
        maps: occupied voxels, and those that are ground or None.
        kept: distance that is kept in the exemption of each end of each path [voxels].
    """
    exempt = np.flatnonzero(parts.exempt.any(axis=1))
    if not exempt.size:
        return np.full(len(which), -math.inf)
    # Parts by the exemptions that hold them: in that of the first end, of the last, and of both.
    held = parts.exempt[exempt] @ np.array([1, 2]) - 1
    some = Parts(*(field[exempt] for field in parts))
    least, _ = clearances(some, 3 * path_of[exempt] + held, np.repeat(which, 3), *maps)
    asked = np.concatenate([kept, kept.min(axis=1, keepdims=True)], axis=1)
    shortfall: Float64[np.ndarray, " p"] = (asked - least.min(axis=1).reshape(-1, 3)).max(axis=1)
    return shortfall


def beside_ground(
    ends: Float64[np.ndarray, "p 2 3"],
    asked: Bool[np.ndarray, "p 2"],
    tolerance: Float64[np.ndarray, " p"],
    which: Integer[np.ndarray, " p"],
    maps: tuple[Bool[np.ndarray, "m nx ny nz"], Bool[np.ndarray, "m nx ny nz"] | None],
) -> Bool[np.ndarray, "p 2"]:
    """Whether ends touch a voxel, not occupied itself, that has a face neighbour which is ground.

    Args:
        ends: first and last points of paths; what lies outside the map touches nothing.
        asked: which ends to look at; the others are taken to touch nothing.
        tolerance: by which the voxels are grown, for each path.
        which: map of each path.
        maps: occupied voxels, and those that are ground or None.
    """
    occupied, ground = maps
    found = np.zeros_like(asked)
    path, end = np.nonzero(asked & np.isfinite(ends).all(axis=2))
    if ground is None or not path.size:
        return found
    last = np.array(ground.shape[1:]) - 1
    grown = ends[path, end][:, None] + tolerance[path, None, None] * _CORNERS
    voxels = np.floor(np.clip(grown, -2.0, last + 3.0)).astype(np.int64)

    def at(volumes: Bool[np.ndarray, "m nx ny nz"], shift: Sequence[int] = (0, 0, 0)) -> Bool[np.ndarray, "n 8"]:
        seen = voxels + np.array(shift)
        x, y, z = np.clip(seen, 0, last).transpose(2, 0, 1)
        held: Bool[np.ndarray, "n 8"] = volumes[which[path][:, None], x, y, z]
        held &= ((seen >= 0) & (seen <= last)).all(axis=2)
        return held

    beside = np.logical_or.reduce([at(ground, step) for step in _FACES])
    beside &= ((voxels >= 0) & (voxels <= last)).all(axis=2) & ~at(occupied) & ~at(ground)
    found[path, end] = beside.any(axis=1)
    return found
