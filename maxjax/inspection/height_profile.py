"""Heights along the lines of a survey: a distance above the ground or above roofs, no steeper than a vehicle climbs.

    z(s) = max over s' of  r(s') + h − g |s − s'|          r what lies below, h the distance, g the greatest slope

z is the lowest line above r + h that climbs and sinks no more steeply than g. It is flown as few straight legs, none of
which leaves it by more than a tolerance.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Literal

import numpy as np
from jaxtyping import Float64

from maxjax.core.terrain import Terrain
from maxjax.core.voxel_map import VoxelMap
from maxjax.inspection.sweep_lines import Line
from maxjax.trajectories.envelope import least_envelope

Above = Literal["ground", "roof"]

SLOPE = 0.5
"""Greatest slope of a line: 27 degrees."""
_EVERY = 1.0  # between samples of a line [m]
_STRAIGHT = 0.05  # of the distance above ground, by which legs may leave the heights

Points = Float64[np.ndarray, "n 3"]


@dataclasses.dataclass(frozen=True, eq=False)
class Below:
    """What lies below a survey.

    Attributes:
        heights: of each column [m].
        where: the map.
    """

    heights: Float64[np.ndarray, "nx ny"]
    where: VoxelMap

    @classmethod
    def of(cls, where: VoxelMap, above: Above, radius: float = 0.0) -> Below:
        """The ground of a map, or what stands highest within a radius of each column [m].

        Raises:
            ValueError: for a map that tells no ground.
        """
        ground = np.asarray(where.terrain.everywhere, np.float64)
        if np.isnan(ground).any():
            raise ValueError("map: expected one that tells its ground; load it with ground=0.0")
        if above == "ground":
            return cls(ground, where)
        occupied, grid = np.asarray(where.occupied), where.grid
        highest = Terrain.of(occupied, grid).heights
        # What is only ground has its own height, which voxels overstate.
        stands = (occupied & ~np.asarray(where.ground)).any(axis=2)
        roofs = np.where(stands, np.maximum(highest, ground), ground)
        from scipy import ndimage  # a quarter of a second that most commands can do without

        return cls(ndimage.maximum_filter(roofs, 2 * math.ceil(radius / grid.spacing + 0.5) + 1), where)

    def at(self, places: Float64[np.ndarray, "n 2"]) -> Float64[np.ndarray, " n"]:
        """Heights at places [m]; beside the map those of its border."""
        grid = self.where.grid
        index = np.floor((places - np.array(grid.lower[:2])) / grid.spacing).astype(np.int64)
        i, j = np.clip(index, 0, np.array(grid.shape[:2]) - 1).T
        return np.asarray(self.heights[i, j])


def samples(line: Line) -> Line:
    """Places along a line, at most a metre apart, its corners among them."""
    found = [line[:1]]
    for a, b in itertools.pairwise(line):
        count = max(1, math.ceil(float(np.linalg.norm(b - a)) / _EVERY))
        found.append(a + np.arange(1, count + 1)[:, None] / count * (b - a))
    return np.concatenate(found)


def lift(line: Line, below: Below, distance: float) -> Points:
    """Samples of a line at heights above what lies below, no steeper than `SLOPE` [m]."""
    places = samples(line)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    return np.column_stack([places, least_envelope(below.at(places) + distance, along, SLOPE)])


def legs_along(points: Points, distance: float) -> list[int]:
    """Numbers of some points between which straight legs stay near all: the first and the last among them."""
    if len(points) < 3:
        return list(range(len(points)))
    tolerance, kept = _STRAIGHT * distance, [0, len(points) - 1]
    parts = [(0, len(points) - 1)]
    while parts:
        first, last = parts.pop()
        if last <= first + 1:
            continue
        way = points[last] - points[first]
        share = np.clip((points[first : last + 1] - points[first]) @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
        off = np.linalg.norm(points[first : last + 1] - points[first] - share[:, None] * way, axis=1)
        worst = first + int(off.argmax())
        if off.max() > tolerance:
            kept.append(worst)
            parts += [(first, worst), (worst, last)]
    return sorted(kept)
