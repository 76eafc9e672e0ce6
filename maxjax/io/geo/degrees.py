"""Longitudes and latitudes of a file, one beside the other across the antimeridian.

    λ ← λ − 360° round((λ − λ₁) / 360°),    λ₁ the first

so that a town across it is as wide as it is. The plane that they come to lie on is `io.geo.units_and_axes`'s.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from maxjax.core.files import FileError

_NORTHERNMOST = 85.0  # [degrees]; farther on, a degree of longitude is hardly a length

Places = Float64[np.ndarray, "_ 2"]


def side_by_side(lines: Sequence[Places], path: Path) -> list[Places]:
    """Lines of longitudes and latitudes [degrees] with longitudes near those of the first.

    Raises:
        FileError: if one is not on Earth, or too far north or south.
    """
    if not lines:
        return []
    corners = np.concatenate(lines)
    off = ~((np.abs(corners[:, 0]) <= 180.0) & (np.abs(corners[:, 1]) <= _NORTHERNMOST))
    if off.any():
        longitude, latitude = corners[off][0]
        raise FileError(
            f"{path}: expected longitudes within 180 and latitudes within {_NORTHERNMOST:g} degrees, "
            f"found {longitude}, {latitude}; swapped, or no degrees?"
        )
    first = corners[0, 0]
    turn = np.array([360.0, 0.0])
    return [np.asarray(line - turn * np.round((line[:, :1] - first) / 360.0), np.float64) for line in lines]
