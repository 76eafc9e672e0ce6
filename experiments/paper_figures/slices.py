"""Figures 2 and 4: the training map, and fields on both unseen maps, cut at the height of the goal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from experiments.differentiable.field import figure
from experiments.paper_figures.planned import Planned, ends
from maxjax.ui.figures import marks, plan_view

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FIELD_COLORS = "cividis"
_WALL, _MARGIN = "#3A3A3A", "#B9B9B9"
_CITY = {"downtown": "downtown (dense)", "suburb": "suburb (open)"}


def draw_training(found: Planned, file: Path) -> Path:
    """The training map from above, its conductivity and its field."""
    with figure(file, 9.6, 2.9) as drawn:
        panels = [drawn.add_axes((0.05 + 0.33 * k, 0.17, 0.24, 0.76)) for k in range(3)]
        lower, upper = (np.array(corner[:2]) for corner in (found.grid.lower, found.grid.upper))
        bar = panels[0].inset_axes((1.03, 0.0, 0.035, 1.0))
        path = found.plan.path.astype(np.float64)
        plan_view.draw_plan(panels[0], bar, found.city, (lower, upper), float(found.task.goals[0, 2]))
        _draw_slice(panels[1], found, np.log10(np.where(found.sigma > 0, found.sigma, np.nan)), r"$\log_{10}\sigma$")
        _draw_slice(panels[2], found, found.normalised, "normalised log-potential", scale="levels")
        for axes, title in zip(panels, ("training map", "conductivity", "field"), strict=True):
            line = marks.draw_path(axes, path[:, 0], path[:, 1], 0, f"path, {found.plan.length:.1f} m")
            marks.draw_ends(axes, *ends(found), labelled=True)
            axes.set_title(title, fontsize=9)
            if axes is not panels[0]:
                axes.set_ylabel("")
                axes.tick_params(labelleft=False)
        draw_legend(drawn, [line, *_marks(panels[2], line), *_areas(f"within its margin of {found.plan.margin:g} m")])
    return file


def draw_fields(unseen: Mapping[str, Planned], file: Path) -> Path:
    """Conductivity, its logarithm, potential and normalised potential with the path, on both unseen maps."""
    with figure(file, 9.8, 5.0) as drawn:
        for row, (name, found) in enumerate(unseen.items()):
            path = found.plan.path.astype(np.float64)
            panels: tuple[tuple[str, np.ndarray, dict[str, Any]], ...] = (
                (r"conductivity, $\sigma\,/\,10^6$", found.sigma / 1e6, {"least": 0.0}),
                (r"$\log_{10}\sigma$", np.log10(np.where(found.sigma > 0, found.sigma, np.nan)), {}),
                (r"potential, $\phi$", found.phi, {"scale": "logarithmic"}),
                (r"normalised, $1-\log\phi\,/\,\min\log\phi$", found.normalised, {"scale": "levels"}),
            )
            for column, (label, volume, options) in enumerate(panels):
                axes = drawn.add_axes((0.06 + 0.245 * column, 0.54 - 0.46 * row, 0.185, 0.38))
                _draw_slice(axes, found, volume, "", **options)
                line = marks.draw_path(axes, path[:, 0], path[:, 1], 0, "path")
                marks.draw_ends(axes, *ends(found), labelled=True)
                if column:
                    axes.set(ylabel="")
                    axes.tick_params(labelleft=False)
                if row == 0:
                    axes.set(xlabel="")
                    axes.set_title(label, fontsize=9)
            text = f"{_CITY[name]}, margin {found.plan.margin:g} m"
            drawn.text(-0.015, 0.73 - 0.46 * row, text, rotation=90, va="center", ha="center", fontsize=9)
        draw_legend(drawn, [line, *_marks(axes, line), *_areas("within the margin")])
    return file


def _draw_slice(
    axes: Axes,
    found: Planned,
    volume: np.ndarray,
    label: str,
    least: float | None = None,
    scale: Literal["linear", "logarithmic", "levels"] = "linear",
) -> None:
    """A field at the height of the goal; walls and margin in grey, level lines where asked for."""
    from matplotlib.colors import ListedColormap, LogNorm, Normalize

    grid = found.grid
    level = plan_view.level_of(grid, float(found.task.goals[0, 2]))
    extent = (grid.lower[0], grid.upper[0], grid.lower[1], grid.upper[1])
    obstacle, blocked = (mask[:, :, level] for mask in (found.obstacle, found.blocked))
    values = np.ma.masked_invalid(np.where(blocked | (found.phi[:, :, level] <= 0), np.nan, volume[:, :, level]))
    limits = float(values.min()) if least is None else least, float(values.max())
    shown: dict[str, Any] = {"origin": "lower", "extent": extent, "interpolation": "nearest"}
    norm = LogNorm(*limits) if scale == "logarithmic" else Normalize(*limits)
    image = axes.imshow(values.T, cmap=_FIELD_COLORS, norm=norm, **shown)
    walls = np.ma.masked_where(~blocked & ~values.mask, np.where(obstacle, 1.0, 0.0))
    axes.imshow(walls.T, cmap=ListedColormap([_MARGIN, _WALL]), vmin=0, vmax=1, **shown)
    if scale == "levels":
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


def draw_legend(drawn: Any, handles: Sequence[Any]) -> None:
    """One line of entries below a figure."""
    drawn.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=len(handles), borderaxespad=0.0)
