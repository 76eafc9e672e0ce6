"""Paths as the verifier takes them: arrays over a batch, and their points in one row in index coordinates.

u = (x − origin) / spacing + 1/2        world frame [m] ↦ index coordinates, in which voxel i is the cube [i, i + 1]
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64, Integer

from maxjax.core.grid import Grid
from maxjax.verification.exempt_parts import Parts, cut, dot


@dataclasses.dataclass(frozen=True, eq=False)
class Paths:
    """Paths of a batch.

    Attributes:
        points: in the world frame [m], ENU, each path filled up to one length.
        counts: how many points each has.
        map_of: which of several maps each is in.
    """

    points: Float[np.ndarray, "p t 3"]
    counts: Int64[np.ndarray, " p"]
    map_of: Integer[np.ndarray, " p"]

    @classmethod
    def of(cls, paths: Sequence[Float[np.ndarray, "_ 3"]], map_of: Integer[np.ndarray, " p"] | None = None) -> Paths:
        """Those of single paths (t, 3) [m]; of one map unless `map_of` tells others.

        Raises:
            ValueError: if one is not (t, 3) with t of at least 1.
        """
        for path in paths:
            if path.ndim != 2 or path.shape[1] != 3 or len(path) == 0:
                raise ValueError(f"path: expected shape (t, 3) with t of at least 1, given {path.shape}")
        counts = np.array([len(path) for path in paths], np.int64)
        dtype = np.result_type(*paths) if len(paths) else np.float64
        points = np.zeros((len(paths), max(counts, default=1), 3), dtype)
        for row, path in zip(points, paths, strict=True):
            row[: len(path)] = path
        return cls(points, counts, np.zeros(len(paths), np.int64) if map_of is None else map_of)

    def __len__(self) -> int:
        return len(self.counts)

    def some(self, rows: slice) -> Paths:
        """Some of them."""
        return Paths(self.points[rows], self.counts[rows], self.map_of[rows])


@dataclasses.dataclass(frozen=True)
class Polylines:
    """Paths in index coordinates, their points in one row.

    Attributes:
        points: of all paths, one path after the other.
        path_of: path of each point.
        first, last: as `ends`.
        steps: from each point to the next of its path; nothing from the last.
        finite, inside: as in `Verification`.
        lengths: [m], NaN unless finite.
        tolerance: of all paths [voxels].
        width: to which paths are filled up.
    """

    points: Float64[np.ndarray, "n 3"]
    path_of: Int64[np.ndarray, " n"]
    first: Int64[np.ndarray, " p"]
    last: Int64[np.ndarray, " p"]
    steps: Float64[np.ndarray, "n 3"]
    finite: Bool[np.ndarray, " p"]
    inside: Bool[np.ndarray, " p"]
    lengths: Float64[np.ndarray, " p"]
    tolerance: float
    width: int

    @property
    def ends(self) -> Int64[np.ndarray, "p 2"]:
        """Which points each path begins and ends with."""
        return np.stack([self.first, self.last], axis=1)

    @classmethod
    def of(cls, paths: Paths, grid: Grid, tolerance: float) -> Polylines:
        """Paths given in the world [m]; inside the map with that tolerance [voxels]."""
        points, counts = paths.points, paths.counts
        used = np.arange(points.shape[1]) < counts[:, None]
        local = points[used].astype(np.float64) - np.array(grid.origin)
        last, path_of = np.cumsum(counts) - 1, np.repeat(np.arange(len(counts)), counts)
        first = last - counts + 1
        with np.errstate(over="ignore", invalid="ignore"):  # infinite coordinates and lengths are verdicts, not errors
            index = local / grid.spacing + 0.5
            steps = np.zeros_like(index)
            np.subtract(index[1:], index[:-1], out=steps[:-1], where=(path_of[1:] == path_of[:-1])[:, None])
            lengths = np.bincount(path_of, grid.spacing * np.sqrt(dot(steps, steps)), len(counts))
        finite = np.logical_and.reduceat(np.isfinite(local).all(axis=1), first)
        within = ((index >= -tolerance) & (index <= np.array(grid.shape) + tolerance)).all(axis=1)
        inside = np.logical_and.reduceat(within, first)
        lengths = np.where(finite, lengths, math.nan)
        return cls(index, path_of, first, last, steps, finite, inside, lengths, tolerance, points.shape[1])

    def spread(self, values: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, "p t"]:
        """A value of each point, in rows by path, NaN beyond."""
        rows = np.full((len(self.first), self.width), math.nan)
        rows[np.arange(self.width) < (self.last - self.first + 1)[:, None]] = values
        return rows

    def cut(self, radii: Float64[np.ndarray, "p 2 2"]) -> tuple[Parts, Int64[np.ndarray, " k"]]:
        """The paths that are inside, cut by the radii of exemptions [voxels] around their first and last points.

        Returns:
            Their parts, and the path of each.
        """
        moves = (self.steps != 0).any(axis=1)
        moves[self.first] |= ~np.logical_or.reduceat(moves, self.first)  # a path that stays where it is: one segment
        moves &= self.inside[self.path_of]
        path_of = self.path_of[moves]
        centres = self.points[self.ends][path_of]
        parts = cut(self.points[moves], self.steps[moves], centres, radii[path_of])
        return parts, path_of[parts.segment]
