"""Where a vehicle touches down upright below the end of a mission, where that is not the ground of the map: a roof."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Bool

from maxjax.core.grid import Point3
from maxjax.core.voxel_map import VoxelMap

_SAME = 1e-6  # [m]


@dataclasses.dataclass(frozen=True)
class Touchdown:
    """A surface below the end of a mission.

    Attributes:
        height: of the surface there [m], ENU.
        clear: radius around it in plan in which nothing else stands [m].
        rise: by which the surface is higher within that radius, at most [m].

    Raises:
        ValueError: if the height is not finite, the radius not positive, or the rise negative.
    """

    height: float
    clear: float
    rise: float = 0.0

    def __post_init__(self) -> None:
        if not math.isfinite(self.height):
            raise ValueError(f"Touchdown.height: expected a height [m], given {self.height}")
        if not 0.0 < self.clear < math.inf or not 0.0 <= self.rise < math.inf:
            raise ValueError(
                "Touchdown: expected a positive clear radius and a rise of at least 0 [m], "
                f"given {self.clear} and {self.rise}"
            )

    def surface(self, where: VoxelMap, place: Point3) -> Bool[np.ndarray, "nx ny nz"]:
        """The voxels that hold the surface, or what is below it, around a place in plan [m].

        They are to the landing what the ground is elsewhere: what the vehicle touches in the end.
        """
        grid = where.grid
        beside = [
            np.maximum(np.abs(grid.origin[axis] + grid.spacing * np.arange(n) - place[axis]) - 0.5 * grid.spacing, 0.0)
            for axis, n in enumerate(grid.shape[:2])
        ]
        column = np.hypot(beside[0][:, None], beside[1][None, :]) <= self.clear
        lower = grid.lower[2] + grid.spacing * np.arange(grid.shape[2])
        below = lower <= self.height + self.rise + _SAME
        return np.asarray(column[:, :, None] & below & np.asarray(where.occupied))
