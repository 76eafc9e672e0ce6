"""Surface models: one height a cell, seen from above.

    occupied = { voxels of a column up to the highest cell that its square shares an area with }

Columns without a height are unknown. The model does not tell buildings from the ground. Files of them are read in
`io.readers.raster`.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid
from maxjax.io.geo.units_and_axes import UNREFERENCED, Reference

_TOUCH = 1e-6  # [voxels]


@dataclasses.dataclass(frozen=True)
class Heights:
    """A surface model, on the host.

    Attributes:
        height: of each cell, from west to east and from south to north [m]; NaN where there is none.
        west, south: corner of the first cell [m].
        cell: edges of a cell along x and y [m].
        source: the file's name.
        reference: of the file's coordinates.
        remarks: sentences on what a user should know.
    """

    height: Float[np.ndarray, "nx ny"]
    west: float
    south: float
    cell: tuple[float, float]
    source: str
    reference: Reference = UNREFERENCED
    remarks: tuple[str, ...] = ()

    @property
    def extent(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of what has a height [m]."""
        known = np.isfinite(self.height)
        x, y = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        low, high = np.array([x[0], y[0]]), np.array([x[-1] + 1, y[-1] + 1])
        corner = np.array([self.west, self.south])
        levels = np.nanmin(self.height), np.nanmax(self.height)
        return np.array([[*(corner + low * self.cell), levels[0]], [*(corner + high * self.cell), levels[1]]])

    def voxels(self, grid: Grid) -> tuple[Bool[np.ndarray, "nx ny nz"], Bool[np.ndarray, "nx ny"]]:
        """Occupied voxels, and the columns of which nothing is known."""
        nx, ny, nz = grid.shape
        ranges = []
        for axis, (corner, count) in enumerate(((self.west, nx), (self.south, ny))):
            edge = (corner + self.cell[axis] * np.arange(self.height.shape[axis] + 1) - grid.lower[axis]) / grid.spacing
            first = np.clip(np.floor(edge[:-1] + _TOUCH), 0, count).astype(int)
            last = np.clip(np.ceil(edge[1:] - _TOUCH) - 1, -1, count - 1).astype(int)
            ranges.append((first, last, np.flatnonzero(first <= last)))
        (x0, x1, rows), (y0, y1, columns) = ranges
        # Along one axis, then along the other: the highest cell of each column.
        strips = np.full((nx, len(columns)), np.nan)
        for step in range(int((x1 - x0)[rows].max(initial=-1)) + 1):
            some = rows[x0[rows] + step <= x1[rows]]
            np.fmax.at(strips, x0[some] + step, self.height[np.ix_(some, columns)])
        highest = np.full((ny, nx), np.nan)
        for step in range(int((y1 - y0)[columns].max(initial=-1)) + 1):
            kept = y0[columns] + step <= y1[columns]
            np.fmax.at(highest, y0[columns[kept]] + step, strips.T[kept])
        unknown = np.isnan(highest.T)
        top = np.ceil(
            (np.where(unknown, grid.lower[2] - grid.spacing, highest.T) - grid.lower[2]) / grid.spacing - _TOUCH
        )
        return np.arange(nz) < top[:, :, None], unknown
