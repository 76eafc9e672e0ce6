"""Parts of a map from above that are hatched: closed to flight, or outside the data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from maxjax.core.grid import Grid
from maxjax.ui.figures.plan_view import edges
from maxjax.ui.figures.style import CLOSED, UNKNOWN, UNKNOWN_MARKS

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_closed(axes: Axes, closed: Bool[np.ndarray, "nx ny"], grid: Grid) -> None:
    """Columns that are closed to flight."""
    _hatch(axes, closed, grid, ("////", CLOSED, "closed area"))


def draw_outside(axes: Axes, within: Bool[np.ndarray, "nx ny"], grid: Grid) -> None:
    """The area outside the data (columns that are not `within`): unknown, not free."""
    _hatch(axes, ~within, grid, ("....", UNKNOWN_MARKS, "outside the data, unknown"), UNKNOWN)


def _hatch(
    axes: Axes, columns: Bool[np.ndarray, "nx ny"], grid: Grid, look: tuple[str, str, str], face: str = "none"
) -> None:
    """Columns in a hatch and a colour, outlined, with a label in the legend."""
    from matplotlib.collections import LineCollection
    from matplotlib.patches import Rectangle

    if not columns.any():
        return
    hatch, color, label = look
    order = 2.0 if face == "none" else 0.5  # what is filled lies below lines of the potential
    # Four places a voxel, so that what is filled ends at its faces to an eighth of it.
    fine = np.pad(np.kron(columns, np.ones((4, 4))), 1)
    x, y = (grid.lower[axis] + grid.spacing * (np.arange(-1, 4 * grid.shape[axis] + 1) + 0.5) / 4 for axis in (0, 1))
    filled = axes.contourf(x, y, fine.T, levels=[0.5, 1.5], colors=face, hatches=[hatch], zorder=order)
    filled.set(edgecolor=color, linewidth=0.0)
    outline = LineCollection(list(edges(columns, grid)), colors=color, linewidths=0.9, zorder=order)
    axes.add_collection(outline, autolim=False)
    axes.add_patch(Rectangle(grid.lower[:2], 0.0, 0.0, facecolor=face, edgecolor=color, hatch=hatch, label=label))
