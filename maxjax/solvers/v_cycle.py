"""A multigrid V-cycle: the symmetric positive definite preconditioner of the Jacobi-scaled system.

    (I − G) y = b,  G = D^-1/2 W D^-1/2:      M⁻¹ = S (2 − (I − G) S) + (1 − S (I − G)) P M_c⁻¹ Pᵀ (1 − (I − G) S)

S is one polynomial in G before and after the coarse correction, P spreads a coarse value over its aggregate of 2 × 2 ×
2 voxels (in unscaled φ), and Pᵀ sums the aggregate. Coarse coefficients are again conductances of a 7-point operator,
chosen together with these transfers: a coarse face takes *half* the sum of its four fine faces, because current flows
twice as far between coarse centres (a quarter of the area each, so that the sum alone is what P would give, twice too
stiff); so does the grounding of an outer face, half a voxel away. A leak, or the coupling to a held voxel, is summed as
it is. Walls stay walls: a coarse face conducts only where fine faces do. A wall that ends up inside an aggregate joins
both its sides in the coarse value; that costs CG iterations, never correctness.

Positive by construction, whatever the coarse operator is: the spectrum of I − G lies in [0, 2] (its rows sum to at most
2), S leaves |1 − λ S(λ)| < 1 on (0, 2], so the first term is positive definite, and the second is semidefinite when
M_c⁻¹ is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from maxjax.fields import stencil
from maxjax.fields.stencil import Faces, Volume

# A volume of whatever shape: for functions whose result has another shape than their argument.
AnyVolume = Float[Array, "_ _ _"]

# S = a + b G, so that 1 − λ S(λ) = 1 − (a + b) λ + b λ²: the polynomial of degree 2 that is best for V-cycles on (0, 2]
# (fourth-kind Chebyshev with optimised weights: Lottes, "Optimal polynomial smoothers for multigrid V-cycles", 2023).
# Its modulus is at most 0.39 on [0.34, 2].
_OWN, _NEIGHBOURS = 1.356763, 1.011271
# Grids of up to so many voxels (4³) are inverted once; at 8³ the inverse takes longer than the whole of CG at 51³.
_COARSEST = 64


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Level:
    """One grid.

    Attributes:
        faces: of G on this grid, as `stencil.normalize` gives them.
        root: D^1/2 on the voxels that exchange corrections with the coarser grid, else 0.
    """

    faces: Faces
    root: Volume


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Hierarchy:
    """Every grid, finest first, and the last one's inverse.

    Attributes:
        levels: from the given grid down to one of at most 64 voxels; each has half the voxels along every axis,
            rounded up.
        inverse: (I − G)⁻¹ of the last level, over its ravelled voxels.
    """

    levels: tuple[Level, ...]
    inverse: Float[Array, "n n"]


def hierarchy(operator: stencil.Operator, component: Bool[Array, "nx ny nz"]) -> Hierarchy:
    """Coarsen an operator; a few passes over the grid.

    Args:
        operator: A, with φ held or a leak or grounded outer faces somewhere in `component`.
        component: the voxels to correct from coarser grids: a union of components of the free voxels, that of the goal.
            Others (sealed pockets, where A may be singular) are smoothed only.
    """
    free = component & (operator.diagonal > 0)
    # A held voxel has no faces left: its unit diagonal must not weigh on its aggregate.
    free = free & (stencil.inflow(operator.faces, jnp.ones_like(operator.diagonal)) > 0)
    faces, diagonal = operator.faces, operator.diagonal
    ground = jnp.where(free, _ground(operator), 0)
    levels = []
    while True:
        faces_of_g, scale = stencil.normalize(stencil.Operator(faces, diagonal))
        root = jnp.where(free, diagonal * scale, 0)
        levels.append(Level(faces_of_g, root))
        if diagonal.size <= _COARSEST:
            return Hierarchy(tuple(levels), _inverse(levels[-1].faces))
        inside = free.astype(diagonal.dtype)
        faces = tuple(_coarse_face(face * inside, axis) for axis, face in enumerate(faces))  # type: ignore[assignment]
        ground = _sum_aggregates(ground * _outer_factor(ground.shape, ground.dtype))
        diagonal = ground + sum(face + stencil.behind(face, axis) for axis, face in enumerate(faces))
        free = diagonal > 0


def v_cycle(grids: Hierarchy) -> Callable[[Volume], Volume]:
    """The preconditioner r ↦ M⁻¹ r of (I − G) y = b on the finest level: linear, symmetric positive definite.

    One cycle applies G four times on every level but the last.
    """

    def cycle(depth: int, r: Volume) -> Volume:
        level = grids.levels[depth]
        if depth == len(grids.levels) - 1:
            return jnp.matmul(grids.inverse, r.ravel(), precision=lax.Precision.HIGHEST).reshape(r.shape)
        y, left = _twice(level.faces, r, jnp.zeros_like(r), r, (_OWN, -1.0), (_NEIGHBOURS, 1.0))
        below = _reciprocal(grids.levels[depth + 1].root)
        coarse = cycle(depth + 1, below * _sum_aggregates(level.root * left))
        y = y + level.root * _spread(below * coarse, r.shape)
        return _twice(level.faces, y, r, y, (-1.0, _OWN), (1.0, _NEIGHBOURS))[1]

    return lambda r: cycle(0, r)


def _twice(
    faces: Faces, v: Volume, first: Volume, second: Volume, own: tuple[float, float], neighbours: tuple[float, float]
) -> tuple[Volume, Volume]:
    """The two applications of G in a smoothing step: u = first + own₀ v + neighbours₀ G v, then the same of u.

    Before the coarse correction u = S r and then its residual; after it, the residual and then y + S of that. A loop:
    in straight-line code XLA recomputes u for each voxel that G reads (docs/performance.md).
    """
    a, b = jnp.asarray(own, v.dtype), jnp.asarray(neighbours, v.dtype)

    def step(k: Array, state: tuple[Volume, Volume]) -> tuple[Volume, Volume]:
        _, v = state
        return v, jnp.where(k == 0, first, second) + a[k] * v + b[k] * stencil.inflow(faces, v)

    before, after = lax.fori_loop(0, 2, step, (v, v))
    return before, after


def _ground(operator: stencil.Operator) -> Volume:
    """Rest of the diagonal beyond the faces: leak, grounded faces, held neighbours; rounding is taken for none."""
    faces = sum(face + stencil.behind(face, axis) for axis, face in enumerate(operator.faces))
    beyond = operator.diagonal - faces
    return jnp.where(beyond > 8 * np.finfo(beyond.dtype).eps * operator.diagonal, beyond, 0)


def _outer_factor(shape: tuple[int, ...], dtype: jnp.dtype) -> Volume:
    """1/2 on the outermost voxels, whose grounded face is twice as far from the coarse centre, else 1."""
    outer = jnp.zeros(shape, bool)
    for axis, size in enumerate(shape):
        position = lax.broadcasted_iota(jnp.int32, shape, axis)
        outer = outer | (position == 0) | (position == size - 1)
    return jnp.where(outer, 0.5, 1).astype(dtype)


def _coarse_face(face: AnyVolume, axis: int) -> AnyVolume:
    """Half the sum of the four fine faces between two aggregates: those after each odd voxel along `axis`."""
    coarse = 0.5 * lax.slice_in_dim(_even(face, axis), 1, None, 2, axis)
    for across in range(3):
        if across != axis:
            coarse = _sum_pairs(coarse, across)
    return coarse


def _even(array: AnyVolume, axis: int) -> AnyVolume:
    """Pad an odd axis with one layer of zeros: a wall."""
    config = [(0, 0, 0)] * 3
    config[axis] = (0, array.shape[axis] % 2, 0)
    return lax.pad(array, jnp.zeros((), array.dtype), config)


def _sum_pairs(array: AnyVolume, axis: int) -> AnyVolume:
    array = _even(array, axis)
    # Slices, not a reduction over an axis of two: XLA's CPU reductions over short axes are slow.
    first, second = (lax.slice_in_dim(array, start, None, 2, axis) for start in (0, 1))
    return jnp.asarray(first + second)


def _sum_aggregates(array: AnyVolume) -> AnyVolume:
    """Sum over aggregates of 2 × 2 × 2 voxels."""
    for axis in range(3):
        array = _sum_pairs(array, axis)
    return array


def _spread(coarse: AnyVolume, shape: tuple[int, ...]) -> AnyVolume:
    """Each coarse value on all voxels of its aggregate; the transpose of `_sum_aggregates`."""
    for axis in (2, 1, 0):
        coarse = jnp.stack([coarse, coarse], axis + 1)
        sizes = list(coarse.shape)
        sizes[axis : axis + 2] = [2 * sizes[axis]]
        coarse = lax.slice_in_dim(coarse.reshape(sizes), 0, shape[axis], axis=axis)
    return coarse


def _reciprocal(root: AnyVolume) -> AnyVolume:
    return jnp.where(root > 0, 1 / jnp.where(root > 0, root, 1), 0)


def _inverse(faces: Faces) -> Float[Array, "n n"]:
    """(I − G)⁻¹ by Cholesky, symmetric; a shift by rounding's size keeps it finite where nothing grounds the grid."""
    shape = faces[0].shape
    size = faces[0].size
    columns = jnp.eye(size, dtype=faces[0].dtype)
    shift = 1 + 32 * np.finfo(columns.dtype).eps
    matrix = shift * columns - jax.vmap(lambda e: stencil.inflow(faces, e.reshape(shape)).ravel())(columns)
    inverse = jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(matrix), True), columns)
    return (inverse + inverse.T) / 2
