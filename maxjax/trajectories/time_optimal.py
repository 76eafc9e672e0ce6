"""The shortest time in which a B-spline follows a curve within limits: an interior-point method.

A curve X(σ) is flown by a uniform cubic B-spline with control points X(σ_k), a step h apart, at rest at both ends
(three equal control points). Sought are σ_k and h:

    minimise  log h   where   p = Δ³X(σ)/(J h³),   Δ²X(σ)/(A h²)                        stay in the unit ball,
                              p = Δσ/(c h),   ΔX_z(σ)/(ascent h),   −ΔX_z(σ)/(descent h)   below 1,

with jerk J, acceleration A and the greatest dσ/dt, c(σ), half-way between two control points. Derivatives of the spline
lie in the hull of these differences, so limits that hold for them hold at every time. With barriers −log(1 − |p|²) and
−log(1 − p), the function t log h + barriers is minimised for rising t (the central path; all iterates keep the
limits). Newton's matrix leaves out the curvature of p: what remains, ∂pᵀ (∂²barrier) ∂p, is positive and banded, seven
diagonals and one row for h. For a convex problem log h would be within the number of barriers over t of its least.

Small steps h converge slowly from far away: the first step is long, and a solution is refined by halving it, which
leaves the spline as it is.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float64
from scipy.linalg import LinAlgError, solveh_banded

from maxjax.trajectories.corner_rounding import Curve
from maxjax.trajectories.limits import FlightLimits

if TYPE_CHECKING:
    from scipy.interpolate import CubicHermiteSpline

_WEIGHTS = {1: (-1.0, 1.0), 2: (1.0, -2.0, 1.0), 3: (-1.0, 3.0, -3.0, 1.0)}  # of differences
# t over the number of barriers: the first one of a start, and of a refined solution; the last one; the factor between.
_FIRST, _REFINED, _LAST, _FACTOR = 3.0, 40.0, 600.0, 8.0
_PER_POINT = 6.0  # about the number of barriers a control point
# Newton steps for each t, and the decrease that needs no further one.
_STEPS, _ENOUGH = 25, 0.3
_FARTHEST = 1.0  # step of log h
_SHORTEST = 1e-4  # of a line search
_ARMIJO = 1e-4
_INSIDE = 1.002  # times the step that just keeps all limits: where a central path begins
_RIDGE = 1e-9  # of the matrix's greatest entry
_ENDS = 3  # equal control points at a rest


class Way(NamedTuple):
    """A curve to be flown.

    Attributes:
        place: X(σ) [m].
        slope: dX/dσ.
        stations: σ at which the greatest speed is known, from the curve's start to its end.
        squares: greatest (dσ/dt)² there, above 0, linear in between [m²/s²].
        limits: to keep.
    """

    place: CubicHermiteSpline
    slope: CubicHermiteSpline
    stations: Float64[np.ndarray, " k"]
    squares: Float64[np.ndarray, " k"]
    limits: FlightLimits

    @classmethod
    def of(
        cls,
        curve: Curve,
        stations: Float64[np.ndarray, " k"],
        squares: Float64[np.ndarray, " k"],
        limits: FlightLimits,
    ) -> Way:
        """Along a rounded polyline, which is a cubic between corners and ends of blends."""
        from scipy.interpolate import CubicHermiteSpline  # a third of a second that a plan can do without

        s, width, total = curve.arclength, curve.widths, curve.arclength[-1]
        ends = np.unique(np.concatenate([s, s - width, s + width]))
        apart = np.diff(ends) > 1e-9 * total
        ends = np.concatenate([[0.0], ends[1:-1][apart[:-1] & apart[1:]], [total]])
        points, slopes, _ = curve.at(ends)
        place = CubicHermiteSpline(ends, points, slopes)
        return cls(place, place.derivative(), stations, squares, limits)

    def cap(self, sigma: Float64[np.ndarray, " m"]) -> Float64[np.ndarray, " m"]:
        """Greatest dσ/dt at some places [m/s]."""
        found: Float64[np.ndarray, " m"] = np.sqrt(np.interp(sigma, self.stations, self.squares))
        return found


# p of each barrier, in the order of `_ORDERS`: (m, 3) of a ball, (m, 1) of a bound from above.
_Sizes = list[Float64[np.ndarray, "_ _"]]
_ORDERS = (3, 2, 1, 1, 1)


def shortest(
    way: Way, sigma: Float64[np.ndarray, " n"], step: float, halvings: int
) -> tuple[Float64[np.ndarray, " m"], float]:
    """σ of the control points and their step [s], from a start that need not keep the limits.

    Args:
        way: to be flown.
        sigma: of the start, at least four; three equal ones at each end.
        step: of the start [s].
        halvings: of the step.
    """
    first = _FIRST
    for level in range(halvings + 1):
        if level:
            sigma, step, first = _halved(sigma), 0.5 * step, _REFINED
        size = math.log(step * factor_to_keep(way, sigma, step) * _INSIDE)
        count = _PER_POINT * len(sigma)
        share = first
        while len(sigma) > 2 * _ENDS:
            sigma, size = _centred(way, sigma, size, share * count)
            if share >= _LAST:
                break
            share = min(share * _FACTOR, _LAST)
        step = math.exp(size)
    return sigma, step * factor_to_keep(way, sigma, step)


def factor_to_keep(way: Way, sigma: Float64[np.ndarray, " n"], step: float) -> float:
    """The factor on the step with which all limits are just kept."""
    most = 0.0
    for order, p in zip(_ORDERS, _sizes(way, sigma, step), strict=True):
        size = float((np.linalg.norm(p, axis=1) if p.shape[1] > 1 else p[:, 0]).max())
        most = max(most, size ** (1.0 / order) if size > 0.0 else 0.0)
    return most


def _halved(sigma: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " m"]:
    """Control points of the same spline at half the step; at its ends it rests as well."""
    found = np.empty(2 * len(sigma) - 3)
    found[0::2] = 0.5 * (sigma[1:] + sigma[:-1])
    found[1::2] = (sigma[:-2] + 6.0 * sigma[1:-1] + sigma[2:]) / 8.0
    return np.concatenate([sigma[:1], found, sigma[-1:]])


def _sizes(way: Way, sigma: Float64[np.ndarray, " n"], step: float) -> _Sizes:
    """The variable of each barrier, as p."""
    limits, place = way.limits, way.place(sigma)
    velocity = np.diff(place, axis=0) / step
    acceleration = np.diff(velocity, axis=0) / step
    jerk = np.diff(acceleration, axis=0) / step
    rate = np.diff(sigma) / (way.cap(0.5 * (sigma[1:] + sigma[:-1])) * step)
    climb = velocity[:, 2:]
    sizes = jerk / limits.jerk, acceleration / limits.acceleration, rate[:, None]
    return [*sizes, climb / limits.ascent, climb / -limits.descent]


def _slopes(
    way: Way, sigma: Float64[np.ndarray, " n"], step: float, rate: Float64[np.ndarray, " e"]
) -> list[Float64[np.ndarray, "_ _ _"]]:
    """Derivatives of each p by the control points that it is made of: (m, order + 1, d).

    `rate` is p of the speed.
    """
    limits, slope = way.limits, way.slope(sigma)

    def parts(order: int, most: float) -> Float64[np.ndarray, "_ _ 3"]:
        count, scale = len(sigma) - order, 1.0 / (most * step**order)
        return np.stack([scale * weight * slope[i : i + count] for i, weight in enumerate(_WEIGHTS[order])], axis=1)

    middle = 0.5 * (sigma[1:] + sigma[:-1])
    cap = way.cap(middle)
    edge = np.clip(np.searchsorted(way.stations, middle) - 1, 0, len(way.stations) - 2)
    rise = np.diff(way.squares)[edge] / np.diff(way.stations)[edge]
    # The cap moves with the middle, by its square's rise over twice itself.
    moves = 0.25 * rate * rise / cap**2
    speed = np.stack([-1.0 / (cap * step) - moves, 1.0 / (cap * step) - moves], axis=1)[:, :, None]
    climb = parts(1, 1.0)[:, :, 2:]
    return [parts(3, limits.jerk), parts(2, limits.acceleration), speed, climb / limits.ascent, climb / -limits.descent]


def _room(p: Float64[np.ndarray, "m d"]) -> Float64[np.ndarray, " m"]:
    """1 − |p|² or 1 − p."""
    room: Float64[np.ndarray, " m"] = 1.0 - (np.einsum("kd,kd->k", p, p) if p.shape[1] > 1 else p[:, 0])
    return room


def _value(way: Way, sigma: Float64[np.ndarray, " n"], size: float, t: float) -> float:
    """The function that is minimised for one t; infinite where a limit is not kept."""
    found = t * size
    for p in _sizes(way, sigma, math.exp(size)):
        room = _room(p)
        if not (room > 0.0).all():
            return math.inf
        found -= float(np.log(room).sum())
    return found


def _centred(
    way: Way, sigma: Float64[np.ndarray, " n"], size: float, t: float
) -> tuple[Float64[np.ndarray, " n"], float]:
    """σ and log h nearer to the minimum for this t, by Newton steps with a line search."""
    for _ in range(_STEPS):
        found = _newton(way, sigma, size, t)
        if found is None or found[2] < _ENOUGH:
            break
        move, growth, decrease = found
        before, share = _value(way, sigma, size, t), min(1.0, _FARTHEST / max(abs(growth), _FARTHEST))
        while share >= _SHORTEST:
            after = _value(way, sigma + share * move, size + share * growth, t)
            if after < before - _ARMIJO * share * decrease:
                break
            share *= 0.5
        else:
            break
        sigma, size = sigma + share * move, size + share * growth
    return sigma, size


def _newton(
    way: Way, sigma: Float64[np.ndarray, " n"], size: float, t: float
) -> tuple[Float64[np.ndarray, " n"], float, float] | None:
    """The step of σ and of log h, and the decrease that it promises; None where the matrix is not positive.

    The matrix is [[B, b], [bᵀ, d]], B banded with its lower diagonals as rows.
    """
    n = len(sigma)
    bands, b, d = np.zeros((4, n)), np.zeros(n), 0.0
    by_sigma, by_size = np.zeros(n), t
    sizes = _sizes(way, sigma, math.exp(size))
    every = _slopes(way, sigma, math.exp(size), sizes[2][:, 0])
    for order, p, slopes in zip(_ORDERS, sizes, every, strict=True):
        gradient, hessian = _derivatives(p)
        weighted = np.einsum("kde,kwe->kwd", hessian, slopes)
        # p falls by its order times itself for each unit of log h.
        across = -order * np.einsum("kde,ke->kd", hessian, p)
        for i in range(order + 1):
            rows = slice(i, i + len(p))
            by_sigma[rows] += np.einsum("kd,kd->k", gradient, slopes[:, i])
            b[rows] += np.einsum("kd,kd->k", across, slopes[:, i])
            for j in range(i, order + 1):
                bands[j - i, rows] += np.einsum("kd,kd->k", weighted[:, i], slopes[:, j])
        by_size -= order * float(np.einsum("kd,kd->", gradient, p))
        d -= order * float(np.einsum("kd,kd->", across, p))
    inner = slice(_ENDS, n - _ENDS)
    bands = bands[:, inner]
    bands[0] += _RIDGE * bands[0].max()
    try:
        solved = solveh_banded(bands, np.stack([by_sigma[inner], b[inner]], axis=1), lower=True)
    except LinAlgError:
        return None
    left = d - float(b[inner] @ solved[:, 1])
    if not left > 0.0:
        return None
    growth = -(by_size - float(b[inner] @ solved[:, 0])) / left
    move = np.zeros(n)
    move[inner] = -solved[:, 0] - solved[:, 1] * growth
    return move, growth, -float(by_sigma[inner] @ move[inner]) - by_size * growth


def _derivatives(p: Float64[np.ndarray, "m d"]) -> tuple[Float64[np.ndarray, "m d"], Float64[np.ndarray, "m d d"]]:
    """Gradient and Hessian of −log(1 − |p|²) or −log(1 − p) by p."""
    room = _room(p)[:, None]
    if p.shape[1] == 1:
        return 1.0 / room, (1.0 / room**2)[:, :, None]
    outer = p[:, :, None] * p[:, None, :]
    return 2.0 * p / room, (2.0 / room)[:, :, None] * np.eye(3) + (4.0 / room**2)[:, :, None] * outer
