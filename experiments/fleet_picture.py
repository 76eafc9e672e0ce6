"""A picture: hundreds of vehicles on their way to one goal, each on a verified path, all in one field.

    python -m experiments.fleet_picture     # 101 x 101 x 61 voxels of 2 m; half a minute on two CPU cores

Starts are drawn from a seed, in the open and at any height; those without a verified path are left out, and counted in
the title. Paths are coloured by what is left of the way.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Bool, Float

import maxjax
from maxjax.viz.plan_view import draw_plan
from maxjax.viz.style import CLEARANCES, STYLE, load_matplotlib, save_figure
from maxjax.worlds.scenes import make_scene, occupancy


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        city: map and seed.
        shape: voxels of 2 m.
        starts: vehicles.
        goal: [m].
        out: file of the picture.
    """

    city: tuple[str, int] = ("downtown", 0)
    shape: tuple[int, int, int] = (101, 101, 61)
    starts: int = 400
    goal: tuple[float, float, float] = (4.0, 6.0, 12.0)
    out: Path = Path("docs/fleet.png")


def main(config: Config) -> list[Float[np.ndarray, "_ 3"]]:
    """Draw the picture. Returns the paths in it."""
    grid = maxjax.Grid(config.shape, 2.0, (-float(config.shape[0] - 1), -float(config.shape[1] - 1), -1.0))
    voxels = occupancy(make_scene(*config.city).geoms, grid)
    occupied, ground = (np.asarray(volume) for volume in voxels)
    starts = _starts(occupied, grid, config)
    plans = maxjax.plan_fleet(
        maxjax.VoxelMap.on(grid, occupied, ground),
        starts,
        config.goal,
        distances=maxjax.Distances(radius=1.0, margin=8.0),
    )
    paths = [plan.path for plan in plans if plan.status == maxjax.Status.OK]
    _draw(paths, occupied & ~ground, grid, config)
    return paths


def _starts(occupied: Bool[np.ndarray, "nx ny nz"], grid: maxjax.Grid, config: Config) -> Float[np.ndarray, "n 3"]:
    """Voxels in the open, at least two from anything [m]."""
    near = np.asarray(maxjax.dilate(occupied, 2.0 * grid.spacing, grid))
    free = np.argwhere(~near)
    chosen = np.random.default_rng(config.city[1]).choice(len(free), config.starts, replace=False)
    return np.asarray(np.array(grid.origin) + grid.spacing * free[chosen])


def _draw(
    paths: list[Float[np.ndarray, "_ 3"]], obstacle: Bool[np.ndarray, "nx ny nz"], grid: maxjax.Grid, config: Config
) -> None:
    from matplotlib.collections import LineCollection

    rc_context, new_figure = load_matplotlib()
    with rc_context(STYLE):
        figure = new_figure(figsize=(7.2, 6.2))
        axes, bar = figure.add_axes((0.09, 0.08, 0.72, 0.86)), figure.add_axes((0.83, 0.55, 0.02, 0.36))
        view = np.array(grid.lower[:2]), np.array(grid.upper[:2])
        draw_plan(axes, bar, obstacle, grid, view, config.goal[2])
        pieces, left = [], []
        for path in paths:
            lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
            pieces += list(np.stack([path[:-1, :2], path[1:, :2]], axis=1))
            left += list(np.cumsum(lengths[::-1])[::-1])
        lines = LineCollection(pieces, array=np.array(left), cmap=CLEARANCES, linewidths=0.9, zorder=5)
        axes.add_collection(lines, autolim=False)
        figure.colorbar(lines, cax=figure.add_axes((0.83, 0.1, 0.02, 0.36)), label="Way to the goal [m]")
        if paths:
            axes.plot(*np.array([path[0, :2] for path in paths]).T, ".", color="black", markersize=2.5, zorder=6)
        axes.plot(*config.goal[:2], "*", color="#F0E442", markeredgecolor="black", markersize=15, zorder=7)
        name, seed = config.city
        axes.set_title(f"{name}:{seed}, {len(paths)} of {config.starts} vehicles with a verified path, one field")
        save_figure(figure, config.out)


if __name__ == "__main__":
    main(tyro.cli(Config))
