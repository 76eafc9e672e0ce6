"""Towns that several tests of inspections look at, and C MuJoCo's rays in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.common.mesh_rays import MeshRays
from maxjax.io.kinds.footprints import Footprint, Footprints
from maxjax.io.load import LoadedMap, map_of
from maxjax.io.reading import PLAIN
from maxjax.io.window import Window

SAMPLES = Path(__file__).parents[2] / "docs" / "samples"


def rectangle(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    """An outline."""
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def town(*houses: tuple[np.ndarray, float], spacing: float = 1.0, room: float = 25.0, sky: float = 20.0) -> LoadedMap:
    """Houses on flat ground, each an outline and a height, as a map with faces."""
    found = tuple(Footprint((outline,), 0.0, height, f"house {k}") for k, (outline, height) in enumerate(houses))
    corners = np.concatenate([outline for outline, _ in houses])
    low, high = corners.min(axis=0) - room, corners.max(axis=0) + room
    top = max(height for _, height in houses) + sky
    bounds = (*low.tolist(), -spacing, *high.tolist(), top)
    return map_of(Footprints(found, np.zeros((0, 3, 3)), "a town"), Window(spacing, bounds, ground=0.0), PLAIN)


def ray_model(triangles: np.ndarray) -> MeshRays:
    """A mesh of some triangles for C MuJoCo."""
    return MeshRays(triangles)


def hits(where: MeshRays, origin: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """How far short of some ends C MuJoCo's rays from a place meet something [m]; negative: they do not."""
    return np.linalg.norm(ends - origin, axis=1) - where.first_hits(origin, ends)
