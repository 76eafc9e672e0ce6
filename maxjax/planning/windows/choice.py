"""Which window of a map holds every way of a cost; the same arithmetic in NumPy and JAX.

    ellipsoid of the cost → box, raised to where the map is open → smallest shape that holds it → corner, and bound

The bound is the least cost of a way that leaves the window (`windows.geometry`): a face beyond which the map ends, or
holds nothing but occupied voxels, is crossed by no way.

Positions are index coordinates of the map, costs and bounds [voxels]; b problems lead. What differs between a host and
a device is how the lowest open layers of boxes are found; the argument before the last one finds them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from maxjax.core.grid import Index3
from maxjax.planning.windows.geometry import centre, costs_over_faces, ellipsoid_box, ends_inside, worthwhile

# (lowest, highest voxels of k boxes a problem (b, k, 3)) ↦ the lowest layer of each that is not all occupied, one above
# the highest where all are (b, k). What lies beyond the map is left out.
LowestOpen = Callable[[Any, Any], Int[Any, "b k"]]


class Choice(NamedTuple):
    """Windows of maps, one for each of several problems.

    Attributes:
        corners: the lowest voxel of each.
        sizes: voxels along the axes of the map; those beyond it hold nothing.
        bounds: least cost of a way between the ends that leaves it; NaN: there is none.
    """

    corners: Int[Any, "b 3"]
    sizes: Int[Any, "b 3"]
    bounds: Float[Any, " b"]


def choose(
    ends: Float[Any, "b 2 3"],
    costs: Float[Any, " b"],
    whole: Index3,
    shapes: Sequence[Index3],
    lowest_open: LowestOpen,
    xp: Any,
) -> Choice:
    """The smallest window of each problem that no way of its cost leaves.

    Args:
        ends: starts and goals.
        costs: of the ways, at least the straight lines.
        whole: shape of the maps.
        shapes: of windows, the smallest first, each also with x and y exchanged.
        lowest_open: of boxes of the maps.
        xp: `numpy` or `jax.numpy`.

    Returns:
        The windows; none where there is no smaller one than the whole map, or an end is not inside it.
    """
    either = np.array([turn for x, y, z in shapes for turn in ((x, y, z), (y, x, z))])
    limits = np.array(whole)
    inside = ends_inside(ends, limits, xp)
    ends = xp.where(inside[:, None, None], ends, 0.0)
    low, high = ellipsoid_box(ends, xp.where(inside, costs, 0.0), limits, xp)
    floor = lowest_open(low[:, None], high[:, None])[:, 0]
    low = _with_height(low, xp.minimum(floor, high[:, 2]), xp)
    fits = (high - low < either[:, None]).all(axis=2) & worthwhile(either, whole)[:, None]
    sizes, found = xp.asarray(either)[xp.argmax(fits, axis=0)], inside & fits.any(axis=0)
    # In the middle of a window lies the box, and below it are only layers that are all occupied.
    corners = centre(low, high, sizes, limits, xp)
    floor = lowest_open(corners[:, None], _with_height(corners + sizes - 1, low[:, 2], xp)[:, None])[:, 0]
    bottom = xp.minimum(xp.minimum(floor, low[:, 2]), xp.maximum(limits - sizes, 0)[:, 2])
    corners = _with_height(corners, bottom, xp)
    bounds = ways_out(ends, corners, sizes, limits, lowest_open, xp)
    return Choice(
        xp.where(found[:, None], corners, 0), xp.where(found[:, None], sizes, 0), xp.where(found, bounds, math.nan)
    )


def ways_out(
    ends: Float[Any, "b 2 3"],
    corners: Int[Any, "b 3"],
    sizes: Int[Any, "b 3"],
    limits: Int[np.ndarray, " 3"],
    lowest_open: LowestOpen,
    xp: Any,
) -> Float[Any, " b"]:
    """The least cost of a way that leaves each window; infinite if none can."""
    own: Bool[np.ndarray, "3 3"] = np.eye(3, dtype=bool)
    beyond = xp.stack([corners - 1, corners + sizes], axis=1)[:, :, None]
    lowest = xp.where(own, beyond, corners[:, None, None])
    highest = xp.where(own, beyond, xp.minimum(corners + sizes, limits)[:, None, None] - 1)
    # The layers beyond the faces: those within the map that are not all occupied are crossed.
    within = ((lowest >= 0) & (highest < limits)).all(axis=3)
    open_at = lowest_open(lowest.reshape(-1, 6, 3), highest.reshape(-1, 6, 3)).reshape(within.shape)
    crossed = within & (open_at <= highest[..., 2])
    return xp.where(crossed, costs_over_faces(ends, corners, sizes, xp), math.inf).min(axis=(1, 2))


def _with_height(voxels: Int[Any, "b 3"], height: Int[Any, " b"], xp: Any) -> Int[Any, "b 3"]:
    """Voxels at other heights."""
    return xp.stack([voxels[:, 0], voxels[:, 1], height], axis=1)
