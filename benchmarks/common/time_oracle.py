"""The time that toppra needs along a curve: its limits of speed, climb and acceleration, none of jerk.

toppra (H. Pham and Q.-C. Pham, 2018) knows limits that are linear. The ball of accelerations is given to it as a
polytope around the ball, with one face for each of `_FACES` directions, so that its time is a lower bound.
"""

from __future__ import annotations

import logging

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import CubicSpline

import maxjax

_FACES = 200
_SPACING = 0.1  # of its samples [m]
_FREE = 1e3  # a speed that is no limit [m/s]


def _directions() -> Float64[np.ndarray, "n 3"]:
    """Directions spread over the sphere, on a spiral."""
    k = np.arange(_FACES) + 0.5
    polar, azimuth = np.arccos(1.0 - 2.0 * k / _FACES), np.pi * (1.0 + np.sqrt(5.0)) * k
    return np.stack([np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)], axis=1)


def fastest_time(
    points: Float64[np.ndarray, "n 3"], caps: Float64[np.ndarray, " n"], limits: maxjax.FlightLimits
) -> float:
    """Shortest time from rest to rest along a curve [s]; NaN where toppra finds none.

    Args:
        points: of the curve, close together [m].
        caps: greatest speed at each [m/s].
        limits: of speed, climb and acceleration.

    Raises:
        ImportError: without toppra.
    """
    import toppra
    from toppra import algorithm, constraint

    logging.getLogger("toppra").setLevel(logging.ERROR)
    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    apart = np.append(True, gaps > 1e-6)
    s = np.append(0.0, np.cumsum(gaps))[apart]
    grid = np.linspace(0.0, s[-1], max(int(s[-1] / _SPACING), 2) + 1)
    # The arc length is a coordinate of its own, whose speed is the speed.
    path = toppra.SplineInterpolator(grid, np.column_stack([CubicSpline(s, points[apart])(grid), grid]))
    allowed = np.minimum(np.interp(grid, s, caps[apart]), limits.speed)

    def speeds(place: float) -> Float64[np.ndarray, "4 2"]:
        cap = float(np.interp(place, grid, allowed))
        return np.array([[-_FREE, _FREE], [-_FREE, _FREE], [-limits.descent, limits.ascent], [-cap, cap]])

    faces = np.pad(_directions(), ((0, 0), (0, 1)))
    accelerations = constraint.SecondOrderConstraint(
        lambda q, v, a: a,
        lambda q: faces,
        lambda q: np.full(_FACES, limits.acceleration),
        4,
        discretization_scheme=constraint.DiscretizationType.Interpolation,
    )
    limited = [constraint.JointVelocityConstraintVarying(speeds), accelerations]
    solver = algorithm.TOPPRA(limited, path, gridpoints=grid, solver_wrapper="seidel")
    solver.compute_parameterization(0, 0)
    speed = solver.problem_data.sd_vec
    if speed is None:
        return float("nan")
    return float((2.0 * np.diff(grid) / (speed[1:] + speed[:-1])).sum())
