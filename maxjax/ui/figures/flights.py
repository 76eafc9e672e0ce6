"""Many flights over their city, from above and in height (extra `viz`).

Flights that arrived and flights that did not differ in colour, in line style and in a number at their end.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid
from maxjax.core.voxel_map import VoxelMap
from maxjax.ui.figures.marks import Mark, draw_halo, draw_mark
from maxjax.ui.figures.plan_view import draw_plan, square_around
from maxjax.ui.figures.section import horizontal_distance
from maxjax.ui.figures.style import ARRIVED, FAILED, GOAL, OBSTACLE, STYLE, load_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

AROUND = 15.0  # map shown around the flights [m]
_DASHES = (0, (3, 1))


@dataclasses.dataclass(frozen=True)
class Flown:
    """One flight.

    Attributes:
        trial: its number.
        line: positions [m], the start first.
        goal: [m].
        arrived: whether it reached the goal without contact.
    """

    trial: int
    line: Float[np.ndarray, "_ 3"]
    goal: Float[np.ndarray, "3"]
    arrived: bool


def figure_flights(
    obstacle: Bool[np.ndarray, "nx ny nz"],
    grid: Grid,
    flights: Sequence[Flown],
    *,
    title: str | None = None,
    caption: str | None = None,
) -> Figure:
    """All flights over one city, from above, and their heights; of a single one, also what stands below it.

    Args:
        obstacle: the city without its ground.
        grid: where its voxels lie.
        flights: to show.
        title: headline.
        caption: line below the legend.

    Raises:
        ValueError: if the city does not fit the grid, or there is no flight.
        ImportError: if matplotlib is missing; names the extra.
    """
    rc_context, new_figure = load_matplotlib()
    grid.check_volume("obstacle", obstacle)
    if not flights:
        raise ValueError("flights: expected at least one flight, given none")
    points = np.concatenate([*(flight.line for flight in flights), *(flight.goal[None] for flight in flights)])
    with rc_context(STYLE):
        figure = new_figure(figsize=(7.2, 8.8))
        plan, bar = figure.add_axes((0.09, 0.345, 0.76, 0.62)), figure.add_axes((0.875, 0.345, 0.018, 0.32))
        side = figure.add_axes((0.09, 0.15, 0.76, 0.13))
        view = square_around(points, grid, AROUND)
        draw_plan(plan, bar, VoxelMap.on(grid, obstacle), view, float(np.median(points[:, 2])))
        for flight in flights:
            _draw_flight(plan, flight, 1.6 if len(flights) < 5 else 1.0)
            _draw_height(side, flight, 1.4 if len(flights) < 5 else 0.8)
        if len(flights) == 1:  # of several, what is below one would seem to stand in the way of another
            tops = _tops_below(obstacle, grid, flights[0].line)
            along = horizontal_distance(flights[0].line)
            side.fill_between(along, 0.0, tops, color=OBSTACLE, linewidth=0.0, label="obstacle below")
            side.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
        side.set(xlabel="Horizontal distance flown [m]", ylabel="Height, z [m]", ylim=(0.0, None))
        side.spines[["top", "right"]].set_visible(False)
        arrived = sum(flight.arrived for flight in flights)
        figure.legend(
            handles=_legend(arrived, len(flights) - arrived) + plan.get_legend_handles_labels()[0],
            loc="upper center",
            bbox_to_anchor=(0.5, 0.1),
            ncols=3,
        )
        if title:
            figure.suptitle(title, x=0.47, y=0.985, va="top", fontsize=9)
        if caption:
            figure.text(0.47, 0.012, caption, ha="center", va="bottom", fontsize=7)
    return figure


def _draw_flight(axes: Axes, flight: Flown, wide: float) -> None:
    """A flown line of a width [pt] and its ends; of a failed one, the trial's number as well."""
    line, goal, bad = flight.line.astype(np.float64), flight.goal.astype(np.float64), not flight.arrived
    color, dashes = (FAILED, _DASHES) if bad else (ARRIVED, "-")
    draw_halo(axes, line[:, 0], line[:, 1], wide)
    axes.plot(*line[:, :2].T, color=color, linewidth=wide + 0.3 * bad, linestyle=dashes, zorder=6 + bad)
    draw_mark(axes, line[0, 0], line[0, 1], Mark("o", 3.6, "white"))
    draw_mark(axes, goal[0], goal[1], Mark("*", 6.5, GOAL))
    if bad:
        draw_mark(axes, line[-1, 0], line[-1, 1], Mark("X", 5.5, FAILED))
        axes.annotate(
            str(flight.trial),
            (float(line[-1, 0]), float(line[-1, 1])),
            textcoords="offset points",
            xytext=(5, 4),
            color="black",
            weight="bold",
            zorder=11,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": FAILED, "linewidth": 0.6},
        )


def _tops_below(
    obstacle: Bool[np.ndarray, "nx ny nz"], grid: Grid, line: Float[np.ndarray, "t 3"]
) -> Float[np.ndarray, " t"]:
    """Top of the highest obstacle below each position [m]; NaN where there is none."""
    index = np.floor((line - np.array(grid.origin)) / grid.spacing + 0.5).astype(int)
    inside = ((index >= 0) & (index < np.array(grid.shape)))[:, :2].all(axis=1)
    x, y, z = np.clip(index, 0, np.array(grid.shape) - 1).T
    below = obstacle[x, y] & (np.arange(grid.shape[2]) <= z[:, None])
    top = grid.shape[2] - below[:, ::-1].argmax(axis=1)
    return np.where(inside & below.any(axis=1), grid.lower[2] + grid.spacing * top, np.nan)


def _draw_height(axes: Axes, flight: Flown, wide: float) -> None:
    """Heights of a flight over the distance that it flew; a cross where it failed."""
    line = flight.line.astype(np.float64)
    along, bad = horizontal_distance(line), not flight.arrived
    color, dashes = (FAILED, _DASHES) if bad else (ARRIVED, "-")
    axes.plot(along, line[:, 2], color=color, linewidth=wide + 0.3 * bad, linestyle=dashes, zorder=6 + bad)
    if bad:
        draw_mark(axes, float(along[-1]), float(line[-1, 2]), Mark("X", 5.5, FAILED))


def _legend(arrived: int, failed: int) -> list[Line2D]:
    from matplotlib.lines import Line2D

    def mark(marker: str, size: float, color: str, label: str) -> Line2D:
        drawn = Line2D([], [], marker=marker, markersize=size, markerfacecolor=color, linestyle="", label=label)
        drawn.set(markeredgecolor="black", markeredgewidth=0.8)
        return drawn

    lines = [mark("o", 4.5, "white", "start"), mark("*", 8.0, GOAL, "goal")]
    if arrived:
        lines.append(Line2D([], [], color=ARRIVED, linewidth=1.6, label=f"flown, arrived ({arrived})"))
    if failed:
        dashed = Line2D([], [], color=FAILED, linewidth=1.6, linestyle=_DASHES)
        dashed.set_label(f"flown, failed ({failed}), with its trial")
        lines += [dashed, mark("X", 5.5, FAILED, "end of a failed flight")]
    return lines
