"""A flight over a link: planned against flown, from above and over time (extra `viz`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from maxjax.link.flight_log import Look
from maxjax.trajectories.trajectory import Trajectory
from maxjax.ui.figures.style import ARRIVED, FAILED, OBSTACLE, PLANNED, STYLE, load_matplotlib

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIZE = (5.6, 6.4)  # [in]
_AROUND = 15.0  # of the map, around the flight [m]
_FAR = 30.0  # clearance above which a figure says no more [m]


def figure_flown(trajectory: Trajectory, looks: Sequence[Look], title: str = "") -> Figure:
    """The way from above, where obstacles reach its least height, and error, clearance and height over time.

    Args:
        trajectory: that was planned.
        looks: at the vehicle, at least one.
        title: above all.

    Raises:
        ImportError: without matplotlib.
    """
    rc_context, figure_class = load_matplotlib()
    flown, planned = (np.array([getattr(look, name) for look in looks]) for name in ("position", "planned"))
    times, way = np.array([look.time for look in looks]), trajectory.sampled(0.1).position
    with rc_context(STYLE):
        figure = figure_class(figsize=_SIZE, layout="constrained")
        axes = figure.subplots(4, 1, height_ratios=(4.0, 1.0, 1.0, 1.0))
        above, error, clearance, height = axes
        above.set_title(title, loc="left")
        grid, z = trajectory.map.grid, float(way[:, 2].min())
        layer = int(np.clip(np.floor((z - grid.lower[2]) / grid.spacing), 0, grid.shape[2] - 1))
        solid = (np.asarray(trajectory.map.occupied) & ~np.asarray(trajectory.map.ground))[:, :, layer:].any(axis=2)
        extent = (grid.lower[0], grid.upper[0], grid.lower[1], grid.upper[1])
        shown = np.where(solid.T, 1.0, np.nan)
        above.imshow(shown, origin="lower", extent=extent, cmap=_one(OBSTACLE), interpolation="nearest")
        above.plot(way[:, 0], way[:, 1], color=PLANNED, lw=2.2, label="planned")
        above.plot(flown[:, 0], flown[:, 1], color=ARRIVED, lw=1.0, label="flown")
        both = np.concatenate([way, flown])[:, :2]
        above.set_xlim(both[:, 0].min() - _AROUND, both[:, 0].max() + _AROUND)
        above.set_ylim(both[:, 1].min() - _AROUND, both[:, 1].max() + _AROUND)
        above.set_xlabel("x [m]")
        above.set_ylabel("y [m]")
        error.plot(times, np.linalg.norm(flown - planned, axis=1), color=ARRIVED, lw=1.0)
        error.set_ylabel("error [m]")
        clearance.plot(times, np.minimum([look.clearance for look in looks], _FAR), color=ARRIVED, lw=1.0)
        clearance.axhline(trajectory.radius, color=FAILED, lw=0.7, ls=(0, (4, 2)), label="radius")
        clearance.set_ylabel("clearance [m]")
        height.plot(times, planned[:, 2], color=PLANNED, lw=2.2, label="planned")
        height.plot(times, flown[:, 2], color=ARRIVED, lw=1.0, label="flown")
        height.set_ylabel("z [m]")
        height.set_xlabel("time [s]")
        for one in axes:
            one.spines[["top", "right"]].set_visible(False)
            if one is not error:
                one.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        figure.align_ylabels(axes[1:])
    return figure


def _one(color: str) -> object:
    from matplotlib.colors import ListedColormap

    return ListedColormap([color])
