"""Many flights over their city, from above (extra `viz`).

Flights that arrived and flights that did not differ in colour, in line style and in a number at their end.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid
from maxjax.viz.marks import Mark, draw_mark
from maxjax.viz.plan_view import draw_plan, square_around
from maxjax.viz.style import ARRIVED, FAILED, GOAL, STYLE, load_matplotlib

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
    """All flights over one city, from above.

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
        figure = new_figure(figsize=(7.2, 7.0))
        plan, bar = figure.add_axes((0.09, 0.17, 0.76, 0.78)), figure.add_axes((0.875, 0.17, 0.018, 0.4))
        view = square_around(points, grid, AROUND)
        draw_plan(plan, bar, obstacle, grid, view, float(np.median(points[:, 2])))
        for flight in flights:
            _draw_flight(plan, flight, 1.6 if len(flights) < 5 else 1.0)
        arrived = sum(flight.arrived for flight in flights)
        figure.legend(
            handles=_legend(arrived, len(flights) - arrived) + plan.get_legend_handles_labels()[0],
            loc="upper center",
            bbox_to_anchor=(0.5, 0.11),
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
    axes.plot(*line[:, :2].T, color="white", linewidth=wide + 1.2, zorder=5, solid_capstyle="round")
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
