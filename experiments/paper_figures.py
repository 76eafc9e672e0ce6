"""Figures 1 to 5 of the paper (Bong and Beltrame, arXiv 2605.10880), drawn anew from our own runs.

    python -m experiments.paper_figures --out docs/figures                                  # 2 minutes on two CPU cores
    python -m experiments.closed_loop --trials 50 --keep OUT                                # one H200, for figure 5
    python -m experiments.paper_figures --only flights --flights OUT/downtown-solver-calm OUT/suburb-solver-calm

1. `paper_path`: a path that follows the field between buildings.    2. `paper_training_map`: the training map.
3. `paper_architecture`: both networks, from their configurations.   4. `paper_fields`: fields on both unseen maps.
5. `paper_flights`: the worst flights of campaigns, by what they flew over the straight distance.

Problems are those of the offline protocol (`experiments.random_problems`), of the first city of a map: of those with
the largest margin the one with the longest detour. Fields are cut at the height of the goal, which a path may leave.
Where the paper shows what its network predicts, this shows the certified potential of the solver. Every figure is a PNG
below 250 kB; axes are in metres.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Bool, Float

import maxjax
from benchmarks.common.problems import Problem, problems
from experiments.differentiable.field import COLORS, FIGURES, city, draw_city, figure
from maxjax.campaigns.ledger import ROWS, Ledger
from maxjax.campaigns.outcomes import Outcome
from maxjax.nn import layers
from maxjax.nn.autoencoder import CONFIGS, Autoencoder, init
from maxjax.planning.planner import Stopwatch, potential_field
from maxjax.viz import figures as style
from maxjax.viz import flights as flown_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Name = Literal["path", "training", "architecture", "fields", "flights"]
_FIELD_COLORS = "cividis"
_WALL, _MARGIN = "#3A3A3A", "#B9B9B9"
_ELEVATION = 34.0  # of the eye in figure 1 [degrees]
_CITY = {"downtown": "downtown (dense)", "suburb": "suburb (open)", "midtown": "midtown (training)"}


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        only: which figures; `flights` is left out where no folder is given.
        flights: folders of campaigns (`maxjax fly --trials`, `experiments.closed_loop --keep`), one row each.
        worst: flights of a folder.
        candidates: problems of a map that the longest detour is chosen from.
        shape: of the grid, voxels of 2 m around the origin.
        margin: [m].
        seed: of the cities.
        out: where the figures go.
    """

    only: tuple[Name, ...] = ("path", "training", "architecture", "fields", "flights")
    flights: tuple[Path, ...] = ()
    worst: int = 3
    candidates: int = 10
    shape: tuple[int, int, int] = (101, 101, 101)
    margin: float = 8.0
    seed: int = 0
    out: Path = FIGURES


TINY = Config(candidates=1, shape=(51, 51, 21), worst=2)


def main(config: Config) -> list[Path]:
    """Draw the figures; returns their files."""
    names = [name for name in config.only if name != "flights" or config.flights]
    if len(names) < len(config.only):
        print("flights: left out, no --flights given", file=sys.stderr)
    return [_DRAWN[name](config) for name in names]


@dataclasses.dataclass(frozen=True)
class Field:
    """A planned problem and its fields.

    Attributes:
        problem: see there.
        grid: of it.
        plan: by the solver.
        blocked: within the margin of the plan.
        sigma, phi: conductivity and potential there.
    """

    problem: Problem
    grid: maxjax.Grid
    plan: maxjax.Plan
    blocked: Bool[np.ndarray, "nx ny nz"]
    sigma: Float[np.ndarray, "nx ny nz"]
    phi: Float[np.ndarray, "nx ny nz"]

    @property
    def obstacle(self) -> Bool[np.ndarray, "nx ny nz"]:
        """Occupied voxels, ground left out."""
        return np.asarray(self.problem.occupied & ~self.problem.ground)

    @property
    def log_potential(self) -> Float[np.ndarray, "nx ny nz"]:
        """Its logarithm; NaN where no current flows."""
        return np.asarray(np.log(np.where(self.phi > 0, self.phi, np.nan)))

    @property
    def normalised(self) -> Float[np.ndarray, "nx ny nz"]:
        """The log-potential from 0, the least of the map, to 1 at the goal."""
        return np.asarray(1 - self.log_potential / np.nanmin(self.log_potential))


@functools.lru_cache(maxsize=4)
def field_of(name: str, config: Config) -> Field:
    """A solved problem: of those with the largest margin, in free space at the goal's height, the longest detour."""
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    best: tuple[tuple[float, ...], Problem, maxjax.Plan, np.ndarray] | None = None
    for problem in problems(name, config.candidates, config.seed, grid):
        plan = maxjax.plan(
            problem.occupied, problem.start, problem.goal, grid, margin=config.margin, ground=problem.ground
        )
        if plan.status != maxjax.Status.OK:
            continue
        volume = jnp.asarray(problem.occupied)
        blocked = np.asarray(maxjax.dilate(volume, plan.margin, grid, jnp.asarray(problem.ground)))
        seen = _dense(plan.path.astype(np.float64), 0.5)[:, :2]
        x, y = np.floor((seen - np.array(grid.lower[:2])) / grid.spacing).astype(int).T
        clear = float(np.mean(~blocked[x, y, style.level_of(grid, float(problem.goal[2]))]))
        rank = (plan.margin, min(clear, 0.95), plan.length / math.dist(problem.start, problem.goal))
        if best is None or rank > best[0]:
            best = rank, problem, plan, blocked
    if best is None:
        raise ValueError(f"candidates: expected one of {config.candidates} problems of {name} to be solvable")
    _, problem, plan, blocked = best
    goal = grid.index_of(jnp.asarray(problem.goal))
    sigma = maxjax.conductivity(jnp.asarray(blocked), goal, grid)
    # The program that the plan was made by.
    phi = potential_field(jnp.asarray(blocked), goal, grid, maxjax.solve_potential, Stopwatch()).phi
    return Field(problem, grid, plan, blocked, np.asarray(sigma), np.asarray(phi))


# Figure 1.


def draw_path(config: Config) -> Path:
    """A path between buildings: seen from the side and above, and over the field's level lines."""
    found = field_of("downtown", config)
    low, high = _around(found, 26.0)
    with figure(config.out / "paper_path.png", 7.4, 3.5) as drawn:
        view = drawn.add_axes((-0.14, -0.08, 0.62, 1.16), projection="3d", computed_zorder=False)
        _draw_solid(view, found, low, high)
        plan = drawn.add_axes((0.62, 0.13, 0.37, 0.82))
        path = found.plan.path.astype(np.float64)
        style.draw_plan(
            plan,
            plan.inset_axes((1.04, 0.0, 0.035, 0.7)),
            found.obstacle,
            found.grid,
            (low[:2], high[:2]),
            float(np.median(path[:, 2])),
        )
        style.draw_field(plan, np.nan_to_num(found.log_potential, nan=-np.inf), found.blocked, found.grid, path)
        line = style.draw_path(plan, path[:, 0], path[:, 1], 0, f"path, {found.plan.length:.1f} m")
        style.draw_ends(plan, *_ends(found), labelled=True)
        handles = [line, *(h for h in plan.get_legend_handles_labels()[0] if h is not line)]
        drawn.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=5, borderaxespad=0.0)
        for axes, letter in ((-0.03, "a"), (0.52, "b")):
            drawn.text(axes, 0.97, letter, weight="bold", fontsize=10, va="top")
    return config.out / "paper_path.png"


def _around(found: Field, room: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners [m] of a square of the map around a path, on the faces of voxels, as high as what stands there."""
    grid = found.grid
    points = found.plan.path.astype(np.float64)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    bottom, top = np.array(grid.lower[:2]), np.array(grid.upper[:2])
    half = min(float((high - low).max()) / 2 + room, float((top - bottom).min()) / 2)
    middle = np.clip((low + high) / 2, bottom + half, top - half)
    edges = [
        bottom + grid.spacing * np.round((corner - bottom) / grid.spacing) for corner in (middle - half, middle + half)
    ]
    return np.array([*edges[0], 0.0]), np.array([*edges[1], points[:, 2].max() + 26.0])


def _ends(found: Field) -> tuple[np.ndarray, np.ndarray]:
    x, y, _ = np.stack([found.problem.start, found.problem.goal]).T.astype(np.float64)
    return x, y


def _draw_solid(axes: Any, found: Field, low: np.ndarray, high: np.ndarray) -> None:
    """Buildings in parallel projection, cut off above the path; the path dashed where they hide it."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    grid = found.grid
    origin = np.array(grid.lower)
    first = np.round((low - origin) / grid.spacing).astype(int)
    last = np.minimum(np.round((high - origin) / grid.spacing).astype(int), grid.shape)
    inside = found.obstacle[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
    path = _dense(found.plan.path.astype(np.float64), 0.5)

    def eye(azimuth: float) -> np.ndarray:
        a, e = np.radians([azimuth, _ELEVATION])
        return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])

    def behind(azimuth: float) -> np.ndarray:
        """Which points of the path something stands before."""
        hidden = np.zeros(len(path), bool)
        for far in np.arange(1.0, 120.0, 1.0):
            index = np.floor((path + far * eye(azimuth) - origin) / grid.spacing).astype(int) - first
            valid = np.all((index >= 0) & (index < inside.shape), axis=1)
            hidden[valid] |= inside[tuple(index[valid].T)]
        return hidden

    # From where most of the path is seen.
    azimuth = min((float(a) for a in (-60, -30, -120, -150, -45, -135)), key=lambda a: behind(a).sum())
    towards, hidden = eye(azimuth), behind(azimuth)
    polygons, colors = [], []
    shades = {0: "#8E8E8E", 1: "#B4B4B4", 2: "#DEDEDE"}
    for axis in range(3):
        # Of the three pairs of faces only those towards the eye are seen.
        beside = np.roll(np.pad(inside, 1), -int(np.sign(towards[axis])), axis=axis)[1:-1, 1:-1, 1:-1]
        for voxel in np.argwhere(inside & ~beside):
            corner = origin + grid.spacing * (first + voxel)
            corner[axis] += grid.spacing * (towards[axis] > 0)
            u, v = (grid.spacing * np.eye(3)[k] for k in range(3) if k != axis)
            polygons.append([corner, corner + u, corner + u + v, corner + v])
            colors.append(shades[axis])
    faces = Poly3DCollection(polygons, facecolors=colors, edgecolors=colors, linewidths=0.5, zorder=1)
    faces.set_rasterized(True)
    axes.add_collection3d(faces)
    runs = np.split(np.arange(len(path)), np.flatnonzero(np.diff(hidden)) + 1)
    for run in runs:
        part = path[max(run[0] - 1, 0) : run[-1] + 1].T
        dashes = (0, (1.2, 1.0)) if hidden[run[0]] else "-"
        if not hidden[run[0]]:
            axes.plot(*part, color="white", linewidth=3.2, zorder=4)
        axes.plot(*part, color=COLORS[0], linewidth=1.6, linestyle=dashes, zorder=5)
    for point, marker, size, color in (
        (found.problem.start, "o", 5.5, "white"),
        (found.problem.goal, "*", 10.0, "#F0E442"),
    ):
        x, y, z = point.astype(np.float64)
        axes.plot([x, x], [y, y], [0, z], color="black", linewidth=0.6, zorder=6)
        axes.plot(
            [x], [y], [z], marker, markersize=size, markerfacecolor=color, markeredgecolor="black",
            markeredgewidth=0.8, zorder=7,
        )  # fmt: skip
    axes.view_init(_ELEVATION, azimuth)
    axes.set_proj_type("ortho")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(high - low, zoom=1.0)
    for k, (name, every, pad) in enumerate((("East, x [m]", 40, -3), ("North, y [m]", 40, -3), ("z [m]", 20, -6))):
        axis = (axes.xaxis, axes.yaxis, axes.zaxis)[k]
        axis.set_label_text(name)
        axis.labelpad = pad
        axis.set_ticks(np.arange(every * math.ceil(low[k] / every), high[k], every))
    axes.tick_params(pad=-2, labelsize=7)
    for pane in (axes.xaxis, axes.yaxis, axes.zaxis):
        pane.set_pane_color((1.0, 1.0, 1.0, 0.0))
        pane.line.set_linewidth(0.6)
    axes.grid(False)


def _dense(path: np.ndarray, step: float) -> np.ndarray:
    """A point every `step` metres."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / step)))
    return np.stack([np.interp(at, along, path[:, axis]) for axis in range(3)], axis=-1)


# Figures 2 and 4.


def draw_training(config: Config) -> Path:
    """The training map from above, its conductivity and its field."""
    found = field_of("midtown", config)
    file = config.out / "paper_training_map.png"
    with figure(file, 9.6, 2.9) as drawn:
        panels = [drawn.add_axes((0.05 + 0.33 * k, 0.17, 0.24, 0.76)) for k in range(3)]
        lower, upper = (np.array(corner[:2]) for corner in (found.grid.lower, found.grid.upper))
        bar = panels[0].inset_axes((1.03, 0.0, 0.035, 1.0))
        path = found.plan.path.astype(np.float64)
        style.draw_plan(panels[0], bar, found.obstacle, found.grid, (lower, upper), float(found.problem.goal[2]))
        _draw_slice(panels[1], found, np.log10(np.where(found.sigma > 0, found.sigma, np.nan)), r"$\log_{10}\sigma$")
        _draw_slice(panels[2], found, found.normalised, "normalised log-potential", levels=True)
        for axes, title in zip(panels, ("training map", "conductivity", "field"), strict=True):
            line = style.draw_path(axes, path[:, 0], path[:, 1], 0, f"path, {found.plan.length:.1f} m")
            style.draw_ends(axes, *_ends(found), labelled=True)
            axes.set_title(title, fontsize=9)
            if axes is not panels[0]:
                axes.set_ylabel("")
                axes.tick_params(labelleft=False)
        _legend(drawn, [line, *_marks(panels[2], line), *_areas(f"within its margin of {found.plan.margin:g} m")])
    return file


def draw_fields(config: Config) -> Path:
    """Conductivity, its logarithm, potential and normalised potential with the path, on both unseen maps."""
    file = config.out / "paper_fields.png"
    with figure(file, 9.8, 5.0) as drawn:
        for row, name in enumerate(("downtown", "suburb")):
            found = field_of(name, config)
            path = found.plan.path.astype(np.float64)
            panels: tuple[tuple[str, np.ndarray, dict[str, Any]], ...] = (
                (r"conductivity, $\sigma\,/\,10^6$", found.sigma / 1e6, {"least": 0.0}),
                (r"$\log_{10}\sigma$", np.log10(np.where(found.sigma > 0, found.sigma, np.nan)), {}),
                (r"potential, $\phi$", found.phi, {"logarithmic": True}),
                (r"normalised, $1-\log\phi\,/\,\min\log\phi$", found.normalised, {"levels": True}),
            )
            for column, (label, volume, options) in enumerate(panels):
                axes = drawn.add_axes((0.06 + 0.245 * column, 0.54 - 0.46 * row, 0.185, 0.38))
                _draw_slice(axes, found, volume, "", **options)
                line = style.draw_path(axes, path[:, 0], path[:, 1], 0, "path")
                style.draw_ends(axes, *_ends(found), labelled=True)
                if column:
                    axes.set(ylabel="")
                    axes.tick_params(labelleft=False)
                if row == 0:
                    axes.set(xlabel="")
                    axes.set_title(label, fontsize=9)
            text = f"{_CITY[name]}, margin {found.plan.margin:g} m"
            drawn.text(-0.015, 0.73 - 0.46 * row, text, rotation=90, va="center", ha="center", fontsize=9)
        _legend(drawn, [line, *_marks(axes, line), *_areas("within the margin")])
    return file


def _draw_slice(
    axes: Axes,
    found: Field,
    volume: np.ndarray,
    label: str,
    *,
    least: float | None = None,
    logarithmic: bool = False,
    levels: bool = False,
) -> None:
    """A field at the height of the goal; walls and margin in grey, level lines where asked for."""
    from matplotlib.colors import ListedColormap, LogNorm, Normalize

    grid = found.grid
    level = style.level_of(grid, float(found.problem.goal[2]))
    extent = (grid.lower[0], grid.upper[0], grid.lower[1], grid.upper[1])
    obstacle, blocked = (mask[:, :, level] for mask in (found.obstacle, found.blocked))
    values = np.ma.masked_invalid(np.where(blocked | (found.phi[:, :, level] <= 0), np.nan, volume[:, :, level]))
    limits = float(values.min()) if least is None else least, float(values.max())
    shown: dict[str, Any] = {"origin": "lower", "extent": extent, "interpolation": "nearest"}
    norm = LogNorm(*limits) if logarithmic else Normalize(*limits)
    image = axes.imshow(values.T, cmap=_FIELD_COLORS, norm=norm, **shown)
    walls = np.ma.masked_where(~blocked & ~values.mask, np.where(obstacle, 1.0, 0.0))
    axes.imshow(walls.T, cmap=ListedColormap([_MARGIN, _WALL]), vmin=0, vmax=1, **shown)
    if levels:
        x, y = (grid.origin[axis] + grid.spacing * np.arange(grid.shape[axis]) for axis in (0, 1))
        lines = np.linspace(float(values.min()), float(values.max()), 20)[1:-1]
        axes.contour(x, y, values.T, levels=lines, colors="white", linewidths=0.35, alpha=0.8)
    axes.figure.colorbar(image, cax=axes.inset_axes((1.03, 0.0, 0.035, 1.0)), label=label)
    axes.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", xlabel="East, x [m]", ylabel="North, y [m]")


def _marks(axes: Axes, line: Any) -> list[Any]:
    return [handle for handle in axes.get_legend_handles_labels()[0] if handle is not line]


def _areas(margin: str) -> list[Any]:
    from matplotlib.patches import Patch

    return [
        Patch(facecolor=_WALL, label="obstacle, at the height of the goal"),
        Patch(facecolor=_MARGIN, label=margin),
    ]


def _legend(drawn: Any, handles: Sequence[Any]) -> None:
    drawn.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=len(handles), borderaxespad=0.0)


# Figure 3.


@dataclasses.dataclass(frozen=True)
class Volume:
    """Features between two layers: what made them, their channels, the voxels along an edge."""

    made_by: str
    channels: int
    voxels: int
    level: int


_ARROW: Any = {"arrowstyle": "-|>", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 6, "color": "black"}
_KEPT: Any = {"color": "#666666", "linewidth": 0.8, "linestyle": (0, (3, 1.5))}
_LAYERS = {
    "input": "#E4E4E4",
    "convolution, ReLU": COLORS[1],
    "max-pooling": COLORS[4],
    "upsampling": COLORS[2],
    "head": COLORS[3],
}


def volumes_of(network: Autoencoder, voxels: int = 101) -> list[Volume]:
    """What a network computes, in order: the layers of its encoder, its decoder and its head."""
    spaces = [space[0] for space in network.spaces((voxels,) * network.dimensions)]
    inputs = network.inputs * network.channels
    found = [Volume("input", inputs, spaces[0], 0)]
    for level, channels in enumerate(network.encoder):
        found += [Volume("convolution, ReLU", c, spaces[level], level) for c in channels]
        found.append(Volume("max-pooling", channels[-1], spaces[level + 1], level + 1))
    for level, channels in zip(reversed(range(len(network.encoder))), network.decoder, strict=True):
        kept = network.encoder[level][-1] if network.skips else 0
        found.append(Volume("upsampling", found[-1].channels + kept, spaces[level], level))
        found += [Volume("convolution, ReLU", c, spaces[level], level) for c in channels]
    return [*found, Volume("head", network.channels, spaces[0], 0)]


def weights_of(network: Autoencoder) -> int:
    """Number of weights, without drawing them."""
    shapes = jax.eval_shape(functools.partial(init, config=network), jax.random.key(0))
    return layers.count(shapes)


def draw_architecture(config: Config) -> Path:
    """The paper's network and maxjax's, each volume a box: its height the voxels of an edge, its width the channels."""
    file = config.out / "paper_architecture.png"
    with figure(file, 9.6, 5.6) as drawn:
        for row, (name, title) in enumerate((("paper", "the paper's network"), ("maxjax", "maxjax's network"))):
            axes = drawn.add_axes((0.01, 0.53 - 0.47 * row, 0.98, 0.42))
            network = CONFIGS[name]
            _draw_network(axes, network)
            kept = ", encoder features kept for the decoder" if network.skips else ""
            block = f", blocks of {network.block}³ voxels as channels" if network.block > 1 else ""
            kernels = "·".join(f"{k}³" for k in sorted(set(network.kernels)))
            text = f"{title}: {weights_of(network):,} weights, kernels {kernels}{block}{kept}"
            axes.set_title(text, fontsize=9, loc="left")
        from matplotlib.lines import Line2D
        from matplotlib.patches import Patch

        handles: list[Any] = [
            Patch(facecolor=color, edgecolor="black", linewidth=0.5, label=name) for name, color in _LAYERS.items()
        ]
        handles.append(Line2D([], [], label="kept for the decoder", **_KEPT))
        drawn.text(0.5, 0.055, "above each box: voxels; below: channels", ha="center", fontsize=8)
        drawn.legend(handles=handles, loc="lower center", ncols=len(handles), borderaxespad=0.0)
    return file


def _draw_network(axes: Axes, network: Autoencoder) -> None:
    from matplotlib.patches import Rectangle

    volumes = volumes_of(network)
    gap, x = 0.62, 0.0
    placed: list[tuple[float, float]] = []
    tallest = max(volume.voxels for volume in volumes)
    for volume in volumes:
        width, height = 0.045 * math.sqrt(volume.channels) + 0.06, 0.12 + volume.voxels / tallest
        axes.add_patch(
            Rectangle(
                (x, -height / 2), width, height, facecolor=_LAYERS[volume.made_by], edgecolor="black", linewidth=0.5
            )
        )
        axes.text(x + width / 2, -height / 2 - 0.03, str(volume.channels), ha="center", va="top", fontsize=6.5)
        axes.text(x + width / 2, height / 2 + 0.03, f"{volume.voxels}³", ha="center", va="bottom", fontsize=6.5)
        if placed:
            before = placed[-1][0] + placed[-1][1]
            axes.annotate("", (x, 0.0), (before, 0.0), arrowprops=_ARROW)
        placed.append((x, width))
        x += width + gap * (0.6 if volume.made_by == "max-pooling" else 0.5)
    if network.skips:
        pooled = [k for k, volume in enumerate(volumes) if volume.made_by == "max-pooling"]
        raised = [k for k, volume in enumerate(volumes) if volume.made_by == "upsampling"]
        for level, (left, right) in enumerate(zip(pooled, reversed(raised), strict=True)):
            # What is kept is what the pooling reads.
            source = volumes[left - 1]
            ends = [placed[k][0] + placed[k][1] / 2 for k in (left - 1, right)]
            top, foot = 0.85 - 0.07 * level, 0.06 + source.voxels / tallest / 2 + 0.13
            axes.plot([ends[0], ends[0], ends[1], ends[1]], [foot, top, top, foot], **_KEPT)
            axes.plot(ends[1], foot, "v", markersize=3.0, color="#666666")
    axes.set(xlim=(-0.1, x), ylim=(-0.72, 0.9 if network.skips else 0.75))
    axes.axis("off")


# Figure 5.


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
    try:
        campaign = json.loads((folder / "config.json").read_text(encoding="utf-8"))["campaign"]
        lines = (folder / ROWS).read_text(encoding="utf-8").splitlines()
        outcomes = {outcome.trial: outcome for outcome in (Outcome(**json.loads(line)) for line in lines)}
        name = str(campaign["map"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"flights: expected the folder of a campaign, given {folder.name} ({error})") from error
    positions = Ledger(folder, campaign, outcomes, None).positions()
    found = [Flown(name, outcomes[trial], position) for trial, position in positions.items() if len(position) > 1]
    if not found:
        raise ValueError(f"flights: expected a flight with positions in {folder.name}, given none")
    return sorted(found, key=lambda flight: (-flight.detour, flight.outcome.trial))[:count]


def draw_flights(config: Config) -> Path:
    """The worst flights from above, a campaign a row; squares at their ends are the larger the higher they are."""
    file = config.out / "paper_flights.png"
    rows = [worst_flights(folder, config.worst) for folder in config.flights]
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
        _legend(drawn, _flight_legend(any(not f.outcome.arrived for some in rows for f in some)))
    return file


_HEIGHTS = (3.0, 15.0)  # of the ends, by the protocol [m]


def _size(height: float) -> float:
    """Edge of a square [pt] that tells a height [m]."""
    return 4.0 + 5.0 * float(np.clip((height - _HEIGHTS[0]) / (_HEIGHTS[1] - _HEIGHTS[0]), 0.0, 2.0))


def _draw_flight(axes: Axes, flight: Flown, obstacle: np.ndarray, grid: maxjax.Grid) -> None:
    outcome, line = flight.outcome, flight.position.astype(np.float64)
    assert outcome.start is not None
    assert outcome.goal is not None
    start, goal = np.array(outcome.start), np.array(outcome.goal)
    draw_city(axes, obstacle, grid, float(np.median(line[:, 2])), np.stack([*line, start, goal]))
    color = flown_style.ARRIVED if outcome.arrived else flown_style.FAILED
    axes.plot(*np.stack([start, goal])[:, :2].T, color="black", linewidth=0.7, linestyle=(0, (1, 1.5)), zorder=4)
    axes.plot(*line[:, :2].T, color="white", linewidth=3.0, zorder=5, solid_capstyle="round")
    axes.plot(*line[:, :2].T, color=color, linewidth=1.6, zorder=6, solid_capstyle="round")
    for point, face in ((start, "white"), (goal, flown_style.GOAL)):
        style.draw_mark(axes, point[0], point[1], "s", _size(point[2]), face, None)
    what = f"{flight.detour:.2f} of the straight line" if outcome.arrived else outcome.status
    axes.set_title(f"{flight.map}, trial {outcome.trial}: {what}", fontsize=8)


def _flight_legend(failed: bool) -> list[Any]:
    from matplotlib.lines import Line2D

    def square(height: float, color: str, label: str) -> Line2D:
        mark = Line2D([], [], marker="s", linestyle="", markersize=_size(height), markerfacecolor=color, label=label)
        mark.set(markeredgecolor="black", markeredgewidth=0.8)
        return mark

    lines = [Line2D([], [], color=flown_style.ARRIVED, linewidth=1.6, label="flown")]
    if failed:
        lines.append(Line2D([], [], color=flown_style.FAILED, linewidth=1.6, label="flown, did not arrive"))
    lines.append(Line2D([], [], color="black", linewidth=0.7, linestyle=(0, (1, 1.5)), label="straight line"))
    low, high = _HEIGHTS
    return [
        *lines,
        square(low, "white", f"start, {low:g} m high"),
        square(high, "white", f"start, {high:g} m high"),
        square((low + high) / 2, flown_style.GOAL, f"goal, {(low + high) / 2:g} m high"),
    ]


_DRAWN: dict[Name, Callable[[Config], Path]] = {
    "path": draw_path,
    "training": draw_training,
    "architecture": draw_architecture,
    "fields": draw_fields,
    "flights": draw_flights,
}


if __name__ == "__main__":
    main(tyro.cli(Config))
