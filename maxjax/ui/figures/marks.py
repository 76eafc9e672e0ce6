"""Lines and marks that all figures share: paths with a pale halo, ends and other places with a black edge."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from maxjax.ui.figures.style import CLEARANCES, GOAL, PATHS, RETURN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D


@dataclasses.dataclass(frozen=True)
class Mark:
    """A symbol.

    Attributes:
        marker: of matplotlib.
        size: [pt].
        color: of its face.
        label: in the legend; None: left out of it.
    """

    marker: str
    size: float
    color: str
    label: str | None = None


def draw_path(axes: Axes, x: np.ndarray, y: np.ndarray, number: int, label: str | None) -> Line2D:
    """A line with a halo, so that it stands out against dark roofs; the first path lies on top."""
    color, dashes = PATHS[number % len(PATHS)]
    width = 1.8 if number == 0 else 1.5
    draw_halo(axes, x, y, width)
    (line,) = axes.plot(x, y, color=color, linewidth=width, linestyle=dashes, zorder=7 - 0.1 * number, label=label)
    return line


def draw_halo(axes: Axes, x: np.ndarray, y: np.ndarray, width: float) -> None:
    """A pale edge around a line of a width [pt]: roofs show through, or it would look like a street between them."""
    axes.plot(x, y, color="white", alpha=0.5, linewidth=width + 1.0, zorder=5, solid_capstyle="round")


def draw_colored(
    axes: Axes, x: np.ndarray, y: np.ndarray, values: np.ndarray, limits: tuple[float, float]
) -> LineCollection:
    """A line whose colour is a value at each of its points, over the line of the main path."""
    from matplotlib.collections import LineCollection

    points = np.stack([x, y], axis=1)
    segments = np.stack([points[:-1], points[1:]], axis=1)
    line = LineCollection(list(segments), cmap=CLEARANCES, linewidths=1.8, zorder=7.5, capstyle="round")
    line.set_array(np.minimum(0.5 * (values[:-1] + values[1:]), limits[1]))
    line.set_clim(*limits)
    axes.add_collection(line, autolim=False)
    return line


def draw_ends(axes: Axes, x: np.ndarray, y: np.ndarray, *, labelled: bool) -> None:
    """Marks at a start and a goal, in this order, as the legend of every figure has them."""
    draw_mark(axes, x[0], y[0], Mark("o", 5.5, "white", "start" if labelled else None))
    draw_mark(axes, x[1], y[1], Mark("*", 10.0, GOAL, "goal" if labelled else None))


def draw_mark(axes: Axes, x: float, y: float, mark: Mark) -> None:
    """One mark with a black edge, above all lines."""
    axes.plot(
        x,
        y,
        mark.marker,
        markersize=mark.size,
        markerfacecolor=mark.color,
        markeredgecolor="black",
        markeredgewidth=0.8,
        linestyle="",
        zorder=9,
        label=mark.label,
        clip_on=False,
    )


def draw_returns(axes: Axes, points: np.ndarray, label: str) -> None:
    """Returns of a scan (n, 3) as dots, seen from above."""
    x, y, _ = points.T
    axes.plot(x, y, ",", color=RETURN, rasterized=True, zorder=4)
    axes.plot([], [], ".", color=RETURN, markersize=3.0, label=label)
