"""An inspection drawn: how many photos show each point of a surface, where they are taken, and the flights (`viz`).

Where a battery is given, the state of charge over each flight stands beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from maxjax.energy.charge_profile import ChargeProfile
from maxjax.inspection.inspection import Inspection
from maxjax.ui.figures.charge_strip import draw_charge
from maxjax.ui.figures.style import ARRIVED, FAILED, PATHS, STYLE, load_matplotlib

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIZE = (7.2, 4.2)  # [in]
_COLORS = "viridis"
_DRAWN = 40_000  # points at most
_DOT = 6.0  # of a point of the surface [points²]
_LOOK = 2.0  # length of a line of sight that is drawn [m]
_VIEW = (24.0, -58.0)  # elevation and azimuth of the eye [deg]


def figure_inspection(found: Inspection, title: str = "", charges: Sequence[ChargeProfile] = ()) -> Figure:
    """The surface in space, coloured by its photos, with viewpoints and flights; and its area by the number of photos.

    Args:
        found: to draw.
        title: above all.
        charges: of the battery over each flight; none: none is given.

    Raises:
        ImportError: without matplotlib.
    """
    rc_context, figure_class = load_matplotlib()
    coverage, photos = found.coverage, found.photos
    with rc_context(STYLE):
        figure = figure_class(figsize=_SIZE, layout="constrained")
        grid = figure.add_gridspec(2 if charges else 1, 2, width_ratios=(2.3, 1.0))
        space: Any = figure.add_subplot(grid[:, 0], projection="3d")
        share = figure.add_subplot(grid[0, 1])
        if charges:
            battery = figure.add_subplot(grid[1, 1])
            draw_charge(battery, charges, [color for color, _ in PATHS])
            battery.legend(loc="lower left", fontsize=7.0)
            battery.set_xlabel("Time [s]")
            battery.spines[["top", "right"]].set_visible(False)
        space.set_title(title, loc="left")
        every = max(1, -(-len(coverage.surface) // _DRAWN))
        points, counts = coverage.surface.points[::every], coverage.counts[::every]
        seen = counts > 0
        most = max(int(np.percentile(coverage.counts, 98)), coverage.wanted, 1)
        shade = {"cmap": _COLORS, "vmin": 0.5, "vmax": most + 0.5, "linewidths": 0, "depthshade": False}
        dots = space.scatter(*points[seen].T, c=counts[seen], s=_DOT, **shade)
        if not seen.all():
            space.scatter(*points[~seen].T, c=FAILED, s=_DOT, linewidths=0, depthshade=False, label="seen by none")
        for k, mission in enumerate(found.missions):
            if len(mission.path):
                space.plot(*mission.path.T, color=PATHS[k % len(PATHS)][0], lw=0.9, label=f"flight {k + 1}")
        ends = photos.position + _LOOK * photos.axes[:, 2]
        gaps = np.full_like(ends, np.nan)
        space.plot(*np.stack([photos.position, ends, gaps], axis=1).reshape(-1, 3).T, color=ARRIVED, lw=0.7)
        space.scatter(*photos.position.T, c=ARRIVED, s=3.0, linewidths=0, label="photos")
        space.set_aspect("equal")
        space.view_init(*_VIEW)
        space.locator_params(nbins=5)
        space.set_xlabel("x [m]")
        space.set_ylabel("y [m]")
        space.set_zlabel("z [m]")
        space.tick_params(pad=0.0, labelsize=7.0)
        space.legend(loc="upper left", fontsize=7.0, markerscale=2.5)
        ticks = np.unique(np.linspace(1, most, min(most, 6)).round().astype(int))
        figure.colorbar(dots, ax=space, shrink=0.55, pad=0.1, label="photos of a point", ticks=ticks)
        _draw_shares(share, found)
    return figure


def _draw_shares(axes: Any, found: Inspection) -> None:
    """Share of the area that so many photos show at least."""
    coverage = found.coverage
    most = max(int(coverage.counts.max(initial=1)), coverage.wanted)
    numbers = np.arange(1, min(most, 3 * coverage.wanted) + 1)
    shares = [100.0 * coverage.share(int(number)) for number in numbers]
    axes.bar(numbers, shares, color=ARRIVED, width=0.8)
    axes.axvline(coverage.wanted, color=FAILED, lw=0.9, ls=(0, (4, 2)))
    axes.text(coverage.wanted + 0.15, 101.5, "asked for", color=FAILED, fontsize=7.0, va="bottom")
    axes.set_ylim(0.0, 108.0)
    axes.set_xlabel("photos, at least")
    axes.set_ylabel("share of the area [%]")
    axes.spines[["top", "right"]].set_visible(False)
