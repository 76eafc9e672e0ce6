"""Few photos that show each point often enough: set multi-cover, by linear and integer programs.

    minimise |C|   such that   Σ_{c ∈ C} V_cp ≥ r_p   for every point p            c at most once

Points are taken in blocks that lie side by side. For a block the linear relaxation is solved, then the integer program
among the photos that the relaxation uses; what is taken counts for the blocks that follow. With one block the
relaxation bounds how few can do. Where time runs out the choice is greedy: the photo that shows the most area that
still lacks a view is next, until nothing lacks one, which takes H(n) times as many as needed at most, with the
harmonic number H of the points of a photo (Dobson 1982). Last, photos without which nothing lacks a view are left out,
those that show least first.
"""

from __future__ import annotations

import dataclasses
import heapq
import math
import time

import numpy as np
from jaxtyping import Float64, Int64
from scipy import sparse

_BLOCK = 8_000  # points of a block, at most
_GAP = 0.02  # between a choice and its bound, at which it is good enough
_USED = 1e-6  # of a photo in the relaxation, from which on it may be chosen


@dataclasses.dataclass(frozen=True)
class PhotoChoice:
    """Photos that show each point as often as wanted.

    Attributes:
        photos: their numbers.
        least: no fewer of the given ones do.
    """

    photos: Int64[np.ndarray, " k"]
    least: int


def choose_photos(
    shows: sparse.csr_array,
    points: Float64[np.ndarray, "n 3"],
    areas: Float64[np.ndarray, " n"],
    wanted: int,
    seconds: float = 30.0,
) -> PhotoChoice:
    """Few photos that show each point as often as wanted, or as often as all together do.

    Args:
        shows: (m, n), 1 where a photo shows a point.
        points: [m].
        areas: of the points [m²].
        wanted: views of each point.
        seconds: for linear and integer programs, at most; 0: the greedy choice alone.
    """
    cover = _Cover.of(shows, areas, wanted)
    least, until = cover.least, time.monotonic() + seconds
    parts, chosen = blocks(points, np.flatnonzero(cover.need > 0)), list[int]()
    for rows in parts if seconds > 0.0 else []:
        some, bound = cover.by_program(rows, chosen, until)
        least = max(least, bound) if len(parts) == 1 else least
        chosen += some
    chosen = cover.needed([*chosen, *cover.greedy(np.maximum(cover.need - cover.counts(chosen), 0), chosen)])
    return PhotoChoice(np.array(sorted(chosen), np.int64), least)


def blocks(points: Float64[np.ndarray, "n 3"], rows: Int64[np.ndarray, " k"]) -> list[Int64[np.ndarray, " b"]]:
    """Numbers of points in parts that lie side by side: halved across their longest extent."""
    if len(rows) <= _BLOCK:
        return [rows] if len(rows) else []
    axis = int(np.ptp(points[rows], axis=0).argmax())
    ordered = rows[np.argsort(points[rows, axis], kind="stable")]
    half = len(rows) // 2
    return [*blocks(points, ordered[:half]), *blocks(points, ordered[half:])]


@dataclasses.dataclass(frozen=True, eq=False)
class _Cover:
    """A problem of set multi-cover.

    Attributes:
        shows: as above.
        rows: the points that each photo shows.
        areas: of the points [m²].
        need: views that each point is to have.
    """

    shows: sparse.csr_array
    rows: list[np.ndarray]
    areas: Float64[np.ndarray, " n"]
    need: Int64[np.ndarray, " n"]

    @classmethod
    def of(cls, shows: sparse.csr_array, areas: Float64[np.ndarray, " n"], wanted: int) -> _Cover:
        rows = [shows.indices[a:b] for a, b in zip(shows.indptr[:-1], shows.indptr[1:], strict=True)]
        return cls(shows, rows, areas, np.minimum(wanted, np.asarray(shows.sum(axis=0), np.int64).ravel()))

    @property
    def least(self) -> int:
        """So many are needed by counting alone: for the point that needs most, and for all areas together."""
        largest = max((float(self.areas[row].sum()) for row in self.rows), default=0.0)
        total = float(self.need @ self.areas)
        return max(int(self.need.max(initial=0)), math.ceil(total / largest - 1e-9) if largest > 0.0 else 0)

    def counts(self, chosen: list[int]) -> Int64[np.ndarray, " n"]:
        """How many of some photos show each point."""
        found = np.zeros(len(self.need), np.int64)
        for k in chosen:
            found[self.rows[k]] += 1
        return found

    def greedy(self, lacking: Int64[np.ndarray, " n"], taken: list[int] | None = None) -> list[int]:
        """Photos, not among those taken, that give each point the views that it lacks."""
        left, chosen = lacking.copy(), list[int]()
        gains = self.shows @ (self.areas * (left > 0))
        heap = [(-float(gains[k]), k) for k in np.flatnonzero(gains > 0.0).tolist() if k not in set(taken or ())]
        heapq.heapify(heap)
        while heap and left.any():
            _, k = heapq.heappop(heap)
            row = self.rows[k]
            gain = float(self.areas[row][left[row] > 0].sum())
            if gain <= 0.0:
                continue
            if heap and gain < -heap[0][0]:
                heapq.heappush(heap, (-gain, k))
                continue
            chosen.append(k)
            left[row] = np.maximum(left[row] - 1, 0)
        return chosen

    def needed(self, chosen: list[int]) -> list[int]:
        """Photos without those that can be left out."""
        counts, kept = self.counts(chosen), set(chosen)
        for k in sorted(chosen, key=lambda k: (float(self.areas[self.rows[k]].sum()), k)):
            if (counts[self.rows[k]] > self.need[self.rows[k]]).all():
                counts[self.rows[k]] -= 1
                kept.discard(k)
        return [k for k in chosen if k in kept]

    def by_program(self, rows: Int64[np.ndarray, " b"], taken: list[int], until: float) -> tuple[list[int], int]:
        """Photos that give the points of a block what they lack, and how many that takes at least; none out of time.

        Args:
            rows: numbers of the points.
            taken: photos that are taken already.
            until: when time runs out (`time.monotonic`) [s].
        """
        lacking = self.need[rows] - self.counts(taken)[rows]
        rows, lacking = rows[lacking > 0], lacking[lacking > 0]
        usable = np.ones(self.shows.shape[0], bool)
        usable[taken] = False
        matrix = self.shows[:, rows].T.tocsr().astype(np.float64)
        columns = np.flatnonzero(usable & (np.bincount(matrix.indices, minlength=len(usable)) > 0))
        if not len(rows) or time.monotonic() >= until:
            return [], 0
        shares = _solve(matrix[:, columns], lacking, until, whole=False)
        if shares is None:
            return [], 0
        columns = columns[shares > _USED]
        found = _solve(matrix[:, columns], lacking, max(until, time.monotonic() + 1.0), whole=True)
        bound = math.ceil(float(shares.sum()) - 1e-6)
        return ([] if found is None else columns[found > 0.5].tolist()), bound


def _solve(
    matrix: sparse.csr_array, lacking: Int64[np.ndarray, " b"], until: float, *, whole: bool
) -> Float64[np.ndarray, " k"] | None:
    """The least sum of numbers from 0 to 1 that give all points what they lack; None where time runs out."""
    from scipy.optimize import Bounds, LinearConstraint, milp  # half a second that most commands can do without

    count = matrix.shape[1]
    found = milp(
        np.ones(count),
        integrality=np.full(count, int(whole)),
        bounds=Bounds(0, 1),
        constraints=LinearConstraint(matrix, lb=lacking),
        options={"mip_rel_gap": _GAP, "time_limit": max(until - time.monotonic(), 0.0)},
    )
    # A relaxation that is not solved bounds nothing.
    usable = whole or found.success
    return np.asarray(found.x, np.float64) if usable and found.x is not None else None
