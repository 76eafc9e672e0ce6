"""A straight leg from rest to rest in least time, as ArduCopter's AUTO times it: an S-curve with rounded jerk.

    jerk           rises to J in τ as ½ J (1 − cos π t / τ), stays for t₂, falls likewise;  τ = π J / 2 S  (snap S)
    acceleration   reaches A = J (τ + t₂) in T = 2 τ + t₂, stays for t₄, falls to 0 in T
    speed          reaches V = A (T + t₄) on the way ½ V (2 T + t₄), at most half of the leg; then the same backward

What is asked for is the greatest V within the limits of speed, acceleration and jerk. Where the leg is too short for
the whole jerk, J and τ shrink together, along the snap.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float64

Vector = Float64[np.ndarray, " n"]


@dataclasses.dataclass(frozen=True)
class LegLimits:
    """Greatest derivatives along a leg: speed [m/s], acceleration [m/s²], jerk [m/s³], snap [m/s⁴]."""

    speed: float
    acceleration: float
    jerk: float
    snap: float


@dataclasses.dataclass(frozen=True, eq=False)
class SCurve:
    """Motion along a leg.

    Attributes:
        length: of the leg [m].
        knots: times between its 15 parts [s], from 0.
        states: way, speed and acceleration at the knots.
        jerks: (15, 2): constant part of the jerk, and the amplitude of its cosine [m/s³].
        rate: of the cosine, π / τ [rad/s].
    """

    length: float
    knots: Vector
    states: Float64[np.ndarray, "n 3"]
    jerks: Float64[np.ndarray, "m 2"]
    rate: float

    @classmethod
    def of(cls, length: float, limits: LegLimits) -> SCurve:
        """The fastest along a leg of some length [m], which is positive."""
        rise, flat, coast = _ramp(0.5 * length, limits)
        jerk = min(limits.jerk, 2.0 * limits.snap * rise / math.pi)
        peak = jerk * (rise + flat)
        ramp = 2.0 * rise + flat
        speed = peak * (ramp + coast)
        cruise = max(0.0, length - speed * (2.0 * ramp + coast)) / speed
        half = 0.5 * jerk
        up = [(rise, half, -half), (flat, jerk, 0.0), (rise, half, half)]
        down = [(time, -constant, -cosine) for time, constant, cosine in up]
        coasting = [(coast, 0.0, 0.0)]
        parts = [*up, *coasting, *down, (cruise, 0.0, 0.0), *down, *coasting, *up]
        rate, states = math.pi / rise, [np.zeros(3)]
        for time, constant, cosine in parts:
            states.append(_advance(states[-1], np.asarray(time), np.array([constant, cosine]), rate))
        times = np.array([time for time, _, _ in parts])
        return cls(length, np.r_[0.0, np.cumsum(times)], np.array(states), np.array(parts)[:, 1:], rate)

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.knots[-1])

    @property
    def accelerates(self) -> float:
        """How long it accelerates [s]."""
        return float(self.knots[7])

    @property
    def brakes(self) -> float:
        """When it begins to brake [s]."""
        return float(self.knots[8])

    def at(self, time: Vector) -> tuple[Vector, Vector, Vector]:
        """Way [m], speed [m/s] and acceleration [m/s²] at some times [s]; before and after it is at rest."""
        time = np.clip(time, 0.0, self.duration)
        part = np.clip(np.searchsorted(self.knots, time, side="right") - 1, 0, len(self.jerks) - 1)
        way, speed, acceleration = _advance(self.states[part].T, time - self.knots[part], self.jerks[part].T, self.rate)
        return way, speed, acceleration


def _ramp(way: float, limits: LegLimits) -> tuple[float, float, float]:
    """Times τ, t₂, t₄ of the acceleration on half a leg [s]."""
    speed, acceleration, jerk, snap = dataclasses.astuple(limits)
    whole = 0.5 * math.pi * jerk / snap
    short = min(
        (math.pi * way / (8.0 * snap)) ** (1 / 4),
        (math.pi * speed / (4.0 * snap)) ** (1 / 3),
        (math.pi * acceleration / (2.0 * snap)) ** (1 / 2),
    )
    rise = min(whole, short)
    if rise < whole:
        peak, flat = 2.0 * snap * rise**2 / math.pi, 0.0
    else:
        # V = A (τ + A / J) and, of a way, A (τ + A / J)².
        by_speed = 0.5 * jerk * (math.sqrt(rise**2 + 4.0 * speed / jerk) - rise)
        roots = np.roots([1.0 / jerk**2, 2.0 * rise / jerk, rise**2, -way])
        by_way = float(roots[np.abs(roots.imag) < 1e-9].real.max())
        peak = min(acceleration, by_speed, by_way)
        flat = max(0.0, peak / jerk - rise)
    ramp = 2.0 * rise + flat
    by_way = 0.5 * (math.sqrt(ramp**2 + 8.0 * way / peak) - 3.0 * ramp)
    return rise, flat, max(0.0, min(speed / peak - ramp, by_way))


def _advance(state: np.ndarray, time: np.ndarray, jerk: np.ndarray, rate: float) -> np.ndarray:
    """Way, speed and acceleration some time after a state, under the jerk c + d cos(rate t)."""
    way, speed, acceleration = state
    constant, cosine = jerk
    turned = cosine / rate**2
    return np.stack(
        [
            way
            + time * (speed + time * (0.5 * acceleration + time * constant / 6.0))
            + turned * (time - np.sin(rate * time) / rate),
            speed + time * (acceleration + 0.5 * time * constant) + turned * (1.0 - np.cos(rate * time)),
            acceleration + constant * time + rate * turned * np.sin(rate * time),
        ]
    )
