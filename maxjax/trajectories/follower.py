"""A clock that waits: a trajectory's time runs as fast as the vehicle keeps up with it.

    p = clip(2 − e / tolerance, 0, 1)    pace; e the distance from the vehicle to the set-point of the present time
    ṡ = p                                time of the trajectory, which never goes back and stops at its end
    x(s),  p ẋ(s),  p² ẍ(s)              set-point, by the chain rule

Full pace within the tolerance, none from twice the tolerance on. The third term of the chain rule, ṗ ẋ, is left out: it
brakes while the vehicle falls behind, which is the error that made the pace fall, and carries the noise of e.

At its end a trajectory is at rest, and so is the last set-point.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

Number = Float[Array, "*#batch"] | Float[np.ndarray, "*#batch"] | float
_Vector = TypeVar("_Vector")


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Follower:
    """The clock; static. Its methods are pure, and safe under `jit`, `vmap` and `lax.scan`.

    They compute in JAX what they are given as JAX's arrays, and all else in NumPy, so that a loop in real time waits
    for no compiler.

    Attributes:
        tolerance: distance to the set-point up to which time runs at full pace [m]; at twice that it stands.

    Raises:
        ValueError: unless it is a positive finite number.
    """

    tolerance: float = 1.0

    def __post_init__(self) -> None:
        if not 0.0 < self.tolerance < math.inf:
            raise ValueError(f"Follower.tolerance: expected a positive number of metres, given {self.tolerance}")

    def pace(self, error: Number) -> Any:
        """How fast the trajectory's time runs, from 0 to 1; 0 where the error is no number.

        Args:
            error: distance from the vehicle to the set-point of the present time [m].
        """
        xp = _numbers(error)
        slack = 2.0 - error / self.tolerance
        return xp.where(xp.isnan(slack), 0.0, xp.clip(slack, 0.0, 1.0))

    def advance(self, time: Number, error: Number, step: Number, duration: Number) -> Any:
        """The trajectory's time a moment later [s]: not before the present one, and not after its end.

        Args:
            time: present time of the trajectory [s].
            error: as `pace` takes it.
            step: that has passed [s]; a clock that runs backwards counts as one that stands.
            duration: of the trajectory [s].
        """
        xp = _numbers(time, error, step, duration)
        return xp.maximum(time, xp.minimum(time + self.pace(error) * xp.maximum(step, 0.0), duration))

    def scale(self, velocity: _Vector, acceleration: _Vector, pace: Number) -> tuple[_Vector, _Vector]:
        """Velocity and acceleration of a set-point whose time runs at a pace, by the chain rule.

        Args:
            velocity, acceleration: (…, 3) of the trajectory [m/s], [m/s²].
            pace: (…) from `pace`.
        """
        rate: Any = _numbers(pace).asarray(pace)[..., None]
        return rate * velocity, rate * rate * acceleration


def _numbers(*values: Number) -> Any:
    return jnp if any(isinstance(value, jax.Array) for value in values) else np
