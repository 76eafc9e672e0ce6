"""Newton's method for log φ, its linear steps solved by multigrid on a random walk.

    d_i φ_i = Σ_j w_ij φ_j   (`fields.stencil`; φ > 0, held on the goal)

Linear solvers lose the far field: φ spans thirty decades, and what counts is its *relative* accuracy in every voxel.
So solve for u = log φ instead, 0 = log(Σ_j w_ij φ_j / d_i φ_i) = ρ_i. Its Newton step δ, φ ← φ e^δ, solves

    δ_i = ρ_i + Σ_j p_ij δ_j,   p_ij = w_ij φ_j / Σ_k w_ik φ_k,   δ = 0 on the goal:

rows of p sum to one. It is a random walk that drifts to the goal (Doob's transform of the leaky one by φ), and δ_i the
residual that it meets on its way. Where the linear problem is about values that e-fold every voxel or two, this one is
about transport: its solution is smooth, and every quantity in it is of order one.

Cycle. The walk is lumped: blocks of 2 × 2 × 2 voxels become the states of a smaller walk, again with six neighbours,
and so on; each level relaxes, hands its residual down and takes the correction back, constant on a block. Then sweeps
φ_i ← φ_i + ω (Σ_j w_ij φ_j / d_i − φ_i) smooth, each with a weight ω of its own. Two choices make this converge in a
few cycles whatever the walls:

- Rows are averaged evenly in a block of free space, where the walk passes through, which keeps its drift; at walls and
  beside the goal weighted by φ, since there it lingers at the exit (an even average would hide a narrow exit from it).
- Lumping doubles diffusion, since jumps of two voxels count as one: the symmetric part of the lumped rates is halved
  again, but kept as large as the drift, so that no rate is negative.

Everything stays positive: walls one voxel thick, sealed pockets and dead ends need no care. Doors of one voxel in such
walls may stall the cycles on deep levels; `solve` then ends and says so.

Divisions stand last wherever a result has several uses: XLA on CPU computes a division once, but a sum or a product
anew for each use, six times over for six neighbours; an optimisation barrier does not keep it from that.
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

from maxjax.core.batching import settle
from maxjax.core.lowering import maximum, repeat
from maxjax.core.slabs import on_every_device
from maxjax.fields.stencil import Faces, Links, Operator, Volume, behind, cell, gather, inflow, neighbours

Mask = Bool[Array, "nx ny nz"]
Blocks = Float[Array, "mx my mz"]  # one number a block

# Weights of the sweeps after a correction, to damp what a block cannot see: (1 − 0.6 λ)² (1 − λ)² |1 − 1.7 λ| stays
# below 0.07 for 0.4 ≤ λ ≤ 1.9. Plain sweeps do not damp what alternates from voxel to voxel, λ = 2.
_SWEEPS = (0.6, 1.0, 1.7, 1.0, 0.6)
# Relaxations on the way down and up: on the first lumped level, and on the deeper ones, which cost little.
_RELAX, _RELAX_DEEP = 4, 10
# Levels are added until the longest axis has this many states: a few relaxations cross it.
_COARSEST = 16
# An axis of fewer states is not halved any more.
_THIN = 4
# Levels of no more states than these are relaxed by every device alone: to fetch a layer from a neighbour takes longer.
_SHARED = 2**20
# Cycles of every scene before the first look at whether it needs another one, for which the host waits for the device.
_BLIND = 3
# Cycles end when for so many of them the residual has not fallen below this share of the best.
_PATIENCE, _PROGRESS = 4, 0.8


# φ, cycles taken, the last change and the least one so far, cycles without progress.
State = tuple[Volume, Array, Array, Array, Array]
# Faces and diagonal of A, the goal's voxel, the coarser levels.
System = tuple[Faces, Volume, Mask, "tuple[_Level, ...]"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Solution:
    """What `solve` found.

    Attributes:
        phi: the iterate, positive on the component, zero elsewhere.
        cycles: cycles taken.
        residual: largest |ρ|, the relative change that one more sweep would make to a voxel.
        converged: whether it is at most the tolerance; False at the cap or once cycles make no progress.
    """

    phi: Volume
    cycles: Int32[Array, ""]
    residual: Float[Array, ""]
    converged: Bool[Array, ""]


def halvings(shape: Sequence[int]) -> tuple[int, int, int]:
    """How often each axis is halved: until the longest fits `_COARSEST`, at least once; thin axes less often."""
    levels = max(1, math.ceil(math.log2(max(shape) / _COARSEST)))
    nx, ny, nz = (min(levels, max(0, math.ceil(math.log2(n / (_THIN - 1))) - 1)) for n in shape)
    return nx, ny, nz


def padded(array: Array) -> Array:
    """Obstacles behind each axis, to a multiple of 2^`halvings`, so that every level consists of whole blocks."""
    counts = halvings(array.shape)
    return jnp.pad(array, [(0, -n % 2**count) for n, count in zip(array.shape, counts, strict=True)])


def guessed(phi: Volume) -> Solution:
    """A guess, before any cycle."""
    return Solution(phi, jnp.int32(0), jnp.asarray(jnp.inf, phi.dtype), jnp.array(False))


def begin(
    operator: Operator,
    phi: Volume,
    component: Mask,
    goal_index: Int32[Array, " 3"],
    *,
    tolerance: float,
    max_cycles: int,
) -> Solution:
    """The cycles that nearly every scene takes, whether it needs them or not; arguments as of `solve`."""
    state = _begun(_system(operator, component, goal_index), _state(guessed(phi)), max_cycles)
    return _solution(state, tolerance)


def solve(
    operator: Operator,
    begun: Solution,
    component: Mask,
    goal_index: Int32[Array, " 3"],
    *,
    tolerance: float,
    max_cycles: int,
    blind: bool = False,
) -> Solution:
    """Cycles until no sweep would change any voxel by more than `tolerance` of itself.

    Args:
        operator: A, on a `padded` grid.
        begun: φ and the cycles that it has had: positive on the component, zero elsewhere; its value on the goal is
            kept.
        component: the goal's component.
        goal_index: voxel of the goal.
        tolerance: largest |ρ|. Static.
        max_cycles: cap. Static.
        blind: on an accelerator, `begin` with cycles that nobody looks at. Static.
    """

    def going(system: System, state: State) -> Bool[Array, ""]:
        _, cycles, change, _, stalled = state
        return (cycles < max_cycles) & (change > tolerance) & (stalled < _PATIENCE)

    def blindly(system: System, state: State) -> State:
        return _begun(system, state, max_cycles)

    system, state = _system(operator, component, goal_index), _state(begun)
    if blind:
        state = lax.platform_dependent(system, state, cpu=lambda _, state: state, default=blindly)
    # Most scenes of a city take three or four cycles, few take many.
    return _solution(settle(going, _cycle, system, state, parts=16), tolerance)


def _begun(system: System, state: State, max_cycles: int) -> State:
    begun: State = lax.fori_loop(0, min(_BLIND, max_cycles), lambda _, state: _cycle(system, state), state)
    return begun


def _system(operator: Operator, component: Mask, goal_index: Int32[Array, " 3"]) -> System:
    faces, diagonal = operator.faces, jnp.where(operator.diagonal > 0, operator.diagonal, 1)
    return faces, diagonal, cell(component.shape, goal_index), _levels(faces, component, goal_index)


def _state(begun: Solution) -> State:
    return begun.phi, begun.cycles, begun.residual, begun.residual, jnp.int32(0)


def _solution(state: State, tolerance: float) -> Solution:
    phi, cycles, change, _, _ = state
    return Solution(phi, cycles, change, change <= tolerance)


def _cycle(system: System, state: State) -> State:
    """One correction, and sweeps."""
    faces, diagonal, goal, levels = system
    phi, cycles, _, best, stalled = state

    @jax.named_scope("sweep")
    def sweep(phi: Volume, weight: float) -> Volume:
        here = phi * diagonal
        # Weights above one may overshoot: what remains of φ stays positive.
        swept = jnp.maximum(weight * inflow(faces, phi) + (1 - weight) * here, here / 8)
        return jnp.where(goal, here, swept) / diagonal

    if levels:
        phi = phi / _spread(jnp.exp(-_correction(faces, diagonal, phi, levels)), levels[0].axes)
    for weight in _SWEEPS[:-1]:
        phi = lax.optimization_barrier(sweep(phi, weight))
    with jax.named_scope("change"):
        after = sweep(phi, 1.0)
        change = maximum(lambda after, phi: jnp.abs(after - phi) / jnp.where(phi > 0, phi, 1), after, phi)
        stalled = jnp.where(change < _PROGRESS * best, 0, stalled + 1)
        return phi + _SWEEPS[-1] * (after - phi), cycles + 1, change, jnp.minimum(change, best), stalled


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Level:
    """The blocks of one level.

    Attributes:
        axes: that are halved to get here. Static.
        even: whether the rows of a block are averaged evenly.
        goal: the block that holds the goal.
    """

    axes: tuple[int, ...] = dataclasses.field(metadata={"static": True})
    even: Mask
    goal: Mask


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Walk:
    """A walk between blocks.

    Attributes:
        rates: of leaving for each of the six neighbours.
        leaving: their sum; 1 where there are none.
    """

    rates: Links
    leaving: Volume


@jax.named_scope("lump")
def _levels(faces: Faces, component: Mask, goal_index: Int32[Array, " 3"]) -> tuple[_Level, ...]:
    """Which blocks are free space: all their voxels free and joined, away from the goal."""
    counts = halvings(component.shape)
    levels: list[_Level] = []
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
        levels.append(_Level(axes, whole, cell(whole.shape, index)))
    return tuple(levels)


@jax.named_scope("lump")
def _correction(faces: Faces, diagonal: Volume, phi: Volume, levels: tuple[_Level, ...]) -> Blocks:
    """δ on the blocks: the lumped walk's answer to the residual of φ."""
    around = neighbours(phi)
    total = inflow(faces, phi, around)
    known = (total > 0) & (phi > 0)
    residual = jnp.where(known, jnp.log(jnp.where(known, total, 1) / jnp.where(known, diagonal * phi, 1)), 0)
    axes = levels[0].axes
    # A row of rates w_ij φ_j sums to the inflow, about d_i φ_i: undivided, it is weighted by φ already.
    weight = 1 / jnp.where(_spread(levels[0].even, axes) & (total > 0), total, 1)
    rates = tuple(
        (weight * face * following, weight * behind(face, axis) * preceding)
        for axis, (face, (following, preceding)) in enumerate(zip(faces, around, strict=True))
    )
    walk, residual = _lump(rates, weight * total, weight * total * residual, axes)  # type: ignore[arg-type]
    return _relaxed(walk, residual, _blocks(phi, axes), levels, _RELAX)


@jax.named_scope("relax")
def _relaxed(walk: _Walk, residual: Volume, phi: Volume, levels: tuple[_Level, ...], times: int) -> Volume:
    """Solve leaving δ = residual + Σ rates δ, about, on the first of these levels: relax, correct from below, relax."""
    # Nothing leaves for the block of the goal: δ = 0 there.
    leaving = jnp.where(levels[0].goal, jnp.inf, walk.leaving)

    def relax(delta: Volume) -> Volume:
        return (gather(walk.rates, delta) + residual) / leaving

    delta = _repeat(relax, residual / leaving, times)
    if not levels[1:]:
        return delta
    below = levels[1]
    weight = jnp.where(_spread(below.even, below.axes), 1, phi) / walk.leaving
    rates = tuple((weight * forward, weight * backward) for forward, backward in walk.rates)
    left = weight * (gather(walk.rates, delta) + residual - walk.leaving * delta)
    coarse, left = _lump(rates, weight * walk.leaving, left, below.axes)  # type: ignore[arg-type]
    correction = _relaxed_deeper(coarse, left, _blocks(phi, below.axes), levels[1:])
    correction = jnp.where(levels[0].goal, 0, _spread(correction, below.axes))
    return _repeat(relax, delta + correction, times)


def _relaxed_deeper(walk: _Walk, residual: Volume, phi: Volume, levels: tuple[_Level, ...]) -> Volume:
    """`_relaxed` on a level that costs little; on a small one, by every device alone."""
    relaxed = functools.partial(_relaxed, times=_RELAX_DEEP)
    if residual.size > _SHARED:
        return relaxed(walk, residual, phi, levels)
    return on_every_device(relaxed, walk, residual, phi, levels)


def _repeat(step: Callable[[Volume], Volume], x: Volume, times: int) -> Volume:
    """`step` so many times; two a turn of the loop, which spares a copy."""
    (x,) = repeat(times // 2, lambda state: (step(step(state[0])),), (x,))
    return step(x) if times % 2 else x


def _lump(rates: Links, weight: Volume, residual: Volume, axes: tuple[int, ...]) -> tuple[_Walk, Blocks]:
    """The walk between blocks and its residual, as means over the rows of a block.

    Args:
        rates: rows of the walk, weighted.
        weight: of the rows.
        residual: of the rows, weighted.
        axes: that are halved. Static.
    """
    rows = _blocks(weight, axes)
    rows = jnp.where(rows > 0, rows, 1)
    lumped = []
    for axis, (forward, backward) in enumerate(rates):
        if axis in axes:
            others = tuple(other for other in axes if other != axis)
            leaving = _blocks(_half(forward, axis, 1), others), _blocks(_half(backward, axis, 0), others)
            lumped.append(_halve_diffusion(leaving[0] / rows, leaving[1] / rows))
        else:
            lumped.append((_blocks(forward, axes) / rows, _blocks(backward, axes) / rows))
    total = sum((forward + backward for forward, backward in lumped), start=jnp.zeros(()))
    return _Walk(tuple(lumped), jnp.where(total > 0, total, 1)), _blocks(residual, axes) / rows  # type: ignore[arg-type]


def _halve_diffusion(forward: Volume, backward: Volume) -> tuple[Volume, Volume]:
    """Half the symmetric part of the rates along an axis, though no less than the drift needs to keep both ≥ 0."""
    mean, drift = (forward + backward) / 2, (forward - backward) / 2
    wanted = jnp.where((forward > 0) & (backward > 0), jnp.maximum(mean / 2, jnp.abs(drift)), mean)
    return wanted + drift, wanted - drift


def _half(array: Array, axis: int, parity: int) -> Array:
    """Every other entry along an axis."""
    return jnp.asarray(lax.slice_in_dim(array, parity, None, 2, axis))


def _blocks(array: Volume, axes: tuple[int, ...]) -> Blocks:
    """Sums over blocks of two along `axes`."""
    for axis in axes:
        array = _half(array, axis, 0) + _half(array, axis, 1)
    return jnp.asarray(array)


def _spread(array: Array, axes: tuple[int, ...]) -> Array:
    """Each value to its block of two along `axes`."""
    for axis in axes:
        array = jnp.repeat(array, 2, axis)
    return array
