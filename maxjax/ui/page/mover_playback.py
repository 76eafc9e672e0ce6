"""Movers of a flight as a page shows them, and what the vehicle knew of them, in turns of a tenth of a second.

box     the mover                         frame   what may hold it now
veil    what may hold it at the horizon   line    the motion that is flown, to its place of rest

What moves in a trial is known without flying it again (`sim.trials.trial_movers`); what was known of it is not. A box
stands for each solid, at least 0.8 m wide: a drone of 0.3 m could not be seen.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from maxjax.sim.movers.moments import Moment
from maxjax.sim.worlds.movers import Movers, boxes_at
from maxjax.sim.worlds.populations import place_movers
from maxjax.ui.page.colors import MOVER, REFERENCE
from maxjax.ui.page.draw import plain_line
from maxjax.ui.page.nodes import Frame, Lines, Node, Surface
from maxjax.ui.page.timeline import Cue

MOVERS_NODE, KNOWN_NODE = "/movers", "/among"
_LEAST = 0.4  # half edge that is shown [m]
# Two triangles a side of the box, counter-clockwise as seen from outside, and how bright the sides are.
_SIDES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
_EDGES = np.array([[a, a | bit] for a in range(8) for bit in (1, 2, 4) if not a & bit])
_VEIL, _FRAME, _MOTION = 0.05, 1.5, 6.0  # opacity, so low because veils stack; widths [px]
_BRIGHT = np.array([0.8, 0.9, 0.75, 0.95, 0.6, 1.0])


def moving_cues(movers: Movers, times: Float[np.ndarray, " n"], frame: Frame) -> tuple[Cue, ...]:
    """Where movers are at some times [s], from each on; those without a way are left out."""
    there = np.asarray(place_movers(movers))
    if not there.any():
        return ()
    corners = frame.page(np.asarray(boxes_at(movers, jnp.asarray(times, jnp.float32), _LEAST), np.float64)[:, there])
    return tuple(
        Cue(float(time), MOVERS_NODE, {MOVERS_NODE: _boxes(one)}) for time, one in zip(times, corners, strict=True)
    )


def knowledge_cues(moments: Sequence[Moment], times: Float[np.ndarray, " n"], frame: Frame) -> tuple[Cue, ...]:
    """Tracks of movers and the chosen motion at some times [s], from each on."""
    return tuple(
        Cue(float(time), KNOWN_NODE, _known(moment, frame)) for time, moment in zip(times, moments, strict=True)
    )


def _known(moment: Moment, frame: Frame) -> dict[str, Node]:
    nodes: dict[str, Node] = {}
    if len(moment.boxes[0]):
        now, later = (frame.page(_corners(boxes)) for boxes in (moment.boxes[0], moment.boxes[-1]))
        edges = now[:, _EDGES].reshape(-1, 2, 3)
        colors = np.broadcast_to(np.array(MOVER, np.uint8), edges.shape)
        nodes[f"{KNOWN_NODE}/now"] = Lines(edges, colors, _FRAME)
        nodes[f"{KNOWN_NODE}/later"] = _boxes(later, _VEIL)
    if np.ptp(moment.motion, axis=0).max() > 0.1:
        nodes[f"{KNOWN_NODE}/motion"] = plain_line(frame.page(moment.motion), REFERENCE, _MOTION)
    return nodes


def _corners(boxes: Float[np.ndarray, "b 2 3"]) -> Float[np.ndarray, "b 8 3"]:
    """In the order of `sim.worlds.movers.boxes_at`: z changes first."""
    which = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    corners: Float[np.ndarray, "b 8 3"] = boxes[:, which, np.arange(3)]
    return corners


def _boxes(corners: Float[np.ndarray, "m 8 3"], opacity: float = 1.0) -> Surface:
    """Boxes by their corners, each side with its own light."""
    points = corners[:, _SIDES].reshape(-1, 3)
    first = 4 * np.arange(len(points) // 4, dtype=np.uint32)[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]], np.uint32)).reshape(-1, 3)
    bright = np.tile(np.repeat(_BRIGHT, 4), len(corners))
    colors = np.round(np.array(MOVER) * bright[:, None]).astype(np.uint8)
    return Surface(points.astype(np.float32), faces, colors, opacity)
