"""A picture: the four heights of one point of a flight, and what a wrong home would do.

    python -m experiments.heights_picture     # a section, drawn; a second

On the left z of the map, height above sea level, above ground and above home of one point; on the right what a vehicle
flies that reads its heights above a home that its file puts 13 m too high.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.command import configured
from maxjax.ui.figures.style import EARTH, FAILED, FIELD, OBSTACLE, PLANNED, STYLE, load_matplotlib, save_figure

_START, _POINT, _GOAL = 20.0, 70.0, 155.0  # along the section [m]
_UP, _ROOF, _SUNK = 38.0, 27.0, 13.0  # of the way, of a roof, and of what is wrong [m]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        out: file of the picture.
    """

    out: Path = Path("docs/figures/heights.png")


TINY = Config()


def main(config: Config) -> None:
    """Draw the picture."""
    rc_context, new_figure = load_matplotlib()
    with rc_context(STYLE):
        figure = new_figure(figsize=(7.4, 3.5), facecolor="white")
        axes = figure.add_axes((0.07, 0.13, 0.91, 0.84))
        x = np.linspace(0.0, 175.0, 351)
        ground = _ground(x)
        axes.fill_between(x, -14.0, ground, color=EARTH, linewidth=0, zorder=1)
        axes.plot(x, ground, color="#7A6437", linewidth=1.0, zorder=2)
        for left, right, top in ((98.0, 116.0, _ROOF), (126.0, 140.0, 22.0)):
            low = float(_ground(np.array([left, right])).min())
            axes.fill_between([left, right], low, top, color=OBSTACLE, linewidth=0, zorder=3)
        foot = float(_ground(np.array([_START]))[0])
        way = np.array([_START, _START, _GOAL, _GOAL]), np.array([foot, _UP, _UP, float(_ground(np.array([_GOAL]))[0])])
        axes.plot(*way, color=PLANNED, linewidth=1.8, zorder=5)
        axes.plot(way[0][1:3], way[1][1:3] - _SUNK, color=FAILED, linewidth=1.5, linestyle=(0, (4, 2)), zorder=5)
        axes.axhline(0.0, color=FIELD, linewidth=1.2, zorder=4)
        axes.axhline(-9.0, color=FIELD, linewidth=1.2, linestyle=(0, (5, 2)), zorder=4)
        axes.text(173.0, 0.8, "z = 0 of the map", color="#2F6690", ha="right", va="bottom", zorder=6)
        axes.text(
            173.0, -9.7, "sea level of its reference system, or of --place", color="#2F6690", ha="right", va="top"
        )
        _measures(axes, foot)
        axes.plot([_START], [foot], "s", color="black", markersize=5, zorder=7)
        axes.text(22.0, 6.0, "home: on the ground\nbelow the start", ha="left", va="bottom", zorder=7)
        axes.text(148.0, _UP + 1.2, "planned", color=PLANNED, ha="right", va="bottom")
        wrong = f"flown where home is\nsaid to lie {_SUNK:g} m too high"
        axes.text(153.5, _UP - _SUNK + 1.0, wrong, color=FAILED, ha="right", va="bottom")
        axes.set(xlim=(0.0, 175.0), ylim=(-14.0, 46.0), xlabel="Along the way [m]", ylabel="z of the map [m]")
        save_figure(figure, config.out)


def _ground(x: np.ndarray) -> np.ndarray:
    """Height of a hillside [m]."""
    found: np.ndarray = 4.0 + 5.0 * np.sin(0.025 * (x - 40.0)) + 1.2 * np.sin(0.09 * x)
    return found


def _measures(axes: Any, foot: float) -> None:
    """The four heights of one point, side by side."""
    beneath = float(_ground(np.array([_POINT]))[0])
    for k, (name, low) in enumerate((("AMSL", -9.0), ("z", 0.0), ("AGL", beneath), ("above home", foot))):
        at = _POINT + 8.0 * (k - 1.5)
        if name == "above home":
            axes.plot([_START, at], [foot, foot], color="black", linewidth=0.6, linestyle=":", zorder=4)
        if name == "AGL":
            axes.plot([at], [beneath], ".", color="black", markersize=4, zorder=7)
        arrow = {"arrowstyle": "<->", "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (at, low), (at, _UP), arrowprops=arrow, zorder=7)
        axes.text(at - 0.8, 22.0, name, rotation=90, ha="right", va="center", zorder=7)


if __name__ == "__main__":
    main(configured(TINY))
