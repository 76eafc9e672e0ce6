"""Print-quality figures of paths in a map: a plan view and a section along the path (extra `viz`).

    plan view: top of the highest obstacle in each column [m], seen from above, ground left out
    section:   the voxels over and under the main path, unrolled over its horizontal distance s,
               s(t) = ∫ ‖(dx, dy)‖

Paths have the Okabe-Ito colours, which the colour-blind tell apart, and line styles that remain in black and
white. Figures are plain objects: nothing here touches pyplot's global state.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid
from maxjax.core.serialize import atomic_write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

PATHS: tuple[tuple[str, Any], ...] = (
    ("#D55E00", "-"),
    ("#0072B2", (0, (4, 1.5))),
    ("#009E73", (0, (1.2, 1.0))),
    ("#CC79A7", (0, (5, 1.4, 1.2, 1.4))),
    ("#E69F00", (0, (8, 2))),
    ("#56B4E9", (0, (3, 1, 1.2, 1, 1.2, 1))),
)
HEIGHTS = ("#E4E4E4", "#484848")
_FIELD = "#6FA3CC"
RETURN = "#222222"
_EARTH, _BESIDE, _OBSTACLE = "#D3BE94", "#E4E4E4", "#8A8A8A"
STYLE: dict[Any, Any] = {
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "pdf.fonttype": 42,  # editable text
    "svg.hashsalt": "maxjax",  # equal figures, equal files
}
_METADATA: dict[str, dict[str, None]] = {".pdf": {"CreationDate": None}, ".png": {}, ".svg": {"Date": None}}

_ASIDE = 8.0  # what counts as beside the path in the section [m]
_ABOVE = 30.0  # most that the section shows above the path [m]
_WIDTH = 5.2  # of the panels [in]


def figure_plan(
    occupied: Bool[np.ndarray, "nx ny nz"],
    ground: Bool[np.ndarray, "nx ny nz"],
    grid: Grid,
    paths: Mapping[str, Float[np.ndarray, "_ 3"]],
    *,
    start: Float[np.ndarray, "3"],
    goal: Float[np.ndarray, "3"],
    log_potential: Float[np.ndarray, "nx ny nz"] | None = None,
    points: Float[np.ndarray, "_ 3"] | None = None,
    title: str | None = None,
    around: float = 14.0,
) -> Figure:
    """Plan view and section of one or more paths through a map.

    Args:
        occupied: obstacles, without any safety margin.
        ground: the part of the map that is terrain; shown in the section, left out of the plan view.
        grid: where the voxels lie.
        paths: points (t, 3) [m] by name, at least two each. The section follows the first.
        start: where the paths begin [m].
        goal: where they end [m].
        log_potential: logarithm of the potential; its level lines are drawn in the free space at the main
            path's median altitude, and left out where it is not finite.
        points: returns of a scan [m], shown as dots in the plan view.
        title: headline.
        around: width of the map shown around the paths [m].

    Raises:
        ValueError: if shapes do not fit the grid, or a path has fewer than two points, or one that is not
            finite.
        ImportError: if matplotlib is missing; names the extra.
    """
    rc_context, new_figure = load_matplotlib()
    for name, volume in (("occupied", occupied), ("ground", ground), ("log_potential", log_potential)):
        if volume is not None:
            grid.check_volume(name, volume)
    if not paths:
        raise ValueError("paths: expected at least one path, given none")
    for name, path in paths.items():
        if path.ndim != 2 or path.shape[1] != 3 or len(path) < 2 or not np.all(np.isfinite(path)):
            raise ValueError(f"paths[{name!r}]: expected finite (t, 3) with t at least 2, given shape {path.shape}")
    main = np.asarray(next(iter(paths.values())), np.float64)
    ends = np.stack([start, goal]).astype(np.float64)
    lower, upper = _view(grid, np.concatenate([*paths.values(), ends]), around)
    section = _section(occupied, ground, grid, main)
    rows = max(len(paths), 3 + (log_potential is not None) + (points is not None))

    # Layout in inches, since labels have a size of their own whatever the shape of the map.
    plan_width, plan_height = _WIDTH * (upper - lower) / (upper - lower).max()
    section_height = float(np.clip(_WIDTH * section.rise / max(section.length, 1.0), 0.9, 2.0))
    section_bottom = 0.52 + 0.17 * rows
    plan_bottom = section_bottom + section_height + 0.5
    # Room for the digits of y beside its label.
    left = 0.34 + 0.07 * max(len(f"{y:.0f}") for y in (-100.0, lower[1], upper[1]))
    size = (left + _WIDTH + 0.88, plan_bottom + plan_height + (0.34 if title else 0.1))

    with rc_context(STYLE):
        figure = new_figure(figsize=size)

        def panel(x: float, y: float, width: float, height: float) -> Axes:
            return figure.add_axes((x / size[0], y / size[1], width / size[0], height / size[1]))

        plan = panel(left, plan_bottom, plan_width, plan_height)
        bar = panel(left + plan_width + 0.12, plan_bottom, 0.1, min(plan_height, 2.4))
        side = panel(left, section_bottom, _WIDTH, section_height)
        draw_plan(plan, bar, occupied & ~ground, grid, (lower, upper), float(np.median(main[:, 2])))
        _draw_section(side, section, grid)
        draw_ends(plan, ends[:, 0], ends[:, 1], labelled=True)
        draw_ends(side, _distance(main)[[0, -1]], main[[0, -1], 2], labelled=False)
        if log_potential is not None:
            draw_field(plan, log_potential, occupied, grid, main)
        if points is not None:
            x, y, _ = points.T
            plan.plot(x, y, ",", color=RETURN, rasterized=True, zorder=4)
            plan.plot([], [], ".", color=RETURN, markersize=3.0, label="scan return")
        lines = []
        for number, (name, path) in enumerate(paths.items()):
            length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
            lines += [draw_path(plan, path[:, 0], path[:, 1], number, f"{name}, {length:.1f} m")]
        draw_path(side, _distance(main), main[:, 2], 0, None)
        marks = [handle for handle in plan.get_legend_handles_labels()[0] if handle not in lines]
        areas = side.get_legend_handles_labels()[0]
        strip = (0.3 / size[0], 0.0, 1 - 0.6 / size[0], (0.17 * rows + 0.08) / size[1])
        figure.legend(handles=lines, loc="upper left", bbox_to_anchor=strip, borderaxespad=0.0)
        figure.legend(handles=marks, loc="upper center", bbox_to_anchor=strip, borderaxespad=0.0)
        figure.legend(handles=areas, loc="upper right", bbox_to_anchor=strip, borderaxespad=0.0)
        if title:
            figure.suptitle(title, x=(left + 0.5 * plan_width) / size[0], y=1 - 0.08 / size[1], va="top", fontsize=9)
    return figure


def figure_scan(
    obstacle: Bool[np.ndarray, "nx ny nz"],
    grid: Grid,
    points: Float[np.ndarray, "_ 3"],
    position: Float[np.ndarray, "3"],
    *,
    title: str | None = None,
) -> Figure:
    """Plan view of one LiDAR scan over the buildings that it was taken among.

    Args:
        obstacle: obstacles, ground left out.
        grid: where the voxels lie.
        points: returns [m].
        position: of the sensor [m].
        title: headline.

    Raises:
        ValueError: if the shape does not fit the grid.
        ImportError: if matplotlib is missing; names the extra.
    """
    rc_context, new_figure = load_matplotlib()
    grid.check_volume("obstacle", obstacle)
    lower, upper = np.array(grid.lower[:2]), np.array(grid.upper[:2])
    with rc_context(STYLE):
        figure = new_figure(figsize=(6.7, 6.1))
        plan, bar = figure.add_axes((0.1, 0.14, 0.75, 0.8)), figure.add_axes((0.87, 0.14, 0.018, 0.4))
        draw_plan(plan, bar, obstacle, grid, (lower, upper), float(position[2]))
        x, y, _ = points.T
        plan.plot(x, y, ",", color=RETURN, rasterized=True, zorder=4)
        plan.plot([], [], ".", color=RETURN, markersize=3.0, label=f"scan return ({len(points)})")
        draw_mark(plan, position[0], position[1], "^", 7.0, "white", "sensor")
        figure.legend(loc="lower center", ncols=3)
        if title:
            figure.suptitle(title, x=0.475, y=0.985, va="top", fontsize=9)
    return figure


def load_matplotlib() -> tuple[Callable[[Any], contextlib.AbstractContextManager[None]], Callable[..., Figure]]:
    """`rc_context` and the class of figures.

    Raises:
        ImportError: if matplotlib is missing; names the extra.
    """
    try:
        from matplotlib import rc_context
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("figures need the extra viz: pip install 'maxjax[viz]'") from error
    return rc_context, Figure


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure atomically, as .pdf, .png (200 dots an inch) or .svg by the suffix.

    Raises:
        ValueError: for another suffix.
        OSError: if the file cannot be written.
    """
    from matplotlib import rc_context

    suffix = Path(path).suffix.lower()
    if suffix not in _METADATA:
        raise ValueError(f"{path}: expected a suffix among {', '.join(_METADATA)}, given {suffix or 'none'}")
    buffer = io.BytesIO()
    with rc_context(STYLE):
        figure.savefig(buffer, format=suffix[1:], dpi=200, metadata=_METADATA[suffix])
    atomic_write(path, buffer.getvalue())


@dataclasses.dataclass(frozen=True)
class _Section:
    """Voxels along the main path's course: 0 free, 1 obstacle beside it, 2 obstacle on it, 3 ground."""

    kind: np.ndarray
    length: float
    low: float
    high: float

    @property
    def rise(self) -> float:
        return self.high - self.low


def _section(occupied: np.ndarray, ground: np.ndarray, grid: Grid, path: np.ndarray) -> _Section:
    distance = _distance(path)
    length = float(distance[-1])
    s = np.linspace(0.0, length, max(2, math.ceil(4 * length / grid.spacing)))
    course = np.stack([np.interp(s, distance, path[:, axis]) for axis in (0, 1)], axis=-1)
    along = np.gradient(course, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)

    def columns(offset: float) -> tuple[np.ndarray, np.ndarray]:
        index = np.floor((course + offset * across - np.array(grid.origin[:2])) / grid.spacing + 0.5)
        x, y = np.clip(index.astype(np.int64), 0, np.array(grid.shape[:2]) - 1).T
        return x, y

    obstacle = occupied & ~ground
    on = obstacle[columns(0.0)]
    beside = np.zeros_like(on)
    for offset in np.arange(-_ASIDE, _ASIDE + 1e-6, grid.spacing / 2):
        beside |= obstacle[columns(float(offset))]
    below = ground[columns(0.0)]
    kind = np.select([below, on, beside], [3, 2, 1], 0)

    # Altitudes worth showing: the path, the ground under it, and obstacles unless they tower over it.
    bottom, top = grid.lower[2], grid.upper[2]
    faces = bottom + grid.spacing * np.arange(grid.shape[2] + 1)
    lowest, highest = float(path[:, 2].min()), float(path[:, 2].max())
    terrain = faces[grid.shape[2] - below[:, ::-1].argmax(axis=1)][below.any(axis=1)]
    tops = faces[1:][(kind > 0).any(axis=0)]
    tops = tops[tops <= highest + _ABOVE]
    low = float(terrain.min()) - 3 * grid.spacing if len(terrain) else lowest - 10.0
    high = max(highest + 8.0, float(tops.max()) + 4.0 if len(tops) else highest)
    return _Section(kind, length, max(low, bottom), min(high, top))


def _distance(path: np.ndarray) -> np.ndarray:
    """Horizontal distance flown up to each point [m]."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1))])


def _view(grid: Grid, points: np.ndarray, around: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the part of the map around these points: at least 3 to 5 in shape, never beyond the grid."""
    lower, upper = points[:, :2].min(axis=0) - around, points[:, :2].max(axis=0) + around
    slack = np.maximum(0.6 * (upper - lower).max() - (upper - lower), 0.0)
    lower, upper = lower - 0.5 * slack, upper + 0.5 * slack
    return np.maximum(lower, grid.lower[:2]), np.minimum(upper, grid.upper[:2])


def draw_plan(
    axes: Axes,
    bar: Axes,
    obstacle: np.ndarray,
    grid: Grid,
    view: tuple[np.ndarray, np.ndarray],
    altitude: float,
) -> None:
    """Heights of the obstacles from above, and their outline at an altitude [m]."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LinearSegmentedColormap

    (x0, y0, z0), (x1, y1, _) = grid.lower, grid.upper
    nz = grid.shape[2]
    top = np.where(obstacle.any(axis=2), z0 + grid.spacing * (nz - obstacle[:, :, ::-1].argmax(axis=2)), np.nan)
    inside = [slice(*_index_range(grid, axis, view)) for axis in (0, 1)]
    seen = top[inside[0], inside[1]]
    shown = seen[np.isfinite(seen)]
    limits = (shown.min(), max(shown.max(), shown.min() + grid.spacing)) if len(shown) else (0.0, 1.0)
    image = axes.imshow(
        top.T,
        origin="lower",
        extent=(x0, x1, y0, y1),
        cmap=LinearSegmentedColormap.from_list("heights", HEIGHTS),
        vmin=limits[0],
        vmax=limits[1],
        interpolation="nearest",
    )
    axes.figure.colorbar(image, cax=bar, label="Top of obstacles, z [m]")
    outline = LineCollection(
        list(_edges(obstacle[:, :, level_of(grid, altitude)], grid)),
        colors="black",
        linewidths=0.5,
        label=f"obstacle at z = {altitude:.0f} m",
    )
    axes.add_collection(outline, autolim=False)
    axes.set(xlim=(view[0][0], view[1][0]), ylim=(view[0][1], view[1][1]), aspect="equal")
    axes.set(xlabel="East, x [m]", ylabel="North, y [m]")
    # National grids have coordinates of six digits, which are to be read as they are.
    axes.ticklabel_format(useOffset=False, style="plain")


def draw_field(axes: Axes, log_potential: np.ndarray, occupied: np.ndarray, grid: Grid, path: np.ndarray) -> None:
    """Level lines of the log-potential at the path's median altitude, evenly spaced over what is in view."""
    from matplotlib.lines import Line2D

    altitude = float(np.median(path[:, 2]))
    level = level_of(grid, altitude)
    values = np.asarray(log_potential[:, :, level], np.float64)
    values = np.ma.masked_where(occupied[:, :, level] | ~np.isfinite(values), values)
    x, y = (grid.origin[axis] + grid.spacing * np.arange(grid.shape[axis]) for axis in (0, 1))
    view = (
        np.array([axes.get_xlim()[0], axes.get_ylim()[0]]),
        np.array([axes.get_xlim()[1], axes.get_ylim()[1]]),
    )
    inside = [slice(*_index_range(grid, axis, view)) for axis in (0, 1)]
    seen = values[inside[0], inside[1]].compressed()
    if len(seen) == 0 or seen.min() == seen.max():
        return
    levels = np.linspace(seen.min(), seen.max(), 24)[1:-1]
    axes.contour(x, y, values.T, levels=levels, colors=_FIELD, linewidths=0.5, linestyles="solid")
    label = f"log-potential at z = {altitude:.0f} m"
    axes.add_line(Line2D([], [], color=_FIELD, linewidth=0.8, label=label))


def _draw_section(axes: Axes, section: _Section, grid: Grid) -> None:
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Rectangle

    colors = ("white", _BESIDE, _OBSTACLE, _EARTH)
    axes.imshow(
        section.kind.T,
        origin="lower",
        extent=(0.0, max(section.length, 1.0), grid.lower[2], grid.upper[2]),
        cmap=ListedColormap(colors),
        vmin=-0.5,
        vmax=3.5,
        interpolation="nearest",
        aspect="auto",
    )
    edge = 0.02 * max(section.length, 1.0)
    axes.set(xlim=(-edge, max(section.length, 1.0) + edge), ylim=(section.low, section.high))
    axes.set(xlabel="Horizontal distance along the first path [m]", ylabel="Height, z [m]")
    labels = {2: "obstacle in the section", 1: f"obstacle within {_ASIDE:.0f} m of it", 3: "ground"}
    for kind in (kind for kind in labels if (section.kind == kind).any()):
        # Of no size: only there for the legend.
        axes.add_patch(Rectangle((0.0, section.low), 0.0, 0.0, facecolor=colors[kind], label=labels[kind]))


def draw_path(axes: Axes, x: np.ndarray, y: np.ndarray, number: int, label: str | None) -> Line2D:
    """A line with a white halo, so that it stands out against dark roofs; the first path lies on top."""
    color, dashes = PATHS[number % len(PATHS)]
    width = 1.8 if number == 0 else 1.5
    axes.plot(x, y, color="white", linewidth=width + 1.4, zorder=5, solid_capstyle="round")
    (line,) = axes.plot(x, y, color=color, linewidth=width, linestyle=dashes, zorder=7 - 0.1 * number, label=label)
    return line


def draw_ends(axes: Axes, x: np.ndarray, y: np.ndarray, *, labelled: bool) -> None:
    """Marks at a start and a goal, in this order, as the legend of every figure has them."""
    for number, (marker, size, color, label) in enumerate(
        (("o", 5.5, "white", "start"), ("*", 10.0, "#F0E442", "goal"))
    ):
        draw_mark(axes, x[number], y[number], marker, size, color, label if labelled else None)


def draw_mark(axes: Axes, x: float, y: float, marker: str, size: float, color: str, label: str | None) -> None:
    """One mark with a black edge, above all lines."""
    axes.plot(
        x,
        y,
        marker,
        markersize=size,
        markerfacecolor=color,
        markeredgecolor="black",
        markeredgewidth=0.8,
        linestyle="",
        zorder=9,
        label=label,
        clip_on=False,
    )


def level_of(grid: Grid, altitude: float) -> int:
    """Index along z of the voxels at an altitude."""
    return int(np.clip(math.floor((altitude - grid.lower[2]) / grid.spacing), 0, grid.shape[2] - 1))


def _index_range(grid: Grid, axis: int, view: tuple[np.ndarray, np.ndarray]) -> tuple[int, int]:
    """First index and end of the voxels of one axis that lie in view."""
    first, last = ((corner[axis] - grid.lower[axis]) / grid.spacing for corner in view)
    return max(0, math.floor(first)), min(grid.shape[axis], math.ceil(last))


def _edges(mask: np.ndarray, grid: Grid) -> np.ndarray:
    """Outline of a horizontal slice: the segments (n, 2, 2) [m] between its voxels and free ones."""
    padded = np.pad(mask, 1).astype(np.int8)
    corner = np.array(grid.lower[:2])
    i, j = np.nonzero(np.diff(padded, axis=0)[:, 1:-1])
    east = np.stack([np.stack([i, j], -1), np.stack([i, j + 1], -1)], axis=1)
    i, j = np.nonzero(np.diff(padded, axis=1)[1:-1])
    north = np.stack([np.stack([i, j], -1), np.stack([i + 1, j], -1)], axis=1)
    return np.asarray(corner + grid.spacing * np.concatenate([east, north]))
