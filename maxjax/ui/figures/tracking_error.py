"""A flight along a trajectory over time: tracking error, clearance and speed (extra `viz`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from maxjax.sim.loop.trajectory_flight import VEHICLE_RADIUS, Tracking
from maxjax.trajectories.trajectory import Trajectory
from maxjax.ui.figures.style import ARRIVED, FAILED, KNOWN, PLANNED, STYLE, load_matplotlib

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIZE = (5.2, 4.4)  # [in]
_FAR = 30.0  # clearance above which a figure says no more [m]


def figure_tracking(trajectory: Trajectory, flown: Tracking, title: str = "") -> Figure:
    """Three panels over one axis of time; a contact is marked in each.

    Args:
        trajectory: that was asked for.
        flown: along it.
        title: above all.

    Raises:
        ImportError: without matplotlib.
    """
    rc_context, figure_class = load_matplotlib()
    with rc_context(STYLE):
        figure = figure_class(figsize=_SIZE, layout="constrained")
        error, clearance, speed = figure.subplots(3, 1, sharex=True)
        error.set_title(title, loc="left")
        error.plot(flown.time, flown.error, color=ARRIVED, lw=1.0)
        error.axhline(np.quantile(flown.error, 0.95), color=ARRIVED, lw=0.7, ls=(0, (4, 2)), label="95 %")
        error.set_ylabel("tracking error [m]")
        clearance.plot(flown.time, np.minimum(flown.clearance, _FAR), color=ARRIVED, lw=1.0)
        clearance.axhline(trajectory.radius, color=PLANNED, lw=0.7, ls=(0, (4, 2)), label="radius")
        keeps = min(VEHICLE_RADIUS, trajectory.radius)
        clearance.axhline(keeps, color=FAILED, lw=0.7, ls=(0, (1, 1.5)), label="vehicle")
        clearance.set_ylabel("clearance [m]" + (f", to {_FAR:g}" if flown.clearance.max() > _FAR else ""))
        motion = trajectory.at(flown.time)
        speed.plot(flown.time, np.linalg.norm(motion.velocity, axis=1), color=KNOWN, lw=2.2, label="trajectory")
        speed.plot(flown.time, np.linalg.norm(flown.velocity, axis=1), color=ARRIVED, lw=1.0, label="flown")
        speed.set_ylabel("speed [m/s]")
        speed.set_xlabel("time [s]")
        speed.set_xlim(0.0, flown.time[-1])
        touched = np.flatnonzero(flown.contact)
        for axes in (error, clearance, speed):
            axes.set_ylim(bottom=0.0)
            axes.spines[["top", "right"]].set_visible(False)
            if touched.size:
                axes.axvline(flown.time[touched[0]], color=FAILED, lw=1.0)
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        figure.align_ylabels()
    return figure
