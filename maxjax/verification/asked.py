"""Questions to the verifier, checked: paths, their maps, the radius and the exemptions."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float, Float64

from maxjax.core.grid import Grid
from maxjax.core.voxel_map import VoxelMap
from maxjax.verification.contacts import tolerance_of
from maxjax.verification.polylines import Paths
from maxjax.verification.volumes import Volumes

# Distance from both ends [m] beyond which a path cruises.
CRUISE = 10.0
# Of the radius, and of the exemptions [voxels].
_SLACK = 1e-3


@dataclasses.dataclass(frozen=True, eq=False)
class Asked:
    """A question to the verifier.

    Attributes:
        paths: in the world frame [m], ENU.
        volumes: of the maps that they are in.
        grid: of these.
        radius: distance to keep [m].
        exemptions: radii of the exemptions around the first and the last point of each path [m]; 0: none.
        tolerance: by which voxels are larger where a path touches them [voxels].
    """

    paths: Paths
    volumes: Volumes
    grid: Grid
    radius: float
    exemptions: Float64[np.ndarray, "p 2"]
    tolerance: float

    @classmethod
    def of(
        cls,
        paths: Paths,
        where: VoxelMap,
        radius: float,
        exemptions: Float[np.ndarray, "p 2"] | None,
        blocked: Bool[np.ndarray, "m nx ny nz"] | None,
    ) -> Asked:
        """Arguments of `verifier.verify_paths`; raises its errors."""
        volumes, count, width = Volumes.of(where, blocked), len(paths), paths.points.shape[1]
        exemptions = _checked_exemptions(radius, exemptions, count)
        maps, which = len(volumes.occupied), paths.map_of
        if which.shape != (count,) or (count and not 0 <= which.min() <= which.max() < maps):
            raise ValueError(f"map_of: expected the map, 0 to {maps - 1}, of {count} paths, given {which}")
        if len(paths.points) != count or (count and not 1 <= paths.counts.min() <= paths.counts.max() <= width):
            raise ValueError(
                f"counts: expected 1 to {width} points for each of {len(paths.points)} paths, given {paths.counts}"
            )
        tolerance = tolerance_of(paths.points.dtype, where.grid)
        return cls(paths, volumes, where.grid, radius, exemptions, tolerance)

    @property
    def kept(self) -> float:
        """The radius [voxels]."""
        return self.radius / self.grid.spacing

    @property
    def allowed(self) -> float:
        """By how much a path may come nearer than that, and exemptions are larger [voxels]."""
        return _SLACK + self.tolerance

    @property
    def cruise(self) -> float:
        """`CRUISE` [voxels]."""
        return CRUISE / self.grid.spacing


def _checked_exemptions(
    radius: float, exemptions: Float[np.ndarray, "p 2"] | None, count: int
) -> Float64[np.ndarray, "p 2"]:
    """The exemptions, or none; a `ValueError` unless they and the radius are distances [m], two for each path."""
    exemptions = np.zeros((count, 2)) if exemptions is None else exemptions.astype(np.float64)
    if not 0 <= radius < math.inf:
        raise ValueError(f"radius: expected a distance [m] of at least 0, given {radius}")
    if exemptions.shape != (count, 2) or not ((exemptions >= 0) & np.isfinite(exemptions)).all():
        raise ValueError(
            f"exemptions: expected two radii [m] of at least 0 for each of {count} paths, given {exemptions}"
        )
    return exemptions
