"""The price of a metre beside a wall: n(d) ≥ 1, which falls to 1 at the margin D.

    quadratic      n = 1 + a (1 − d/D)²
    exponential    n = 1 + a (e^(−3 d/D) − e^(−3)) / (1 − e^(−3))      Nav2's inflation layer, scaled to reach 1 at D
    speed          n = min(1 + a, D/d)                                 1/speed of Fast Marching Square

for d < D, with the height a: n is 1 + a on the wall. A path of least ∫ n ds keeps away from walls where that costs less
than its detour.

The price stands in the leak, −∇·(σ∇φ) + κ N² σ φ = q with κ = 1/ℓ². On the lattice, φ = exp(−θ i) along an axis solves
it where 2 cosh θ − 2 = κ N², hence φ decays by n θ a voxel, with θ = 2 asinh(1 / 2ℓ) that of n = 1, if

    N = 2 ℓ sinh(n θ / 2)        `lattice_price`

N is n for prices that are small beside ℓ, and 1 for n = 1.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

SCREENING_LENGTH = 1.25
"""ℓ [voxels]: the shorter, the closer to cheapest paths, and the more cycles a solve takes."""

_SHAPES = ("quadratic", "exponential", "speed")
# What the exponential falls by over the margin, as a power of e: Nav2's rate of 3 per metre over a metre.
_FALL = 3.0


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Price:
    """How a price rises from 1 at the margin to 1 + `height` on the wall; static under `jit`.

    Attributes:
        shape: of the rise.
        height: a; 0 leaves distance alone.

    Raises:
        ValueError: for another shape, or a height that is not a finite number ≥ 0.
    """

    shape: Literal["quadratic", "exponential", "speed"] = "quadratic"
    height: float = 3.5

    def __post_init__(self) -> None:
        if self.shape not in _SHAPES:
            raise ValueError(f"Price.shape: expected one of {', '.join(_SHAPES)}, given {self.shape!r}")
        number = isinstance(self.height, int | float) and not isinstance(self.height, bool)
        if not (number and 0 <= self.height < math.inf):
            raise ValueError(f"Price.height: expected a finite number of at least 0, given {self.height!r}")
        object.__setattr__(self, "height", float(self.height))

    def price_at(self, distance: Float[Array, "*b"], margin: float) -> Float[Array, "*b"]:
        """The price n at a distance to the nearest wall.

        Args:
            distance: [m], 0 at the wall's face.
            margin: from where on it is 1 [m]; at margin 0 it is 1 everywhere. Static.
        """
        if margin == 0:
            return jnp.ones_like(distance)
        part = jnp.clip(distance / margin, 0, 1)
        if self.shape == "quadratic":
            return 1 + self.height * (1 - part) ** 2
        if self.shape == "exponential":
            return 1 + self.height * (jnp.exp(-_FALL * part) - math.exp(-_FALL)) / (1 - math.exp(-_FALL))
        return 1 / jnp.maximum(part, 1 / (1 + self.height))


def decay(n: Float[Array, "*b"] | float, length: Float[Array, ""] | float) -> Float[Array, "*b"]:
    """By how much log φ falls a voxel along an axis, 2 asinh(n / 2ℓ): the θ of 2 (cosh θ − 1) = n²/ℓ².

    Args:
        n: price in the leak.
        length: screening length ℓ [voxels].
    """
    return 2 * jnp.arcsinh(n / (2 * length))


def lattice_price(n: Float[Array, "*b"], length: float) -> Float[Array, "*b"]:
    """N, by which φ decays along an axis n times as fast as at n = 1.

    Args:
        n: price.
        length: screening length ℓ [voxels].
    """
    # Rounding must not take it below 1.
    return jnp.maximum(2 * length * jnp.sinh(n * math.asinh(1 / (2 * length))), 1)
