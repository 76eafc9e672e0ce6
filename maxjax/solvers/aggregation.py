"""Aggregation multigrid for a random walk that drifts to the goal: the linear step of `solvers.newton`.

    δ_i = ρ_i + Σ_j p_ij δ_j,   p_ij = w_ij φ_j / Σ_k w_ik φ_k,   δ = 0 on the goal

The walk is lumped: aggregates of 2 × 2 × 2 voxels become the states of a smaller walk, again with six neighbours, and
so on; each level relaxes, hands its residual down and takes the correction back, constant on an aggregate. Two choices
make this converge in a few cycles whatever the walls:

- Rows are averaged evenly in an aggregate of free space, where the walk passes through, which keeps its drift; at walls
  and beside the goal weighted by φ, since there it lingers at the exit (an even average would hide a narrow exit).
- Lumping doubles diffusion, since jumps of two voxels count as one: the symmetric part of the lumped rates is halved
  again, but kept as large as the drift, so that no rate is negative.

Divisions stand last wherever a result has several uses (docs/performance.md).
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.lowering import repeat
from maxjax.compile.sharded_volume import on_every_device
from maxjax.fields.stencil import Faces, Links, Volume, cell, gather

Mask = Bool[Array, "nx ny nz"]
Aggregates = Float[Array, "mx my mz"]  # one number an aggregate

# Relaxations on the way down and up: on the first lumped level, and on the deeper ones, which cost little.
_RELAX, _RELAX_DEEP = 4, 10
# Levels are added until the longest axis has this many states: a few relaxations cross it.
_COARSEST = 16
# An axis of fewer states is not halved any more.
_THIN = 4
# Levels of no more states than these are relaxed by every device alone: to fetch a layer from a neighbour takes longer.
_SHARED = 2**20
# log φ where there is none.
_NOTHING = -1e30


def halvings(shape: Sequence[int]) -> tuple[int, int, int]:
    """How often each axis is halved: until the longest fits `_COARSEST`, at least once; thin axes less often."""
    levels = max(1, math.ceil(math.log2(max(shape) / _COARSEST)))
    nx, ny, nz = (min(levels, max(0, math.ceil(math.log2(n / (_THIN - 1))) - 1)) for n in shape)
    return nx, ny, nz


def pad_to_aggregates(array: Array) -> Array:
    """Obstacles behind each axis, to a multiple of 2^`halvings`, so that every level consists of whole aggregates."""
    counts = halvings(array.shape)
    return jnp.pad(array, [(0, -n % 2**count) for n, count in zip(array.shape, counts, strict=True)])


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class AggregateLevel:
    """The aggregates of one level.

    Attributes:
        axes: that are halved to get here. Static.
        even: whether the rows of an aggregate are averaged evenly.
        goal: the aggregate that holds the goal.
    """

    axes: tuple[int, ...] = dataclasses.field(metadata={"static": True})
    even: Mask
    goal: Mask


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Walk:
    """A walk between aggregates.

    Attributes:
        rates: of leaving for each of the six neighbours.
        leaving: their sum; 1 where there are none.
    """

    rates: Links
    leaving: Volume


@jax.named_scope("lump")
def levels_of(faces: Faces, component: Mask, goal_index: Int32[Array, " 3"]) -> tuple[AggregateLevel, ...]:
    """Which aggregates are free space: all their voxels free and joined, away from the goal."""
    counts = halvings(component.shape)
    levels: list[AggregateLevel] = []
    whole, index = component, goal_index
    for depth in range(max(counts)):
        axes = tuple(axis for axis in range(3) if counts[axis] > depth)
        if depth == 0:
            for axis in axes:
                first = lax.broadcasted_iota(jnp.int32, whole.shape, axis) % 2 == 0
                whole = whole & (~first | (faces[axis] > 0))
        for axis in axes:
            whole = _half(whole, axis, 0) & _half(whole, axis, 1)
        index = jnp.stack([index[axis] // 2 if axis in axes else index[axis] for axis in range(3)])
        near = jnp.ones((), bool)
        for axis in range(3):
            near = near & (jnp.abs(lax.broadcasted_iota(jnp.int32, whole.shape, axis) - index[axis]) <= 1)
        whole = whole & ~near
        levels.append(AggregateLevel(axes, whole, cell(whole.shape, index)))
    return tuple(levels)


@jax.named_scope("lump")
def correction(links: Links, diagonal: Volume, log_phi: Volume, levels: tuple[AggregateLevel, ...]) -> Aggregates:
    """δ on the aggregates: the lumped walk's answer to the residual of φ.

    Args:
        links: w_ij φ_j / φ_i (`stencil.rates`), zero outside the component.
        diagonal: d_i; 1 in obstacles.
        log_phi: log φ.
        levels: of `levels_of`.
    """
    total = sum((forward + backward for forward, backward in links), start=jnp.zeros((), log_phi.dtype))
    residual = jnp.log(jnp.where(total > 0, total / diagonal, 1))
    return answer_on_aggregates(links, residual, log_phi, levels)


@jax.named_scope("lump")
def answer_on_aggregates(
    links: Links, residual: Volume, log_phi: Volume, levels: tuple[AggregateLevel, ...]
) -> Aggregates:
    """δ on the aggregates: the lumped walk's answer to a residual, in which it is linear.

    Args:
        links: rates of the walk, of whatever scale in each row; zero outside the component.
        residual: what a step of the walk from each voxel meets.
        log_phi: log φ.
        levels: of `levels_of`.
    """
    total = sum((forward + backward for forward, backward in links), start=jnp.zeros((), log_phi.dtype))
    known = total > 0
    axes = levels[0].axes
    phi, below = _in_aggregates(jnp.where(known, log_phi, _NOTHING), axes)
    # A row of rates sums to about d_i: undivided, it is weighted by d_i already.
    weight = jnp.where(spread(levels[0].even, axes), 1 / jnp.where(known, total, 1), phi)
    rates = tuple((weight * forward, weight * backward) for forward, backward in links)
    walk, residual = _lump(rates, weight * total, weight * total * residual, axes)  # type: ignore[arg-type]
    return _relaxed(walk, residual, below, levels, _RELAX)


def _in_aggregates(log_phi: Volume, axes: tuple[int, ...]) -> tuple[Volume, Aggregates]:
    """φ in terms of the largest of its aggregate, and log Σ φ of each."""
    largest = log_phi
    for axis in axes:
        largest = jnp.maximum(_half(largest, axis, 0), _half(largest, axis, 1))
    phi = jnp.exp(log_phi - spread(largest, axes))
    return phi, largest + jnp.log(_sums(phi, axes))


@jax.named_scope("relax")
def _relaxed(walk: _Walk, residual: Volume, log_phi: Volume, levels: tuple[AggregateLevel, ...], times: int) -> Volume:
    """Solve leaving δ = residual + Σ rates δ, about, on the first of these levels: relax, correct from below, relax."""
    # Nothing leaves the aggregate of the goal: δ = 0 there.
    leaving = jnp.where(levels[0].goal, jnp.inf, walk.leaving)

    def relax(delta: Volume) -> Volume:
        return (gather(walk.rates, delta) + residual) / leaving

    delta = _repeat(relax, residual / leaving, times)
    if not levels[1:]:
        return delta
    below = levels[1]
    phi, log_sums = _in_aggregates(log_phi, below.axes)
    weight = jnp.where(spread(below.even, below.axes), 1, phi) / walk.leaving
    rates = tuple((weight * forward, weight * backward) for forward, backward in walk.rates)
    left = weight * (gather(walk.rates, delta) + residual - walk.leaving * delta)
    coarse, left = _lump(rates, weight * walk.leaving, left, below.axes)  # type: ignore[arg-type]
    correction = _relaxed_deeper(coarse, left, log_sums, levels[1:])
    correction = jnp.where(levels[0].goal, 0, spread(correction, below.axes))
    return _repeat(relax, delta + correction, times)


def _relaxed_deeper(walk: _Walk, residual: Volume, log_phi: Volume, levels: tuple[AggregateLevel, ...]) -> Volume:
    """`_relaxed` on a level that costs little; on a small one, by every device alone."""
    relaxed = functools.partial(_relaxed, times=_RELAX_DEEP)
    if residual.size > _SHARED:
        return relaxed(walk, residual, log_phi, levels)
    return on_every_device(relaxed, walk, residual, log_phi, levels)


def _repeat(step: Callable[[Volume], Volume], x: Volume, times: int) -> Volume:
    """`step` so many times; two a turn of the loop, which spares a copy."""
    x = repeat(times // 2, lambda x: step(step(x)), x)
    return step(x) if times % 2 else x


def _lump(rates: Links, weight: Volume, residual: Volume, axes: tuple[int, ...]) -> tuple[_Walk, Aggregates]:
    """The walk between aggregates and its residual, as means over the rows of an aggregate.

    Args:
        rates: rows of the walk, weighted.
        weight: of the rows.
        residual: of the rows, weighted.
        axes: that are halved. Static.
    """
    rows = _sums(weight, axes)
    rows = jnp.where(rows > 0, rows, 1)
    lumped = []
    for axis, (forward, backward) in enumerate(rates):
        if axis in axes:
            others = tuple(other for other in axes if other != axis)
            leaving = _sums(_half(forward, axis, 1), others), _sums(_half(backward, axis, 0), others)
            lumped.append(_halve_diffusion(leaving[0] / rows, leaving[1] / rows))
        else:
            lumped.append((_sums(forward, axes) / rows, _sums(backward, axes) / rows))
    total = sum((forward + backward for forward, backward in lumped), start=jnp.zeros((), rows.dtype))
    return _Walk(tuple(lumped), jnp.where(total > 0, total, 1)), _sums(residual, axes) / rows  # type: ignore[arg-type]


def _halve_diffusion(forward: Volume, backward: Volume) -> tuple[Volume, Volume]:
    """Half the symmetric part of the rates along an axis, though no less than the drift needs to keep both ≥ 0."""
    mean, drift = (forward + backward) / 2, (forward - backward) / 2
    wanted = jnp.where((forward > 0) & (backward > 0), jnp.maximum(mean / 2, jnp.abs(drift)), mean)
    return wanted + drift, wanted - drift


def _half(array: Array, axis: int, parity: int) -> Array:
    """Every other entry along an axis."""
    return jnp.asarray(lax.slice_in_dim(array, parity, None, 2, axis))


def _sums(array: Volume, axes: tuple[int, ...]) -> Aggregates:
    """Sums over pairs along `axes`."""
    for axis in axes:
        array = _half(array, axis, 0) + _half(array, axis, 1)
    return jnp.asarray(array)


def spread(array: Array, axes: tuple[int, ...]) -> Array:
    """Each value to its pair along `axes`."""
    for axis in axes:
        array = jnp.repeat(array, 2, axis)
    return array
