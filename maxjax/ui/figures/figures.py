"""Print-quality figures of paths in a map and of scans (extra `viz`).

plan view: top of the obstacles in each column [m], seen from above, ground left out
section:   the voxels over and under the first path, unrolled over its horizontal distance
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.voxel_map import VoxelMap
from maxjax.ui.figures.areas import draw_closed, draw_outside
from maxjax.ui.figures.drawable import drawable, title_with_remark, voxels_to_draw
from maxjax.ui.figures.marks import Mark, draw_colored, draw_ends, draw_mark, draw_path, draw_returns
from maxjax.ui.figures.plan_view import View, draw_field, draw_plan, level_of, view_around
from maxjax.ui.figures.section import Section, draw_section, horizontal_distance, section_along
from maxjax.ui.figures.style import STYLE, load_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

_WIDTH = 5.2  # of the panels [in]
_NARROWEST = 0.9  # a panel [in]
_LEAST_PAGE = 3.4  # between its margins, for the legend below [in]
_ROW = 0.17  # of the legend [in]

# A box on the page: left, bottom, width, height [in].
Box = tuple[float, float, float, float]


@dataclasses.dataclass(frozen=True)
class Nearness:
    """How near the main path comes to obstacles.

    Attributes:
        points: along the path, so close that its colour changes smoothly [m].
        distance: from each to the nearest obstacle, ground left out [m].
        least: where the distance is least away from the ends [m]; None where there is no obstacle.
    """

    points: Float[np.ndarray, "n 3"]
    distance: Float[np.ndarray, " n"]
    least: tuple[float, float, float] | None


@dataclasses.dataclass(frozen=True)
class Overlay:
    """Additions to a figure of paths.

    Attributes:
        log_potential: logarithm of the potential; its level lines are drawn in the free space at the main path's
            median altitude, and left out where it is not finite.
        points: returns of a scan [m], shown as dots in the plan view.
        nearness: what the main path is coloured by; its least place is marked and named.
        title: headline.
        around: width of the map shown around the paths [m].
        within: columns that lie within the map's data; the others are drawn as unknown. None: all do.
    """

    log_potential: Float[np.ndarray, "nx ny nz"] | None = None
    points: Float[np.ndarray, "_ 3"] | None = None
    nearness: Nearness | None = None
    title: str | None = None
    around: float = 14.0
    within: Bool[np.ndarray, "nx ny"] | None = None


@dataclasses.dataclass(frozen=True)
class _Page:
    """Where the parts of a figure of paths stand, in inches: labels have a size of their own, whatever the map's."""

    size: tuple[float, float]
    plan: Box
    bar: Box
    side: Box
    legend: Box
    scale: Box

    @classmethod
    def of(cls, view: View, section: Section, rows: int, titled: bool) -> _Page:
        """The page of a view of the map, a section, and a legend of some rows."""
        lower, upper = view
        width, height = np.maximum(_WIDTH * (upper - lower) / (upper - lower).max(), _NARROWEST)
        side = float(np.clip(_WIDTH * section.rise / max(section.length, 1.0), 0.9, 2.0))
        bottom = 0.52 + _ROW * rows
        above = bottom + side + 0.5
        # Room for the digits of y beside its label.
        left = 0.34 + 0.07 * max(len(f"{y:.0f}") for y in (-100.0, lower[1], upper[1]))
        size = (left + _WIDTH + 0.88, above + height + (0.34 if titled else 0.1))
        return cls(
            size,
            plan=(left, above, width, height),
            bar=(left + width + 0.12, above, 0.1, min(height, 2.4)),
            side=(left, bottom, _WIDTH, side),
            legend=(0.3, 0.0, size[0] - 0.6, _ROW * rows + 0.08),
            scale=(left + _WIDTH + 0.12, bottom, 0.1, side),
        )

    def share(self, box: Box) -> Box:
        """A box as shares of the page's width and height."""
        (x, y, width, height), size = box, self.size
        return x / size[0], y / size[1], width / size[0], height / size[1]


def figure_plan(
    where: VoxelMap,
    paths: Mapping[str, Float[np.ndarray, "_ 3"]],
    start: Float[np.ndarray, "3"],
    goal: Float[np.ndarray, "3"],
    overlay: Overlay = Overlay(),
) -> Figure:
    """Plan view and section of one or more paths through a map.

    Args:
        where: the map.
        paths: points (t, 3) [m] by name, at least two each. The section follows the first.
        start, goal: where the paths begin and end [m].
        overlay: what else is shown.

    Raises:
        ValueError: if shapes do not fit the grid, or a path has fewer than two points, or one that is not
            finite.
        ImportError: if matplotlib is missing; names the extra.
    """
    rc_context, new_figure = load_matplotlib()
    _check(where, paths, overlay)
    where, overlay = _drawable(where.on_host(), overlay)
    occupied, ground = np.asarray(where.occupied), np.asarray(where.ground)
    closed = None if where.closed is None else np.asarray(where.shut)
    grid, main = where.grid, np.asarray(next(iter(paths.values())), np.float64)
    ends = np.stack([start, goal]).astype(np.float64)
    view = view_around(grid, np.concatenate([*paths.values(), ends]), overlay.around)
    section = section_along(occupied, ground, grid, main, closed, overlay.within)
    shown = (overlay.log_potential, overlay.points, overlay.nearness, closed, overlay.within)
    rows = max(len(paths), 3 + sum(part is not None for part in shown))
    page = _Page.of(view, section, rows, bool(overlay.title))

    with rc_context(STYLE):
        figure = new_figure(figsize=page.size)
        plan, bar, side = (figure.add_axes(page.share(box)) for box in (page.plan, page.bar, page.side))
        altitude = float(np.median(main[:, 2]))
        draw_plan(plan, bar, voxels_to_draw(where, overlay.within), view, altitude)
        if overlay.within is not None:
            draw_outside(plan, overlay.within, grid)
        if closed is not None:
            draw_closed(plan, closed[:, :, level_of(grid, altitude)], grid)
        draw_section(side, section, grid)
        draw_ends(plan, ends[:, 0], ends[:, 1], labelled=True)
        draw_ends(side, horizontal_distance(main)[[0, -1]], main[[0, -1], 2], labelled=False)
        if overlay.log_potential is not None:
            draw_field(plan, overlay.log_potential, occupied, grid, main)
        if overlay.points is not None:
            draw_returns(plan, overlay.points, "scan return")
        lines = []
        for number, (name, path) in enumerate(paths.items()):
            length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
            lines += [draw_path(plan, path[:, 0], path[:, 1], number, f"{name}, {length:.1f} m")]
        draw_path(side, horizontal_distance(main), main[:, 2], 0, None)
        if overlay.nearness is not None:
            _draw_nearness(plan, side, figure.add_axes(page.share(page.scale)), overlay.nearness)
        _draw_legends(figure, page, lines, plan, side)
        if overlay.title:
            _draw_title(figure, page, overlay.title)
    return figure


def _drawable(where: VoxelMap, overlay: Overlay) -> tuple[VoxelMap, Overlay]:
    """A map of a size that can be drawn, and what is shown on it."""
    where, within, remark = drawable(where, overlay.within)
    if not remark:
        return where, overlay
    # Level lines of the fine map fit no other.
    title = title_with_remark(overlay.title, remark)
    return where, dataclasses.replace(overlay, within=within, log_potential=None, title=title)


def _draw_title(figure: Figure, page: _Page, title: str) -> None:
    """A title above the plan view."""
    left, _, width, _ = page.plan
    across, top = (left + 0.5 * width) / page.size[0], 1 - 0.08 / page.size[1]
    figure.suptitle(title, x=across, y=top, va="top", fontsize=9)


def _draw_nearness(plan: Axes, side: Axes, bar: Axes, nearness: Nearness) -> None:
    """Colour the main path in both panels by its distance to obstacles, and mark and name where that is least."""
    points, distance = nearness.points, nearness.distance
    along = horizontal_distance(points)
    finite = distance[np.isfinite(distance)]
    limits = (0.0, float(finite.max()) if finite.size else 1.0)
    lines = [
        draw_colored(axes, x, y, distance, limits)
        for axes, x, y in ((plan, points[:, 0], points[:, 1]), (side, along, points[:, 2]))
    ]
    plan.figure.colorbar(lines[0], cax=bar, label="Clearance [m]")
    if nearness.least is None:
        return
    least = np.array(nearness.least)
    at = int(np.linalg.norm(points - least, axis=1).argmin())
    place = ", ".join(f"{x:.0f}" for x in least)
    mark = Mark("D", 5.0, "white", f"least clearance, {distance[at]:.1f} m at ({place})")
    draw_mark(plan, float(least[0]), float(least[1]), mark)
    draw_mark(side, float(along[at]), float(least[2]), dataclasses.replace(mark, label=None))


def _check(where: VoxelMap, paths: Mapping[str, np.ndarray], overlay: Overlay) -> None:
    """Raise a ValueError for what does not fit together."""
    volumes = {"occupied": where.occupied, "ground": where.ground, "closed": where.closed}
    volumes["log_potential"] = overlay.log_potential
    for name, volume in volumes.items():
        if volume is not None:
            where.grid.check_volume(name, volume)
    if not paths:
        raise ValueError("paths: expected at least one path, given none")
    for name, path in paths.items():
        if path.ndim != 2 or path.shape[1] != 3 or len(path) < 2 or not np.all(np.isfinite(path)):
            raise ValueError(f"paths[{name!r}]: expected finite (t, 3) with t at least 2, given shape {path.shape}")


def _draw_legends(figure: Figure, page: _Page, lines: list[Line2D], plan: Axes, side: Axes) -> None:
    """Below the panels, from the left: the paths, what else is in the plan view, what is in the section."""
    marks = [handle for handle in plan.get_legend_handles_labels()[0] if handle not in lines]
    areas = side.get_legend_handles_labels()[0]
    strip: dict[str, Any] = {"bbox_to_anchor": page.share(page.legend), "borderaxespad": 0.0}
    figure.legend(handles=lines, loc="upper left", **strip)
    figure.legend(handles=marks, loc="upper center", **strip)
    figure.legend(handles=areas, loc="upper right", **strip)


@contextlib.contextmanager
def _from_above(where: VoxelMap, level: float, title: str | None) -> Iterator[tuple[Figure, Axes]]:
    """A page with the plan view of a whole map, obstacles outlined at `level` [m], for what is drawn into it.

    The page is as high and as wide as the map needs: none of it is empty, however long the map is.
    """
    rc_context, new_figure = load_matplotlib()
    lower, upper = np.array(where.grid.lower[:2]), np.array(where.grid.upper[:2])
    width, height = np.maximum(_WIDTH * (upper - lower) / (upper - lower).max(), _NARROWEST)
    # Room for the digits of y beside its label.
    left, bottom = 0.42 + 0.06 * max(len(f"{y:.0f}") for y in (lower[1], upper[1])), 0.8
    size = (left + max(width, _LEAST_PAGE) + 0.95, bottom + height + (0.36 if title else 0.1))
    left += 0.5 * (max(width, _LEAST_PAGE) - width)
    with rc_context(STYLE):
        figure = new_figure(figsize=size)
        plan, bar = (
            figure.add_axes((x / size[0], bottom / size[1], wide / size[0], high / size[1]))
            for x, wide, high in ((left, width, height), (left + width + 0.12, 0.1, min(height, 2.4)))
        )
        draw_plan(plan, bar, where, (lower, upper), level)
        yield figure, plan
        if title:
            figure.suptitle(title, x=(left + 0.5 * width) / size[0], y=1 - 0.08 / size[1], va="top", fontsize=9)


def figure_map(
    where: VoxelMap,
    *,
    title: str | None = None,
    within: Bool[np.ndarray, "nx ny"] | None = None,
) -> Figure:
    """A whole map from above, with the outline of its obstacles at half of their height.

    Args:
        where: the map.
        title: headline.
        within: columns that lie within the data; the others are drawn as unknown. None: all do.

    Raises:
        ImportError: if matplotlib is missing; names the extra.
    """
    where, grid = voxels_to_draw(where, within), where.grid
    obstacle = np.asarray(where.occupied) & ~np.asarray(where.ground)
    outside = np.zeros((1, 1, 1), bool) if within is None else ~within[:, :, None]
    # Of levels, those where something is free and something is not: not what is unknown above everything.
    levels = np.flatnonzero(obstacle.any(axis=(0, 1)) & ~(obstacle | outside).all(axis=(0, 1)))
    middle = grid.origin[2] + grid.spacing * (0.5 * (levels[0] + levels[-1]) if len(levels) else 0.0)
    with _from_above(where, float(middle), title) as (figure, plan):
        if within is not None:
            draw_outside(plan, within, grid)
        figure.legend(loc="lower center", ncols=2)
    return figure


def figure_scan(
    where: VoxelMap,
    points: Float[np.ndarray, "_ 3"],
    position: Float[np.ndarray, "3"],
    *,
    title: str | None = None,
) -> Figure:
    """Plan view of one LiDAR scan over the buildings that it was taken among.

    Args:
        where: the map of the city.
        points: returns [m].
        position: of the sensor [m].
        title: headline.

    Raises:
        ImportError: if matplotlib is missing; names the extra.
    """
    with _from_above(where, float(position[2]), title) as (figure, plan):
        draw_returns(plan, points, f"scan return ({len(points)})")
        draw_mark(plan, position[0], position[1], Mark("^", 7.0, "white", "sensor"))
        figure.legend(loc="lower center", ncols=3)
    return figure
