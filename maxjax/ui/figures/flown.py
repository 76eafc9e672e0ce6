"""A flight over a link: planned against flown, from above and over time (extra `viz`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from maxjax.link.flight_log import Look
from maxjax.trajectories.trajectory import Trajectory
from maxjax.ui.figures.plan_view import draw_plan, view_around
from maxjax.ui.figures.style import ARRIVED, FAILED, PLANNED, STYLE, load_matplotlib

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIZE = (5.6, 6.4)  # [in]
_AROUND = 15.0  # of the map, around the flight [m]
_FAR = 30.0  # clearance above which a figure says no more [m]


def figure_flown(trajectory: Trajectory, looks: Sequence[Look], title: str = "") -> Figure:
    """The way from above, over obstacles with their outline at its median height; error, clearance, height over time.

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
        grid = figure.add_gridspec(4, 2, height_ratios=(4.0, 1.0, 1.0, 1.0), width_ratios=(1.0, 0.03))
        above, bar = (figure.add_subplot(grid[0, k]) for k in (0, 1))
        error, clearance, height = (figure.add_subplot(grid[k, 0]) for k in (1, 2, 3))
        above.set_title(title, loc="left")
        where = trajectory.map.on_host()
        view = view_around(where.grid, np.concatenate([way, flown]), _AROUND)
        draw_plan(above, bar, where, view, float(np.median(way[:, 2])))
        above.plot(way[:, 0], way[:, 1], color=PLANNED, lw=2.2, label="planned")
        above.plot(flown[:, 0], flown[:, 1], color=ARRIVED, lw=1.0, label="flown")
        error.plot(times, np.linalg.norm(flown - planned, axis=1), color=ARRIVED, lw=1.0)
        error.set_ylabel("error [m]")
        clearance.plot(times, np.minimum([look.clearance for look in looks], _FAR), color=ARRIVED, lw=1.0)
        clearance.axhline(trajectory.radius, color=FAILED, lw=0.7, ls=(0, (4, 2)), label="radius")
        clearance.set_ylabel("clearance [m]")
        height.plot(times, planned[:, 2], color=PLANNED, lw=2.2)
        height.plot(times, flown[:, 2], color=ARRIVED, lw=1.0)
        height.set_ylabel("z [m]")
        height.set_xlabel("time [s]")
        for one in (error, clearance, height):
            one.spines[["top", "right"]].set_visible(False)
            one.set_ylim(bottom=min(0.0, one.get_ylim()[0]))
        above.legend(loc="upper left", bbox_to_anchor=(0.0, -0.18), ncols=3)
        clearance.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        figure.align_ylabels((error, clearance, height))
    return figure
