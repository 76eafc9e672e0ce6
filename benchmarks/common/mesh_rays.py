"""C MuJoCo's rays in a mesh: an oracle of what is hidden, and of what a straight leg passes through.

Nothing here imports maxjax: its own rays are judged by these.
"""

from __future__ import annotations

import dataclasses
import functools

import mujoco
import numpy as np
from jaxtyping import Bool, Float64

_SMALLEST = 1e-10  # twice the area of a triangle that counts [m²]


@dataclasses.dataclass(frozen=True, eq=False)
class MeshRays:
    """Triangles for MuJoCo's rays.

    Attributes:
        triangles: (n, 3, 3) corners [m].
    """

    triangles: Float64[np.ndarray, "n 3 3"]

    @functools.cached_property
    def _middle(self) -> Float64[np.ndarray, "3"]:
        """About which MuJoCo's vertices, which are float32, count [m]."""
        return np.asarray(self.triangles.reshape(-1, 3).mean(axis=0))

    @functools.cached_property
    def _model(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        edges = self.triangles[:, 1:] - self.triangles[:, :1]
        kept = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) > _SMALLEST
        corners = (self.triangles[kept] - self._middle).reshape(-1, 3)
        spec = mujoco.MjSpec()
        mesh = spec.add_mesh(name="city", uservert=corners.ravel(), userface=np.arange(len(corners)))
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="city")
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        return model, data

    def first_hits(
        self, origin: Float64[np.ndarray, "3"], ends: Float64[np.ndarray, "n 3"]
    ) -> Float64[np.ndarray, " n"]:
        """Distance from a place along the ways to some ends to the first triangle, infinite where there is none [m]."""
        ways = ends - origin
        length = np.maximum(np.linalg.norm(ways, axis=1), 1e-9)
        found, geom = np.empty(len(ends)), np.empty(len(ends), np.int32)
        if len(ends):
            rays = (ways / length[:, None]).ravel()
            far = float(length.max()) + 1.0
            start = np.asarray(origin - self._middle, np.float64)
            mujoco.mj_multiRay(*self._model, start, rays, None, True, -1, geom, found, None, len(ends), far)
        return np.where(found < 0.0, np.inf, found)

    def hides(
        self, origin: Float64[np.ndarray, "3"], ends: Float64[np.ndarray, "n 3"], touch: float
    ) -> Bool[np.ndarray, " n"]:
        """Which ends something hides from a place: it is nearer than they are, by more than a distance [m]."""
        return np.asarray(self.first_hits(origin, ends) < np.linalg.norm(ends - origin, axis=1) - touch)
