"""Gradient ascent of the log-potential, from the start to the goal.

    m ← β m + g / |g|,    x ← x + η m,    g = ∇ log φ at x       (momentum; the paper has β = 0.9, η = 0.1)
    m ← β m + (1 − β) g,  v ← β₂ v + (1 − β₂) g²,  x ← x + η m̂ / √v̂      (its predecessor's ADAM, per component)

A step must be clear (`line_of_sight.clear`: of blocked voxels; with room, half a voxel beside it) and must not enter a
voxel whose log φ is lower than where it left from.
Where the wall is in the way the step loses the components that point into it, so the path slides along the wall. Where
no such step is left, or the path lingers in one voxel, the *discrete step* takes over: to the centre of the voxel, then
to the centre of its highest neighbour. Both are clear with room, too: the position lies in a cell between centres of
voxels, and its own voxel's centre is a corner of it; between centres of two face neighbours lies nothing else.

Why it arrives: log φ of the visited voxels never falls and each change of voxel raises it, so no voxel is entered twice
and nothing can orbit; on a certified field every voxel but the goal has a higher neighbour, so the discrete step always
exists.

Positions are index coordinates (whole numbers at voxel centres).
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Literal

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Shaped

from maxjax.compile.lowering import first_maximum, in_block, once
from maxjax.fields import gradient as slope
from maxjax.planning.path.line_of_sight import Sight, clear

# Steps within one voxel before the discrete step takes over; at full speed a voxel takes one or two.
_PATIENCE = 12
_ADAM_BETA2 = 0.999
# Steps between two looks whether the goal is reached.
_STRIDE = 16
# Slabs of a step's line of sight, which bound the step; and how far from its voxel what it reads can lie: the voxel
# where it ends, that one's span, and one more for its rounding.
_SLABS, _REACH = 3, 5
# Which components of a step survive: all, then two, then one. Where none does, the step to the goal stands in the row.
_MASKS = ((1, 1, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0))
# The six neighbours, and the voxel itself to make eight, as many scores as there are masks (docs/performance.md).
_NEIGHBOURS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0, 0, 0), (0, 0, 0))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Field:
    """Volumes that a step of the ascent reads.

    Attributes:
        log_phi: log-potential; −inf in voxels without current.
        smoothed: the same, smoothed: its gradient is climbed.
        sight: of the blocked voxels.
        free: voxels that are not blocked.
    """

    log_phi: Float[Array, "nx ny nz"]
    smoothed: Float[Array, "nx ny nz"]
    sight: Sight
    free: Bool[Array, "nx ny nz"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _ClimberCarry:
    """Carry of the steps.

    Attributes:
        position: index coordinates.
        momentum: m.
        second_moment: v.
        lingered: steps spent in this voxel.
        arrived: at the goal.
    """

    position: Float[Array, " 3"]
    momentum: Float[Array, " 3"]
    second_moment: Float[Array, " 3"]
    lingered: Int32[Array, ""]
    arrived: Bool[Array, ""]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _PathCarry:
    """Carry of the scans.

    Attributes:
        climber: after the steps taken.
        taken: steps.
        path: points so far; the rest is the goal.
    """

    climber: _ClimberCarry
    taken: Int32[Array, ""]
    path: Float[Array, "t 3"]


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
    log_phi: Float[Array, "nx ny nz"],
    sight: Sight,
    free: Bool[Array, "nx ny nz"],
    start: Float[Array, " 3"],
    goal: Float[Array, " 3"],
    settings: Ascent,
) -> tuple[Float[Array, "t 3"], Bool[Array, ""]]:
    """Climb from start to goal.

    Args:
        log_phi: log-potential, highest at the goal's voxel; −inf where there is no conductor or no current.
        sight: of the blocked voxels.
        free: voxels that are not blocked.
        start, goal: index coordinates, both clear.
        settings: static.

    Returns:
        The path of `steps + 1` points, the last one repeated to the end, and whether it reached the goal.
    """
    field = _Field(log_phi, slope.smooth(log_phi, free, settings.smoothing), sight, free)
    step = functools.partial(_step, field, goal, settings)
    # One scan after the other, until the goal is reached: most paths need few of the steps that some do.
    stride = min(_STRIDE, settings.steps)

    def stretch(carry: _PathCarry) -> _PathCarry:
        steps = carry.taken + jnp.arange(stride, dtype=jnp.int32)
        climber, points = lax.scan(step, carry.climber, steps)
        path = lax.dynamic_update_slice(carry.path, points, (carry.taken + 1, jnp.int32(0)))
        return _PathCarry(climber, carry.taken + stride, path)

    strides = -(-settings.steps // stride)
    zero = jnp.zeros_like(start)
    climber = _ClimberCarry(start, zero, zero, jnp.int32(0), jnp.array(False))
    path = jnp.broadcast_to(goal, (strides * stride + 1, 3)).at[0].set(start)
    last = lax.while_loop(
        lambda carry: ~carry.climber.arrived & (carry.taken < settings.steps),
        stretch,
        _PathCarry(climber, jnp.int32(0), path),
    )
    return last.path[: settings.steps + 1], last.climber.arrived


def _voxel(x: Float[Array, "*b 3"], shape: tuple[int, ...]) -> Int32[Array, "*b 3"]:
    return jnp.clip(jnp.floor(x + 0.5).astype(jnp.int32), 0, jnp.asarray(shape, jnp.int32) - 1)


def _at(volume: Shaped[Array, "nx ny nz"], v: Int32[Array, "*b 3"]) -> Shaped[Array, "*b"]:
    _, ny, nz = volume.shape
    return volume.reshape(-1)[(v[..., 0] * ny + v[..., 1]) * nz + v[..., 2]]


def _step(
    field: _Field, goal: Float[Array, " 3"], settings: Ascent, carry: _ClimberCarry, k: Int32[Array, ""]
) -> tuple[_ClimberCarry, Float[Array, " 3"]]:
    """The k-th step; returns the new position, too."""

    def step(
        near: _Field,
        corner: Int32[Array, " 3"],
        goal: Float[Array, " 3"],
        carry: _ClimberCarry,
        k: Int32[Array, ""],
    ) -> _ClimberCarry:
        # By whole numbers, which rounds nothing within the block.
        shift = corner.astype(goal.dtype)
        after = _step_among(
            near, goal - shift, settings, dataclasses.replace(carry, position=carry.position - shift), k
        )
        return dataclasses.replace(after, position=after.position + shift)

    here = _voxel(carry.position, field.log_phi.shape)
    after: _ClimberCarry = in_block(step, field, here, _REACH, goal, carry, k)
    return after, after.position


def _step_among(
    field: _Field, goal: Float[Array, " 3"], settings: Ascent, carry: _ClimberCarry, k: Int32[Array, ""]
) -> _ClimberCarry:
    """The k-th step among these voxels, in their own index coordinates."""
    x, log_phi = carry.position, field.log_phi
    here = _voxel(x, log_phi.shape)
    height = _at(log_phi, here)
    g = slope.gradient_at(field.smoothed, field.free, x)
    m, v, move = _moved(settings, carry, g, k)

    masks = jnp.asarray(_MASKS, log_phi.dtype)
    ends = jnp.where(jnp.any(masks > 0, axis=1, keepdims=True), x + masks * move, goal)
    seen = clear(field.sight, x, ends, slabs=_SLABS)
    rises = _at(log_phi, _voxel(ends, log_phi.shape)) > height
    same = jnp.all(_voxel(ends, log_phi.shape) == here, axis=1)
    gain = jnp.where(seen & (rises | same), jnp.sum(masks * move * g, axis=1), -jnp.inf)
    most, end, mask = first_maximum(gain, ends, masks)
    smooth_step = (most > 0) & (carry.lingered < _PATIENCE)

    arrives = (k < settings.steps) & (jnp.max(jnp.abs(goal - x)) <= 1.5) & seen[-1]
    following = jnp.where(smooth_step, end, _discrete(field, x, here, height))
    following = jnp.where(arrives, goal, following)
    following = jnp.where(carry.arrived | (k >= settings.steps), x, following)
    # What the wall took from the step is lost to the momentum too; a discrete step starts afresh.
    following, m = once(following, jnp.where(smooth_step, m * mask, 0))
    entered = jnp.any(_voxel(following, log_phi.shape) != here)
    lingered = jnp.where(entered, 0, carry.lingered + 1)
    return _ClimberCarry(following, m, v, lingered, carry.arrived | arrives)


def _moved(
    settings: Ascent, carry: _ClimberCarry, g: Float[Array, " 3"], k: Int32[Array, ""]
) -> tuple[Float[Array, " 3"], Float[Array, " 3"], Float[Array, " 3"]]:
    """Momentum, second moment and step [voxels] by the rule of the settings."""
    if settings.rule == "momentum":
        size = jnp.linalg.norm(g)
        m = settings.momentum * carry.momentum + g / jnp.where(size > 0, size, 1)
        return m, carry.second_moment, settings.rate * m
    m = settings.momentum * carry.momentum + (1 - settings.momentum) * g
    v = _ADAM_BETA2 * carry.second_moment + (1 - _ADAM_BETA2) * g**2
    unbiased = m / (1 - settings.momentum ** (k + 1))
    return m, v, settings.rate * unbiased / (jnp.sqrt(v / (1 - _ADAM_BETA2 ** (k + 1))) + 1e-12)


def _discrete(
    field: _Field, x: Float[Array, " 3"], here: Int32[Array, " 3"], height: Float[Array, ""]
) -> Float[Array, " 3"]:
    """The discrete step: to the centre first (the voxel is convex), from there to the highest neighbour."""
    shape = jnp.asarray(field.log_phi.shape, jnp.int32)
    around = here + jnp.asarray(_NEIGHBOURS, jnp.int32)
    inside = jnp.all((around >= 0) & (around < shape), axis=1)
    around = jnp.clip(around, 0, shape - 1)
    values = jnp.where(inside & _at(field.free, around), _at(field.log_phi, around), -jnp.inf)
    top, neighbour = first_maximum(values, around.astype(x.dtype))
    centre = here.astype(x.dtype)
    up = jnp.where(top > height, neighbour, centre)
    return jnp.where(jnp.all(x == centre), up, centre)
