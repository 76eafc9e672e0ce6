"""A whole plan at 101³, stage by stage, and the solve beside SciPy's conjugate gradients.

    python -m benchmarks.plan

`plan` rows: seconds from map to verified path on random problems of the three maps (offline protocol, margin 8 m),
after a warm-up; compilation apart; A* on the same problems in the same run. `solve` rows: the same system A φ = q for
every method, assembled beforehand. SciPy solves it in float64 from φ = 0 and stops as soon as its gradient angles are
at least as good as ours (looking is not timed). SciPy's best is the goal's component alone, a third to a half of the
grid in a city; `whole grid` is the system as the paper solves it, and as ours does. Angles are against a float64
solution (CG to 1e-40 of the source, then sweeps), over the free voxels of the goal's component: share within 1° and
within 5°.

Expected on two CPU cores: a plan 0.3 to 0.5 s, the solve 0.25 to 0.45 s.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jaxtyping import Float
from scipy import ndimage
from scipy.sparse import csr_matrix, dia_array, diags_array
from scipy.sparse.linalg import LinearOperator, cg

import maxjax
from benchmarks.harness import RESULTS, Row, measure, save
from experiments.random_problems import Problem, problems
from maxjax.fields.gradient import gradient, log_potential
from maxjax.sim.scenes import MAPS
from maxjax.solvers.potential import DEGREE

_PEER_ITERATIONS = 3000
_PROBE = """
import resource, numpy as np, maxjax
occupied = np.zeros((101, 101, 101), bool)
occupied[40:60, 40:60, :80] = True
assert maxjax.plan(occupied, (-60, 0, 9), (60, 0, 9)).status == maxjax.Status.OK
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        maps: maps to take problems from.
        problems: problems a map for the `plan` rows.
        repeats: timed solves of ours a map for the `solve` rows.
        peer_repeats: timed solves of SciPy.
        peers: of the solve.
        margin: [m].
        seed: of the problems.
        out: where the JSON goes.
    """

    maps: tuple[str, ...] = MAPS
    problems: int = 10
    repeats: int = 10
    peer_repeats: int = 1
    peers: tuple[str, ...] = ("plain", "Jacobi", "Chebyshev", "whole grid, plain", "whole grid, Jacobi")
    margin: float = 8.0
    seed: int = 0
    out: Path = RESULTS


def main(config: Config) -> list[Row]:
    """Time plans, then solves; save and return the rows."""
    grid = maxjax.Grid()
    posed = {name: problems(name, config.problems, config.seed, grid) for name in config.maps}
    rows = _plan_rows(posed, grid, config)
    for name in config.maps:
        rows += _solve_rows(name, posed[name][0], grid, config)
    rows.append({"what": "peak memory of a process that plans once", "unit": "MB", "median": _peak_memory()})
    save("plan", config, rows, config.out)
    return rows


def _plan_rows(posed: dict[str, list[Problem]], grid: maxjax.Grid, config: Config) -> list[Row]:
    everything = [problem for some in posed.values() for problem in some]

    def run(problem: Problem, method: str) -> maxjax.Plan:
        return maxjax.plan(
            problem.occupied, problem.start, problem.goal, grid,
            margin=config.margin, ground=problem.ground, method=method,
        )  # fmt: skip

    rows: list[Row] = []
    for method in ("solver", "astar"):
        compile_s = run(everything[0], method).timings["compile"]
        plans = [run(problem, method) for problem in everything]
        for stage in [name for name in plans[0].timings if name != "compile"]:
            seconds = [plan.timings[stage] for plan in plans]
            row: dict[str, str | float | int | None] = {
                "what": f"plan, {method}: {stage}",
                "unit": "ms",
                "median": round(1e3 * statistics.median(seconds), 2),
                "min": round(1e3 * min(seconds), 2),
                "max": round(1e3 * max(seconds), 2),
                "n": len(seconds),
            }
            if stage == "total":
                row["compile_s"] = round(compile_s, 2)
                row["solved"] = sum(plan.status == maxjax.Status.OK for plan in plans)
            rows.append(row)
    return rows


def _solve_rows(name: str, problem: Problem, grid: maxjax.Grid, config: Config) -> list[Row]:
    plan = maxjax.plan(problem.occupied, problem.start, problem.goal, grid, margin=config.margin, ground=problem.ground)
    blocked = maxjax.dilate(jnp.asarray(problem.occupied), plan.margin, grid, jnp.asarray(problem.ground))
    goal = grid.index_of(jnp.asarray(problem.goal))
    sigma = maxjax.conductivity(blocked, goal, grid)
    solve = jax.jit(maxjax.solve_potential)
    timing = measure(lambda: solve(sigma, goal), config.repeats)
    ours = solve(sigma, goal)

    matrix, source, component = _system(np.asarray(sigma), np.asarray(goal), float(ours.screening_length))
    scale = diags_array(1 / np.sqrt(matrix.diagonal()))
    jacobi = csr_matrix(scale @ matrix @ scale)
    right = scale @ source

    def volume(phi: Float[np.ndarray, " n"], voxels: np.ndarray) -> Float[np.ndarray, "nx ny nz"]:
        full = np.zeros(grid.shape)
        full[voxels] = phi
        full[tuple(np.asarray(goal))] = 1.0
        return full

    exact = _reference(jacobi, right)
    reference = volume(scale @ exact, component)
    angles = functools.partial(_angles, reference, component)
    within = angles(np.asarray(ours.phi))
    rows: list[Row] = [
        {
            "what": f"solve, {name}: maxjax",
            "unit": "ms",
            "median": round(1e3 * timing.median_s, 1),
            "min": round(1e3 * timing.min_s, 1),
            "max": round(1e3 * timing.max_s, 1),
            "n": timing.n,
            "compile_s": round(timing.compile_s, 2),
            "iterations": int(ours.iterations),
            "certified": bool(ours.certified),
            "within_1deg": round(within[0], 5),
            "within_5deg": round(within[1], 5),
        }
    ]
    for label in config.peers:
        a, b, voxels = _system(np.asarray(sigma), np.asarray(goal), float(ours.screening_length), "whole" in label)
        root = diags_array(np.ones(len(b)) if "plain" in label else 1 / np.sqrt(a.diagonal()))
        scaled = csr_matrix(root @ a @ root)
        preconditioner = _chebyshev(a, scaled) if "Chebyshev" in label else None

        def judged(x: np.ndarray, root: dia_array = root, voxels: np.ndarray = voxels) -> tuple[float, float]:
            return angles(volume(root @ x, voxels))

        runs = [_until(judged, within, scaled, root @ b, preconditioner) for _ in range(config.peer_repeats)]
        seconds = [run[0] for run in runs]
        _, iterations, found = runs[0]
        median = statistics.median(seconds)
        rows.append(
            {
                "what": f"solve, {name}: SciPy CG, {label}",
                "unit": "ms",
                "median": round(1e3 * median, 1),
                "min": round(1e3 * min(seconds), 1),
                "max": round(1e3 * max(seconds), 1),
                "n": len(seconds),
                "iterations": iterations,
                "within_1deg": round(found[0], 5),
                "within_5deg": round(found[1], 5),
                "times_ours": round(median / timing.median_s, 1),
            }
        )
    return rows


class _GoodEnoughError(Exception):
    """Ends SciPy's iteration."""


def _until(
    angles: Callable[[np.ndarray], tuple[float, float]],
    enough: tuple[float, float],
    matrix: csr_matrix,
    right: np.ndarray,
    preconditioner: LinearOperator | None,
) -> tuple[float, int, tuple[float, float]]:
    """Run SciPy's CG until its angles are at least `enough`: (seconds without the looking, iterations, angles)."""
    every = 1 if preconditioner is not None else 10
    looked, count, found = 0.0, 0, (0.0, 0.0)
    begun = time.perf_counter()

    def look(x: np.ndarray) -> None:
        nonlocal looked, count, found
        count += 1
        if count % every == 0:
            paused = time.perf_counter()
            found = angles(x)
            looked += time.perf_counter() - paused
            if found[0] >= enough[0] - 1e-5 and found[1] >= enough[1] - 1e-5:
                raise _GoodEnoughError

    with contextlib.suppress(_GoodEnoughError):
        cg(matrix, right, rtol=1e-300, atol=0.0, maxiter=_PEER_ITERATIONS, M=preconditioner, callback=look)
    return time.perf_counter() - begun - looked, count, found


def _system(
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


def _reference(matrix: csr_matrix, right: np.ndarray) -> np.ndarray:
    """The solution of the unit-diagonal system in float64: CG, then positive sweeps for what rounding left."""
    x, _ = cg(matrix, right, rtol=1e-40, atol=0.0, maxiter=3000)
    x = np.maximum(x, 0)
    for _ in range(50):
        x = right + x - matrix @ x
    return np.asarray(x)


def _chebyshev(matrix: csr_matrix, scaled: csr_matrix, degree: int = DEGREE) -> LinearOperator:
    """The same polynomial as ours, as a SciPy preconditioner of the scaled matrix."""
    off = csr_matrix(diags_array(np.ones(matrix.shape[0])) - scaled)
    diagonal = matrix.diagonal()
    radius = min(float(np.max((diagonal - matrix @ np.ones(len(diagonal))) / diagonal)), 1 - 1 / degree**2)

    def apply(r: np.ndarray) -> np.ndarray:
        before, z, omega = np.zeros_like(r), r, 2.0
        for _ in range(degree - 1):
            omega = 1 / (1 - radius**2 * omega / 4)
            before, z = z, before + omega * (off @ z + r - before)
        return z

    return LinearOperator(matrix.shape, matvec=apply, dtype=np.float64)


def _angles(reference: np.ndarray, component: np.ndarray, phi: np.ndarray) -> tuple[float, float]:
    """Share of the component's voxels whose gradient of log φ lies within 1° and 5° of the reference's."""
    free = jnp.asarray(component)
    with jax.enable_x64(True):
        a, b = (
            np.asarray(gradient(log_potential(jnp.asarray(np.maximum(field, 0), jnp.float64)), free))[component]
            for field in (reference, phi)
        )
    size = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    known = np.linalg.norm(a, axis=1) > 1e-6
    cosine = np.where(size > 0, np.sum(a * b, axis=1) / np.where(size > 0, size, 1), -1)[known]
    return float(np.mean(cosine >= np.cos(np.radians(1)))), float(np.mean(cosine >= np.cos(np.radians(5))))


def _peak_memory() -> float:
    """Largest resident set of a fresh process that plans once, imports and compilation included [MB]."""
    here = {**os.environ, "JAX_PLATFORMS": os.environ.get("JAX_PLATFORMS", "cpu")}
    done = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, text=True, check=True, env=here)
    return round(int(done.stdout.split()[-1]) / 1024, 1)


if __name__ == "__main__":
    main(tyro.cli(Config))
