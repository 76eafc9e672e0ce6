"""Linear solvers of the screened system beside ours: the peers of the `solve` rows of `benchmarks.potential`.

    A φ = q        stopped, with hindsight, when φ's directions are as good as ours

All but the JAX one are handed the assembled matrix. SciPy, PyAMG and CuPy run in float64; JAX's Jacobi-PCG in float32,
with the residual kept at unit length, without which it would underflow.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import inspect
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int32
from scipy.sparse import csr_matrix, dia_array, diags_array
from scipy.sparse.linalg import LinearOperator, cg

import maxjax
from benchmarks.common.harness import Row, Timing, left_out, measure, package, timed_row, timing_of
from benchmarks.common.screened_system import (
    Angles,
    Mask,
    Volume,
    angles_of,
    blas_threads,
    reference_of,
    system,
    unit_diagonal,
)
from maxjax.fields import stencil

# A preconditioner set up anew, or none.
Prepare = Callable[[], LinearOperator | None]
# Shares of the component within 1° and 5°.
Shares = tuple[float, float]

_MOST_ITERATIONS = 2048
_STALLED = 20  # looks without any progress before a peer is taken at its best
_SLACK = 1e-5


@dataclasses.dataclass(frozen=True)
class System:
    """A linear system of a scene, as SciPy takes it.

    Attributes:
        peer: who is to solve it.
        matrix, source: A and q.
        scale: what its solution is multiplied by to give φ.
        voxels: those that are its unknowns.
    """

    peer: str
    matrix: csr_matrix
    source: Float[np.ndarray, " n"]
    scale: dia_array
    voxels: Mask


@dataclasses.dataclass(frozen=True)
class Target:
    """What the peers of a scene have to reach.

    Attributes:
        scene: its name.
        sigma: conductivity.
        goal: its voxel.
        length: screening length that ours used [voxels].
        angles: shares of the component whose directions agree with a float64 solution.
        enough: the shares of ours.
        ours: the timing of ours.
    """

    scene: str
    sigma: Float[Array, "nx ny nz"]
    goal: Int32[Array, " 3"]
    length: float
    angles: Angles
    enough: Shares
    ours: Timing

    def row(self, peer: str, spent: Timing, iterations: int, found: Shares) -> dict[str, Any]:
        """The row of a peer."""
        print(f"  {peer}: {spent.median_s:.3f} s", file=sys.stderr, flush=True)
        ratio = {"times_ours": round(spent.median_s / self.ours.median_s, 2)}
        what = f"solve, {self.scene}: {peer}"
        return timed_row(what, spent, iterations=iterations) | reached(found, self.enough) | ratio

    def volume(self, phi: Float[np.ndarray, " n"], voxels: Mask) -> Volume:
        """The field of a system's solution, 1 at the goal."""
        full = np.zeros(voxels.shape)
        full[voxels] = phi
        full[tuple(np.asarray(self.goal))] = 1.0
        return full


def rows_of(
    scene: str,
    sigma: Float[Array, "nx ny nz"],
    goal: Int32[Array, " 3"],
    ours: maxjax.Potential,
    timing: Timing,
    repeats: tuple[int, int],
) -> tuple[Shares, Mask, list[Row]]:
    """The rows of every peer, with the shares that ours reaches and the goal's component.

    Args:
        scene: its name.
        sigma: conductivity.
        goal: its voxel.
        ours: the potential by maxjax.
        timing: its run time.
        repeats: timed calls of programs on the device, and of peers on the host.
    """
    length = float(ours.screening_length)
    assembled = functools.partial(system, np.asarray(sigma), np.asarray(goal), length)
    matrix, source, component = assembled()
    scale, scaled, right = unit_diagonal(matrix, source)
    with blas_threads(1):
        exact = scale @ reference_of(scaled, right)
    target = Target(scene, sigma, goal, length, lambda _: (0.0, 0.0), (0.0, 0.0), timing)
    angles = angles_of(target.volume(exact, component), component)
    target = dataclasses.replace(target, angles=angles, enough=angles(np.asarray(ours.phi)))

    whole, whole_source, everywhere = assembled(whole=True)
    whole_scale, whole_scaled, whole_right = unit_diagonal(whole, whole_source)
    one = diags_array(np.ones(len(whole_source)))
    jacobi = System("SciPy CG, Jacobi, component", scaled, right, scale, component)
    rows: list[Row] = [
        _scipy_row(target, jacobi, repeats[1]),
        _scipy_row(
            target,
            System("SciPy CG, Jacobi, whole grid", whole_scaled, whole_right, whole_scale, everywhere),
            repeats[1],
        ),
        _scipy_row(target, System("SciPy CG, whole grid", whole, whole_source, one, everywhere), repeats[1]),
        _pyamg_row(target, matrix, source, component, repeats[1]),
        _jax_row(target, repeats[0]),
        _cupy_row(target, dataclasses.replace(jacobi, peer="CuPy CG, Jacobi, component"), repeats[1]),
    ]
    return target.enough, component, rows


def reached(found: Shares, enough: Shares) -> dict[str, Any]:
    """Cells on the shares that a solver reaches, and whether they suffice."""
    good = all(a >= b - _SLACK for a, b in zip(found, enough, strict=True))
    return {"within_1deg": round(found[0], 5), "within_5deg": round(found[1], 5), "as_good": good}


def _scipy_row(target: Target, linear: System, repeats: int, prepare: Prepare = lambda: None) -> Row:
    def judged(x: np.ndarray) -> Shares:
        return target.angles(target.volume(linear.scale @ x, linear.voxels))

    count, found = hindsight(judged, target.enough, linear.matrix, linear.source, prepare)
    spent, more = _conjugate_gradients(linear, count, prepare, repeats)
    return target.row(linear.peer, spent, count, found) | more


def _pyamg_row(target: Target, matrix: csr_matrix, source: np.ndarray, component: Mask, repeats: int) -> Row:
    pyamg = package("pyamg")
    if pyamg is None:
        return left_out(f"solve, {target.scene}: PyAMG", "not installed")

    def hierarchy() -> LinearOperator:
        levels = pyamg.smoothed_aggregation_solver(matrix, improve_candidates=None)
        cycle: LinearOperator = levels.aspreconditioner(cycle="V")
        return cycle

    one = diags_array(np.ones(len(source)))
    linear = System("PyAMG smoothed aggregation + CG, component", matrix, source, one, component)
    return _scipy_row(target, linear, repeats, hierarchy)


def _jax_row(target: Target, repeats: int) -> Row:
    def solve(count: int) -> Array:
        return jnp.asarray(_jacobi_pcg(target.sigma, target.goal, jnp.float32(target.length), jnp.int32(count)))

    count = least(lambda k: target.angles(np.asarray(solve(k))), target.enough)
    spent = measure(lambda: solve(count), repeats)
    return target.row("JAX, Jacobi-PCG, whole grid", spent, count, target.angles(np.asarray(solve(count))))


class _EnoughError(Exception):
    """Ends SciPy's iteration."""


def hindsight(
    angles: Callable[[np.ndarray], Shares],
    enough: Shares,
    a: csr_matrix,
    b: np.ndarray,
    prepare: Prepare,
) -> tuple[int, Shares]:
    """The iterations that SciPy's CG needs: until its angles are good enough, or the best before they stall."""
    preconditioner = prepare()
    every = 10 if preconditioner is None else 1
    count, best, found = 0, 0, (-1.0, -1.0)

    def look(x: np.ndarray) -> None:
        nonlocal count, best, found
        count += 1
        if count % every == 0:
            now = angles(x)
            if now > found:
                best, found = count, now
            if reached(now, enough)["as_good"] or count - best >= _STALLED * every:
                raise _EnoughError

    # A stalled iteration may divide by what has underflowed.
    with contextlib.suppress(_EnoughError), np.errstate(all="ignore"), blas_threads(1):
        cg(a, b, rtol=1e-300, atol=0.0, maxiter=_MOST_ITERATIONS, M=preconditioner, callback=look)
    return best, found


def least(angles: Callable[[int], Shares], enough: Shares) -> int:
    """The fewest iterations whose angles are good enough, by bisection; the cap where none are."""

    def good(count: int) -> bool:
        return bool(reached(angles(count), enough)["as_good"])

    high = 16
    while not good(high):
        if high == _MOST_ITERATIONS:
            return high
        high *= 2
    low = high // 2 if high > 16 else 0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if good(middle) else (middle, high)
    return high


def _conjugate_gradients(linear: System, count: int, prepare: Prepare, repeats: int) -> tuple[Timing, dict[str, Any]]:
    """Time SciPy's CG, set-up included: (timing, what else is known of it).

    Threads help BLAS on an idle machine and ruin it on a busy one, so both are tried and the faster counts.
    """
    tried: list[tuple[Timing, dict[str, Any]]] = []
    for threads in (1, None):
        setups, solves = [], []
        with blas_threads(threads):
            for _ in range(repeats):
                start = time.perf_counter()
                preconditioner = prepare()
                ready = time.perf_counter()
                cg(linear.matrix, linear.source, rtol=1e-300, atol=0.0, maxiter=count, M=preconditioner)
                setups.append(ready - start)
                solves.append(time.perf_counter() - ready)
        more: dict[str, Any] = {"blas_threads": threads or "all"}
        if preconditioner is not None:
            more["setup_ms"] = round(1e3 * statistics.median(setups), 1)
            more["solve_ms"] = round(1e3 * statistics.median(solves), 1)
        tried.append((timing_of([x + y for x, y in zip(setups, solves, strict=True)]), more))
    return min(tried, key=lambda found: found[0].median_s)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _PcgCarry:
    """Loop carry: iterate, residual of unit length, its size before, direction of search."""

    x: Float[Array, "nx ny nz"]
    residual: Float[Array, "nx ny nz"]
    size: Float[Array, ""]
    direction: Float[Array, "nx ny nz"]


@jax.jit
def _jacobi_pcg(
    sigma: Float[Array, "nx ny nz"], goal: Int32[Array, " 3"], length: Float[Array, ""], count: Int32[Array, ""]
) -> Float[Array, "nx ny nz"]:
    """Textbook Jacobi-PCG with our stencil, assembly included.

    The residual is kept at unit length and its size ρ beside it, or |r|² would leave float32 long before the far voxels
    are right.
    """
    held = jnp.zeros_like(sigma).at[goal[0], goal[1], goal[2]].set(1)
    operator, source = stencil.hold(stencil.assemble(sigma, 1 / length**2), held)
    faces, scale = stencil.normalize(operator)
    b = scale * source

    def step(_: Array, at: _PcgCarry) -> _PcgCarry:
        x, r, rho, p = at.x, at.residual, at.size, at.direction
        q = p - stencil.inflow(faces, p)
        curvature = jnp.sum(p * q)
        alpha = jnp.where(curvature > 0, 1 / jnp.where(curvature > 0, curvature, 1), 0)
        x = x + (rho * alpha) * p
        r = r - alpha * q
        shrink = jnp.sqrt(jnp.sum(r * r))
        r = r / jnp.where(shrink > 0, shrink, 1)
        return _PcgCarry(x, r, rho * shrink, r + shrink * p)

    size = jnp.sqrt(jnp.sum(b * b))
    r = b / size
    last: _PcgCarry = lax.fori_loop(0, count, step, _PcgCarry(jnp.zeros_like(b), r, size, r))
    return jnp.asarray(scale * last.x)


def _cupy_row(target: Target, linear: System, repeats: int) -> Row:
    """CuPy's CG on the Jacobi-scaled system of the component, in float64 on the GPU."""
    cupy, sparse, linalg = (package(part) for part in ("cupy", "cupyx.scipy.sparse", "cupyx.scipy.sparse.linalg"))
    if jax.default_backend() != "gpu" or cupy is None or sparse is None or linalg is None:
        return left_out(f"solve, {target.scene}: {linear.peer}", "needs a CUDA device and cupy")
    a, b = sparse.csr_matrix(linear.matrix), cupy.asarray(linear.source)
    # Its tolerance was renamed between versions.
    tolerance = "rtol" if "rtol" in inspect.signature(linalg.cg).parameters else "tol"

    def solve(count: int) -> Any:
        x, _ = linalg.cg(a, b, maxiter=count, **{tolerance: 1e-300})
        cupy.cuda.Device().synchronize()
        return x

    def judged(count: int) -> Shares:
        return target.angles(target.volume(linear.scale @ cupy.asnumpy(solve(count)), linear.voxels))

    count = least(judged, target.enough)
    return target.row(linear.peer, measure(lambda: solve(count), repeats), count, judged(count))
