"""Oracle: a CityJSON LoD1 model on a voxel grid, read and rasterised without any code of maxjax's readers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np


def column_heights(path: Path, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Base and roof of the buildings at columns (x[i], y[j]) [m], NaN without; and where the model is.

    A column belongs to a building if its centre lies in a face that is not a wall; its base and roof are the
    lowest and the highest of those faces there.
    """
    city = json.loads(path.read_text())
    vertices = np.array(city["vertices"], float)
    base, roof = np.full((2, len(x), len(y)), np.nan)
    covered = np.zeros((len(x), len(y)), bool)
    for thing in city["CityObjects"].values():
        building = thing["type"] == "Building"
        for geometry in thing["geometry"]:
            shells = geometry["boundaries"] if geometry["type"] == "Solid" else [geometry["boundaries"]]
            for face in (face for shell in shells for face in shell):
                i, j = _inside(face, vertices, x, y)
                covered[i, j] = True
                if building and len(i):
                    z = _height(vertices[face[0]], x[i], y[j])
                    base[i, j] = np.fmin(base[i, j], z)
                    roof[i, j] = np.fmax(roof[i, j], z)
    return base, roof, covered


def _inside(
    rings: list[list[int]], vertices: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Columns in the face's shadow on the ground: the even-odd rule over all its rings."""
    outer = vertices[rings[0]]
    (x0, y0), (x1, y1) = outer[:, :2].min(0), outer[:, :2].max(0)
    i, j = np.flatnonzero((x >= x0) & (x <= x1)), np.flatnonzero((y >= y0) & (y <= y1))
    i, j = (index.ravel() for index in np.meshgrid(i, j, indexing="ij"))
    odd = np.zeros(len(i), bool)
    for ring in rings:
        corners = vertices[ring][:, :2]
        for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if ay != by:
                crosses = (y[j] < ay) != (y[j] < by)
                odd ^= crosses & (x[i] < ax + (y[j] - ay) * (bx - ax) / (by - ay))
    return i[odd], j[odd]


def _height(corners: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height of the face's plane (least squares over its corners) at the columns."""
    design = np.column_stack([corners[:, :2] - corners[0, :2], np.ones(len(corners))])
    slope_x, slope_y, level = np.linalg.lstsq(design, corners[:, 2], rcond=None)[0]
    return slope_x * (x - corners[0, 0]) + slope_y * (y - corners[0, 1]) + level
