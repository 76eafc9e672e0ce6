"""The fastest way along a curve whose acceleration is bounded: two passes through the phase plane.

Along x(s) with b = ṡ², acceleration is x' b'/2 + x'' b. Between samples h apart b is linear, a = b'/2 constant, and at
each sample

    |x' a + x'' b| ≤ A,    0 ≤ b ≤ c²,    b + 2 h a = b of the next sample.

The first is an ellipse in the plane (b, a), so that all that is feasible is convex. The backward pass finds the largest
b from which the end can be reached at rest, the forward pass then takes the largest a that stays below it
(reachability analysis: H. Pham and Q.-C. Pham, 2018, there with linear bounds).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float64

# Of |x'|²: where a curve turns back on itself, x' is 0 and a is free.
_LEAST = 1e-9
# Duration of a trajectory [s]; more would take gigabytes.
_MOST = 40_000.0


def fastest(
    s: Float64[np.ndarray, " n"],
    slope: Float64[np.ndarray, "n 3"],
    bend: Float64[np.ndarray, "n 3"],
    caps: Float64[np.ndarray, " n"],
    acceleration: Float64[np.ndarray, " n"],
) -> Float64[np.ndarray, " n"]:
    """Squared speed b = ṡ² along a curve, at rest at both ends.

    Args:
        s: rising parameter of the samples.
        slope, bend: x' and x'' at the samples.
        caps: greatest ṡ.
        acceleration: greatest |ẍ| [m/s²].
    """
    alpha = np.maximum(np.einsum("ni,ni->n", slope, slope), _LEAST)
    beta, gamma = np.einsum("ni,ni->n", slope, bend), np.einsum("ni,ni->n", bend, bend)
    # The largest b of the ellipse.
    across = np.maximum(alpha * gamma - beta * beta, 1e-30)
    top = np.minimum(acceleration * np.sqrt(alpha / across), caps * caps)
    columns = (alpha, beta, gamma, acceleration**2, top, np.append(np.diff(s), 1.0))
    rows = list(zip(*(column.tolist() for column in columns), strict=True))
    reach = _backward(rows)
    return np.array(_forward(rows, reach))


_Row = tuple[float, float, float, float, float, float]

# Both passes solve |x' a + x'' b|² = α a² + 2 β a b + γ b² = A² for the least or the greatest a: written out twice,
# as a call for each sample would take longer than the rest.


def _backward(rows: list[_Row]) -> list[float]:
    """The largest b at each sample from which the end can be reached at rest."""
    reach = [0.0] * len(rows)
    following = 0.0
    for i in range(len(rows) - 2, -1, -1):
        alpha, beta, gamma, square, b, h = rows[i]
        root = math.sqrt(max(beta * beta * b * b - alpha * (gamma * b * b - square), 0.0))
        if b + 2.0 * h * (-beta * b - root) / alpha > following:
            # The largest b at which the line b + 2 h a = following meets the ellipse.
            two = alpha / (4.0 * h * h) - beta / h + gamma
            one = following * (beta / (2.0 * h) - alpha / (4.0 * h * h))
            zero = alpha * following * following / (4.0 * h * h) - square
            inside = one * one - two * zero
            b = min(b, (-one + math.sqrt(inside)) / two if inside > 0.0 and two > 0.0 else following)
        reach[i] = following = max(b, 0.0)
    return reach


def _forward(rows: list[_Row], reach: list[float]) -> list[float]:
    """The largest b that comes from rest and stays within reach."""
    found = [0.0] * len(rows)
    b = 0.0
    for i in range(len(rows) - 1):
        alpha, beta, gamma, square, _, h = rows[i]
        root = math.sqrt(max(beta * beta * b * b - alpha * (gamma * b * b - square), 0.0))
        b = max(min(b + 2.0 * h * (root - beta * b) / alpha, reach[i + 1]), 0.0)
        found[i + 1] = b
    return found


def positions(s: Float64[np.ndarray, " n"], b: Float64[np.ndarray, " n"], step: float) -> Float64[np.ndarray, " t"]:
    """The parameter at times `step` apart [s], from rest to rest; the last one is the first at rest.

    Raises:
        ValueError: where it takes longer than `_MOST`, or b is 0 at two neighbours.
    """
    speed = np.sqrt(b)
    mean = 0.5 * (speed[1:] + speed[:-1])
    if not (mean > 0.0).all():
        raise ValueError("positions: expected a speed above 0 between any two samples, given two at rest")
    time = np.concatenate([[0.0], np.cumsum(np.diff(s) / mean)])
    check_duration(float(time[-1]), float(s[-1]))
    at = step * np.arange(math.ceil(time[-1] / step) + 1)
    i = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(s) - 2)
    elapsed = np.minimum(at, time[-1]) - time[i]
    gain = (speed[i + 1] - speed[i]) / (time[i + 1] - time[i])
    found: Float64[np.ndarray, " t"] = np.minimum(s[i] + elapsed * (speed[i] + 0.5 * gain * elapsed), s[-1])
    return found


def check_duration(seconds: float, length: float) -> None:
    """Refuse what takes too long.

    Raises:
        ValueError: beyond `_MOST`.
    """
    if seconds > _MOST:
        raise ValueError(
            f"limits: expected ones with which a path takes at most {_MOST:g} s, given some with which one of "
            f"{length:g} m takes {seconds:.3g} s"
        )
