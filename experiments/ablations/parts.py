"""Parts that the library leaves out on purpose: smoothing that ignores walls, and the ascent without guards.

x ← x + η m        m: momentum of normalised gradients, or ADAM's step
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32
from scipy import ndimage

import maxjax
from experiments.ablations.variants import Kernel, Rule
from maxjax.fields import gradient as slope
from maxjax.planning.ascent import Ascent

_STEPS = 4096
_ADAM_BETA2 = 0.999
_NEAR = 1.5  # voxels, along each axis
# Outcomes of the bare ascent.
_GOING, _ARRIVED, _LOST = 0, 1, 2


@functools.partial(jax.jit, static_argnames=("sigma",))
def _aware(u: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"], sigma: float) -> Float[Array, "nx ny nz"]:
    return slope.smooth(u, free, sigma)


def smooth(
    u: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"], sigma: float, kernel: Kernel
) -> Float[Array, "nx ny nz"]:
    """The smoothed log-potential, by the library's kernel or by the Gaussian that does not see walls."""
    if kernel == "walls" or sigma == 0:
        return jnp.asarray(_aware(u, free, sigma))
    values = np.asarray(u)
    reached = np.isfinite(values)
    blurred = ndimage.gaussian_filter(np.where(reached, values, values[reached].min()), sigma, mode="nearest")
    return jnp.asarray(blurred)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class BareCarry:
    """Loop carry: point, first and second moment, steps made, outcome, points so far."""

    x: Float[Array, " 3"]
    m: Float[Array, " 3"]
    v: Float[Array, " 3"]
    count: Int32[Array, ""]
    outcome: Int32[Array, ""]
    path: Float[Array, "t 3"]


@functools.partial(jax.jit, static_argnames=("rule",))
def bare(
    u: Float[Array, "nx ny nz"],
    free: Bool[Array, "nx ny nz"],
    start: Float[Array, " 3"],
    goal: Float[Array, " 3"],
    rule: Rule,
) -> tuple[Float[Array, "t 3"], Int32[Array, ""]]:
    """The ascent of `planning.ascent` without any guard: nothing keeps it out of walls, off lower ground or on the map.

    Args:
        u: log-potential, smoothed.
        free: voxels that are no walls.
        start, goal: index coordinates.
        rule: static.

    Returns:
        The path, its last point repeated, and its status: OK where it came within a voxel and a half of the goal,
        which is then its end; PATH_IN_COLLISION where it ran into a wall or off the map; PATH_STALLED where its
        steps ran out.
    """
    shape = jnp.asarray(u.shape)
    advance = functools.partial(_momentum if rule == "momentum" else _adam, rate=Ascent().rate, beta=Ascent().momentum)

    def step(at: BareCarry) -> BareCarry:
        move, m, v = advance(slope.gradient_at(u, free, at.x), at)
        x = at.x + move
        voxel = jnp.floor(x + 0.5).astype(jnp.int32)
        inside = jnp.all((voxel >= 0) & (voxel < shape))
        i, j, h = jnp.clip(voxel, 0, shape - 1)
        near = jnp.max(jnp.abs(goal - x)) <= _NEAR
        outcome = jnp.where(~inside | ~free[i, j, h], _LOST, jnp.where(near, _ARRIVED, _GOING))
        return BareCarry(x, m, v, at.count + 1, outcome, at.path.at[at.count + 1].set(x))

    zero = jnp.zeros_like(start)
    path = jnp.broadcast_to(start, (_STEPS + 2, 3))
    first = BareCarry(start, zero, zero, jnp.int32(0), jnp.int32(_GOING), path)
    last: BareCarry = lax.while_loop(lambda at: (at.count < _STEPS) & (at.outcome == _GOING), step, first)
    end = jnp.where(last.outcome == _ARRIVED, goal, last.x)
    path = jnp.where(jnp.arange(len(path))[:, None] > last.count, end, last.path)
    statuses = [maxjax.Status.PATH_STALLED, maxjax.Status.OK, maxjax.Status.PATH_IN_COLLISION]
    return path, jnp.asarray([int(status) for status in statuses], jnp.int32)[last.outcome]


def _momentum(g: Array, at: BareCarry, rate: float, beta: float) -> tuple[Array, Array, Array]:
    """The move along normalised gradients, and the moments behind it."""
    size = jnp.linalg.norm(g)
    m = beta * at.m + g / jnp.where(size > 0, size, 1)
    return rate * m, m, at.v


def _adam(g: Array, at: BareCarry, rate: float, beta: float) -> tuple[Array, Array, Array]:
    """The move of ADAM, and the moments behind it."""
    m = beta * at.m + (1 - beta) * g
    v = _ADAM_BETA2 * at.v + (1 - _ADAM_BETA2) * g**2
    k = at.count + 1
    return rate * m / (1 - beta**k) / (jnp.sqrt(v / (1 - _ADAM_BETA2**k)) + 1e-12), m, v
