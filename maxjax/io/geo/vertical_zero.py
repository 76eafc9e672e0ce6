"""The zero of a map's heights: sea level, an ellipsoid, or a zero that nobody stated.

    height above sea level = z + height of the map's z = 0 above sea level
    height above sea level = height above the ellipsoid − N            N: undulation of the geoid there [m]

National heights, EGM96, EGM2008 and a receiver's "mean sea level" differ by decimetres, and are taken as one.
"""

from __future__ import annotations

import dataclasses

import numpy as np

_HIGHEST = 1e5  # [m]


class UnknownZeroError(ValueError):
    """A sentence on what needs a height above sea level that is not known."""


@dataclasses.dataclass(frozen=True)
class VerticalZero:
    """What a map's heights count from.

    Attributes:
        above_sea: height of z = 0 above sea level [m]; None where it is not known.
        datum: what the heights count from, in words; None where nobody states it.
        ellipsoidal: whether z = 0 lies on an ellipsoid.

    Raises:
        ValueError: if the height is none.
    """

    above_sea: float | None = None
    datum: str | None = None
    ellipsoidal: bool = False

    def __post_init__(self) -> None:
        if self.above_sea is not None and not abs(self.above_sea) <= _HIGHEST:
            raise ValueError(f"height: expected metres for z = 0, at most {_HIGHEST:g}, given {self.above_sea}")

    @property
    def number(self) -> float:
        """Height of z = 0 above sea level [m]; NaN where it is not known."""
        return np.nan if self.above_sea is None else self.above_sea

    def height(self, needed_by: str) -> float:
        """Height of z = 0 above sea level [m].

        Args:
            needed_by: who asks, for the message.

        Raises:
            UnknownZeroError: where it is not known (a ValueError).
        """
        if self.above_sea is None:
            raise UnknownZeroError(
                f"{needed_by}: expected a map whose heights above sea level are known, and {self._why()}; give the "
                "height of its z = 0 above sea level, as --height-of-zero 450 (in Python maxjax.VerticalZero(450.0)), "
                "or a reference system with heights, as --crs EPSG:28992+5709"
            )
        return self.above_sea

    def _why(self) -> str:
        if self.datum is None:
            return "nobody states what they count from"
        return f"they count from {self.datum}, whose height above sea level is not known here"

    def __str__(self) -> str:
        """In words, as a file's heights."""
        if self.above_sea is None:
            return f"above {self.datum or 'the zero of the map, which nobody states'}"
        return f"above sea level ({self.datum or 'as stated'})"


UNSTATED = VerticalZero()
