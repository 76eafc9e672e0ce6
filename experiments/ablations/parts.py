"""Parts that the library leaves out on purpose: smoothing that ignores walls, and the ascent without guards.

u ← G u along each axis        G_ij ~ exp(−(i − j)² / 2σ²), at the border as SciPy's "nearest"
x ← x + η m                    m: momentum of normalised gradients, or ADAM's step
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
from maxjax.core.interpolation import CORNERS, corner_weights
from maxjax.fields import gradient as slope
from maxjax.planning.path.ascent import Ascent

_ADAM_BETA2 = 0.999
# Outcomes of the bare ascent.
_GOING, _ARRIVED, _LOST = 0, 1, 2


@functools.partial(jax.jit, static_argnames=("sigma",))
def _aware(u: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"], sigma: float) -> Float[Array, "nx ny nz"]:
    return slope.smooth(u, free, sigma)


def smooth(
    u: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"], sigma: float, kernel: Kernel
) -> Float[Array, "nx ny nz"]:
    """The smoothed log-potential, by the library's kernel or by the Gaussian that does not see walls."""
    blur = _aware if kernel == "walls" or sigma == 0 else _plain
    return jnp.asarray(blur(u, free, sigma))


@functools.partial(jax.jit, static_argnames=("sigma",))
def _plain(u: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"], sigma: float) -> Float[Array, "nx ny nz"]:
    """Voxels without current, free or not, hold the least value of the others."""
    reached = jnp.isfinite(u)
    return gaussian(jnp.where(reached, u, jnp.min(jnp.where(reached, u, jnp.inf))), sigma)


def gaussian(u: Float[Array, "nx ny nz *c"], sigma: float) -> Float[Array, "nx ny nz *c"]:
    """SciPy's `gaussian_filter` over the first three axes, which sees no walls; sigma is static [voxels]."""
    for axis, n in enumerate(u.shape[:3]):
        weights = ndimage.gaussian_filter1d(np.eye(n, dtype=np.float32), sigma, axis=0, mode="nearest")
        # Products of fewer digits would drown the gradient between two voxels.
        u = jnp.moveaxis(jnp.tensordot(weights, u, axes=(1, axis), precision="highest"), 0, axis)
    return u


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


@dataclasses.dataclass(frozen=True)
class Bare:
    """How the ascent without guards climbs.

    Attributes:
        rule: of its steps.
        steps: at most so many.
        near: distance along each axis at which the goal is the next point [voxels].
    """

    rule: Rule = "momentum"
    steps: int = 4096
    near: float = 1.5


@functools.partial(jax.jit, static_argnames=("settings",))
def bare(
    gradient: Float[Array, "nx ny nz 3"],
    free: Bool[Array, "nx ny nz"],
    start: Float[Array, " 3"],
    goal: Float[Array, " 3"],
    settings: Bare,
) -> tuple[Float[Array, "t 3"], Int32[Array, ""]]:
    """The ascent of `planning.path.ascent` without any guard: it may enter walls and leave the map.

    Args:
        gradient: of the log-potential; between centres of voxels it is interpolated among those that are free.
        free: voxels that are no walls.
        start, goal: index coordinates.
        settings: static.

    Returns:
        The path of `steps + 2` points, its last point repeated, and its status: OK where it came near the goal,
        which is then its end; PATH_IN_COLLISION where it ran into a wall or off the map; PATH_STALLED where its
        steps ran out.
    """
    shape = jnp.asarray(free.shape)
    advance = functools.partial(
        _momentum if settings.rule == "momentum" else _adam, rate=Ascent().rate, beta=Ascent().momentum
    )

    def step(at: BareCarry) -> BareCarry:
        move, m, v = advance(_at(gradient, free, at.x), at)
        x = at.x + move
        voxel = jnp.floor(x + 0.5).astype(jnp.int32)
        inside = jnp.all((voxel >= 0) & (voxel < shape))
        i, j, h = jnp.clip(voxel, 0, shape - 1)
        reached = jnp.max(jnp.abs(goal - x)) <= settings.near
        outcome = jnp.where(~inside | ~free[i, j, h], _LOST, jnp.where(reached, _ARRIVED, _GOING))
        return BareCarry(x, m, v, at.count + 1, outcome, at.path.at[at.count + 1].set(x))

    zero = jnp.zeros_like(start)
    path = jnp.broadcast_to(start, (settings.steps + 2, 3))
    first = BareCarry(start, zero, zero, jnp.int32(0), jnp.int32(_GOING), path)
    last: BareCarry = lax.while_loop(lambda at: (at.count < settings.steps) & (at.outcome == _GOING), step, first)
    end = jnp.where(last.outcome == _ARRIVED, goal, last.x)
    path = jnp.where(jnp.arange(len(path))[:, None] > last.count, end, last.path)
    statuses = [maxjax.Status.PATH_STALLED, maxjax.Status.OK, maxjax.Status.PATH_IN_COLLISION]
    return path, jnp.asarray([int(status) for status in statuses], jnp.int32)[last.outcome]


def _at(gradient: Float[Array, "nx ny nz 3"], free: Bool[Array, "nx ny nz"], x: Float[Array, " 3"]) -> Array:
    base = jnp.clip(jnp.floor(x).astype(jnp.int32), 0, jnp.asarray(free.shape) - 2)
    i, j, k = (base + jnp.asarray(CORNERS)).T
    share = corner_weights(jnp.clip(x - base, 0, 1)).reshape(8) * free[i, j, k]
    total = jnp.sum(share)
    return share @ gradient[i, j, k] / jnp.where(total > 0, total, 1)


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
