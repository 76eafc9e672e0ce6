"""A map from above: heights of the obstacles, their outline at an altitude, level lines of the potential.

height in a column = top of its highest obstacle below its highest free voxel [m], ground left out

So where a ceiling or what is unknown above it closes a column, the floor below is shown. A column that is closed from
its ground, or from its lowest obstacle, up to the top of the map is drawn as high as that, and counts for the scale of
colours only where there is no other.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from maxjax.core.grid import Grid
from maxjax.core.voxel_map import VoxelMap
from maxjax.ui.figures.style import EARTH, FIELD, HEIGHTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Lower and upper corner (x, y) of what is shown [m].
View = tuple[np.ndarray, np.ndarray]

# How far a field is continued beyond free space [voxels]: further than the radius around walls mostly reaches.
_CONTINUED = 4.0


def view_around(grid: Grid, points: np.ndarray, around: float) -> View:
    """Corners of the part of the map around these points: at least 3 to 5 in shape, never beyond the grid."""
    lower, upper = points[:, :2].min(axis=0) - around, points[:, :2].max(axis=0) + around
    slack = np.maximum(0.6 * (upper - lower).max() - (upper - lower), 0.0)
    lower, upper = lower - 0.5 * slack, upper + 0.5 * slack
    return np.maximum(lower, grid.lower[:2]), np.minimum(upper, grid.upper[:2])


def square_around(points: np.ndarray, grid: Grid, around: float) -> View:
    """The square part of the map around these points (n, 3) and so much more [m], inside the grid."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    half = min(0.5 * float((high - low).max()) + around, 0.5 * float(np.min(np.subtract(grid.upper, grid.lower)[:2])))
    middle = np.clip(0.5 * (low + high), np.array(grid.lower[:2]) + half, np.array(grid.upper[:2]) - half)
    return middle - half, middle + half


def draw_plan(
    axes: Axes,
    bar: Axes,
    where: VoxelMap,
    view: View,
    altitude: float,
) -> None:
    """Heights of a map's obstacles from above, and their outline at an altitude [m]."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LinearSegmentedColormap

    grid, ground = where.grid, np.asarray(where.ground)
    obstacle = np.asarray(where.occupied) & ~ground
    (x0, y0, _), (x1, y1, _) = grid.lower, grid.upper
    top, full = tops(obstacle, ground, grid)
    inside = slice(*_index_range(grid, 0, view)), slice(*_index_range(grid, 1, view))
    seen, filled = top[inside], full[inside]
    shown = seen[np.isfinite(seen) & ~filled]
    shown = shown if len(shown) else seen[np.isfinite(seen)]
    limits = (shown.min(), max(shown.max(), shown.min() + grid.spacing)) if len(shown) else (0.0, 1.0)
    higher = bool(np.any(seen[filled] > limits[1]))
    image = axes.imshow(
        top.T,
        origin="lower",
        extent=(x0, x1, y0, y1),
        cmap=LinearSegmentedColormap.from_list("heights", HEIGHTS),
        vmin=limits[0],
        vmax=limits[1],
        interpolation="nearest",
    )
    axes.figure.colorbar(image, cax=bar, label="Top of obstacles, z [m]", extend="max" if higher else "neither")
    outline = LineCollection(
        list(edges(obstacle[:, :, level_of(grid, altitude)], grid)),
        colors="black",
        linewidths=0.5,
        label=f"obstacle at z = {altitude:.0f} m",
    )
    axes.add_collection(outline, autolim=False)
    axes.set(xlim=(view[0][0], view[1][0]), ylim=(view[0][1], view[1][1]), aspect="equal")
    axes.set(xlabel="East, x [m]", ylabel="North, y [m]")
    _space_ticks(axes)
    # National grids have coordinates of six digits, which are to be read as they are.
    axes.ticklabel_format(useOffset=False, style="plain")


def _space_ticks(axes: Axes) -> None:
    """As many ticks as there is room for, of a long and narrow map too, whose axes are smaller than their place."""
    from matplotlib.ticker import MaxNLocator

    axes.apply_aspect()
    place = axes.get_window_extent()
    size = place.width / axes.figure.dpi, place.height / axes.figure.dpi
    for axis, room, each in ((axes.xaxis, size[0], 0.55), (axes.yaxis, size[1], 0.3)):
        most = int(np.clip(room / each, 1, 9))
        # Axes lower than two labels have one.
        axis.set_major_locator(MaxNLocator(most, steps=[1, 2, 2.5, 5, 10], min_n_ticks=min(most, 2)))


def tops(obstacle: np.ndarray, ground: np.ndarray, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Heights (nx, ny) of obstacles seen from the highest free place of each column [m], and which columns are full.

    NaN: there is none. Full is a column that is closed up to the top of the map from its ground, or where it has none
    from its lowest obstacle; its height is the map's.
    """
    levels = np.arange(grid.shape[2])
    closed = obstacle | ground
    under = np.where(closed.all(axis=2), 0, grid.shape[2] - (~closed)[:, :, ::-1].argmax(axis=2))
    below = obstacle & (levels < under[:, :, None])
    top = grid.lower[2] + grid.spacing * (grid.shape[2] - below[:, :, ::-1].argmax(axis=2))
    full = obstacle.any(axis=2) & ~below.any(axis=2) & ((under == 0) | ~ground.any(axis=2))
    return np.where(full, grid.upper[2], np.where(below.any(axis=2), top, np.nan)), full


def draw_field(axes: Axes, log_potential: np.ndarray, occupied: np.ndarray, grid: Grid, path: np.ndarray) -> None:
    """Level lines of the log-potential at the path's median altitude, evenly spaced over what is in view.

    Around free space the field is continued as its neighbour has it, since no current flows into a wall: so each line
    runs up to the wall itself, which is drawn over it.
    """
    from matplotlib.lines import Line2D

    altitude = float(np.median(path[:, 2]))
    level = level_of(grid, altitude)
    solid = occupied[:, :, level]
    free = np.isfinite(log_potential[:, :, level]) & ~solid
    view = (
        np.array([axes.get_xlim()[0], axes.get_ylim()[0]]),
        np.array([axes.get_xlim()[1], axes.get_ylim()[1]]),
    )
    inside = (slice(*_index_range(grid, 0, view)), slice(*_index_range(grid, 1, view)))
    seen = np.asarray(log_potential[:, :, level], np.float64)[inside][free[inside]]
    if len(seen) == 0 or seen.min() == seen.max():
        return
    values = extend_values(np.asarray(log_potential[:, :, level], np.float64), free)
    x, y = (grid.origin[axis] + grid.spacing * np.arange(grid.shape[axis]) for axis in (0, 1))
    levels = np.linspace(seen.min(), seen.max(), 24)[1:-1]
    lines = axes.contour(x, y, np.ma.masked_invalid(values).T, levels=levels, colors=FIELD, linestyles="solid")
    lines.set(linewidth=0.5, zorder=1.0)
    _draw_over(axes, solid)
    label = f"log-potential at z = {altitude:.0f} m"
    axes.add_line(Line2D([], [], color=FIELD, linewidth=0.8, label=label))


def extend_values(values: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Values (nx, ny) of free places, and beside these the value of the nearest one; NaN further away."""
    from scipy.ndimage import distance_transform_edt

    distance, nearest = distance_transform_edt(~free, return_indices=True)
    return np.where(distance <= _CONTINUED, values[tuple(nearest)], np.nan)


def _draw_over(axes: Axes, solid: np.ndarray) -> None:
    """Draw what stands at the altitude of a field (nx, ny) once more, over its lines: obstacles, else ground."""
    from matplotlib.colors import ListedColormap

    heights: Any = axes.images[0]
    tops = np.ma.filled(np.ma.asarray(heights.get_array(), np.float64), np.nan)
    place: dict[str, Any] = {
        "origin": "lower",
        "extent": heights.get_extent(),
        "interpolation": "nearest",
        "zorder": 1.1,
    }
    axes.imshow(np.where(solid.T, tops, np.nan), cmap=heights.cmap, norm=heights.norm, **place)
    ground = np.ma.masked_equal(solid.T & np.isnan(tops), False)
    axes.imshow(ground, cmap=ListedColormap([EARTH]), **place)


def level_of(grid: Grid, altitude: float) -> int:
    """Index along z of the voxels at an altitude."""
    return int(np.clip(math.floor((altitude - grid.lower[2]) / grid.spacing), 0, grid.shape[2] - 1))


def _index_range(grid: Grid, axis: int, view: View) -> tuple[int, int]:
    """First index and end of the voxels of one axis that lie in view."""
    first, last = ((corner[axis] - grid.lower[axis]) / grid.spacing for corner in view)
    return max(0, math.floor(first)), min(grid.shape[axis], math.ceil(last))


def edges(mask: np.ndarray, grid: Grid) -> np.ndarray:
    """Outline of a horizontal slice: the segments (n, 2, 2) [m] between its voxels and free ones."""
    padded = np.pad(mask, 1).astype(np.int8)
    corner = np.array(grid.lower[:2])
    i, j = np.nonzero(np.diff(padded, axis=0)[:, 1:-1])
    east = np.stack([np.stack([i, j], -1), np.stack([i, j + 1], -1)], axis=1)
    i, j = np.nonzero(np.diff(padded, axis=1)[1:-1])
    north = np.stack([np.stack([i, j], -1), np.stack([i + 1, j], -1)], axis=1)
    return np.asarray(corner + grid.spacing * np.concatenate([east, north]))
