"""Pictures of flights (extra `viz`): many of them over their city, and one of them as a film.

    bird's-eye view: top of the highest obstacle in each column [m], flown lines from above
    film:            left the city, what the vehicle knows of it, its plan and its line; right height, speed and
                     clearance over time

Flights that arrived and flights that did not differ in colour, in line style and in a number at their end.
"""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from maxjax.core.grid import Grid
from maxjax.viz.figures import HEIGHTS, RETURN, STYLE, draw_mark, draw_plan, load_matplotlib

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

ARRIVED, FAILED, _PLANNED, _KNOWN, GOAL = "#0072B2", "#D55E00", "#009E73", "#56B4E9", "#F0E442"
_MEANT = (ARRIVED, FAILED, _PLANNED, GOAL)
_AROUND = 15.0  # map shown around the flights [m]
_RATE = 10  # frames a second in a film
_STEP = 0.1  # between two positions [s]
_SIZE = (9.6, 5.4)  # of a film [in]
_DOTS = 100  # an inch
_COLORS = 64
_LARGEST = 6_000_000  # [B]
_FRAMES = 160


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


def figure_flights(
    obstacle: Bool[np.ndarray, "nx ny nz"],
    grid: Grid,
    flown: Mapping[int, Float[np.ndarray, "_ 3"]],
    goals: Mapping[int, Float[np.ndarray, "3"]],
    failed: Mapping[int, str],
    *,
    title: str | None = None,
    caption: str | None = None,
) -> Figure:
    """All flights over one city, from above.

    Args:
        obstacle: the city without its ground.
        grid: where its voxels lie.
        flown: positions (t, 3) [m] by trial, the start first.
        goals: [m] by trial.
        failed: what became of those that did not arrive.
        title: headline.
        caption: line below the legend.

    Raises:
        ValueError: if the city does not fit the grid, or there is no flight.
        ImportError: if matplotlib is missing; names the extra.
    """
    rc_context, new_figure = load_matplotlib()
    grid.check_volume("obstacle", obstacle)
    if not flown:
        raise ValueError("flown: expected at least one flight, given none")
    points = np.concatenate([*flown.values(), *(goals[trial][None] for trial in flown)])
    lower, upper = _square(points, grid)
    with rc_context(STYLE):
        figure = new_figure(figsize=(7.2, 7.0))
        plan, bar = figure.add_axes((0.09, 0.17, 0.76, 0.78)), figure.add_axes((0.875, 0.17, 0.018, 0.4))
        draw_plan(plan, bar, obstacle, grid, (lower, upper), float(np.median(points[:, 2])))
        wide = 1.6 if len(flown) < 5 else 1.0
        for trial, exact in flown.items():
            line = exact.astype(np.float64)
            goal = goals[trial].astype(np.float64)
            bad = trial in failed
            color, dashes = (FAILED, (0, (3, 1))) if bad else (ARRIVED, "-")
            plan.plot(*line[:, :2].T, color="white", linewidth=wide + 1.2, zorder=5, solid_capstyle="round")
            plan.plot(*line[:, :2].T, color=color, linewidth=wide + 0.3 * bad, linestyle=dashes, zorder=6 + bad)
            draw_mark(plan, line[0, 0], line[0, 1], "o", 3.6, "white", None)
            draw_mark(plan, goal[0], goal[1], "*", 6.5, GOAL, None)
            if bad:
                draw_mark(plan, line[-1, 0], line[-1, 1], "X", 5.5, FAILED, None)
                plan.annotate(
                    str(trial),
                    (float(line[-1, 0]), float(line[-1, 1])),
                    textcoords="offset points",
                    xytext=(5, 4),
                    color="black",
                    weight="bold",
                    zorder=11,
                    bbox={"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": FAILED, "linewidth": 0.6},
                )
        figure.legend(
            handles=_legend(len(flown) - len(failed), failed) + plan.get_legend_handles_labels()[0],
            loc="upper center",
            bbox_to_anchor=(0.5, 0.11),
            ncols=3,
        )
        if title:
            figure.suptitle(title, x=0.47, y=0.985, va="top", fontsize=9)
        if caption:
            figure.text(0.47, 0.012, caption, ha="center", va="bottom", fontsize=7)
    return figure


def _legend(arrived: int, failed: Mapping[int, str]) -> list[Line2D]:
    from matplotlib.lines import Line2D

    def mark(marker: str, size: float, color: str, label: str) -> Line2D:
        drawn = Line2D([], [], marker=marker, markersize=size, markerfacecolor=color, linestyle="", label=label)
        drawn.set(markeredgecolor="black", markeredgewidth=0.8)
        return drawn

    lines = [mark("o", 4.5, "white", "start"), mark("*", 8.0, GOAL, "goal")]
    if arrived:
        lines.append(Line2D([], [], color=ARRIVED, linewidth=1.6, label=f"flown, arrived ({arrived})"))
    if failed:
        dashed = Line2D([], [], color=FAILED, linewidth=1.6, linestyle=(0, (3, 1)))
        dashed.set_label(f"flown, failed ({len(failed)}), with its trial")
        lines += [dashed, mark("X", 5.5, FAILED, "end of a failed flight")]
    return lines


def _square(points: Float[np.ndarray, "n 3"], grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the square part of the map around these points, inside the grid."""
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    half = min(0.5 * float((high - low).max()) + _AROUND, 0.5 * float(np.min(np.subtract(grid.upper, grid.lower)[:2])))
    middle = np.clip(0.5 * (low + high), np.array(grid.lower[:2]) + half, np.array(grid.upper[:2]) - half)
    return middle - half, middle + half


def film_flight(
    looks: Sequence[Look],
    obstacle: Bool[np.ndarray, "nx ny nz"],
    grid: Grid,
    goal: Float[np.ndarray, "3"],
    clearance: Float[np.ndarray, " t"],
    *,
    radius: float,
    title: str,
) -> bytes:
    """One flight as an animated GIF of 10 frames a second and at most 6 MB.

    Args:
        looks: its planning periods, in order; the first one's first position is the start.
        obstacle: the true city without its ground.
        grid: where its voxels lie.
        goal: [m].
        clearance: to the nearest solid at each position of all looks [m].
        radius: that the clearance must exceed [m].
        title: headline.

    Raises:
        ValueError: without any position.
        ImportError: if matplotlib is missing; names the extra.
    """
    rc_context, _ = load_matplotlib()
    flown = np.concatenate([look.flown for look in looks]) if looks else np.zeros((0, 3))
    if len(flown) == 0 or len(clearance) != len(flown):
        raise ValueError(f"looks: expected positions, each with a clearance, given {len(flown)} and {len(clearance)}")
    flown, goal = flown.astype(np.float64), goal.astype(np.float64)
    stride = max(2, -(-len(flown) // _FRAMES))
    shown = [*range(0, len(flown) - 1, stride), len(flown) - 1]
    with rc_context(STYLE):
        film = _Film(looks, flown, obstacle, grid, goal, clearance, radius, f"{title}, shown {stride} times as fast")
        frames = [film.frame(last) for last in shown]
    while len(content := _gif(frames)) > _LARGEST and len(frames) > 2:
        frames = [*frames[:-1:2], frames[-1]]
    return content


def _gif(frames: list[Any]) -> bytes:
    """Frames with one palette between them, without dithering, which would make each new to the last pixel."""
    from PIL import Image

    # Colours that mean something are in the palette however little they cover.
    meant = [[int(color[at : at + 2], 16) for at in (1, 3, 5)] for color in (*_MEANT, "#FFFFFF")]
    common = frames[len(frames) // 2].quantize(_COLORS - len(meant)).getpalette()
    palette = np.concatenate([meant, np.reshape(common, (-1, 3))[: _COLORS - len(meant)]])
    # The nearest of them for each colour of five bits a channel; what means something has its own.
    bits = np.stack(np.unravel_index(np.arange(2**15), (32, 32, 32)), -1)
    nearest = np.argmin(((8 * bits + 4)[:, None] - palette) ** 2 @ np.ones(3), axis=1).astype(np.uint8)
    nearest[np.ravel_multi_index(tuple(np.asarray(meant).T // 8), (32, 32, 32))] = np.arange(len(meant))
    plain = []
    for frame in frames:
        index = np.asarray(frame).astype(np.int32) // 8 @ np.array([1024, 32, 1])
        plain.append(Image.fromarray(nearest[index]))
        plain[-1].putpalette(palette.astype(np.uint8).tobytes())
    buffer = io.BytesIO()
    # The last one stays for two seconds.
    lasts = [1000 // _RATE] * (len(plain) - 1) + [2000]
    plain[0].save(buffer, "GIF", save_all=True, append_images=plain[1:], duration=lasts, loop=0, optimize=False)
    return buffer.getvalue()


class _Film:
    """The figure whose frames are drawn one after the other; only what changes is set anew."""

    def __init__(
        self,
        looks: Sequence[Look],
        flown: np.ndarray,
        obstacle: np.ndarray,
        grid: Grid,
        goal: np.ndarray,
        clearance: np.ndarray,
        radius: float,
        title: str,
    ) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.colors import ListedColormap

        _, new_figure = load_matplotlib()
        self.looks, self.flown = looks, flown
        self.first = np.cumsum([0, *(len(look.flown) for look in looks)])
        self.time = _STEP * np.arange(len(flown))
        moved = np.linalg.norm(np.diff(flown, axis=0), axis=1)
        self.distance = np.concatenate([[0.0], np.cumsum(moved)])
        # The last position is that of the end, sooner than a step after the one before.
        speed = np.concatenate([[0.0], moved[:-1] / _STEP, moved[-2:-1] / _STEP])[: len(flown)]
        figure = new_figure(figsize=_SIZE)
        self.canvas: Any = FigureCanvasAgg(figure)

        bar, plan = figure.add_axes((0.505, 0.2, 0.01, 0.36)), figure.add_axes((0.065, 0.2, 0.4275, 0.76))
        self.plan = plan
        paths = [look.path for look in looks]
        lower, upper = _square(np.concatenate([flown, goal[None], *paths]), grid)
        draw_plan(plan, bar, obstacle, grid, (lower, upper), float(np.median(flown[:, 2])))
        self.known = plan.imshow(
            np.zeros((1, 1)),
            cmap=ListedColormap([_KNOWN]),
            alpha=0.45,
            origin="lower",
            interpolation="nearest",
            zorder=3,
        )
        self.limits = (lower[0], upper[0]), (lower[1], upper[1])
        (self.scan,) = plan.plot([], [], ",", color=RETURN, zorder=4)
        (self.path,) = plan.plot([], [], color=_PLANNED, linewidth=1.6, linestyle=(0, (4, 1.2)), zorder=6)
        (self.line,) = plan.plot([], [], color=ARRIVED, linewidth=2.0, zorder=7, solid_capstyle="round")
        draw_mark(plan, flown[0, 0], flown[0, 1], "o", 5.5, "white", "start")
        draw_mark(plan, goal[0], goal[1], "*", 10.0, GOAL, "goal")
        (self.here,) = plan.plot([], [], "o", markersize=6.5, color=ARRIVED, markeredgecolor="white", zorder=10)
        figure.legend(
            handles=[*self._labels(), *plan.get_legend_handles_labels()[0]],
            loc="upper left",
            bbox_to_anchor=(0.03, 0.115),
            ncols=4,
            fontsize=7,
            columnspacing=1.4,
        )

        height, rate, room = (figure.add_axes((0.615, bottom, 0.37, 0.21)) for bottom in (0.72, 0.41, 0.17))
        self._draw_tops(height, obstacle, grid)
        (self.ahead,) = height.plot([], [], color=_PLANNED, linewidth=1.4, linestyle=(0, (4, 1.2)))
        length = max(float(self.distance[-1]), 1.0)
        tallest = max(float(flown[:, 2].max()), float(goal[2]), *(float(path[:, 2].max()) for path in paths))
        rest = float(np.linalg.norm(goal - flown[-1]))
        height.set(xlim=(0.0, 1.03 * (length + rest)), ylim=(0.0, tallest + 6.0))
        height.set(xlabel="Distance flown [m]", ylabel="Height [m]")
        draw_mark(height, 0.0, flown[0, 2], "o", 5.5, "white", None)
        draw_mark(height, length + rest, goal[2], "*", 10.0, GOAL, None)
        for axes, values, label in ((rate, speed, "Speed [m/s]"), (room, clearance, "Clearance [m]")):
            axes.set(
                xlim=(0.0, max(float(self.time[-1]), 1.0)), ylim=(0.0, 1.08 * max(float(values.max()), 2 * radius))
            )
            axes.set_ylabel(label)
        rate.tick_params(labelbottom=False)
        room.set_xlabel("Time [s]")
        room.axhline(radius, color=FAILED, linewidth=1.0, linestyle=(0, (3, 1)))
        room.text(
            room.get_xlim()[1], radius, f"vehicle, {radius:g} m ", color=FAILED, ha="right", va="bottom", fontsize=7
        )
        self.curves = [
            (axes.plot([], [], color=ARRIVED, linewidth=1.6)[0], x, y)
            for axes, x, y in (
                (height, self.distance, flown[:, 2]),
                (rate, self.time, speed),
                (room, self.time, np.asarray(clearance)),
            )
        ]
        figure.text(0.5, 0.985, title, ha="center", va="top", fontsize=9)
        self.clock = figure.text(0.985, 0.02, "", ha="right", va="bottom", fontsize=8)

    def _labels(self) -> list[Any]:
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch

        return [
            Line2D([], [], color=ARRIVED, linewidth=2.0, label="flown"),
            Line2D([], [], color=_PLANNED, linewidth=1.6, linestyle=(0, (4, 1.2)), label="planned"),
            Line2D([], [], color=RETURN, marker=".", markersize=3.0, linestyle="", label="scan return"),
            Patch(facecolor=_KNOWN, alpha=0.45, label="known as occupied"),
        ]

    def _draw_tops(self, axes: Axes, obstacle: np.ndarray, grid: Grid) -> None:
        """What stands under the flown line."""
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
        self.scan.set_data(*look.scan[:, :2].T)
        self.path.set_data(*look.path[:, :2].T)
        self.line.set_data(*self.flown[: last + 1, :2].T)
        self.here.set_data(*self.flown[[last], :2].T)
        along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(look.path, axis=0), axis=1))])
        self.ahead.set_data(self.distance[min(self.first[number], last)] + along, look.path[:, 2])
        for curve, x, y in self.curves:
            curve.set_data(x[: last + 1], y[: last + 1])
        self.clock.set_text(f"t = {self.time[last]:.1f} s, plan {number + 1}")
        self.canvas.draw()
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3].copy())
