"""Motions of a few seconds that end at rest: towards a velocity, on with it, and an escape by braking.

    v(t):   v₀ → u   with |dv/dt| = a,      then u,      then, from t_b on,  v → 0  with |dv/dt| = a

in straight lines of velocity space, so that no more than `a` is ever needed, and no speed exceeds that of the start and
that of the target. The place is quadratic in time in each of the three parts. Frame: world.
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


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class MotionPrimitive:
    """A motion, or some of them; batch axes lead.

    Attributes:
        place: at its start [m].
        velocity: at its start [m/s].
        target: velocity that it takes up [m/s].
        brakes: time at which the escape begins [s].
        acceleration: a [m/s²].
    """

    place: Float[Array, "*batch 3"]
    velocity: Float[Array, "*batch 3"]
    target: Float[Array, "*batch 3"]
    brakes: Float[Array, "*batch"]
    acceleration: Float[Array, "*batch"]


def at(motion: MotionPrimitive, time: Float[Array, "*batch"]) -> tuple[Array, Array, Array]:
    """Place [m], velocity [m/s] and acceleration [m/s²] at a time since the start [s]; shapes are broadcast."""
    a = motion.acceleration[..., None]
    time = jnp.maximum(time, 0.0)[..., None]
    change = motion.target - motion.velocity
    takes = _norm(change) / a
    push = jnp.where(takes > 0.0, change / jnp.where(takes > 0.0, takes, 1.0), 0.0)
    brakes = motion.brakes[..., None]

    first = jnp.minimum(jnp.minimum(time, takes), brakes)
    velocity = motion.velocity + first * push
    place = motion.place + first * (motion.velocity + 0.5 * first * push)
    place += jnp.maximum(jnp.minimum(time, brakes) - takes, 0.0) * motion.target

    speed = _norm(velocity)
    lasts = speed / a
    since = jnp.minimum(jnp.maximum(time - brakes, 0.0), lasts)
    against = jnp.where(speed > 0.0, -a * velocity / jnp.where(speed > 0.0, speed, 1.0), 0.0)
    place += since * (velocity + 0.5 * since * against)
    acceleration = jnp.where(time < jnp.minimum(takes, brakes), push, 0.0)
    acceleration = jnp.where((time >= brakes) & (time - brakes < lasts), against, acceleration)
    return place, velocity + since * against, acceleration


def duration(motion: MotionPrimitive) -> Float[Array, "*batch"]:
    """Time until it rests [s]."""
    end = at(motion, motion.brakes)[1]
    lasts: Array = motion.brakes + jnp.linalg.norm(end, axis=-1) / motion.acceleration
    return lasts


def later(motion: MotionPrimitive, time: Float[Array, ""]) -> MotionPrimitive:
    """The rest of a motion after a time [s]; the same curve."""
    place, velocity, _ = at(motion, time)
    # Where it brakes already, the rest of its braking is a motion towards rest.
    over = time >= motion.brakes
    target = jnp.where(over[..., None], 0.0, motion.target)
    left = jnp.where(over, 0.0, motion.brakes - time)
    return MotionPrimitive(place, velocity, target, left, motion.acceleration)


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class MotionSet:
    """Which motions are tried; static.

    Attributes:
        speed: greatest [m/s].
        acceleration: a [m/s²].
        directions: of the target velocities, spread over the sphere.
        shares: of the greatest speed, a target each in every direction.
        brakes: times at which escapes begin [s].
        horizon: time over which motions are verified [s]; each of them has come to rest by then.

    Raises:
        ValueError: if a motion would not rest within the horizon.
    """

    speed: float = 5.0
    acceleration: float = 3.0
    directions: int = 48
    shares: tuple[float, ...] = (1.0, 0.5)
    brakes: tuple[float, ...] = (0.2, 0.5)
    horizon: float = 2.2

    def __post_init__(self) -> None:
        least = max(self.brakes) + self.speed / self.acceleration
        if not self.horizon >= least:
            raise ValueError(f"MotionSet.horizon: expected {least:.2f} s or more to come to rest, given {self.horizon}")

    @property
    def targets(self) -> Float[np.ndarray, "n 3"]:
        """Target velocities [m/s], rest first."""
        k = np.arange(self.directions)
        z = 1.0 - (2.0 * k + 1.0) / self.directions
        level = np.sqrt(1.0 - z * z)
        unit = np.stack([level * np.cos(_GOLDEN_ANGLE * k), level * np.sin(_GOLDEN_ANGLE * k), z], -1)
        return np.concatenate([np.zeros((1, 3)), *(share * self.speed * unit for share in self.shares)])


def motions(
    choice: MotionSet, place: Float[Array, "3"], velocity: Float[Array, "3"], towards: Float[Array, "3"]
) -> MotionPrimitive:
    """All motions that are tried from a state.

    Args:
        choice: which. Static.
        place: [m].
        velocity: [m/s].
        towards: a velocity that is tried besides [m/s], no faster than `choice.speed`: the guide's.
    """
    targets = jnp.concatenate([jnp.asarray(choice.targets, place.dtype), towards[None], 0.5 * towards[None]])
    targets = jnp.tile(targets, (len(choice.brakes), 1))
    brakes = jnp.repeat(jnp.asarray(choice.brakes, place.dtype), len(targets) // len(choice.brakes))
    count = len(targets)

    def same(x: Array) -> Array:
        return jnp.broadcast_to(x, (count, *x.shape))

    return MotionPrimitive(same(place), same(velocity), targets, brakes, same(jnp.float32(choice.acceleration)))


def _norm(x: Array) -> Array:
    length: Array = jnp.linalg.norm(x, axis=-1, keepdims=True)
    return length
