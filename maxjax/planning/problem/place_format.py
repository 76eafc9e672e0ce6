"""Places and heights in the words of whoever gave them: x, y, z of the map, heights above ground, places on Earth."""

from __future__ import annotations

import dataclasses
import math
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64

from maxjax.core.grid import Point3
from maxjax.core.terrain import Terrain


@runtime_checkable
class Geodetic(Protocol):
    """A local frame whose place on Earth is known."""

    def geodetic(self, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
        """Latitude, longitude [degrees] and height above sea level [m] of points in the frame [m]."""
        ...


@dataclasses.dataclass(frozen=True)
class PlaceFormat:
    """How places are given.

    Attributes:
        frame: map, local-agl, agl or amsl, as `io.places` has them.
        earth: where the map lies, for agl and amsl.
        terrain: how high the ground is, for local-agl and agl; None: unknown.
    """

    frame: str = "map"
    earth: Geodetic | None = None
    terrain: Terrain | None = None

    def ground(self, point: Point3) -> float:
        """Height of the ground below a point [m]; NaN where it is unknown."""
        return math.nan if self.terrain is None else self.terrain.at(point[0], point[1])

    @property
    def above_ground(self) -> bool:
        """Whether heights count from the ground."""
        return self.frame in ("local-agl", "agl")

    def place(self, point: Point3) -> str:
        """A point of the map."""
        x, y, z = point
        if not all(map(math.isfinite, point)) or self.frame == "map":
            return f"({x:.10g}, {y:.10g}, {z:.10g})"
        if self.frame != "local-agl" and self.earth is not None:
            north, east, _ = self.earth.geodetic(np.array([point], np.float64))[0].tolist()
            return f"(latitude {north:.7f}, longitude {east:.7f}, {self.height(point)})"
        return f"(x {x:.10g}, y {y:.10g}, {self.height(point)})"

    def height(self, point: Point3) -> str:
        """The height of a point of the map."""
        z, ground = point[2], self.ground(point)
        if self.above_ground and math.isfinite(ground):
            return f"{round(z - ground, 2) + 0.0:.10g} m above ground"
        if self.frame == "amsl" and self.earth is not None:
            return f"{float(self.earth.geodetic(np.array([point], np.float64))[0, 2]):.1f} m above sea level"
        return f"z = {z:.1f}"
