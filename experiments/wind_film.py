"""A film: one trajectory flown in a strong wind, by time alone and by a clock that waits.

    python -m experiments.wind_film     # the round of docs/samples in twelve winds; two minutes on two CPU cores

The mission of docs/samples/round.toml is given times within 8 m/s, 2 m/s² and 4 m/s³ and flown in MJX in winds of one
speed and random directions, with gusts, by a vehicle that leans 25° at most (`experiments.follower`). Filmed is the
wind in which time alone strays furthest, and the flight by `maxjax.Follower` in that same wind beside it. A vehicle of
the simulation flies on through what it touches: then its line is red.

top:    both flights from above, the set-point of the present time as a ring
middle: their heights, in the section through the city that the planned line is
bottom: distances to the planned line, over time
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import cKDTree

import maxjax
from benchmarks.common.command import configured
from maxjax.core.files import atomic_write
from maxjax.sim.loop.flight_air import air_of
from maxjax.sim.loop.trajectory_flight import follow_setpoints, summarize_tracking
from maxjax.sim.loop.waiting_flight import follow_waiting
from maxjax.sim.vehicle.controller import Controller
from maxjax.sim.vehicle.quadrotor import Vehicle
from maxjax.ui.figures.gif import RATE, animation
from maxjax.ui.figures.plan_view import draw_plan, view_around
from maxjax.ui.figures.section import draw_section, horizontal_distance, section_along
from maxjax.ui.figures.style import ARRIVED, FAILED, FLAGGED, PLANNED, RETURN, STYLE, load_matplotlib

_SIZE = (9.6, 7.0)  # [in]
_DOTS = 80  # an inch
_FRAMES = 105
_PLAN_LINE: dict[str, Any] = {"color": PLANNED, "linewidth": 1.4, "linestyle": (0, (4, 1.2)), "zorder": 5}
_RING: dict[str, Any] = {
    "marker": "o", "markersize": 8.0, "markerfacecolor": "none", "markeredgecolor": FLAGGED, "markeredgewidth": 1.6,
    "linestyle": "",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        mission: file of the mission.
        wind: mean speed [m/s].
        winds: directions that are drawn.
        tolerance: of the follower [m].
        tilt: the most that the vehicle leans [deg].
        seed: of the winds.
        since: where the film begins [s].
        out: file of the film.
    """

    mission: Path = Path("docs/samples/round.toml")
    wind: float = 10.0
    winds: int = 12
    tolerance: float = 1.0
    tilt: float = 25.0
    seed: int = 0
    since: float = 75.0
    out: Path = Path("docs/wind.gif")


TINY = Config(winds=1)


class Filmed(NamedTuple):
    """A flight.

    Attributes:
        time, position: [s], [m].
        clock: the plan's time then [s].
        along: time of the nearest place of the plan, of the part that is filmed [s].
        aside: distance to the plan [m].
        contact: whether something is within the vehicle's radius.
    """

    time: np.ndarray
    position: np.ndarray
    clock: np.ndarray
    along: np.ndarray
    aside: np.ndarray
    contact: np.ndarray


def main(config: Config) -> tuple[Filmed, Filmed]:
    """Fly and draw; both flights."""
    asked = _trajectory(config)
    how = config.wind, config.seed, Vehicle(), Controller(tilt=config.tilt)
    timed = follow_setpoints([asked] * config.winds, *how)
    worst = int(np.argmax([_strays(asked, *one[:2]) for one in timed]))
    waited = follow_waiting([asked] * config.winds, maxjax.Follower(config.tolerance), *how)[worst]
    by_time = *timed[worst], timed[worst][0]  # whose clock is the time
    flights = _filmed(asked, config.since, by_time), _filmed(asked, config.since, waited)
    keys = jax.random.split(jax.random.key(config.seed), config.winds)
    mean = np.asarray(air_of(jnp.float32(config.wind), keys[worst]).mean)
    config.out.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(config.out, _film(asked, flights, mean[:2], config))
    return flights


def _trajectory(config: Config) -> maxjax.Trajectory:
    request = maxjax.load_mission(config.mission)
    city = maxjax.load_map(request.map)
    mission = maxjax.plan_mission(city, request.flown, distances=request.distances)
    return maxjax.trajectory(mission, maxjax.FlightLimits(speed=8.0, acceleration=2.0, jerk=4.0))


def _strays(asked: maxjax.Trajectory, time: np.ndarray, position: np.ndarray) -> float:
    """The greatest distance to the set-point of the same time [m]."""
    return float(np.linalg.norm(position - asked.at(time).position, axis=1).max())


def _filmed(asked: maxjax.Trajectory, since: float, flown: Sequence[object]) -> Filmed:
    """What is drawn of a flight: its times, positions, velocities and the times of its clock."""
    time, position, velocity, clock = map(np.asarray, flown)
    times = np.arange(0.0, asked.duration, 0.01)
    line = asked.at(times).position
    shown = times >= since
    aside = np.asarray(cKDTree(line).query(position)[0])
    nearest = cKDTree(line[shown]).query(position)[1]
    touched = summarize_tracking(asked, time, position, velocity, asked.map, clock).contact
    return Filmed(time, position, clock, times[shown][nearest], aside, touched)


def _film(asked: maxjax.Trajectory, flights: tuple[Filmed, Filmed], wind: np.ndarray, config: Config) -> bytes:
    rc_context, _ = load_matplotlib()
    last = max(one.time[-1] for one in flights)
    with rc_context(STYLE):
        film = _Film(asked, flights, wind, config)
        frames = [film.frame(now) for now in np.linspace(config.since, last, _FRAMES)]
    return animation(frames, (ARRIVED, FAILED, PLANNED, FLAGGED))


class _Film:
    """The figure whose frames are drawn one after the other; only what changes is set anew."""

    def __init__(
        self, asked: maxjax.Trajectory, flights: tuple[Filmed, Filmed], wind: np.ndarray, config: Config
    ) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        _, new_figure = load_matplotlib()
        self.asked, self.flights, self.config = asked, flights, config
        self.end = max(one.time[-1] for one in flights)
        figure = new_figure(figsize=_SIZE, dpi=_DOTS)
        self.canvas: Any = FigureCanvasAgg(figure)
        names = "by time alone", f"by a clock that waits, tolerance {config.tolerance:g} m"
        self.moving = []
        for k, (name, flight) in enumerate(zip(names, flights, strict=True)):
            left = 0.06 + 0.475 * k
            above, side = figure.add_axes((left, 0.5, 0.455, 0.41)), figure.add_axes((left, 0.295, 0.455, 0.14))
            above.set_title(name, fontsize=9, loc="left")
            self._draw_map(above, wind)
            course = self._draw_side(side)
            self.moving.append((flight, course, _lines(above), _lines(side)))
            if k:
                above.set(ylabel="", yticklabels=[])
                side.set(ylabel="", yticklabels=[])
        self.curves = self._draw_distances(figure.add_axes((0.06, 0.06, 0.93, 0.12)), names)
        figure.text(0.06, 0.975, self._title(), va="top", fontsize=9)
        fast = RATE * (self.end - config.since) / (_FRAMES - 1)
        figure.text(0.99, 0.975, f"{fast:.0f} times as fast as flown", ha="right", va="top", fontsize=7)
        self.clock = figure.text(0.99, 0.2, "", ha="right", va="bottom", fontsize=8)
        figure.legend(handles=_labels(), loc="lower left", bbox_to_anchor=(0.05, 0.187), ncols=4, fontsize=7)

    def _title(self) -> str:
        config = self.config
        which = "" if config.winds == 1 else f", of {config.winds} directions the one in which time alone strays most"
        return f"{config.mission.name} at up to {self.asked.limits.speed:g} m/s in {config.wind:g} m/s of wind{which}"

    def _draw_map(self, axes: Any, wind: np.ndarray) -> None:
        """The city from above, the plan and the wind."""
        both = np.concatenate([one.position for one in self.flights])
        view = view_around(self.asked.map.grid, both, 12.0)
        bar = axes.figure.add_axes((0.0, 0.0, 0.01, 0.01))
        draw_plan(axes, bar, self.asked.map, view, float(np.median(both[:, 2])))
        bar.remove()
        axes.plot(*self.asked.at(np.arange(0.0, self.asked.duration, 0.1)).position.T[:2], **_PLAN_LINE)
        middle, along = np.array([0.92, 0.86]), 0.055 * wind / np.linalg.norm(wind)
        arrow = {"arrowstyle": "-|>", "linewidth": 1.6, "color": "black", "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", middle + along, middle - along, xycoords="axes fraction", arrowprops=arrow, zorder=11)
        axes.text(0.92, 0.95, "wind", ha="center", va="center", transform=axes.transAxes, fontsize=7, zorder=11)

    def _draw_side(self, axes: Any) -> tuple[np.ndarray, np.ndarray]:
        """The section along the plan; times, and horizontal distances along it since the film began [m]."""
        where, times = self.asked.map, np.arange(self.config.since, self.asked.duration, 0.1)
        line = self.asked.at(times).position
        section = section_along(np.asarray(where.occupied), np.asarray(where.ground), where.grid, line)
        draw_section(axes, section, where.grid)
        axes.set(xlabel="Along the plan [m]", ylabel="Height [m]")
        course = horizontal_distance(line)
        axes.plot(course, line[:, 2], **_PLAN_LINE)
        return times, course

    def _draw_distances(self, axes: Any, names: tuple[str, str]) -> list[tuple[Any, Filmed]]:
        top = 1.1 * max(float(one.aside.max()) for one in self.flights)
        axes.set(xlim=(self.config.since, self.end), ylim=(0.0, top), xlabel="Time [s]", ylabel="Off the\nplan [m]")
        styles: Any = ({"color": RETURN, "linestyle": (0, (5, 1.5))}, {"color": ARRIVED, "linestyle": "-"})
        lines = [
            axes.plot([], [], linewidth=1.6, label=name, **style)[0] for name, style in zip(names, styles, strict=True)
        ]
        axes.legend(loc="upper left", fontsize=7)
        return list(zip(lines, self.flights, strict=True))

    def frame(self, now: float) -> Any:
        """The picture at a time [s], as an image of Pillow."""
        from PIL import Image

        for flight, course, above, side in self.moving:
            last = min(int(np.searchsorted(flight.time, now, side="right")), len(flight.time)) - 1
            first = int(np.searchsorted(flight.time, self.config.since))
            clock, hits = flight.clock[last], flight.contact[: last + 1]
            target = self.asked.at([clock]).position[0]
            _show(above, flight.position[: last + 1, :2], hits, target[:2])
            flown = np.stack([np.interp(flight.along, *course), flight.position[:, 2]], axis=1)[first : last + 1]
            _show(side, flown, hits[first:], np.array([np.interp(clock, *course), target[2]]))
        for line, flight in self.curves:
            shown = flight.time <= now
            line.set_data(flight.time[shown], flight.aside[shown])
        self.clock.set_text(f"t = {now:.0f} s")
        self.canvas.draw()
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3].copy())


def _lines(axes: Any) -> tuple[Any, ...]:
    """What changes in a picture of a flight."""
    (flown,) = axes.plot([], [], color=ARRIVED, linewidth=2.0, zorder=7, solid_capstyle="round")
    (touched,) = axes.plot([], [], color=FAILED, linewidth=3.5, zorder=8, solid_capstyle="round")
    (behind,) = axes.plot([], [], color=FLAGGED, linewidth=1.2, zorder=9)
    (target,) = axes.plot([], [], zorder=9, **_RING)
    (vehicle,) = axes.plot([], [], "o", markersize=6.5, color=ARRIVED, markeredgecolor="white", zorder=10)
    return flown, touched, behind, target, vehicle


def _show(lines: tuple[Any, ...], track: np.ndarray, hits: np.ndarray, target: np.ndarray) -> None:
    """A track (t, 2) up to now, where it touches something, and the set-point."""
    flown, touched, behind, ring, vehicle = lines
    flown.set_data(*track.T)
    touched.set_data(*np.where(hits[:, None], track, np.nan).T)
    behind.set_data(*np.stack([track[-1], target], axis=1))
    ring.set_data(*target[:, None])
    vehicle.set_data(*track[-1][:, None])


def _labels() -> list[Any]:
    """The legend of both pictures."""
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], **_PLAN_LINE, label="planned"),
        Line2D([], [], color=ARRIVED, linewidth=2.0, label="flown"),
        Line2D([], [], color=FAILED, linewidth=3.5, label="flown within 0.5 m of something"),
        Line2D([], [], **_RING, label="set-point of its clock"),
    ]


if __name__ == "__main__":
    main(configured(TINY))
