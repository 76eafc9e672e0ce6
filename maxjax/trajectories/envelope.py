"""The least envelope above some values that changes no faster than a slope.

e(s) = max over s' of  v(s') − g |s − s'|
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64


def least_envelope(
    values: Float64[np.ndarray, " n"], along: Float64[np.ndarray, " n"], slope: float
) -> Float64[np.ndarray, " n"]:
    """The least values that are nowhere below some others and change by at most a slope.

    Args:
        values: v.
        along: s, ascending.
        slope: g, at least 0.
    """
    ramp = slope * along
    rising = np.maximum.accumulate(values + ramp) - ramp
    falling = np.maximum.accumulate((values - ramp)[::-1])[::-1] + ramp
    found: Float64[np.ndarray, " n"] = np.maximum(rising, falling)
    return found
