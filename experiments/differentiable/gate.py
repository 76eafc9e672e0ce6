"""A gate in a wall as a smooth change of the conductivity, and the mean length through it.

L(y, z) = mean over the starts of −ℓ log φ(s),        σ = σ₀ (1 − wall (1 − window(y, z)))
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int32

from experiments.differentiable.field import log_potential

# Width of the gate's edges [voxels].
_EDGE = 0.7


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Works:
    """What the gate is cut into.

    Attributes:
        sigma: conductivity of the city without the wall.
        wall: 1 in the voxels that the wall and its margin take, 0 elsewhere.
        goal: voxel.
        starts: voxels.
        length: ℓ [voxels].
        closed: what the closed wall conducts beside free space.
    """

    sigma: Float[Array, "nx ny nz"]
    wall: Float[Array, "nx ny nz"]
    goal: Int32[Array, " 3"]
    starts: Int32[Array, "n 3"]
    length: Float[Array, ""]
    closed: Float[Array, ""]


def window(gate: Float[Array, " 2"], half: float, shape: tuple[int, ...]) -> Float[Array, "1 ny nz"]:
    """1 inside the gate, 0 outside, in between over `_EDGE`."""
    y, z = (
        jax.nn.sigmoid((half + 0.5 - jnp.abs(jnp.arange(n, dtype=gate.dtype) - middle)) / _EDGE)
        for n, middle in zip(shape[1:], gate, strict=True)
    )
    return y[None, :, None] * z[None, None, :]


def mean_length(gate: Float[Array, " 2"], works: Works, half: float) -> Float[Array, ""]:
    """L [voxels] of a gate with its middle at (y, z) [voxels]."""
    opened = works.closed + (1 - works.closed) * window(gate, half, works.sigma.shape)
    return _length(works.sigma * (1 - works.wall * (1 - opened)), works)


def _length(sigma: Float[Array, "nx ny nz"], works: Works) -> Float[Array, ""]:
    return -works.length * jnp.mean(log_potential(sigma, works.goal, works.length, works.starts))


def shares(works: Works) -> Float[Array, "nx ny nz"]:
    """Of every voxel of the closed wall, −∂L/∂ log σ: what opening it would take off L, to first order."""
    closed = works.sigma * (1 - works.wall * (1 - works.closed))
    slope: Array = jax.grad(_length)(closed, works)
    return -slope * closed * works.wall
