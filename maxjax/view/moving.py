"""Movers of a flight as a page shows them: boxes, in turns of a tenth of a second.

What moves in a trial is known without flying it again (`campaigns.trial_movers`). A box stands for each solid, at least
0.8 m wide: a drone of 0.3 m could not be seen.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from maxjax.view.colors import MOVER
from maxjax.view.film import Cue
from maxjax.view.nodes import Frame, Surface
from maxjax.worlds.movers import Movers, boxes_at
from maxjax.worlds.populations import placed

MOVERS_NODE = "/movers"
_LEAST = 0.4  # half edge that is shown [m]
# Two triangles a side of the box, counter-clockwise as seen from outside, and how bright the sides are.
_SIDES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
_BRIGHT = np.array([0.8, 0.9, 0.75, 0.95, 0.6, 1.0])


def moving_cues(movers: Movers, times: Float[np.ndarray, " n"], frame: Frame) -> tuple[Cue, ...]:
    """Where movers are at some times [s], from each on; those without a way are left out."""
    there = np.asarray(placed(movers))
    if not there.any():
        return ()
    corners = frame.page(np.asarray(boxes_at(movers, jnp.asarray(times, jnp.float32), _LEAST), np.float64)[:, there])
    return tuple(
        Cue(float(time), MOVERS_NODE, {MOVERS_NODE: _boxes(one)}) for time, one in zip(times, corners, strict=True)
    )


def _boxes(corners: Float[np.ndarray, "m 8 3"]) -> Surface:
    """Boxes by their corners, each side with its own light."""
    points = corners[:, _SIDES].reshape(-1, 3)
    first = 4 * np.arange(len(points) // 4, dtype=np.uint32)[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]], np.uint32)).reshape(-1, 3)
    bright = np.tile(np.repeat(_BRIGHT, 4), len(corners))
    colors = np.round(np.array(MOVER) * bright[:, None]).astype(np.uint8)
    return Surface(points.astype(np.float32), faces, colors)
