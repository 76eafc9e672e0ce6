"""Gradient ascent of the log-potential, from the start to the goal.

    m ← β m + g / |g|,    x ← x + η m,    g = ∇ log φ at x       (momentum; the paper has β = 0.9, η = 0.1)
    m ← β m + (1 − β) g,  v ← β₂ v + (1 − β₂) g²,  x ← x + η m̂ / √v̂      (its predecessor's ADAM, per component)

A step must keep to free voxels (`sight.clear`) and must not enter a voxel whose φ is lower than where it left from.
Where the wall is in the way the step loses the components that point into it, so the path slides along the wall. Where
no such step is left, or the path lingers in one voxel, the *discrete step* takes over: to the centre of the voxel, then
to the centre of its highest neighbour.

Why it arrives: φ of the visited voxels never falls and each change of voxel raises it, so no voxel is entered twice and
nothing can orbit; on a certified field every voxel but the goal has a higher neighbour, so the discrete step always
exists.

Positions are index coordinates (whole numbers at voxel centres).
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Shaped, UInt16

from maxjax.fields import gradient as slope
from maxjax.planning.sight import clear

# Steps within one voxel before the discrete step takes over; at full speed a voxel takes one or two.
_PATIENCE = 12
_ADAM_BETA2 = 0.999
# Steps of one scan, and of one turn of its loop.
_STRIDE, _UNROLLED = 16, 8
# Which components of a step survive: all, then two, then one. Where none does, the step to the goal stands in the row.
_MASKS = ((1, 1, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0))
# The six neighbours, and the voxel itself to make eight: a GPU finds as many scores as there are masks in one kernel.
_NEIGHBOURS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0, 0, 0), (0, 0, 0))


# Position, momentum, second moment, steps spent in this voxel, arrived.
State = tuple[Array, Array, Array, Array, Array]


@dataclasses.dataclass(frozen=True)
class Ascent:
    """Settings of the ascent; static under `jit`.

    Attributes:
        rule: `momentum`, or the per-component `adam`.
        rate: η [voxels].
        momentum: β.
        smoothing: standard deviation of the wall-aware smoothing of log φ before the ascent [voxels]; 5 in the paper.
        steps: at most so many.
    """

    rule: Literal["momentum", "adam"] = "momentum"
    rate: float = 0.1
    momentum: float = 0.9
    smoothing: float = 0.0
    steps: int = 512

    def __post_init__(self) -> None:
        if self.rule not in ("momentum", "adam"):
            raise ValueError(f"Ascent.rule: expected 'momentum' or 'adam', given {self.rule!r}")
        if not (0 < self.rate <= 1 and 0 <= self.momentum < 1 and self.smoothing >= 0 and self.steps > 0):
            raise ValueError(
                f"Ascent: expected 0 < rate <= 1, 0 <= momentum < 1, smoothing >= 0, steps > 0; given {self}"
            )


@jax.named_scope("ascend")
def ascend(
    phi: Float[Array, "nx ny nz"],
    bits: UInt16[Array, "nx ny nz"],
    free: Bool[Array, "nx ny nz"],
    start: Float[Array, " 3"],
    goal: Float[Array, " 3"],
    settings: Ascent,
) -> tuple[Float[Array, "t 3"], Bool[Array, ""]]:
    """Climb from start to goal.

    Args:
        phi: potential, highest at the goal's voxel.
        bits: `sight.span_codes` of the blocked voxels.
        free: voxels that are not blocked; holds start and goal.
        start, goal: index coordinates.
        settings: static.

    Returns:
        The path of `steps + 1` points, the last one repeated to the end, and whether it reached the goal.
    """
    log_phi = slope.smooth(slope.log_potential(phi), free, settings.smoothing)
    shape = jnp.asarray(phi.shape)
    masks, neighbours = jnp.asarray(_MASKS, phi.dtype), jnp.asarray(_NEIGHBOURS)

    def voxel(x: Float[Array, "*b 3"]) -> Int32[Array, "*b 3"]:
        return jnp.clip(jnp.floor(x + 0.5).astype(jnp.int32), 0, shape - 1)

    def at(volume: Shaped[Array, "nx ny nz"], v: Int32[Array, "*b 3"]) -> Shaped[Array, "*b"]:
        _, ny, nz = volume.shape
        return volume.reshape(-1)[(v[..., 0] * ny + v[..., 1]) * nz + v[..., 2]]

    def step(state: State, k: Int32[Array, ""]) -> tuple[State, Float[Array, " 3"]]:
        x, m, v, lingered, done = state
        here = voxel(x)
        centre, height = here.astype(x.dtype), at(phi, here)
        g = slope.gradient_at(log_phi, free, x)
        if settings.rule == "momentum":
            size = jnp.linalg.norm(g)
            m = settings.momentum * m + g / jnp.where(size > 0, size, 1)
            move = settings.rate * m
        else:
            m = settings.momentum * m + (1 - settings.momentum) * g
            v = _ADAM_BETA2 * v + (1 - _ADAM_BETA2) * g**2
            unbiased = m / (1 - settings.momentum ** (k + 1))
            move = settings.rate * unbiased / (jnp.sqrt(v / (1 - _ADAM_BETA2 ** (k + 1))) + 1e-12)

        ends = jnp.where(jnp.any(masks > 0, axis=1, keepdims=True), x + masks * move, goal)
        seen = clear(bits, x, ends, slabs=3)
        rises = at(phi, voxel(ends)) > height
        same = jnp.all(voxel(ends) == here, axis=1)
        gain = jnp.where(seen & (rises | same), jnp.sum(masks * move * g, axis=1), -jnp.inf)
        most, end, mask = _highest(gain, ends, masks)
        smooth_step = (most > 0) & (lingered < _PATIENCE)

        # The discrete step: to the centre first (the voxel is convex), from there to the highest neighbour.
        around = here + neighbours
        inside = jnp.all((around >= 0) & (around < shape), axis=1)
        around = jnp.clip(around, 0, shape - 1)
        values = jnp.where(inside & at(free, around), at(phi, around), -jnp.inf)
        top, neighbour = _highest(values, around.astype(x.dtype))
        up = jnp.where(top > height, neighbour, centre)
        discrete = jnp.where(jnp.all(x == centre), up, centre)

        arrives = (k < settings.steps) & (jnp.max(jnp.abs(goal - x)) <= 1.5) & seen[-1]
        ahead = jnp.where(smooth_step, end, discrete)
        ahead = jnp.where(arrives, goal, ahead)
        ahead = jnp.where(done | (k >= settings.steps), x, ahead)
        # What the wall took from the step is lost to the momentum too; a discrete step starts afresh. With a barrier a
        # GPU finds both in one kernel, and not the momentum once more in the next step.
        ahead, m = lax.optimization_barrier((ahead, jnp.where(smooth_step, m * mask, 0)))
        entered = jnp.any(voxel(ahead) != here)
        lingered = jnp.where(entered, 0, lingered + 1)
        return (ahead, m, v, lingered, done | arrives), ahead

    # One scan after the other, until the goal is reached: most paths need few of the steps that some do.
    stride = min(_STRIDE, settings.steps)

    def stretch(carry: tuple[State, Int32[Array, ""], Float[Array, "t 3"]]) -> tuple[State, Array, Array]:
        state, taken, path = carry
        state, points = lax.scan(step, state, taken + jnp.arange(stride, dtype=jnp.int32), unroll=_UNROLLED)
        return state, taken + stride, lax.dynamic_update_slice(path, points, (taken + 1, 0))

    strides = -(-settings.steps // stride)
    zero = jnp.zeros_like(start)
    state = (start, zero, zero, jnp.int32(0), jnp.array(False))
    path = jnp.broadcast_to(goal, (strides * stride + 1, 3)).at[0].set(start)
    (_, _, _, _, done), _, path = lax.while_loop(
        lambda carry: ~carry[0][4] & (carry[1] < settings.steps), stretch, (state, jnp.int32(0), path)
    )
    return path[: settings.steps + 1], done


def _highest(score: Float[Array, " k"], *rows: Float[Array, "k 3"]) -> tuple[Array, ...]:
    """The highest score, the first one of equals, and its row of each array.

    Written out, like all that a step does with a few numbers: reductions and look-ups would be kernels of their own.
    """
    best = (score[0], *(row[0] for row in rows))
    for k in range(1, score.shape[0]):
        better = score[k] > best[0]
        best = tuple(jnp.where(better, new[k], old) for new, old in zip((score, *rows), best, strict=True))
    return best
