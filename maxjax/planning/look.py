"""Where a camera looks at a waypoint, and what it takes there and on the way on.

    pitch: from the horizon upwards [rad], −π/2 straight down

The heading is the vehicle's (`Waypoint.heading`, `Waypoint.look_at`), the pitch the gimbal's. A photo at a waypoint is
taken once the vehicle has rested there; photos on the way are taken by the distance flown, whatever the heading of the
legs between.
"""

from __future__ import annotations

import dataclasses
import math


@dataclasses.dataclass(frozen=True)
class Look:
    """What a mission does with a camera from a waypoint on.

    Attributes:
        pitch: elevation of the line of sight [rad]. None: as it was.
        photo: whether a photo is taken there.
        every: distance between photos from there on [m], until a waypoint says otherwise; 0: none from there on.
            None: as before.

    Raises:
        ValueError: for angles that are not finite, a pitch beyond ±π/2, or a distance that is negative or not finite.
    """

    pitch: float | None = None
    photo: bool = False
    every: float | None = None

    def __post_init__(self) -> None:
        if self.pitch is not None and not abs(self.pitch) <= 0.5 * math.pi + 1e-9:
            raise ValueError(f"Look.pitch: expected an angle from -pi/2 to pi/2 [rad], given {self.pitch!r}")
        if self.every is not None and not 0.0 <= self.every < math.inf:
            raise ValueError(f"Look.every: expected a distance of at least 0 m, given {self.every!r}")


@dataclasses.dataclass(frozen=True)
class AimedLook:
    """A look with the heading of the vehicle, as files hold both.

    Attributes:
        yaw: heading at the waypoint [rad], from east to north. None: along the way.
        pitch, photo, every: as of `Look`.
    """

    yaw: float | None = None
    pitch: float | None = None
    photo: bool = False
    every: float | None = None
