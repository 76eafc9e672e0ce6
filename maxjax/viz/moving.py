"""Movers from above: where they are, what may hold them, and the motion that the vehicle has committed itself to.

filled   the mover                        outline  the box that may hold it now
faint    boxes that may hold it later     line     the motion, to its place of rest
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from maxjax.sim.moving.moments import Moment
from maxjax.viz.style import FLAGGED, MOTION, MOVER
from maxjax.worlds.movers import Movers, boxes_at
from maxjax.worlds.populations import placed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST = 0.7  # half edge of a mover that is shown [m]
_FAINT = 0.07  # opacity of a box later


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

    there = np.asarray(placed(movers))
    level = np.asarray(boxes_at(movers, jnp.asarray(times, jnp.float32), LEAST), np.float64)[:, there, :, :2]
    outlines = [[body[ConvexHull(body).vertices] for body in bodies] for bodies in level]
    return [Moving(*one) for one in zip(outlines, moments, strict=True)]


class MovingLayer:
    """What is drawn of movers on axes from above; empty until something is shown."""

    def __init__(self, axes: Axes) -> None:
        from matplotlib.collections import PolyCollection

        def layer(zorder: float, **how: Any) -> PolyCollection:
            collection = PolyCollection([], zorder=zorder, **how)
            axes.add_collection(collection, autolim=False)
            return collection

        self._later = layer(4.2, facecolors=MOVER, alpha=_FAINT, linewidths=0.0)
        self._now = layer(4.4, facecolors="none", edgecolors=MOVER, linewidths=0.8)
        self._bodies = layer(8.0, facecolors=MOVER, edgecolors="white", linewidths=0.3)
        (self._motion,) = axes.plot([], [], color=MOTION, linewidth=2.2, zorder=8.5, solid_capstyle="round")

    def show(self, moving: Moving) -> None:
        """Show one position of a flight, in place of what was shown."""
        now, *later = moving.moment.boxes
        self._now.set_verts(_rectangles(now))
        self._later.set_verts([verts for boxes in later for verts in _rectangles(boxes)])
        self._bodies.set_verts(moving.outlines)
        self._motion.set_data(*moving.moment.motion[:, :2].T)


def moving_labels() -> list[Any]:
    """What a legend says of it."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    return [
        Patch(facecolor=MOVER, label="mover"),
        Patch(facecolor="none", edgecolor=MOVER, linewidth=0.8, label="may hold a mover now"),
        Patch(facecolor=MOVER, alpha=3.0 * _FAINT, label="within the horizon"),
        Line2D([], [], color=MOTION, linewidth=2.2, label="committed motion"),
        Line2D([], [], color=FLAGGED, marker="s", markersize=3.0, linestyle="", label="flagged"),
    ]


def _rectangles(boxes: Float[np.ndarray, "b 2 3"]) -> list[np.ndarray]:
    """The boxes from above, as polygons."""
    (x0, y0), (x1, y1) = boxes[:, 0, :2].T, boxes[:, 1, :2].T
    return list(np.stack([np.stack([x0, y0], -1), np.stack([x1, y0], -1), np.stack([x1, y1], -1),
                          np.stack([x0, y1], -1)], axis=1))  # fmt: skip
