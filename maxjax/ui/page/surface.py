"""Voxels as the faces that can be seen of them, joined into few rectangles, with the light in their colours.

    face of a voxel: seen where its neighbour on that side is empty        faces of one plane: joined (`boxes.merged`)

A browser without a GPU computes every pixel: colours that hold the light already are the cheapest to draw.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int64

from maxjax.core.grid import Grid
from maxjax.ui.page.colors import HEIGHTS, Rgb, ramp
from maxjax.ui.page.merged_boxes import merge_voxels
from maxjax.ui.page.nodes import Frame, Surface

# How bright a face is, by its axis and side: the sun stands in the south-west, high.
_LIGHT = {(0, -1): 0.80, (0, 1): 0.64, (1, -1): 0.90, (1, 1): 0.58, (2, -1): 0.45, (2, 1): 1.0}


def surface(
    volume: Bool[np.ndarray, "nx ny nz"],
    grid: Grid,
    frame: Frame,
    color: Rgb | None = None,
    opacity: float = 1.0,
    hidden_by: Bool[np.ndarray, "nx ny nz"] | None = None,
) -> Surface:
    """The surface of a volume as seen from above and from its sides; not from below the grid.

    Args:
        volume: its voxels.
        grid: where they lie.
        frame: of the page.
        color: of all faces; None: by height, from the volume's lowest to its highest.
        opacity: 1: opaque.
        hidden_by: voxels behind which no face is seen; None: the volume's own.
    """
    solid = np.pad(volume if hidden_by is None else hidden_by, 1)
    solid[:, :, 0] = True
    corners, light = [], []
    for (axis, side), brightness in _LIGHT.items():
        found = _rectangles(volume & ~_beside(solid, axis, side), axis, side)
        corners.append(found)
        light.append(np.full(len(found), brightness))
    quads = np.concatenate(corners)
    bright = np.repeat(np.concatenate(light), 4)
    points = frame.page(np.array(grid.lower) + grid.spacing * quads.reshape(-1, 3))
    if color is None:
        low, high = (points[:, 2].min(), points[:, 2].max()) if len(points) else (0.0, 1.0)
        rgb = ramp(HEIGHTS, (points[:, 2] - low) / max(high - low, 1e-9))
    else:
        rgb = np.broadcast_to(np.array(color, np.uint8), points.shape)
    first = 4 * np.arange(len(quads), dtype=np.uint32)[:, None, None]
    faces = first + np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    colors = np.round(rgb * bright[:, None]).astype(np.uint8)
    return Surface(points.astype(np.float32), faces.reshape(-1, 3), colors, opacity)


def split_surface(
    whole: Surface, grid: Grid, frame: Frame, columns: Bool[np.ndarray, "nx ny"]
) -> tuple[Surface, Surface]:
    """A surface as what stands in some columns of its grid, and the rest; a rectangle goes where its middle is."""
    quads = whole.points.reshape(-1, 4, 3)
    normal = np.cross(quads[:, 1] - quads[:, 0], quads[:, 2] - quads[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    # Half a voxel behind its face, and off the border of two where a side has an even number of them.
    behind = frame.map(quads.mean(axis=1) - (0.5 * normal + 0.01) * grid.spacing)
    i, j = np.floor((behind - np.array(grid.lower)) / grid.spacing).astype(np.int64)[:, :2].T
    chosen = columns[i.clip(0, columns.shape[0] - 1), j.clip(0, columns.shape[1] - 1)]
    return _quads(whole, chosen), _quads(whole, ~chosen)


def _quads(whole: Surface, chosen: Bool[np.ndarray, " q"]) -> Surface:
    """Some rectangles of a surface that consists of rectangles."""
    points, colors = (of.reshape(-1, 4, 3)[chosen].reshape(-1, 3) for of in (whole.points, whole.colors))
    return Surface(points, whole.faces[: len(points) // 2], colors, whole.opacity)


def _beside(padded: Bool[np.ndarray, "mx my mz"], axis: int, side: int) -> Bool[np.ndarray, "nx ny nz"]:
    """The neighbours of all voxels on one side, of an array that has one layer more on each."""
    inner = [slice(1, -1)] * 3
    inner[axis] = slice(2, None) if side > 0 else slice(None, -2)
    return padded[tuple(inner)]


def _rectangles(seen: Bool[np.ndarray, "nx ny nz"], axis: int, side: int) -> Int64[np.ndarray, "n 4 3"]:
    """The faces on one side of some voxels as rectangles: corners in voxels, counter-clockwise seen from outside."""
    # An empty layer between any two: faces of different planes are not joined.
    shape = list(seen.shape)
    shape[axis] *= 2
    apart = np.zeros(shape, bool)
    every: list[slice] = [slice(None)] * 3
    every[axis] = slice(None, None, 2)
    apart[tuple(every)] = seen
    boxes = merge_voxels(apart)
    u, v = (axis + 1) % 3, (axis + 2) % 3
    quads = np.zeros((len(boxes), 4, 3), np.int64)
    quads[:, :, axis] = (boxes[:, 2 * axis] // 2 + (side > 0))[:, None]
    turn = [(0, 0), (1, 0), (1, 1), (0, 1)] if side > 0 else [(0, 0), (0, 1), (1, 1), (1, 0)]
    for k, (a, b) in enumerate(turn):
        quads[:, k, u], quads[:, k, v] = boxes[:, 2 * u + a], boxes[:, 2 * v + b]
    return quads
