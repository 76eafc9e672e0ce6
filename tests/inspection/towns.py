"""Towns that several tests of inspections look at, and C MuJoCo's rays in them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

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


def ray_model(triangles: np.ndarray) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A mesh of some triangles for C `mj_ray`."""
    vertices = " ".join(f"{x:.9g}" for x in triangles.ravel())
    faces = " ".join(str(k) for k in range(3 * len(triangles)))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="m" vertex="{vertices}" face="{faces}" inertia="shell"/></asset>'
        '<worldbody><geom type="mesh" mesh="m"/></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def hits(where: tuple[mujoco.MjModel, mujoco.MjData], origin: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """How far short of some ends C MuJoCo's rays from a place meet something [m]; negative: they do not."""
    ways = ends - origin
    length = np.linalg.norm(ways, axis=1)
    found = [
        mujoco.mj_ray(*where, origin, way / far, None, 1, -1, np.zeros(1, np.int32))
        for way, far in zip(ways, length, strict=True)
    ]
    return length - np.where(np.array(found) < 0.0, np.inf, found)
