"""Cameras: pixels, angle of view, what a pixel covers, and which way the gimbal can turn them.

    tan(half angle) = sensor / (2 focal length)        along the width and along the height
    footprint       = 2 distance · tan(half angle)     on a plane across the line of sight
    g               = footprint / pixels               ground sample distance

A pinhole without distortion. Angles of a camera are degrees, as its data sheet has them; elevations count from the
horizon, upwards positive.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from maxjax.inspection.camera_table import CAMERAS

_WIDEST = 170.0  # angle of view of a pinhole [deg]; beyond, its footprint means nothing


@dataclasses.dataclass(frozen=True)
class Camera:
    """A camera on a gimbal, with its width level.

    The angle of view comes from sensor and focal length, or is given from corner to corner, as in data sheets.

    Attributes:
        name: for messages.
        pixels: of a photo, width and height.
        sensor: width and height of what the photo uses of it [mm].
        focal_length: the true one, not its equivalent on 35 mm film [mm].
        field_of_view: in place of these two, the angle from corner to corner [deg].
        gimbal: lowest and highest elevation of the line of sight [deg].
        interval: least time from one photo to the next [s].
        source: where the numbers come from.

    Raises:
        ValueError: if there is no angle of view or two of them, a number is not positive and finite, or the gimbal's
            range is none.
    """

    name: str
    pixels: tuple[int, int]
    sensor: tuple[float, float] | None = None
    focal_length: float | None = None
    field_of_view: float | None = None
    gimbal: tuple[float, float] = (-90.0, 0.0)
    interval: float = 1.0
    source: str = ""

    def __post_init__(self) -> None:
        by_lens = self.sensor is not None and self.focal_length is not None
        if by_lens == (self.field_of_view is not None):
            raise ValueError(
                f"{self.name}: expected an angle of view, by sensor and focal_length [mm] or by field_of_view [deg], "
                f"given {'both' if by_lens else 'none'}"
            )
        self._check("pixels", self.pixels)
        self._check("sensor [mm]", self.sensor)
        self._check("focal_length [mm]", self.focal_length)
        self._check("field_of_view [deg]", self.field_of_view, _WIDEST)
        self._check("interval [s]", self.interval)
        low, high = self.gimbal
        if not -90.0 <= low <= high <= 90.0:
            raise ValueError(f"{self.name}: gimbal: expected -90 <= lowest <= highest <= 90 [deg], given {self.gimbal}")

    def _check(self, what: str, given: Any, most: float = math.inf) -> None:
        numbers = () if given is None else given if isinstance(given, tuple) else (given,)
        if not all(isinstance(number, int | float) and 0.0 < number < most for number in numbers):
            limit = f" below {most:g}" if math.isfinite(most) else ""
            raise ValueError(f"{self.name}: {what}: expected positive finite numbers{limit}, given {given}")

    @classmethod
    def named(cls, name: str) -> Camera:
        """A camera of the table, by its name without regard to case.

        Raises:
            ValueError: if it is none of them, with their names.
        """
        for row in CAMERAS:
            if row["name"].lower() == name.strip().lower():
                return cls(**row)
        known = ", ".join(row["name"] for row in CAMERAS)
        raise ValueError(f"camera: expected one of {known}, given {name!r}; others are made by maxjax.Camera(…)")

    @property
    def half_tangents(self) -> tuple[float, float]:
        """Tangents of half the angles of view, across the width and across the height."""
        if self.sensor is not None and self.focal_length is not None:
            across, along = (0.5 * side / self.focal_length for side in self.sensor)
            return across, along
        diagonal = math.tan(math.radians(0.5 * (self.field_of_view or 0.0)))
        across, along = (diagonal * side / math.hypot(*self.pixels) for side in self.pixels)
        return across, along

    @property
    def pixel_angle(self) -> float:
        """What a pixel in the middle covers at a distance of 1 m, the larger of its two sides [m]."""
        return max(2.0 * t / n for t, n in zip(self.half_tangents, self.pixels, strict=True))

    def footprint(self, distance: float) -> tuple[float, float]:
        """Width and height of what a photo covers of a plane across the line of sight [m]."""
        across, along = self.half_tangents
        return 2.0 * distance * across, 2.0 * distance * along

    def ground_sample_distance(self, distance: float) -> float:
        """Edge of what a pixel covers there, straight ahead [m]."""
        return distance * self.pixel_angle

    def fastest(self, apart: float) -> float:
        """The greatest speed at which photos can be so far apart [m/s]."""
        return apart / self.interval
