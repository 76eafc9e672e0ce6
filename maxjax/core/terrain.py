"""How high the ground of a map is: one height a column, as numbers, under everything that counts from the ground.

Heights above ground, floors and ceilings, home and take-off all count from it. A map's file says it
(`io.kinds.bare_ground`). Where only voxels do, it is the upper face of a column's highest one, and the ground itself
lies up to a voxel below.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid


@dataclasses.dataclass(frozen=True)
class Terrain:
    """Heights of the ground.

    Attributes:
        heights: of each column [m]; NaN where it has no ground.
        grid: that the columns are of.
        doubt: how far below these heights the ground may be [m].
    """

    heights: Float[np.ndarray, "nx ny"]
    grid: Grid
    doubt: float = 0.0

    @classmethod
    def of(cls, ground: Bool[np.ndarray, "nx ny nz"], grid: Grid) -> Terrain:
        """That of ground voxels."""
        below = grid.shape[2] - ground[:, :, ::-1].argmax(axis=2)
        heights = np.where(ground.any(axis=2), grid.lower[2] + grid.spacing * below, np.nan)
        return cls(heights, grid, doubt=grid.spacing)

    @classmethod
    def flat(cls, height: float, grid: Grid) -> Terrain:
        """That of flat ground [m]."""
        return cls(np.full(grid.shape[:2], height), grid)

    def at(self, x: float, y: float) -> float:
        """Height of the ground at a place [m]; NaN where there is none, or outside the grid."""
        index = [math.floor(v) for v in (np.array([x, y]) - self.grid.lower[:2]) / self.grid.spacing]
        if not all(0 <= i < n for i, n in zip(index, self.heights.shape, strict=True)):
            return math.nan
        return float(self.heights[index[0], index[1]])

    def on(self, grid: Grid) -> Terrain:
        """The same heights in other columns: at their centres; NaN outside of these."""
        x, y = (
            low + grid.spacing * (0.5 + np.arange(n)) for low, n in zip(grid.lower[:2], grid.shape[:2], strict=True)
        )
        corner = self.grid.lower[:2]
        columns = [np.floor((v - low) / self.grid.spacing).astype(int) for v, low in zip((x, y), corner, strict=True)]
        inside = [(v >= 0) & (v < n) for v, n in zip(columns, self.heights.shape, strict=True)]
        within = np.ix_(*(np.clip(v, 0, n - 1) for v, n in zip(columns, self.heights.shape, strict=True)))
        heights = np.where(inside[0][:, None] & inside[1][None, :], self.heights[within], np.nan)
        return Terrain(heights, grid, self.doubt)

    @property
    def everywhere(self) -> Float[np.ndarray, "nx ny"]:
        """The heights; where a column has no ground, that of the nearest one that has [m]. NaN if none has."""
        missing = np.isnan(self.heights)
        if not missing.any() or missing.all():
            return self.heights
        from scipy import ndimage  # a quarter of a second that most commands can do without

        nearest = ndimage.distance_transform_edt(missing, return_distances=False, return_indices=True)
        return np.asarray(self.heights[tuple(nearest)])
