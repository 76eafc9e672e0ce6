"""Figure 1: a path that follows the field between buildings."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from experiments.differentiable.field import COLORS, figure
from experiments.paper_figures.planned import Planned, dense, ends
from maxjax.ui.figures import marks, plan_view

_ELEVATION = 34.0  # of the eye [degrees]


def draw_path(found: Planned, file: Path) -> Path:
    """A path between buildings: seen from the side and above, and over the field's level lines."""
    low, high = _around(found, 26.0)
    with figure(file, 7.4, 3.5) as drawn:
        view = drawn.add_axes((-0.14, -0.08, 0.62, 1.16), projection="3d", computed_zorder=False)
        _draw_solid(view, found, low, high)
        plan = drawn.add_axes((0.62, 0.13, 0.37, 0.82))
        path = found.plan.path.astype(np.float64)
        plan_view.draw_plan(
            plan,
            plan.inset_axes((1.04, 0.0, 0.035, 0.7)),
            found.city,
            (low[:2], high[:2]),
            float(np.median(path[:, 2])),
        )
        plan_view.draw_field(plan, np.nan_to_num(found.log_potential, nan=-np.inf), found.blocked, found.grid, path)
        line = marks.draw_path(plan, path[:, 0], path[:, 1], 0, f"path, {found.plan.length:.1f} m")
        marks.draw_ends(plan, *ends(found), labelled=True)
        handles = [line, *(h for h in plan.get_legend_handles_labels()[0] if h is not line)]
        drawn.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=5, borderaxespad=0.0)
        for axes, letter in ((-0.03, "a"), (0.52, "b")):
            drawn.text(axes, 0.97, letter, weight="bold", fontsize=10, va="top")
    return file


def _around(found: Planned, room: float) -> tuple[np.ndarray, np.ndarray]:
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


def _draw_solid(axes: Any, found: Planned, low: np.ndarray, high: np.ndarray) -> None:
    """Buildings in parallel projection, cut off above the path; the path dashed where they hide it."""
    grid = found.grid
    origin = np.array(grid.lower)
    first = np.round((low - origin) / grid.spacing).astype(int)
    last = np.minimum(np.round((high - origin) / grid.spacing).astype(int), grid.shape)
    inside = found.obstacle[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
    corner = origin + grid.spacing * first
    path = dense(found.plan.path.astype(np.float64), 0.5)

    def hidden_from(azimuth: float) -> np.ndarray:
        return _hidden(path, inside, corner, grid.spacing, _eye(azimuth))

    # From where most of the path is seen.
    azimuth = min((float(a) for a in (-60, -30, -120, -150, -45, -135)), key=lambda a: hidden_from(a).sum())
    axes.add_collection3d(_faces(inside, corner, grid.spacing, _eye(azimuth)))
    _draw_line(axes, path, hidden_from(azimuth))
    for point, marker, size, color in (
        (found.task.starts[0], "o", 5.5, "white"),
        (found.task.goals[0], "*", 10.0, "#F0E442"),
    ):
        x, y, z = point.astype(np.float64)
        axes.plot([x, x], [y, y], [0, z], color="black", linewidth=0.6, zorder=6)
        axes.plot(
            [x], [y], [z], marker, markersize=size, markerfacecolor=color, markeredgecolor="black",
            markeredgewidth=0.8, zorder=7,
        )  # fmt: skip
    axes.view_init(_ELEVATION, azimuth)
    _set_axes(axes, low, high)


def _eye(azimuth: float) -> np.ndarray:
    """The direction towards the eye."""
    a, e = np.radians([azimuth, _ELEVATION])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def _hidden(path: np.ndarray, inside: np.ndarray, corner: np.ndarray, spacing: float, eye: np.ndarray) -> np.ndarray:
    """Which points of the path voxels hide; `corner` is that of the first voxel [m]."""
    hidden = np.zeros(len(path), bool)
    for far in np.arange(1.0, 120.0, 1.0):
        index = np.floor((path + far * eye - corner) / spacing).astype(int)
        valid = np.all((index >= 0) & (index < inside.shape), axis=1)
        hidden[valid] |= inside[tuple(index[valid].T)]
    return hidden


def _faces(inside: np.ndarray, first: np.ndarray, spacing: float, eye: np.ndarray) -> Any:
    """The faces of voxels that are turned to the eye; `first` is the corner of the first voxel [m]."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    polygons, colors = [], []
    shades = {0: "#8E8E8E", 1: "#B4B4B4", 2: "#DEDEDE"}
    for axis in range(3):
        # Of the three pairs of faces only those towards the eye are seen.
        beside = np.roll(np.pad(inside, 1), -int(np.sign(eye[axis])), axis=axis)[1:-1, 1:-1, 1:-1]
        for voxel in np.argwhere(inside & ~beside):
            corner = first + spacing * voxel
            corner[axis] += spacing * (eye[axis] > 0)
            u, v = (spacing * np.eye(3)[k] for k in range(3) if k != axis)
            polygons.append([corner, corner + u, corner + u + v, corner + v])
            colors.append(shades[axis])
    faces = Poly3DCollection(polygons, facecolors=colors, edgecolors=colors, linewidths=0.5, zorder=1)
    faces.set_rasterized(True)
    return faces


def _draw_line(axes: Any, path: np.ndarray, hidden: np.ndarray) -> None:
    """The path, dashed where it is hidden."""
    for run in np.split(np.arange(len(path)), np.flatnonzero(np.diff(hidden)) + 1):
        part = path[max(run[0] - 1, 0) : run[-1] + 1].T
        dashes = (0, (1.2, 1.0)) if hidden[run[0]] else "-"
        if not hidden[run[0]]:
            axes.plot(*part, color="white", linewidth=3.2, zorder=4)
        axes.plot(*part, color=COLORS[0], linewidth=1.6, linestyle=dashes, zorder=5)


def _set_axes(axes: Any, low: np.ndarray, high: np.ndarray) -> None:
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
