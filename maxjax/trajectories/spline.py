"""Uniform cubic B-splines in time, whose limits can be read off their control points.

With control points c_k, a step h apart, and τ = t/h − j ∈ [0, 1) on the piece j,

    p(t) = [(1−τ)³ c_j + (3τ³ − 6τ² + 4) c_{j+1} + (−3τ³ + 3τ² + 3τ + 1) c_{j+2} + τ³ c_{j+3}] / 6.

p is twice continuously differentiable. Its derivatives are B-splines of lower degree, over the differences Δc/h, Δ²c/h²
and Δ³c/h³; each stays in the convex hull of its control points, so that a bound of these (a ball, a band of heights)
holds at every time, not only at samples. The second derivative is linear and the third constant on each piece.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

# Weights of the control points of each piece for 1, τ, τ², τ³; column i belongs to c_{j+i}.
_BASIS = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0


def duration(control: Float64[np.ndarray, "n ..."], step: float) -> float:
    """Time from the beginning to the end of the spline [s]."""
    return (len(control) - 3) * step


def evaluate(
    control: Float64[np.ndarray, "n ..."], step: float, time: Float64[np.ndarray, " t"], order: int = 0
) -> Float64[np.ndarray, "t ..."]:
    """The spline, or one of its first three derivatives, at some times.

    Args:
        control: control points, at least four.
        step: between them [s].
        time: [s]; before 0 and after the end, the spline is taken at these.
        order: of the derivative.
    """
    pieces = len(control) - 3
    at = np.clip(time / step, 0.0, pieces)
    j = np.minimum(at.astype(np.int64), pieces - 1)
    powers = np.zeros((len(time), 4))
    for k in range(order, 4):
        powers[:, k] = np.prod(np.arange(k, k - order, -1)) * (at - j) ** (k - order)
    weights = powers @ _BASIS / step**order
    values: Float64[np.ndarray, "t ..."] = np.einsum("ti,ti...->t...", weights, control[j[:, None] + np.arange(4)])
    return values


def differences(control: Float64[np.ndarray, "n ..."], step: float, order: int) -> Float64[np.ndarray, "m ..."]:
    """Control points of a derivative."""
    found: Float64[np.ndarray, "m ..."] = np.diff(control, order, axis=0) / step**order
    return found


def average_neighbours(values: Float64[np.ndarray, "n ..."], count: int) -> Float64[np.ndarray, "m ..."]:
    """Means of every `count` neighbours, both ends repeated: a convex set that holds differences holds theirs."""
    ends = [(count - 1, count - 1)] + [(0, 0)] * (values.ndim - 1)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(values, ends, "edge"), count, axis=0)
    found: Float64[np.ndarray, "m ..."] = windows.mean(axis=-1)
    return found
