"""The clearance that was judged, kept in flight: where the vehicle is, not where it should be.

    least = radius              where the plan keeps it
    least = planned − tolerance at least 0, where an end stands nearer to something

Ground is left out, as in the judgement.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.core.voxel_map import VoxelMap
from maxjax.verification.clearance import distances_at

Point = Float64[np.ndarray, "3"]


@dataclasses.dataclass(frozen=True, eq=False)
class ClearanceWatch:
    """What a flight has to keep.

    Attributes:
        where: the map.
        radius: distance to occupied voxels that the plan keeps [m].
        tolerance: how far the vehicle may be from its way [m].
    """

    where: VoxelMap
    radius: float
    tolerance: float

    def distance(self, point: Point) -> float:
        """Distance to the cube of an occupied voxel, ground left out [m]; infinite where there is none."""
        grid, (occupied, ground) = self.where.grid, self._solid
        index = (point - np.array(grid.origin)) / grid.spacing + 0.5
        found = distances_at(index[None], np.zeros(1, np.int64), occupied, ground)
        return float(grid.spacing * found[0])

    def least(self, planned: Point) -> float:
        """Distance to keep [m] on the way at a planned place."""
        own = self.distance(planned)
        return self.radius if own >= self.radius else max(own - self.tolerance, 0.0)

    @functools.cached_property
    def _solid(self) -> tuple[Bool[np.ndarray, "1 nx ny nz"], Bool[np.ndarray, "1 nx ny nz"]]:
        return np.asarray(self.where.occupied)[None], np.asarray(self.where.ground)[None]
