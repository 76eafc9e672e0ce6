"""From fields to what a network reads, and from its output to a potential.

    y = −ℓ log φ = y₀ + unit · network(x)        log φ = −y / ℓ

y is the log-potential in units of the screening length: a distance in voxels, by Varadhan about the geodesic one to the
goal, whatever ℓ is. 0 at the goal; larger is further. The unit makes the output of order one: 100 voxels without a
start, 10 with one.

The start y₀ is 0 (`nothing`, the paper: the output is all of y), or the closed form of free space (`free`). Where σ
falls as 1/r and nothing is in the way, φ = K₀(r/ℓ), a modified Bessel function; on the lattice, with its decay θ and
K₀'s leading term kept finite at the goal,

    y₀(r) = ℓ (θ r + ½ log(1 + r))        2 (cosh θ − 1) = 1/ℓ²        r: Euclidean distance to the goal, walls ignored

Input: log(1 + σ) / log(1 + σ_goal) for each voxel: 0 in obstacles, 1 at the goal, falling with the distance from it.
A network with the flood among its inputs is also given how walls and prices lengthen distances: the goal's component;
y₀; the increase of y₀ when r is the number of steps in which a flood from the goal arrives (`fields.geodesic`, prices
counted, from which the solver starts as well); and log N of the price. y₀ of the flood is right in the shadow of walls,
but coarse: it stays an input.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Integer

from maxjax.fields.conductivity import SIGMA_GOAL

Start = Literal["nothing", "free"]
Volume = Float[Array, "nx ny nz"]

# What an output of 1 means [voxels].
UNIT: dict[Start, float] = {"nothing": 100.0, "free": 10.0}
# Channels that a network with the flood among its inputs reads besides.
FLOOD_CHANNELS = 4
# What an output that is no number stands for [nats]: farther than any voxel of a city.
_FARTHEST = 1e4


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Known:
    """Inputs of a network for a problem.

    Attributes:
        sigma: conductivity (`fields.conductivity`).
        price: N ≥ 1 (`fields.price.lattice_price`).
        goal_index: voxel of the goal.
        steps: of the flood from the goal, prices counted; 0 outside its component.
        length: screening length ℓ [voxels].
    """

    sigma: Volume
    price: Volume
    goal_index: Int32[Array, " 3"]
    steps: Integer[Array, "nx ny nz"]
    length: Float[Array, ""]


def law(distance: Float[Array, "*space"], length: Float[Array, ""]) -> Float[Array, "*space"]:
    """y₀ at a distance from the goal [voxels]."""
    decay = jnp.arccosh(1 + 1 / (2 * length**2))
    return length * (decay * distance + jnp.log1p(distance) / 2)


def encode(start: Start, flood: bool, known: Known) -> tuple[Float[Array, "nx ny nz c"], Volume]:
    """Channels that the network reads, and y₀ [voxels].

    Args:
        start: what y₀ is. Static.
        flood: whether the network reads the flood and the price. Static.
        known: of the problem.
    """
    sigma, length = known.sigma, known.length
    brightness = jnp.log1p(sigma) / math.log1p(SIGMA_GOAL)
    free = law(_euclidean(sigma.shape, known.goal_index), length)
    base = free if start == "free" else jnp.zeros_like(free)
    if not flood:
        return brightness[..., None], base
    joined = known.steps > 0
    detour = jnp.where(joined, law(known.steps.astype(jnp.float32), length) - free, 0)
    channels = (
        brightness,
        joined.astype(jnp.float32),
        free / UNIT["nothing"],
        detour / UNIT["free"],
        jnp.log(known.price),
    )
    return jnp.stack(channels, axis=-1), base


def _euclidean(shape: tuple[int, ...], goal_index: Int32[Array, " 3"]) -> Volume:
    squared = jnp.zeros(shape, jnp.float32)
    for axis in range(3):
        offset = lax.broadcasted_iota(jnp.int32, shape, axis) - goal_index[axis]
        squared = squared + offset.astype(jnp.float32) ** 2
    return jnp.sqrt(squared)


def decode(y: Volume, component: Bool[Array, "nx ny nz"], goal: Bool[Array, "nx ny nz"], length: Array) -> Volume:
    """Log φ of a predicted y: finite whatever the network says, 0 at the goal and outside its component.

    Args:
        y: −ℓ log φ [voxels].
        component: the goal's component.
        goal: True at the goal.
        length: screening length ℓ [voxels].
    """
    nats = jnp.nan_to_num(y / length, nan=_FARTHEST, posinf=_FARTHEST, neginf=-_FARTHEST)
    return jnp.where(component & ~goal, -jnp.clip(nats, -_FARTHEST, _FARTHEST), 0)
