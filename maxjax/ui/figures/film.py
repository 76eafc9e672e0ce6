"""One flight as a film (extra `viz`).

left:  the city, what the vehicle knows of it, its plan and its line; movers, if there are any
right: height over distance flown, speed and clearance over time, with the time that something assumed did not hold
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid
from maxjax.core.voxel_map import VoxelMap
from maxjax.ui.figures.flights import AROUND
from maxjax.ui.figures.gif import animation
from maxjax.ui.figures.marks import Mark, draw_mark
from maxjax.ui.figures.movers_from_above import Moving, MovingLayer, moving_labels
from maxjax.ui.figures.plan_view import draw_plan, square_around
from maxjax.ui.figures.style import (
    ARRIVED,
    FAILED,
    FLAGGED,
    GOAL,
    HEIGHTS,
    KNOWN,
    MOTION,
    MOVER,
    PLANNED,
    RETURN,
    STYLE,
    load_matplotlib,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STEP = 0.1  # between two positions [s]
_SIZE = (9.6, 5.4)  # [in]
_FRAMES = 160
_FLAG_STRIP = (1.03, 0.06)  # bottom and height of the time that is flagged, in heights of its axes
_PLAN_LINE: dict[str, Any] = {"color": PLANNED, "linestyle": (0, (4, 1.2))}
_START, _GOAL = Mark("o", 5.5, "white"), Mark("*", 10.0, GOAL)


@dataclasses.dataclass(frozen=True)
class Look:
    """One planning period of a flight, world frame [m].

    Attributes:
        scan: returns of the scan, where the vehicle believes them.
        known: columns of the map that hold a voxel known as occupied, ground left out.
        lower: lower corner of the map's first column.
        spacing: of its columns.
        path: the plan that is flown.
        flown: where the vehicle then was, every 0.1 s.
    """

    scan: Float[np.ndarray, "n 3"]
    known: Bool[np.ndarray, "nx ny"]
    lower: tuple[float, float]
    spacing: float
    path: Float[np.ndarray, "p 3"]
    flown: Float[np.ndarray, "t 3"]


@dataclasses.dataclass(frozen=True)
class Filmed:
    """A flight to be filmed.

    Attributes:
        looks: its planning periods, in order; the first one's first position is the start.
        goal: [m].
        clearance: to the nearest solid at each position of all looks [m].
        radius: that the clearance must exceed [m].
        moving: movers at each position of all looks; empty where there were none.
    """

    looks: Sequence[Look]
    goal: Float[np.ndarray, "3"]
    clearance: Float[np.ndarray, " t"]
    radius: float
    moving: Sequence[Moving] = ()


def film_flight(flight: Filmed, obstacle: Bool[np.ndarray, "nx ny nz"], grid: Grid, *, title: str) -> bytes:
    """One flight as an animated GIF of 10 frames a second and at most 6 MB.

    Args:
        flight: what it did and knew.
        obstacle: the true city without its ground.
        grid: where its voxels lie.
        title: headline.

    Raises:
        ValueError: without any position.
        ImportError: if matplotlib is missing; names the extra.
    """
    rc_context, _ = load_matplotlib()
    count = sum(len(look.flown) for look in flight.looks)
    if count == 0 or len(flight.clearance) != count:
        raise ValueError(f"looks: expected positions, each with a clearance, given {count} and {len(flight.clearance)}")
    if len(flight.moving) not in (0, count):
        raise ValueError(f"moving: expected none or one for each of {count} positions, given {len(flight.moving)}")
    stride = max(2, -(-count // _FRAMES))
    shown = [*range(0, count - 1, stride), count - 1]
    with rc_context(STYLE):
        film = _Film(flight, obstacle, grid, title, stride)
        frames = [film.frame(last) for last in shown]
    return animation(frames, (ARRIVED, FAILED, PLANNED, GOAL, MOVER, MOTION, FLAGGED))


class _Film:
    """The figure whose frames are drawn one after the other; only what changes is set anew."""

    def __init__(self, flight: Filmed, obstacle: np.ndarray, grid: Grid, title: str, fast: int) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        _, new_figure = load_matplotlib()
        self.looks, self.goal = flight.looks, flight.goal.astype(np.float64)
        self.flown = np.concatenate([look.flown for look in self.looks]).astype(np.float64)
        self.first = np.cumsum([0, *(len(look.flown) for look in self.looks)])
        self.time = _STEP * np.arange(len(self.flown))
        moved = np.linalg.norm(np.diff(self.flown, axis=0), axis=1)
        self.distance = np.concatenate([[0.0], np.cumsum(moved)])
        # The last position is that of the end, sooner than a step after the one before.
        speed = np.concatenate([[0.0], moved[:-1] / _STEP, moved[-2:-1] / _STEP])[: len(self.flown)]
        figure = new_figure(figsize=_SIZE)
        self.canvas: Any = FigureCanvasAgg(figure)

        bar, self.plan = figure.add_axes((0.5, 0.19, 0.01, 0.36)), figure.add_axes((0.07, 0.19, 0.4163, 0.74))
        self._draw_map(bar, obstacle, grid)
        self.moving, self.layer = flight.moving, MovingLayer(self.plan)
        figure.legend(
            handles=[
                *_labels(bool(flight.moving)),
                *(moving_labels() if flight.moving else self.plan.get_legend_handles_labels()[0]),
            ],
            loc="upper left",
            bbox_to_anchor=(0.03, 0.105),
            ncols=4,
            fontsize=7,
            columnspacing=1.4,
        )
        height, rate, room = (figure.add_axes((0.64, bottom, 0.345, 0.2)) for bottom in (0.73, 0.43, 0.19))
        self._draw_height(height, obstacle, grid)
        clearance = np.asarray(flight.clearance)
        self._draw_over_time(rate, speed, "Speed [m/s]", flight.radius)
        self._draw_over_time(room, clearance, "Clearance [m]", flight.radius)
        rate.tick_params(labelbottom=False)
        room.set_xlabel("Time [s]")
        _draw_least(room, flight.radius)
        self.curves = [
            (axes.plot([], [], color=ARRIVED, linewidth=1.6)[0], x, y)
            for axes, x, y in (
                (height, self.distance, self.flown[:, 2]),
                (rate, self.time, speed),
                (room, self.time, clearance),
            )
        ]
        self.flagged = rate.text(1.0, 1.12, "", ha="right", va="bottom", fontsize=7, transform=rate.transAxes)
        self.flags = rate.broken_barh(
            [], _FLAG_STRIP, transform=rate.get_xaxis_transform(), color=FLAGGED, clip_on=False
        )
        figure.text(0.07, 0.975, title, va="top", fontsize=9)
        figure.text(0.985, 0.975, f"{fast} times as fast as flown", ha="right", va="top", fontsize=7)
        self.clock = figure.text(0.985, 0.025, "", ha="right", va="bottom", fontsize=8)

    def _draw_map(self, bar: Axes, obstacle: np.ndarray, grid: Grid) -> None:
        """The city from above, and the lines and areas that change."""
        from matplotlib.colors import ListedColormap

        flown, goal, plan = self.flown, self.goal, self.plan
        paths = [look.path for look in self.looks]
        view = lower, upper = square_around(np.concatenate([flown, goal[None], *paths]), grid, AROUND)
        draw_plan(plan, bar, VoxelMap.on(grid, obstacle), view, float(np.median(flown[:, 2])))
        known: dict[str, Any] = {
            "cmap": ListedColormap([KNOWN]),
            "alpha": 0.45,
            "origin": "lower",
            "interpolation": "nearest",
        }
        self.known = plan.imshow(np.zeros((1, 1)), zorder=3, **known)
        self.limits = (lower[0], upper[0]), (lower[1], upper[1])
        (self.scan,) = plan.plot([], [], ",", color=RETURN, zorder=4)
        (self.path,) = plan.plot([], [], zorder=6, **_PLAN_LINE, linewidth=1.6)
        (self.line,) = plan.plot([], [], color=ARRIVED, linewidth=2.0, zorder=7, solid_capstyle="round")
        draw_mark(plan, flown[0, 0], flown[0, 1], dataclasses.replace(_START, label="start"))
        draw_mark(plan, goal[0], goal[1], dataclasses.replace(_GOAL, label="goal"))
        (self.vehicle,) = plan.plot([], [], "o", markersize=6.5, color=ARRIVED, markeredgecolor="white", zorder=10)

    def _draw_height(self, axes: Axes, obstacle: np.ndarray, grid: Grid) -> None:
        """Axes of height over distance, with the ends and the buildings under the flown line."""
        flown, goal = self.flown, self.goal
        self._draw_tops(axes, obstacle, grid)
        (self.planned,) = axes.plot([], [], **_PLAN_LINE, linewidth=1.4)
        length = max(float(self.distance[-1]), 1.0)
        highest = [float(look.path[:, 2].max()) for look in self.looks]
        tallest = max(float(flown[:, 2].max()), float(goal[2]), *highest)
        rest = float(np.linalg.norm(goal - flown[-1]))
        axes.set(xlim=(0.0, 1.03 * (length + rest)), ylim=(0.0, tallest + 6.0))
        axes.set(xlabel="Distance flown [m]", ylabel="Height [m]")
        draw_mark(axes, 0.0, flown[0, 2], _START)
        draw_mark(axes, length + rest, goal[2], _GOAL)

    def _draw_over_time(self, axes: Axes, values: np.ndarray, label: str, radius: float) -> None:
        """Axes of some values over time."""
        top = 1.08 * max(float(values.max()), 2 * radius)
        axes.set(xlim=(0.0, max(float(self.time[-1]), 1.0)), ylim=(0.0, top))
        axes.set_ylabel(label)

    def _draw_tops(self, axes: Axes, obstacle: np.ndarray, grid: Grid) -> None:
        """The caption under the flown line."""
        index = np.floor((self.flown[:, :2] - np.array(grid.lower[:2])) / grid.spacing).astype(int)
        i, j = np.clip(index, 0, np.array(grid.shape[:2]) - 1).T
        centers = grid.origin[2] + grid.spacing * np.arange(grid.shape[2])
        under = obstacle[i, j] & (centers < self.flown[:, 2:])
        top = np.where(under.any(axis=1), np.max(np.where(under, centers + 0.5 * grid.spacing, 0.0), axis=1), 0.0)
        axes.fill_between(self.distance, top, color=HEIGHTS[1], alpha=0.5, step="mid", linewidth=0.0)

    def frame(self, last: int) -> Any:
        """The picture when the vehicle is at a position, as an image of Pillow."""
        from PIL import Image

        number = min(int(np.searchsorted(self.first, last, side="right")) - 1, len(self.looks) - 1)
        look = self.looks[number]
        low = np.asarray(look.lower)
        high = low + look.spacing * np.array(look.known.shape)
        self.known.set_data(np.ma.masked_where(~look.known, np.zeros(look.known.shape)).T)
        self.known.set_extent((low[0], high[0], low[1], high[1]))
        # An image sets the limits of its axes to itself.
        self.plan.set(xlim=self.limits[0], ylim=self.limits[1])
        if not self.moving:  # which the rings on the ground would hide
            self.scan.set_data(*look.scan[:, :2].T)
        self.path.set_data(*look.path[:, :2].T)
        self.line.set_data(*self.flown[: last + 1, :2].T)
        self.vehicle.set_data(*self.flown[[last], :2].T)
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(look.path, axis=0), axis=1))])
        self.planned.set_data(self.distance[min(self.first[number], last)] + along, look.path[:, 2])
        for curve, x, y in self.curves:
            curve.set_data(x[: last + 1], y[: last + 1])
        self.clock.set_text(f"t = {self.time[last]:.1f} s, plan {number + 1}")
        if self.moving:
            self.layer.show(self.moving[last])
            self._show_flags(last)
        self.canvas.draw()
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3].copy())

    def _show_flags(self, last: int) -> None:
        """The time up to a position that something assumed did not hold, and what does not hold there."""
        low, high = _FLAG_STRIP[0], sum(_FLAG_STRIP)
        begins = [k for k in range(last + 1) if self.moving[k].moment.flags]
        ends = self.time[np.minimum(np.array(begins, int) + 1, len(self.time) - 1)]
        spans = zip(self.time[begins], ends, strict=True)
        self.flags.set_verts([np.array([[a, low], [b, low], [b, high], [a, high]]) for a, b in spans])
        names = ", ".join(flag.name.lower().replace("_", " ") for flag in self.moving[last].moment.flags)
        self.flagged.set_text(f"flagged: {names}" if names else "")


def _draw_least(axes: Axes, radius: float) -> None:
    """The least clearance without contact [m]."""
    axes.axhline(radius, color=FAILED, linewidth=1.0, linestyle=(0, (3, 1)))
    style: dict[str, Any] = {"color": FAILED, "ha": "right", "va": "bottom", "fontsize": 7}
    axes.text(axes.get_xlim()[1], radius, f"vehicle, {radius:g} m ", **style)


def _labels(moving: bool) -> list[Any]:
    """The legend of lines and areas that change; `moving`: whether movers are shown."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    scan = Line2D([], [], color=RETURN, marker=".", markersize=3.0, linestyle="", label="scan return")
    return [
        Line2D([], [], color=ARRIVED, linewidth=2.0, label="flown"),
        Line2D([], [], **_PLAN_LINE, linewidth=1.6, label="planned"),
        *([] if moving else [scan]),
        Patch(facecolor=KNOWN, alpha=0.45, label="known as occupied"),
    ]
