"""A map in section along a path: the voxels over and under it, unrolled over its horizontal distance s.

s(t) = ∫ ‖(dx, dy)‖
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from maxjax.core.grid import Grid
from maxjax.ui.figures.style import BESIDE, CLOSED_AIR, EARTH, OBSTACLE, UNKNOWN

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ASIDE = 8.0  # what counts as beside the path [m]
_ABOVE = 30.0  # most that is shown above the path [m]


@dataclasses.dataclass(frozen=True)
class Section:
    """A map along a path's course.

    Attributes:
        kind: of each voxel, by distance and height: 0 free, 1 obstacle beside the course, 2 obstacle on it, 3 ground,
            4 closed to flight, 5 free but outside the data.
        length: of the course [m].
        low, high: heights worth showing [m].
    """

    kind: np.ndarray
    length: float
    low: float
    high: float

    @property
    def rise(self) -> float:
        """From the lowest to the highest [m]."""
        return self.high - self.low


def section_along(
    occupied: np.ndarray,
    ground: np.ndarray,
    grid: Grid,
    path: np.ndarray,
    closed: np.ndarray | None = None,
    within: np.ndarray | None = None,
) -> Section:
    """The voxels over and under a path (t, 3) [m], four columns a voxel."""
    distance = horizontal_distance(path)
    length = float(distance[-1])
    s = np.linspace(0.0, length, max(2, math.ceil(4 * length / grid.spacing)))
    course = np.stack([np.interp(s, distance, path[:, axis]) for axis in (0, 1)], axis=-1)
    along = np.gradient(course, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)

    def columns(offset: float) -> tuple[np.ndarray, np.ndarray]:
        index = np.floor((course + offset * across - np.array(grid.origin[:2])) / grid.spacing + 0.5)
        x, y = np.clip(index.astype(np.int64), 0, np.array(grid.shape[:2]) - 1).T
        return x, y

    obstacle = occupied & ~ground
    on = obstacle[columns(0.0)]
    beside = np.zeros_like(on)
    for offset in np.arange(-_ASIDE, _ASIDE + 1e-6, grid.spacing / 2):
        beside |= obstacle[columns(float(offset))]
    below = ground[columns(0.0)]
    kind = np.select([below, on, beside], [3, 2, 1], 0)
    # Altitudes are chosen without what is closed, which may reach to the sky.
    shown = kind if closed is None else np.where(closed[columns(0.0)] & (kind != 2), 4, kind)
    if within is not None:
        shown = np.where(~within[columns(0.0)][:, None] & (shown == 0), 5, shown)

    # Altitudes worth showing: the path, the ground under it, and obstacles unless they tower over it.
    bottom, top = grid.lower[2], grid.upper[2]
    faces = bottom + grid.spacing * np.arange(grid.shape[2] + 1)
    lowest, highest = float(path[:, 2].min()), float(path[:, 2].max())
    terrain = faces[grid.shape[2] - below[:, ::-1].argmax(axis=1)][below.any(axis=1)]
    tops = faces[1:][(kind > 0).any(axis=0)]
    tops = tops[tops <= highest + _ABOVE]
    low = float(terrain.min()) - 3 * grid.spacing if len(terrain) else lowest - 10.0
    high = max(highest + 8.0, float(tops.max()) + 4.0 if len(tops) else highest)
    return Section(shown, length, max(low, bottom), min(high, top))


def horizontal_distance(path: np.ndarray) -> np.ndarray:
    """Horizontal distance flown up to each point [m]."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1))])


def draw_section(axes: Axes, section: Section, grid: Grid) -> None:
    """Fill axes with a section, and label its kinds of voxels."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Rectangle

    colors = ("white", BESIDE, OBSTACLE, EARTH, CLOSED_AIR, UNKNOWN)
    axes.imshow(
        section.kind.T,
        origin="lower",
        extent=(0.0, max(section.length, 1.0), grid.lower[2], grid.upper[2]),
        cmap=ListedColormap(colors),
        vmin=-0.5,
        vmax=5.5,
        interpolation="nearest",
        aspect="auto",
    )
    edge = 0.02 * max(section.length, 1.0)
    axes.set(xlim=(-edge, max(section.length, 1.0) + edge), ylim=(section.low, section.high))
    axes.set(xlabel="Horizontal distance along the first path [m]", ylabel="Height, z [m]")
    labels = {
        2: "obstacle in the section",
        1: f"obstacle within {_ASIDE:.0f} m of it",
        3: "ground",
        4: "closed to flight",
        5: "outside the data, unknown",
    }
    for kind in (kind for kind in labels if (section.kind == kind).any()):
        # Of no size: for the legend alone.
        axes.add_patch(Rectangle((0.0, section.low), 0.0, 0.0, facecolor=colors[kind], label=labels[kind]))
