"""Figure 5: the worst flights of campaigns, by what they flew over the straight distance."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

import maxjax
from experiments.differentiable.field import city, draw_city, figure
from experiments.paper_figures.slices import draw_legend
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import Outcome
from maxjax.ui.figures import marks, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_HEIGHTS = (3.0, 15.0)  # of the ends, by the protocol [m]


@dataclasses.dataclass(frozen=True)
class Flown:
    """One flight of a campaign: its map, what became of it, its positions [m] and the goal."""

    map: str
    outcome: Outcome
    position: Float[np.ndarray, "t 3"]

    @property
    def detour(self) -> float:
        """Flown length over the straight distance; infinite for a flight that did not arrive."""
        outcome = self.outcome
        if not outcome.arrived or not outcome.flown_length or not outcome.distance:
            return math.inf
        return outcome.flown_length / outcome.distance


def worst_flights(folder: Path, count: int) -> list[Flown]:
    """The worst flights of a campaign's folder: those that did not arrive, then the longest for their distance.

    Raises:
        ValueError: if the folder holds no campaign, or no flight.
    """
    ledger = Ledger.read(folder)
    name, outcomes = str(ledger.configuration["map"]), ledger.outcomes
    found = [
        Flown(name, outcomes[trial], position) for trial, position in ledger.positions().items() if len(position) > 1
    ]
    if not found:
        raise ValueError(f"flights: expected a flight with positions in {folder.name}, given none")
    return sorted(found, key=lambda flight: (-flight.detour, flight.outcome.trial))[:count]


def draw_flights(folders: Sequence[Path], worst: int, file: Path) -> Path:
    """The worst flights from above, a campaign a row; squares at their ends are the larger the higher they are."""
    rows = [worst_flights(folder, worst) for folder in folders]
    columns = max(map(len, rows))
    grid = maxjax.Grid()
    with figure(file, 0.6 + 3.15 * columns, 0.2 + 3.0 * len(rows)) as drawn:
        panels = drawn.subplots(len(rows), columns, squeeze=False, gridspec_kw={"wspace": 0.36, "hspace": 0.32})
        for row, flights in zip(panels, rows, strict=True):
            for axes, flight in zip(row, flights, strict=False):
                obstacle, ground = city(flight.map, flight.outcome.city, grid)
                _draw_flight(axes, flight, obstacle & ~ground, grid)
                axes.set_ylabel("North, y [m]" if axes is row[0] else "")
                if axes is not row[len(flights) - 1]:
                    axes.child_axes[0].set_ylabel("")
            for axes in row[len(flights) :]:
                axes.axis("off")
        draw_legend(drawn, _flight_legend(any(not f.outcome.arrived for some in rows for f in some)))
    return file


def _size(height: float) -> float:
    """Edge of a square [pt] that tells a height [m]."""
    return 4.0 + 5.0 * float(np.clip((height - _HEIGHTS[0]) / (_HEIGHTS[1] - _HEIGHTS[0]), 0.0, 2.0))


def _draw_flight(axes: Axes, flight: Flown, obstacle: np.ndarray, grid: maxjax.Grid) -> None:
    outcome, line = flight.outcome, flight.position.astype(np.float64)
    assert outcome.start is not None
    assert outcome.goal is not None
    start, goal = np.array(outcome.start), np.array(outcome.goal)
    draw_city(axes, obstacle, grid, float(np.median(line[:, 2])), np.stack([*line, start, goal]))
    color = style.ARRIVED if outcome.arrived else style.FAILED
    axes.plot(*np.stack([start, goal])[:, :2].T, color="black", linewidth=0.7, linestyle=(0, (1, 1.5)), zorder=4)
    axes.plot(*line[:, :2].T, color="white", linewidth=3.0, zorder=5, solid_capstyle="round")
    axes.plot(*line[:, :2].T, color=color, linewidth=1.6, zorder=6, solid_capstyle="round")
    for point, face in ((start, "white"), (goal, style.GOAL)):
        marks.draw_mark(axes, point[0], point[1], marks.Mark("s", _size(point[2]), face))
    what = f"{flight.detour:.2f} of the straight line" if outcome.arrived else outcome.status
    axes.set_title(f"{flight.map}, trial {outcome.trial}: {what}", fontsize=8)


def _flight_legend(failed: bool) -> list[Any]:
    from matplotlib.lines import Line2D

    def square(height: float, color: str, label: str) -> Line2D:
        mark = Line2D([], [], marker="s", linestyle="", markersize=_size(height), markerfacecolor=color, label=label)
        mark.set(markeredgecolor="black", markeredgewidth=0.8)
        return mark

    lines = [Line2D([], [], color=style.ARRIVED, linewidth=1.6, label="flown")]
    if failed:
        lines.append(Line2D([], [], color=style.FAILED, linewidth=1.6, label="flown, did not arrive"))
    lines.append(Line2D([], [], color="black", linewidth=0.7, linestyle=(0, (1, 1.5)), label="straight line"))
    low, high = _HEIGHTS
    return [
        *lines,
        square(low, "white", f"start, {low:g} m high"),
        square(high, "white", f"start, {high:g} m high"),
        square((low + high) / 2, style.GOAL, f"goal, {(low + high) / 2:g} m high"),
    ]
