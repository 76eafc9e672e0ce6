"""How a surface is to be photographed: from how far, with how much overlap, how obliquely, how finely.

    views = ⌊1/(1 − forward)⌋ · ⌊1/(1 − sideways)⌋      photos that show each point, at least

Photos of a wall in rows that overlap by these shares show each of its points so often, away from its border. A point of
any surface is asked to be seen as often, from as many places.
"""

from __future__ import annotations

import dataclasses
import math

from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.visibility import SightLimits

_ROUNDING = 1e-9


@dataclasses.dataclass(frozen=True)
class Capture:
    """What photos of a surface are to be like.

    Attributes:
        distance: from the surface at which they are taken, where that is free [m].
        overlap: share of a photo that the next one of a row shows, too, and one of the next row.
        incidence: greatest angle between a line of sight and the surface's normal [deg].
        resolution: greatest side of what a pixel covers on the surface [m]; None: twice that straight ahead.

    Raises:
        ValueError: for a distance or a resolution that is not positive, an overlap that is not from 0 on and below 1,
            or an incidence that is not between 0 and 90 degrees.
    """

    distance: float = 8.0
    overlap: tuple[float, float] = (0.7, 0.6)
    incidence: float = 60.0
    resolution: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.distance < math.inf:
            raise ValueError(f"distance: expected a positive number of metres, given {self.distance}")
        pair = tuple(self.overlap)
        if len(pair) != 2 or not all(0.0 <= share < 1.0 for share in pair):
            raise ValueError(
                f"overlap: expected two shares, forward and sideways, from 0 on and below 1, given {self.overlap}; "
                "at 1 the next photo is the same one"
            )
        object.__setattr__(self, "overlap", (float(pair[0]), float(pair[1])))
        SightLimits(self.incidence, 1.0 if self.resolution is None else self.resolution)

    @property
    def views(self) -> int:
        """Photos that are to show each point."""
        forward, sideways = (math.floor(1.0 / (1.0 - share) + _ROUNDING) for share in self.overlap)
        return forward * sideways

    def limits(self, camera: Camera) -> SightLimits:
        """What counts as seen by a camera."""
        ahead = camera.ground_sample_distance(self.distance)
        return SightLimits(self.incidence, 2.0 * ahead if self.resolution is None else self.resolution)

    def steps(self, camera: Camera, distance: float | None = None) -> tuple[float, float]:
        """Distances between photos of a row along the photos' width, and between rows [m]."""
        width, height = camera.footprint(self.distance if distance is None else distance)
        return (1.0 - self.overlap[0]) * width, (1.0 - self.overlap[1]) * height
