"""Sets that hold movers: intervals of place and velocity, and where they can be later.

    |dv/dt| ≤ A,  |v| ≤ V  on each axis

    v(t + τ) ∈ [v⁻ − Aτ, v⁺ + Aτ] ∩ [−V, V]
    p(t + τ) ∈ [p⁻ + ∫ max(v⁻ − As, −V) ds,  p⁺ + ∫ min(v⁺ + As, V) ds]

A mover that keeps the bounds and was in its set is in the later set; and a set that is intersected with what was
measured lies in the one that it came from, so that what could be reached at any time from now only shrinks. So a motion
that was verified against the sets stays verified.

A set is of the middle of the mover; its body lies in a box of half edges `half` around that. Frame: world, each axis by
itself.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

# Standard deviations around an estimate that are likely.
_DEVIATIONS = 2.0


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Bounds:
    """Bounds that movers are assumed to keep; static.

    Attributes:
        speed: V, on each axis [m/s].
        acceleration: A, on each axis [m/s²].
        size: longest edge of the box around a mover [m], or its longest edges along x, y and z, as far as less of it is
            seen.
        turn: how fast a mover turns about its middle at most [rad/s]; 0 for movers that keep their orientation, and for
            spheres. Velocities that are taken from faces are the less certain the faster a mover may turn.

    Raises:
        ValueError: unless all are positive finite numbers (`turn`: at least 0).
    """

    speed: float = 8.0
    acceleration: float = 2.0
    size: float | tuple[float, float, float] = 1.0
    turn: float = 0.5

    def __post_init__(self) -> None:
        if not 0.0 <= self.turn < math.inf:
            raise ValueError(f"Bounds.turn: expected a finite number, at least 0, given {self.turn!r}")
        for name, value in vars(self).items():
            if name == "turn":
                continue
            values = value if isinstance(value, tuple) else (value,)
            if len(values) not in (1, 3) or not all(0.0 < x < math.inf for x in values):
                raise ValueError(f"Bounds.{name}: expected a positive finite number, given {value!r}")

    @property
    def edges(self) -> Float[np.ndarray, "3"]:
        """`size` along x, y and z [m]."""
        return np.broadcast_to(np.asarray(self.size, np.float32), (3,))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Tracks:
    """Movers that are followed, in slots; batch axes lead. All of one time.

    Attributes:
        low, high: set of the middle [m].
        slowest, fastest: set of the velocity [m/s]: least and greatest on each axis.
        half: half edges of the box around the middle that holds the body [m].
        used: whether a slot holds a mover.
        confirmed: whether it was seen often enough to be one.
        place, velocity: best estimate [m], [m/s]; for labels and prices, never for proofs.
        place_deviation, velocity_deviation: standard deviations of these [m], [m/s].
        rests: whether it was seen to stay where it is; a label, for prices: its set grows from rest by the bounds.
        seen: scans that showed it.
        missed: scans since it was seen last.
    """

    low: Float[Array, "*batch s 3"]
    high: Float[Array, "*batch s 3"]
    slowest: Float[Array, "*batch s 3"]
    fastest: Float[Array, "*batch s 3"]
    half: Float[Array, "*batch s 3"]
    used: Bool[Array, "*batch s"]
    confirmed: Bool[Array, "*batch s"]
    place: Float[Array, "*batch s 3"]
    velocity: Float[Array, "*batch s 3"]
    place_deviation: Float[Array, "*batch s 3"]
    velocity_deviation: Float[Array, "*batch s 3"]
    rests: Bool[Array, "*batch s"]
    seen: Int32[Array, "*batch s"]
    missed: Int32[Array, "*batch s"]


def no_tracks(slots: int) -> Tracks:
    """Tracks without movers."""
    zero, none, flag = jnp.zeros((slots, 3)), jnp.zeros(slots, jnp.int32), jnp.zeros(slots, bool)
    return Tracks(zero, zero, zero, zero, zero, flag, flag, zero, zero, zero, zero, flag, none, none)


def likely_sets(tracks: Tracks) -> Tracks:
    """The tracks with sets cut to what the estimates make likely: smaller, and no proof."""

    def cut(low: Array, high: Array, middle: Array, deviation: Array) -> tuple[Array, Array]:
        middle, half = jnp.clip(middle, low, high), _DEVIATIONS * deviation
        return jnp.maximum(low, middle - half), jnp.minimum(high, middle + half)

    low, high = cut(tracks.low, tracks.high, tracks.place, tracks.place_deviation)
    slowest, fastest = cut(tracks.slowest, tracks.fastest, tracks.velocity, tracks.velocity_deviation)
    return dataclasses.replace(tracks, low=low, high=high, slowest=slowest, fastest=fastest)


def reachable(
    tracks: Tracks, times: Float[Array, " t"], bounds: Bounds
) -> tuple[Float[Array, "t s 3"], Float[Array, "t s 3"]]:
    """Boxes that hold the bodies at times from now [s]: least and greatest coordinates [m]; of unused slots: NaN."""
    down, up = _moved(tracks, times[:, None, None], bounds)
    least, greatest = tracks.low - down - tracks.half, tracks.high + up + tracks.half
    used = tracks.used[:, None]
    return jnp.where(used, least, jnp.nan), jnp.where(used, greatest, jnp.nan)


def propagate(tracks: Tracks, time: Array | float, bounds: Bounds) -> Tracks:
    """The tracks a time later [s], one for all or (s, 1), without a measurement."""
    change = bounds.acceleration * time
    down, up = _moved(tracks, time, bounds)
    return dataclasses.replace(
        tracks,
        low=tracks.low - down,
        high=tracks.high + up,
        slowest=jnp.maximum(tracks.slowest - change, -bounds.speed),
        fastest=jnp.minimum(tracks.fastest + change, bounds.speed),
        place=tracks.place + time * jnp.where(tracks.rests[:, None], 0.0, tracks.velocity),
    )


def _moved(tracks: Tracks, time: Array | float, bounds: Bounds) -> tuple[Array, Array]:
    """How far down and up each coordinate of the middle may have moved by a time [m]."""
    return _furthest(-tracks.slowest, time, bounds), _furthest(tracks.fastest, time, bounds)


def _furthest(fastest: Array, time: Array | float, bounds: Bounds) -> Array:
    """∫ min(v + As, V) ds from 0 to a time, for v ≤ V [m]."""
    fastest = jnp.minimum(fastest, bounds.speed)
    speeding = jnp.minimum((bounds.speed - fastest) / bounds.acceleration, time)
    gained = fastest * speeding + 0.5 * bounds.acceleration * speeding**2
    return gained + bounds.speed * (time - speeding)
