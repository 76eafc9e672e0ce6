"""Figures of missions (extra `viz`): from above, and over time.

from above: the map with the flown way, coloured by clearance, its numbered waypoints and their heights
over time:  height above ground, or z where the map knows no ground; clearance; speed; state of charge, where a battery
            is given; and when waypoints are passed
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.core.grid import Grid
from maxjax.core.status import Closure
from maxjax.core.voxel_map import VoxelMap
from maxjax.energy.charge_profile import ChargeProfile
from maxjax.planning.mission import Mission
from maxjax.trajectories.trajectory import Motion, Trajectory
from maxjax.ui.figures.areas import draw_closed, draw_outside
from maxjax.ui.figures.charge_strip import draw_charge
from maxjax.ui.figures.drawable import drawable, title_with_remark, voxels_to_draw
from maxjax.ui.figures.marks import draw_colored, draw_halo
from maxjax.ui.figures.plan_view import draw_plan, level_of, view_around
from maxjax.ui.figures.style import ARRIVED, EARTH, FAILED, KNOWN, OBSTACLE, STYLE, load_matplotlib
from maxjax.verification.verifier import verify

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_AROUND = 30.0  # of the map, around the mission [m]
_EVERY = 0.1  # [s]
_FAR = 30.0  # clearance above which a figure says no more [m]
# On the page [in]: width of the map, height of a strip over time and of the gap above it.
_WIDTH, _STRIP, _GAP = 5.6, 0.85, 0.14
_LEFT, _RIGHT, _BOTTOM, _BETWEEN, _TOP = 0.75, 1.5, 0.45, 0.72, 0.32
_ASKED = (0, (4, 2))


@dataclasses.dataclass(frozen=True)
class _Course:
    """Samples of a flight, every tenth of a second.

    Attributes:
        motion: position and speed.
        clearance: to obstacles, ground left out [m].
        terrain: height of the ground below [m]; NaN where the map knows none.
        roofs: top of the highest obstacle or ground below [m]; NaN where there is none.
        floor, ceiling: where the airspace that is open around it ends [m]; NaN where it does not.
    """

    motion: Motion
    clearance: Float64[np.ndarray, " t"]
    terrain: Float64[np.ndarray, " t"]
    roofs: Float64[np.ndarray, " t"]
    floor: Float64[np.ndarray, " t"]
    ceiling: Float64[np.ndarray, " t"]

    @property
    def most(self) -> str:
        """The label where more clearance is not shown."""
        return f", to {_FAR:g}" if self.clearance.max() >= _FAR else ""

    @classmethod
    def of(cls, trajectory: Trajectory) -> _Course:
        """The course of a trajectory through the map of its plan."""
        motion, where = trajectory.sampled(_EVERY), trajectory.map.on_host()
        grid, verdict = where.grid, verify(motion.position, where)
        index = np.floor((motion.position - np.array(grid.origin)) / grid.spacing + 0.5).astype(int)
        x, y, z = np.clip(index, 0, np.array(grid.shape) - 1).T
        below = np.arange(grid.shape[2]) <= z[:, None]
        volumes = where.ground, where.occupied, where.shut
        terrain, roofs, floor = (_highest(np.asarray(volume)[x, y] & below, grid) for volume in volumes)
        ceiling = -_highest((np.asarray(where.shut)[x, y] & ~below)[:, ::-1], grid) + grid.lower[2] + grid.upper[2]
        return cls(motion, np.minimum(verdict.clearance_at, _FAR), terrain, roofs, floor, ceiling)


def _highest(columns: Bool[np.ndarray, "t nz"], grid: Grid) -> Float64[np.ndarray, " t"]:
    """Top of the highest voxel of each column [m]; NaN where there is none."""
    top = grid.shape[2] - columns[:, ::-1].argmax(axis=1)
    return np.where(columns.any(axis=1), grid.lower[2] + grid.spacing * top, np.nan)


def figure_mission(
    mission: Mission,
    trajectory: Trajectory,
    title: str | None = None,
    within: Bool[np.ndarray, "nx ny"] | None = None,
    charge: ChargeProfile | None = None,
) -> Figure:
    """A mission from above and over time.

    Args:
        mission: one that is OK.
        trajectory: of it.
        title: headline.
        within: columns of the map that lie within its data; the others are drawn as unknown. None: all do.
        charge: of the battery over the trajectory; None: none is given.

    Raises:
        ImportError: if matplotlib is missing; names the extra.
    """
    rc_context, new_figure = load_matplotlib()
    course = _Course.of(trajectory)
    where, within, remark = drawable(trajectory.map.on_host(), within)
    title = title_with_remark(title, remark)
    view = view_around(where.grid, course.motion.position, _AROUND)
    lower, upper = view
    width, height = _WIDTH * (upper - lower) / (upper - lower).max()
    count = 3 if charge is None else 4
    strips = count * (_STRIP + _GAP)
    size = (_LEFT + _WIDTH + _RIGHT, _BOTTOM + strips + _BETWEEN + height + _TOP)

    def share(left: float, bottom: float, wide: float, high: float) -> tuple[float, float, float, float]:
        return left / size[0], bottom / size[1], wide / size[0], high / size[1]

    with rc_context(STYLE):
        figure = new_figure(figsize=size)
        base = _BOTTOM + strips + _BETWEEN
        plan = figure.add_axes(share(_LEFT, base, width, height))
        half = 0.5 * (height - 0.2)
        bars = [
            figure.add_axes(share(_LEFT + width + 0.12, base + k * (half + 0.2), 0.1, min(half, 1.8))) for k in (1, 0)
        ]
        altitude = float(np.median(course.motion.position[:, 2]))
        draw_plan(plan, bars[0], voxels_to_draw(where, within), view, altitude)
        if within is not None:
            draw_outside(plan, within, where.grid)
        draw_closed(plan, _closed_columns(where, course), where.grid)
        _draw_way(plan, bars[1], course, trajectory.passes)
        _draw_waypoints(plan, mission)
        bottoms = [_BOTTOM + k * (_STRIP + _GAP) for k in reversed(range(count))]
        over = [figure.add_axes(share(_LEFT, bottom, _WIDTH, _STRIP)) for bottom in bottoms]
        _draw_height(over[0], course)
        _draw_clearance(over[1], course, mission, trajectory)
        _draw_speed(over[2], course, mission, trajectory)
        if charge is not None:
            draw_charge(over[3], [charge], [ARRIVED])
        over[-1].set_xlabel("Time [s]")
        _draw_passes(over, mission, trajectory)
        if title:
            figure.suptitle(title, x=_LEFT / size[0], y=1 - 0.1 / size[1], ha="left", va="top", fontsize=9)
        plan.legend(loc="upper left", bbox_to_anchor=(0.0, -0.38 / height), borderaxespad=0.0, ncols=3)
    return figure


def _closed_columns(where: VoxelMap, course: _Course) -> Bool[np.ndarray, "nx ny"]:
    """Columns that an area closes, somewhere between the lowest and the highest that is flown."""
    if where.closed is None:
        return np.zeros(where.grid.shape[:2], bool)
    z = course.motion.position[:, 2]
    levels = slice(level_of(where.grid, float(z.min())), level_of(where.grid, float(z.max())) + 1)
    found: Bool[np.ndarray, "nx ny"] = np.any(np.asarray(where.closed)[:, :, levels] == Closure.AREA, axis=2)
    return found


def _draw_way(axes: Axes, bar: Axes, course: _Course, passes: Float64[np.ndarray, " w"]) -> None:
    """The way, coloured by clearance, with an arrow in the middle of each leg."""
    x, y, _ = course.motion.position.T
    for k in np.searchsorted(course.motion.time, 0.5 * (passes[1:] + passes[:-1])).tolist():
        head = {"arrowstyle": "-|>", "color": "black", "mutation_scale": 9.0, "linewidth": 0.0}
        after = min(k + 5, len(x) - 1)
        axes.annotate("", (x[after], y[after]), (x[max(k - 5, 0)], y[max(k - 5, 0)]), arrowprops=head, zorder=9)
    draw_halo(axes, x, y, 1.8)
    line = draw_colored(axes, x, y, course.clearance, (0.0, max(float(course.clearance.max()), 1.0)))
    axes.figure.colorbar(line, cax=bar, label=f"Clearance [m]{course.most}")


def _draw_waypoints(axes: Axes, mission: Mission) -> None:
    """Numbers and heights; of places that are visited more than once, all numbers."""
    names: dict[tuple[float, ...], list[str]] = {}
    for k, waypoint in enumerate(mission.waypoints):
        names.setdefault(waypoint.position, []).append(str(k))
    middle = 0.5 * sum(axes.get_xlim())
    for (x, y, z), numbers in names.items():
        east = x > middle  # then to the left, as the frame is near on the right
        axes.annotate(
            f"{', '.join(numbers)}:  z {z:.0f} m",
            (x, y),
            textcoords="offset points",
            xytext=(-6 if east else 6, 6),
            ha="right" if east else "left",
            fontsize=7,
            zorder=11,
            bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": "black", "linewidth": 0.5},
        )
        axes.plot(x, y, "o", markersize=5.5, markerfacecolor="white", markeredgecolor="black", zorder=10)


def _draw_height(axes: Axes, course: _Course) -> None:
    """Height above ground, and what stands below; z where the map knows no ground anywhere below."""
    time, z = course.motion.time, course.motion.position[:, 2]
    known = np.isfinite(course.terrain).all()
    zero = course.terrain if known else np.zeros_like(z)
    roofs = course.roofs - zero
    if known:
        axes.axhspan(-0.06 * float((z - zero).max()), 0.0, color=EARTH, linewidth=0.0, label="ground")
    floor = 0.0 if known else float(np.nanmin([*roofs, *z])) - 2.0
    axes.fill_between(time, floor, roofs, color=OBSTACLE, linewidth=0.0, step="mid", label="obstacle below")
    axes.plot(time, z - zero, color=ARRIVED, linewidth=1.2)
    top = float((z - zero).max())
    for limit in (course.floor, course.ceiling):
        # A ceiling far above is left out, since it would flatten the rest.
        if np.isfinite(limit).any() and np.nanmin(limit - zero) < 2.0 * top:
            top = max(top, float(np.nanmin(limit - zero)))
            axes.plot(
                time, limit - zero, color=FAILED, linewidth=0.9, linestyle=_ASKED, label=_once(axes, "open airspace")
            )
    axes.set_ylim(-0.06 * top if known else floor, top + 0.15 * max(top - floor, 5.0))
    axes.set_ylabel("Height above\nground [m]" if known else "Height, z [m]")


def _once(axes: Axes, label: str) -> str | None:
    """A label, where the legend has it not."""
    return None if label in axes.get_legend_handles_labels()[1] else label


def _draw_clearance(axes: Axes, course: _Course, mission: Mission, trajectory: Trajectory) -> None:
    axes.plot(course.motion.time, course.clearance, color=ARRIVED, linewidth=1.2)
    kept = [leg.radius for leg in mission.legs]
    axes.step(trajectory.passes, [*kept, kept[-1]], where="post", color=FAILED, linewidth=0.9, linestyle=_ASKED)
    axes.lines[-1].set_label("radius")
    axes.set_ylim(0.0, 1.15 * max(float(course.clearance.max()), 2.0 * max(kept)))
    axes.set_ylabel(f"Clearance\n[m]{course.most}")


def _draw_speed(axes: Axes, course: _Course, mission: Mission, trajectory: Trajectory) -> None:
    axes.plot(course.motion.time, np.linalg.norm(course.motion.velocity, axis=1), color=ARRIVED, linewidth=1.2)
    most = trajectory.limits.speed
    asked = [min(waypoint.speed or most, most) for waypoint in mission.waypoints[1:]]
    axes.step(trajectory.passes, [*asked, asked[-1]], where="post", color=FAILED, linewidth=0.9, linestyle=_ASKED)
    axes.lines[-1].set_label("greatest, by leg")
    axes.set_ylim(0.0, 1.15 * max(asked))
    axes.set_ylabel("Speed\n[m/s]")


def _draw_passes(over: list[Axes], mission: Mission, trajectory: Trajectory) -> None:
    """Where waypoints are passed, by their numbers, and hovered at; and the legends."""
    for axes in over:
        for time, waypoint in zip(trajectory.passes, mission.waypoints, strict=True):
            axes.axvline(time, color="black", linewidth=0.5, zorder=1)
            if waypoint.hover:
                label = _once(axes, "hover") if axes is over[0] else None
                axes.axvspan(time, time + waypoint.hover, color=KNOWN, alpha=0.35, linewidth=0.0, label=label)
        axes.set_xlim(0.0, trajectory.duration)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelbottom=axes is over[-1])
        if axes.get_legend_handles_labels()[1]:
            axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), borderaxespad=0.0)
    free = -np.inf
    for number, time in enumerate(trajectory.passes):
        if time - free > 0.02 * trajectory.duration:
            over[0].text(time, over[0].get_ylim()[1], str(number), ha="center", va="bottom", fontsize=7)
            free = time
