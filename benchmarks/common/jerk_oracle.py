"""The least time along a curve under a limit of jerk: a nonlinear program, stated with CasADi and solved by IPOPT.

States s, ṡ, s̈ along the arc length of a curve x(s) and the control s⃛, constant in each of N equal parts of the time
T:

    minimise T   where   |x' s⃛ + 3 x″ ṡ s̈ + x‴ ṡ³| ≤ J,   |x' s̈ + x″ ṡ²| ≤ A,   ṡ ≤ c(s),   −descent ≤ x'_z ṡ ≤
    ascent

at both ends of each part; x', x″, x‴ from a spline of degree five. It shares neither formulation nor code with
`maxjax.trajectories.time_optimal`. The program is not convex: what IPOPT finds is a local minimum, started from the
flight that is to be judged.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import Float64
from scipy.interpolate import CubicSpline, make_interp_spline

import maxjax

_PARTS = 160
_SPACING = 0.1  # of the samples of the curve [m]
_OPTIONS: dict[str, Any] = {"print_level": 0, "sb": "yes", "max_iter": 300, "tol": 1e-4, "acceptable_tol": 1e-3}


def fastest_time_with_jerk(
    time: Float64[np.ndarray, " n"],
    points: Float64[np.ndarray, "n 3"],
    caps: Float64[np.ndarray, " n"],
    limits: maxjax.FlightLimits,
) -> float:
    """Least time from rest to rest along a curve [s]; NaN where IPOPT finds none.

    Args:
        time: at which a flight is at the points [s].
        points: of the curve, close together [m].
        caps: greatest speed at each [m/s].
        limits: of speed, climb, acceleration and jerk.

    Raises:
        ImportError: without CasADi.
    """
    import casadi

    gaps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    apart = np.append(True, gaps > 1e-6)
    s, time = np.append(0.0, np.cumsum(gaps))[apart], time[apart] - time[0]
    curve = _curve(s, points[apart], np.minimum(caps[apart], limits.speed))
    program = casadi.Opti()
    total, place, speed, gain = program.variable(), *(program.variable(_PARTS + 1) for _ in range(3))
    jerk, h, before = program.variable(_PARTS), total / _PARTS, slice(0, _PARTS)
    program.minimize(total)
    program.subject_to(place[1:] == place[before] + h * speed[before] + h**2 / 2 * gain[before] + h**3 / 6 * jerk)
    program.subject_to(speed[1:] == speed[before] + h * gain[before] + h**2 / 2 * jerk)
    program.subject_to(gain[1:] == gain[before] + h * jerk)
    for end, where in ((0, 0.0), (_PARTS, s[-1])):
        program.subject_to([place[end] == where, speed[end] == 0, gain[end] == 0])
    program.subject_to(speed >= 0)
    program.subject_to(program.bounded(0, place, s[-1]))
    program.subject_to(program.bounded(-limits.jerk, jerk, limits.jerk))
    for k in range(1, _PARTS):
        for control in (jerk[k - 1], jerk[k]):
            _limit(program, curve, (place[k], speed[k], gain[k], control), limits)
    flown, times = CubicSpline(time, s), np.linspace(0.0, time[-1], _PARTS + 1)
    program.set_initial(total, time[-1])
    for variable, order in ((place, 0), (speed, 1), (gain, 2)):
        program.set_initial(variable, flown(times, order))
    program.set_initial(jerk, np.diff(flown(times, 2)) / (time[-1] / _PARTS))
    program.solver("ipopt", {"print_time": 0}, _OPTIONS)
    try:
        return float(program.solve().value(total))
    except RuntimeError:
        return math.nan


def _curve(s: Float64[np.ndarray, " n"], points: Float64[np.ndarray, "n 3"], caps: Float64[np.ndarray, " n"]) -> Any:
    """x', x″, x‴ and the greatest speed as functions of the arc length."""
    import casadi

    grid = np.linspace(0.0, s[-1], max(int(s[-1] / _SPACING), 8) + 1)
    spline = make_interp_spline(grid, CubicSpline(s, points)(grid), k=5)
    parts = [
        casadi.interpolant("x", "bspline", [grid], spline.derivative(k)(grid).ravel(), {"degree": [3]})
        for k in (1, 2, 3)
    ]
    return [*parts, casadi.interpolant("c", "linear", [grid], np.interp(grid, s, caps))]


def _limit(program: Any, curve: Any, at: tuple[Any, Any, Any, Any], limits: maxjax.FlightLimits) -> None:
    """Demand the limits at one place, speed, acceleration and jerk along the curve."""
    import casadi

    place, speed, gain, jerk = at
    tangent, bend, twist, cap = (part(place) for part in curve)
    program.subject_to(speed <= cap)
    program.subject_to(program.bounded(-limits.descent, tangent[2] * speed, limits.ascent))
    program.subject_to(casadi.sumsqr(tangent * gain + bend * speed**2) <= limits.acceleration**2)
    felt = tangent * jerk + 3 * bend * speed * gain + twist * speed**3
    program.subject_to(casadi.sumsqr(felt) <= limits.jerk**2)
