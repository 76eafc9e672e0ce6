"""Which part of a map becomes voxels, and how fine.

Voxel centres lie at whole multiples of the spacing, from the height of flat ground on, so that a map gives the same
voxels in every window. By default a window holds the map and both ends, with room to fly around and above; where that
would take too many voxels, it holds the ends with room.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int64

from maxjax.core.grid import Grid, Point3
from maxjax.io.kinds.point_cloud import FARTHEST

MOST_VOXELS = 2**27
SPACING = 2.0  # [m]
_ROOM = 10  # voxels around a map and above it
_AROUND = 100.0  # [m] around the ends, where a map is too large
_HIGH = 300.0  # [m] above a map; an end beyond is asked about
_MULTIPLE = 8  # of voxels along each edge: maps of about one size share their programs
_CENTERED = 101  # voxels along each edge of a window about a centre
_TOUCH = 1e-6  # [voxels]


@dataclasses.dataclass(frozen=True)
class Window:
    """Settings of a user about the window.

    Attributes:
        spacing: edge of a voxel [m]; None: the file's own, else 2 m.
        bounds: lowest and highest corner [m]; None: by default, as the module says.
        center: middle of 101 x 101 x 101 voxels [m], in place of bounds.
        ends: points that the window has to hold [m]; those that are not finite are ignored.
        ground: height of flat ground [m]; None: the map's own.
        most: voxels at most.

    Raises:
        ValueError: if a number is not finite, bounds are empty, the spacing is not positive, or both bounds and a
            centre are given.
    """

    spacing: float | None = None
    bounds: tuple[float, float, float, float, float, float] | None = None
    center: Point3 | None = None
    ends: Sequence[Point3] = ()
    ground: float | None = None
    most: int = MOST_VOXELS

    def __post_init__(self) -> None:
        if self.spacing is not None and not 1e-3 <= self.spacing <= 1e4:
            raise ValueError(f"spacing: expected metres from 0.001 to 10,000, given {self.spacing}")
        if self.ground is not None and not np.isfinite(self.ground):
            raise ValueError(f"ground: expected a height in metres, given {self.ground}")
        if self.center is not None and not np.isfinite(self.center).all():
            raise ValueError(f"center: expected three finite coordinates [m], given {self.center}")
        if self.bounds is not None:
            low, high = np.reshape(np.asarray(self.bounds, np.float64), (2, 3))
            if not (np.isfinite(low) & np.isfinite(high) & (low < high)).all():
                raise ValueError(f"bounds: expected finite minima below the maxima [m], given {self.bounds}")
            if self.center is not None:
                raise ValueError("bounds and center: expected one of them, given both")

    def grid(
        self, extent: Float[np.ndarray, "2 3"], spacing: float | None = None, lattice: Point3 = (0.0, 0.0, 0.0)
    ) -> tuple[Grid, str]:
        """The grid over a map, and a sentence where it leaves a part of the map out.

        Args:
            extent: lowest and highest corner of the map [m].
            spacing: the file's own [m].
            lattice: centre of any voxel [m].

        Raises:
            ValueError: if it would take too many voxels, lies too far out, or an end is 300 m above the map.
        """
        edge = self.spacing or spacing or SPACING
        base = np.array(lattice) if self.ground is None else np.array([*lattice[:2], self.ground])
        if self.center is not None:
            return _checked(_about(np.asarray(self.center, np.float64), base, edge), self.most), ""
        if self.bounds is not None:
            corners = np.reshape(np.asarray(self.bounds, np.float64), (2, 3))
            return _checked(_fitting(corners, base, edge), self.most), ""
        room = np.array([[-_ROOM, -_ROOM, -1], [_ROOM, _ROOM, _ROOM]]) * edge
        ends = np.array([end for end in self.ends if np.isfinite(end).all()]).reshape(-1, 3)
        _check_height(ends, extent)
        flat = [] if self.ground is None else [*extent[0, :2], self.ground]
        held = np.concatenate([extent, ends, np.reshape(flat, (-1, 3))])
        whole = _fitting(np.stack([held.min(0), held.max(0)]) + room, base, edge, _MULTIPLE)
        if np.prod(whole.shape, dtype=float) <= self.most or not len(ends):
            return _checked(whole, self.most), ""
        around = np.array([[-_AROUND, -_AROUND, 0.0], [_AROUND, _AROUND, 0.0]])
        some = np.stack([ends.min(0), ends.max(0)]) + around
        some[:, 2] = held[:, 2].min(), held[:, 2].max()
        part = _fitting(some + room, base, edge, _MULTIPLE)
        sentence = (
            f"the window leaves a part of the map out: {_size(part)} of {_size(whole)} m; "
            "--bounds and --spacing choose another"
        )
        return _checked(part, self.most), sentence


def _fitting(corners: Float[np.ndarray, "2 3"], base: Float[np.ndarray, "3"], edge: float, multiple: int = 1) -> Grid:
    """The grid whose voxels cover a box, widened to a multiple of voxels: sideways to both sides, and upwards."""
    _check_place(corners)
    first = np.floor((corners[0] - base) / edge + 0.5 + _TOUCH).astype(np.int64)
    last = np.ceil((corners[1] - base) / edge - 0.5 - _TOUCH).astype(np.int64)
    count = np.maximum(last - first + 1, 1)
    widened = -count % multiple
    first -= widened // 2 * np.array([1, 1, 0])
    return _from(first, count + widened, base, edge)


def _about(center: Float[np.ndarray, "3"], base: Float[np.ndarray, "3"], edge: float) -> Grid:
    _check_place(center)
    middle = np.round((center - base) / edge).astype(np.int64)
    return _from(middle - _CENTERED // 2, np.full(3, _CENTERED), base, edge)


def _from(
    first: Int64[np.ndarray, "3"], count: Int64[np.ndarray, "3"], base: Float[np.ndarray, "3"], edge: float
) -> Grid:
    x, y, z = (base + edge * first).tolist()
    nx, ny, nz = count.tolist()
    return Grid((nx, ny, nz), edge, (x, y, z))


def _check_place(points: Float[np.ndarray, "..."]) -> None:
    if not np.abs(points).max() <= FARTHEST:
        raise ValueError(f"window: expected coordinates within {FARTHEST:.0e} m of 0, given {points.tolist()}")


def _check_height(ends: Float[np.ndarray, "n 3"], extent: Float[np.ndarray, "2 3"]) -> None:
    """Raise a `ValueError` where an end is so high above a map that a window up to it is hardly meant."""
    above = ends[:, 2].max(initial=-np.inf) - extent[1, 2]
    if above > _HIGH:
        raise ValueError(
            f"window: an end at z = {ends[:, 2].max():g} lies {above:.0f} m above all that the map holds, whose "
            f"heights are {extent[0, 2]:g} to {extent[1, 2]:g} m: in feet, or in another datum? "
            "Give --bounds to fly there"
        )


def _size(grid: Grid) -> str:
    return " x ".join(f"{count * grid.spacing:g}" for count in grid.shape)


def _checked(grid: Grid, most: int) -> Grid:
    voxels = float(np.prod(grid.shape, dtype=float))
    if voxels > most:
        coarser = grid.spacing * (voxels / most) ** (1 / 3) * 1.05
        raise ValueError(
            f"window: {_size(grid)} m in voxels of {grid.spacing:g} m are {voxels:.3g}, expected at most {most}; "
            f"give --bounds, or a --spacing of {coarser:.2g} m"
        )
    return grid
