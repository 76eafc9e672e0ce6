"""Movers from above: where they are, what may hold them, and the motion that the vehicle has committed itself to.

filled   the mover                          outline  the box that may hold it now
faint    what may hold one in the horizon   line     the motion, to its place of rest, a ring
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from maxjax.sim.movers.moments import Moment
from maxjax.sim.worlds.movers import Movers, boxes_at
from maxjax.sim.worlds.populations import place_movers
from maxjax.ui.figures.style import FLAGGED, MOTION, MOVER

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST = 0.7  # half edge of a mover that is shown [m]
_FAINT = 0.13  # opacity of what may hold a mover later
_REST: dict[str, Any] = {
    "markersize": 5.0,
    "markerfacecolor": "white",
    "markeredgecolor": MOTION,
    "markeredgewidth": 1.6,
}


@dataclasses.dataclass(frozen=True)
class Moving:
    """Movers at one position of a flight.

    Attributes:
        outlines: of the movers from above [m], each at least twice `LEAST` wide.
        moment: what was known of them, and chosen.
    """

    outlines: list[Float[np.ndarray, "_ 2"]]
    moment: Moment


def moving_of(movers: Movers, times: Float[np.ndarray, " t"], moments: list[Moment]) -> list[Moving]:
    """Movers at some times [s], and what was known of them then."""
    from scipy.spatial import ConvexHull

    there = np.asarray(place_movers(movers))
    level = np.asarray(boxes_at(movers, jnp.asarray(times, jnp.float32), LEAST), np.float64)[:, there, :, :2]
    outlines = [[body[ConvexHull(body).vertices] for body in bodies] for bodies in level]
    return [Moving(*one) for one in zip(outlines, moments, strict=True)]


class MovingLayer:
    """Drawings of movers on axes from above; empty until something is shown."""

    def __init__(self, axes: Axes) -> None:
        from matplotlib.collections import PathCollection, PolyCollection

        def layer(zorder: float, **how: Any) -> PolyCollection:
            collection = PolyCollection([], zorder=zorder, **how)
            axes.add_collection(collection, autolim=False)
            return collection

        # One path of many rectangles is filled once: veils that overlap do not add up.
        self._later = PathCollection([], zorder=4.2, facecolors=MOVER, alpha=_FAINT, linewidths=0.0)
        axes.add_collection(self._later, autolim=False)
        self._now = layer(4.4, facecolors="none", edgecolors=MOVER, linewidths=0.8)
        self._bodies = layer(8.0, facecolors=MOVER, edgecolors="white", linewidths=0.6)
        (self._edge,) = axes.plot([], [], color="white", linewidth=4.6, zorder=8.4, solid_capstyle="round")
        (self._motion,) = axes.plot([], [], color=MOTION, linewidth=3.0, zorder=8.5, solid_capstyle="round")
        (self._rest,) = axes.plot([], [], "o", zorder=8.6, **_REST)

    def show(self, moving: Moving) -> None:
        """Show one position of a flight, in place of what was shown."""
        from matplotlib.path import Path

        now, *later = moving.moment.boxes
        self._now.set_verts(_rectangles(now))
        veils = [Path(corners, closed=False) for boxes in later for corners in _rectangles(boxes)]
        self._later.set_paths([Path.make_compound_path(*veils)] if veils else [])
        self._bodies.set_verts(moving.outlines)
        way = moving.moment.motion[:, :2]
        self._edge.set_data(*way.T)
        self._motion.set_data(*way.T)
        self._rest.set_data(*way[-1:].T)


def moving_labels() -> list[Any]:
    """Its text in a legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Line2D([], [], color=MOTION, linewidth=3.0, label="committed motion"),
        Patch(facecolor=MOVER, label="mover"),
        Patch(facecolor="none", edgecolor=MOVER, linewidth=0.8, label="may hold a mover now"),
        Patch(facecolor=MOVER, alpha=1.5 * _FAINT, linewidth=0.0, label="within the horizon"),
        Patch(facecolor=FLAGGED, linewidth=0.0, label="flagged"),
    ]


def _rectangles(boxes: Float[np.ndarray, "b 2 3"]) -> list[np.ndarray]:
    """The boxes from above, as polygons."""
    (x0, y0), (x1, y1) = boxes[:, 0, :2].T, boxes[:, 1, :2].T
    return list(np.stack([np.stack([x0, y0], -1), np.stack([x1, y0], -1), np.stack([x1, y1], -1),
                          np.stack([x0, y1], -1)], axis=1))  # fmt: skip
