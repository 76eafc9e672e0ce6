"""A battery, and how much of it a flight may take.

usable = capacity (1 − reserve)
"""

from __future__ import annotations

import dataclasses
import math


@dataclasses.dataclass(frozen=True)
class Battery:
    """A full battery; there is none without a reserve, as no model of power is exact and none knows its age.

    Attributes:
        capacity: [Wh].
        reserve: share that no flight may touch, above 0, below 1.

    Raises:
        ValueError: for a capacity that is none, or a reserve that leaves all of it or nothing.
    """

    capacity: float
    reserve: float

    def __post_init__(self) -> None:
        if not 0.0 < self.capacity < math.inf:
            raise ValueError(f"battery: expected a capacity above 0 Wh, given {self.capacity:g}")
        if not 0.0 < self.reserve < 1.0:
            left = "nothing is left to fly with" if self.reserve >= 1.0 else "no flight is called enough without one"
            raise ValueError(f"reserve: expected a share above 0, below 1, given {self.reserve:g}: {left}")

    @property
    def usable(self) -> float:
        """What a flight may take [Wh]."""
        return self.capacity * (1.0 - self.reserve)
