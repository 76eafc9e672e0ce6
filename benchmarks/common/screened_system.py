"""The screened system, built and solved without maxjax, and how well a field's directions agree with its solution.

    A φ = q        A = div-form 7-point stencil of sigma plus sigma/ℓ², φ = 1 held at the goal

SciPy's sparse matrices in float64. Norms say little about a field that spans many decades; what is climbed is the
direction of its gradient, so peers are compared by angles.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from importlib import import_module
from importlib.util import find_spec

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.sparse import csr_matrix, dia_array, diags_array
from scipy.sparse.linalg import cg

from maxjax.fields.gradient import gradient, log_potential

Volume = Float[np.ndarray, "nx ny nz"]
Mask = Bool[np.ndarray, "nx ny nz"]
# φ ↦ shares of the component within 1° and within 5°.
Angles = Callable[[Volume], tuple[float, float]]


def system(
    sigma: np.ndarray, goal: np.ndarray, length: float, whole: bool = False
) -> tuple[csr_matrix, Float[np.ndarray, " n"], np.ndarray]:
    """The screened system, goal held at 1, built without maxjax: (A, q, voxels).

    On the goal's component; or on the whole grid, obstacles with a unit diagonal, as the paper solves it.
    """
    sigma = sigma.astype(np.float64)
    labels, _ = ndimage.label(sigma > 0)
    component = np.full(sigma.shape, True) if whole else labels == labels[tuple(goal)]
    component[tuple(goal)] = False
    number = np.full(sigma.shape, -1)
    number[component] = np.arange(component.sum())
    diagonal = np.where(sigma > 0, sigma / length**2, 1.0)[component]
    source = np.zeros(len(diagonal))
    entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    for axis in range(3):
        low = [slice(None)] * 3
        high = [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        a, b = sigma[tuple(low)], sigma[tuple(high)]
        face = np.where(a + b > 0, 2 * a * b / np.where(a + b > 0, a + b, 1), 0)
        i, j = number[tuple(low)], number[tuple(high)]
        joined = (face > 0) & (i >= 0) & (j >= 0)
        entries += [(i[joined], j[joined], -face[joined]), (j[joined], i[joined], -face[joined])]
        for k in (i, j):
            own = (k >= 0) & (face > 0)
            np.add.at(diagonal, k[own], face[own])
        at_goal = np.zeros(sigma.shape, bool)
        at_goal[tuple(goal)] = True
        for k, other in ((i, high), (j, low)):
            beside = (k >= 0) & at_goal[tuple(other)]
            np.add.at(source, k[beside], face[beside])
    n = np.arange(len(diagonal))
    rows, columns, values = (np.concatenate(parts) for parts in zip(*entries, (n, n, diagonal), strict=True))
    return csr_matrix((values, (rows, columns))), source, component


def unit_diagonal(a: csr_matrix, b: np.ndarray) -> tuple[dia_array, csr_matrix, np.ndarray]:
    """Jacobi's preconditioning done once: (S, S A S, S b) with S = D^-1/2; the solution of A is S times its own."""
    scale = diags_array(1 / np.sqrt(a.diagonal()))
    return scale, csr_matrix(scale @ a @ scale), scale @ b


def reference_of(matrix: csr_matrix, right: np.ndarray) -> np.ndarray:
    """The solution of the unit-diagonal system in float64: CG, then positive sweeps for what rounding left."""
    x, _ = cg(matrix, right, rtol=1e-40, atol=0.0, maxiter=3000)
    x = np.maximum(x, 0)
    for _ in range(50):
        x = right + x - matrix @ x
    return np.asarray(x)


def angles_of(reference: Volume, component: Mask) -> Angles:
    """Shares of the component whose gradient of log φ lies within 1° and 5° of the reference's."""

    def slope(phi: Array, free: Array) -> Array:
        g = gradient(log_potential(jnp.maximum(phi, 0)), free)
        size = jnp.linalg.norm(g, axis=-1, keepdims=True)
        return g * jnp.where(size > 1e-6, 1 / jnp.where(size > 0, size, 1), 0)

    @jax.jit
    def shares(phi: Array, exact: Array, free: Array) -> Array:
        known = free & jnp.any(exact != 0, axis=-1)
        cosine = jnp.sum(slope(phi, free) * exact, axis=-1)
        counts = [jnp.sum(known & (cosine >= np.cos(np.radians(degrees)))) for degrees in (1, 5)]
        return jnp.stack([*counts, jnp.sum(known)])

    free = jnp.asarray(component)
    with jax.enable_x64(True):
        exact = jax.jit(slope)(jnp.asarray(reference, jnp.float64), free)

    def angles(phi: Volume) -> tuple[float, float]:
        with jax.enable_x64(True):
            one, five, all_known = map(int, shares(jnp.asarray(phi, jnp.float64), exact, free))
        return one / max(all_known, 1), five / max(all_known, 1)

    return angles


@contextlib.contextmanager
def blas_threads(count: int | None) -> Iterator[None]:
    """Threads of NumPy's BLAS; None leaves them as they are."""
    control = None if find_spec("threadpoolctl") is None else import_module("threadpoolctl")
    with contextlib.nullcontext() if control is None else control.threadpool_limits(count):
        yield
