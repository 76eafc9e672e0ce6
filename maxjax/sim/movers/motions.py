"""Motions of a few seconds that end at rest: to another velocity, on with it, and an escape that brakes.

    a(t):   a₀ → a₁ within τ₁,   a₁ for D,   a₁ → 0 within τ₃         straight lines between
    a₁ = (u − v₀ − τ₁ a₀ / 2) / (D + (τ₁ + τ₃) / 2)                   leads from v₀ to u

changes the velocity; then u, and from t_b on the same towards 0. With p = min(a, √(j |u − v₀| + |a₀|²)), what the
change needs of the greatest acceleration a,

    τ₁ = (p + |a₀|) / j,    τ₃ = p / j,    D = max(0, |u − v₀ − τ₁ a₀ / 2| / p − (τ₁ + τ₃) / 2)

so that |a₁| ≤ p: no acceleration exceeds a, for all lie between those at the ends, and no jerk j. The acceleration is
continuous even where one motion takes the place of another, so that a vehicle can follow. Frame: world.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

# The angle between neighbours on a Fibonacci sphere [rad].
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


# Lines of a motion's acceleration: three of a change, on with it, three of the escape.
_LINES = 7


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class MotionPrimitive:
    """A motion, or some of them; batch axes lead.

    Attributes:
        place: at its start [m].
        velocity: at its start [m/s].
        target: velocity that it takes up [m/s].
        pushes: acceleration where its lines begin and end [m/s²].
        lasts: of each line [s].
    """

    place: Float[Array, "*batch 3"]
    velocity: Float[Array, "*batch 3"]
    target: Float[Array, "*batch 3"]
    pushes: Float[Array, "*batch 8 3"]
    lasts: Float[Array, "*batch 7"]


def at(motion: MotionPrimitive, time: Float[Array, "*batch"]) -> tuple[Array, Array, Array]:
    """Place [m], velocity [m/s] and acceleration [m/s²] at a time since the start [s]; shapes are broadcast."""
    place, velocity, push = motion.place, motion.velocity, motion.pushes[..., 0, :]
    left = jnp.maximum(time, 0.0)
    for k in range(_LINES):
        lasts, begin, end = motion.lasts[..., k], motion.pushes[..., k, :], motion.pushes[..., k + 1, :]
        within = jnp.minimum(left, lasts)
        t, slope = within[..., None], (end - begin) / jnp.where(lasts > 0.0, lasts, jnp.inf)[..., None]
        place = place + t * (velocity + t * (begin / 2.0 + t * slope / 6.0))
        velocity = velocity + t * (begin + t * slope / 2.0)
        push = jnp.where((left > 0.0)[..., None], begin + t * slope, push)
        left = left - within
    return place, velocity, push


def duration(motion: MotionPrimitive) -> Float[Array, "*batch"]:
    """Time until it rests [s]."""
    lasts: Array = jnp.sum(motion.lasts, axis=-1)
    return lasts


def later(motion: MotionPrimitive, time: Float[Array, ""]) -> MotionPrimitive:
    """The rest of a motion after a time [s]; the same curve."""
    place, velocity, push = at(motion, time)
    ends = jnp.cumsum(motion.lasts, axis=-1)
    begun = jnp.concatenate([jnp.zeros_like(ends[..., :1]), ends], axis=-1) <= time
    pushes = jnp.where(begun[..., None], push[..., None, :], motion.pushes)
    lasts = jnp.clip(ends - time, 0.0, motion.lasts)
    # Where it brakes already it is on its way to rest.
    target = jnp.where((time >= ends[..., 3])[..., None], 0.0, motion.target)
    return MotionPrimitive(place, velocity, target, pushes, lasts)


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class MotionSet:
    """Which motions are tried; static.

    Attributes:
        speed: greatest [m/s].
        acceleration: a, greatest [m/s²].
        jerk: j, greatest [m/s³].
        directions: of the target velocities, spread over the sphere.
        shares: of the greatest speed, a target each in every direction.
        brakes: times at which escapes begin [s].
        horizon: time over which motions are looked at [s]; one that does not rest by then is not verified.

    Raises:
        ValueError: if a motion at the greatest speed would not rest within the horizon.
    """

    speed: float = 5.0
    acceleration: float = 6.0
    jerk: float = 30.0
    directions: int = 48
    shares: tuple[float, ...] = (1.0, 0.5)
    brakes: tuple[float, ...] = (0.2, 0.5)
    horizon: float = 2.0

    def __post_init__(self) -> None:
        if not self.horizon >= self.lasts:
            raise ValueError(
                f"MotionSet.horizon: expected {self.lasts:.2f} s or more to come to rest, given {self.horizon}"
            )

    @property
    def stopping(self) -> float:
        """Time in which a motion comes to rest from the greatest speed, if it does not push on [s]."""
        push = min(self.acceleration, math.sqrt(self.jerk * self.speed))
        return self.speed / push + push / self.jerk

    @property
    def lasts(self) -> float:
        """Time that a motion takes which is at the greatest speed for as long as can be [s]."""
        return max(self.brakes) + self.stopping

    @property
    def targets(self) -> Float[np.ndarray, "n 3"]:
        """Target velocities [m/s], rest first."""
        k = np.arange(self.directions)
        z = 1.0 - (2.0 * k + 1.0) / self.directions
        level = np.sqrt(1.0 - z * z)
        unit = np.stack([level * np.cos(_GOLDEN_ANGLE * k), level * np.sin(_GOLDEN_ANGLE * k), z], -1)
        return np.concatenate([np.zeros((1, 3)), *(share * self.speed * unit for share in self.shares)])


def motion_to(
    start: tuple[Float[Array, "*#batch 3"], Float[Array, "*#batch 3"], Float[Array, "*#batch 3"]],
    target: Float[Array, "*#batch 3"],
    brakes: Float[Array, "*#batch"],
    choice: MotionSet,
) -> MotionPrimitive:
    """The motion from a state to a target velocity, and to rest from a time on.

    Args:
        start: place [m], velocity [m/s] and acceleration [m/s²]; of one, or of as many as there are targets.
        target: velocity [m/s]. Towards rest there is nothing to escape from: it brakes once.
        brakes: when the escape begins [s].
        choice: the limits. Static.
    """
    place, velocity, acceleration = (jnp.broadcast_to(x, target.shape) for x in start)
    pushes, lasts = _change(target - velocity, acceleration, choice)
    rests = jnp.all(target == 0.0, axis=-1)
    takes = jnp.sum(lasts, axis=-1)
    cut = jnp.where(rests, takes, jnp.broadcast_to(brakes, takes.shape))
    nothing = jnp.zeros_like(pushes)
    on = jnp.maximum(cut - takes, 0.0)[..., None]
    whole = MotionPrimitive(
        place,
        velocity,
        target,
        jnp.concatenate([pushes, nothing], axis=-2),
        jnp.concatenate([lasts, on, jnp.zeros_like(lasts)], axis=-1),
    )
    _, velocity, acceleration = at(whole, cut)
    after, stops = _change(-velocity, acceleration, choice)
    # The lines of the first change that begin before the cut, up to it.
    ends = jnp.cumsum(lasts, axis=-1)
    knots = jnp.concatenate([jnp.zeros_like(ends[..., :1]), ends], axis=-1)
    pushes = jnp.where((knots >= cut[..., None])[..., None], acceleration[..., None, :], pushes)
    lasts = jnp.clip(cut[..., None] - knots[..., :-1], 0.0, lasts)
    stops = jnp.where(rests[..., None], 0.0, stops)
    after = jnp.where(rests[..., None, None], 0.0, after)
    lines = jnp.concatenate([pushes, after], axis=-2), jnp.concatenate([lasts, on, stops], axis=-1)
    return MotionPrimitive(place, whole.velocity, target, *lines)


def rest_at(place: Float[Array, "*batch 3"]) -> MotionPrimitive:
    """The motion of who stays where he is."""
    zero, batch = jnp.zeros_like(place), place.shape[:-1]
    return MotionPrimitive(place, zero, zero, jnp.zeros((*batch, _LINES + 1, 3)), jnp.zeros((*batch, _LINES)))


def _change(
    change: Float[Array, "*batch 3"], acceleration: Float[Array, "*batch 3"], choice: MotionSet
) -> tuple[Float[Array, "*batch 4 3"], Float[Array, "*batch 3"]]:
    """Lines of a change of velocity [m/s] from an acceleration [m/s²]: pushes at their ends, and what each lasts."""
    size, push = jnp.linalg.norm(change, axis=-1), jnp.linalg.norm(acceleration, axis=-1)
    needs = jnp.minimum(choice.acceleration, jnp.sqrt(choice.jerk * size + push * push))
    rises, falls = (needs + push) / choice.jerk, needs / choice.jerk
    left = change - 0.5 * rises[..., None] * acceleration
    some = jnp.where(needs > 0.0, needs, 1.0)
    holds = jnp.maximum(jnp.linalg.norm(left, axis=-1) / some - 0.5 * (rises + falls), 0.0)
    takes = holds + 0.5 * (rises + falls)
    pushing = left / jnp.where(takes > 0.0, takes, 1.0)[..., None]
    pushes = jnp.stack([acceleration, pushing, pushing, jnp.zeros_like(pushing)], axis=-2)
    return pushes, jnp.stack([rises, holds, falls], axis=-1)


def motions(choice: MotionSet, present: MotionPrimitive, towards: Float[Array, "3"]) -> MotionPrimitive:
    """All motions that are tried from where a motion starts.

    Args:
        choice: which. Static.
        present: the motion.
        towards: a velocity that is tried besides [m/s], no faster than `choice.speed`: the guide's.
    """
    given = jnp.asarray(choice.targets, towards.dtype)
    targets = jnp.concatenate([given, towards[None], 0.5 * towards[None]])
    targets = jnp.tile(targets, (len(choice.brakes), 1))
    brakes = jnp.repeat(jnp.asarray(choice.brakes, towards.dtype), len(targets) // len(choice.brakes))
    return motion_to((present.place, present.velocity, present.pushes[..., 0, :]), targets, brakes, choice)
