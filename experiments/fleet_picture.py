"""A picture: hundreds of vehicles on their way to one goal, each on a verified path, all in one field.

    python -m experiments.fleet_picture     # 101 x 101 x 61 voxels of 2 m; half a minute on two CPU cores

Starts are drawn from a seed, in the open and at any height; those without a verified path are left out, and counted in
the title. Paths and roofs are coloured by height on one scale, what is higher on top.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

import maxjax
from benchmarks.common.command import configured
from maxjax.sim.worlds.scenes import make_scene, occupancy
from maxjax.ui.figures.plan_view import draw_plan
from maxjax.ui.figures.style import CLEARANCES, GOAL, STYLE, load_matplotlib, save_figure

_ROOFS = ("#F4F4F4", "#8C8C8C")


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


TINY = Config(shape=(41, 41, 21), starts=12)


def main(config: Config) -> list[Float[np.ndarray, "_ 3"]]:
    """Draw the picture. Returns the paths in it."""
    grid = maxjax.Grid(config.shape, 2.0, (-float(config.shape[0] - 1), -float(config.shape[1] - 1), -1.0))
    voxels = occupancy(make_scene(*config.city).geoms, grid)
    occupied, ground = (np.asarray(volume) for volume in voxels)
    starts = _starts(occupied, grid, config)
    plans = maxjax.plan_to_goal(
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
    from matplotlib.colors import LinearSegmentedColormap

    rc_context, new_figure = load_matplotlib()
    heights = {"cmap": CLEARANCES, "clim": (0.0, grid.upper[2])}
    with rc_context(STYLE):
        figure = new_figure(figsize=(7.2, 6.3))
        axes, roofs = figure.add_axes((0.085, 0.075, 0.765, 0.875)), figure.add_axes((0.865, 0.075, 0.018, 0.875))
        view = np.array(grid.lower[:2]), np.array(grid.upper[:2])
        draw_plan(axes, roofs, maxjax.VoxelMap.on(grid, obstacle), view, config.goal[2])
        # Pale, with the scale of the paths beside them: a path of a brighter colour than its roof's is above it.
        axes.images[0].set(cmap=LinearSegmentedColormap.from_list("roofs", _ROOFS), clim=heights["clim"])
        roofs.set(ylabel="", yticks=[])
        segments = np.concatenate([np.zeros((0, 2, 3)), *map(_pieces, paths)])
        order = np.argsort(segments[:, :, 2].mean(axis=1))  # what is higher lies on top
        level = segments[order, :, :2]
        axes.add_collection(LineCollection(list(level), colors="white", linewidths=1.7, zorder=5), autolim=False)
        lines = LineCollection(
            list(level), array=segments[order, :, 2].mean(axis=1), linewidths=0.9, zorder=5, **heights
        )
        axes.add_collection(lines, autolim=False)
        if paths:
            x, y, z = np.array([path[0] for path in paths]).T
            axes.scatter(x, y, s=4.0, c=z, linewidths=0.0, zorder=6, cmap=CLEARANCES, vmin=0.0, vmax=grid.upper[2])
        figure.colorbar(
            lines, cax=figure.add_axes((0.89, 0.075, 0.018, 0.875)), label="Height of roofs (grey) and paths, z [m]"
        )
        axes.plot(*config.goal[:2], "*", color=GOAL, markeredgecolor="black", markersize=15, zorder=7)
        name, seed = config.city
        axes.set_title(f"{name}:{seed}, {len(paths)} of {config.starts} vehicles with a verified path, one field")
        save_figure(figure, config.out)


def _pieces(path: Float[np.ndarray, "_ 3"], longest: float = 4.0) -> Float[np.ndarray, "_ 2 3"]:
    """Straight pieces of a path, none longer than this [m], so that each has the colour of its own height."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.union1d(along, np.arange(0.0, along[-1], longest))
    points = np.stack([np.interp(at, along, coordinate) for coordinate in path.T], axis=1)
    return np.stack([points[:-1], points[1:]], axis=1)


if __name__ == "__main__":
    main(configured(TINY))
