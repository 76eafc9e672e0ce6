"""The wind of a flight: one velocity of the air for all of it, or one at each of some times, linear between them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float64


@dataclasses.dataclass(frozen=True, eq=False)
class Wind:
    """Velocity of the air over time; before the first and after the last time it stays.

    Attributes:
        times: since the start of the flight, rising [s].
        velocities: of the air, ENU: where it blows to [m/s].

    Raises:
        ValueError: for arrays of other shapes, numbers that are not finite, or times that do not rise.
    """

    times: Float64[np.ndarray, " n"]
    velocities: Float64[np.ndarray, "n 3"]

    def __post_init__(self) -> None:
        times, velocities = np.asarray(self.times, np.float64), np.asarray(self.velocities, np.float64)
        if times.ndim != 1 or len(times) == 0 or velocities.shape != (len(times), 3):
            raise ValueError(
                f"Wind: expected times (n,) and velocities (n, 3), given shapes {times.shape} and {velocities.shape}"
            )
        if not (np.isfinite(times).all() and np.isfinite(velocities).all()):
            raise ValueError("Wind: expected finite numbers, given others")
        if (np.diff(times) <= 0.0).any():
            raise ValueError("Wind.times: expected times that rise, given others; sort them")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "velocities", velocities)

    @classmethod
    def calm(cls) -> Wind:
        """None."""
        return cls.blowing(0.0, 0.0)

    @classmethod
    def blowing(cls, speed: float, direction: float) -> Wind:
        """A wind as weather reports tell it.

        Args:
            speed: [m/s].
            direction: where it comes from, clockwise from north [deg].

        Raises:
            ValueError: for a speed or a direction that is none.
        """
        if not 0.0 <= speed < math.inf:
            raise ValueError(f"wind: expected a speed from 0 m/s on, given {speed}")
        if not math.isfinite(direction):
            raise ValueError(f"wind: expected the degrees that it comes from, given {direction}")
        angle = math.radians(direction)
        return cls(np.zeros(1), -speed * np.array([[math.sin(angle), math.cos(angle), 0.0]]))

    @property
    def strongest(self) -> float:
        """Its greatest speed [m/s]."""
        return float(np.linalg.norm(self.velocities, axis=1).max())

    def at(self, times: Float64[np.ndarray, " t"]) -> Float64[np.ndarray, "t 3"]:
        """Velocities of the air at some times [m/s]."""
        columns = [np.interp(times, self.times, column) for column in self.velocities.T]
        found: Float64[np.ndarray, "t 3"] = np.stack(columns, axis=1)
        return found
