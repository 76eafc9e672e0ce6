"""The solver beside its peers: linear solvers, travel-time fields, sizes, batches.

    python -m benchmarks.potential [--json]                                            # two CPU cores: 10 to 15 minutes
    python -m benchmarks.potential --sizes 51 101 201 301 401 --batches 1 8 64 256     # one GPU
    python -m benchmarks.potential --shape 51 51 51 --sizes 51 --batches 1             # a quick look

`copy` row: bandwidth of reading and writing one large array. It sets the *floor*, reading sigma and writing φ once.

`solve` rows: sigma → certified φ, problem 0 of each map and a window of a Warframe maze. Linear peers solve
A φ = q at the screening length that ours used; all but the JAX one are handed the assembled matrix, so they are spared
what ours does too: connectivity, assembly, certificate. Each is stopped, with hindsight, as soon as its angles are as
good as ours (within 1° and within 5° of a float64 solution, over the goal's component); then as many iterations are
timed without looking, with one BLAS thread and with all, and the faster counts. `as_good` is false where a peer never
got there; it is then taken at its best. SciPy, PyAMG and CuPy run in float64, JAX's Jacobi-PCG in float32 with the
residual kept at unit length, without which it would underflow. `component` is the free voxels of the goal's component
alone; `whole grid` is the system as the paper solves it, obstacles included.

`field` rows: travel times from the goal by fast marching, second order, the other fields without local minima, and ours
once more. Each field is climbed from the same starts by the same ascent, tightened and verified (travel time T as
φ = exp(−T / scale)), so that only the field differs: `ascent_m` is the length before tightening, `length_m` after it,
means over the starts from which every field arrived; clearance is to occupied voxels. eikonalfm knows no obstacles:
they get a speed of 10⁻⁶. It offers fast marching plain and factored, no fast sweeping.

`size` rows: the same downtown, 200 m wide, on ever finer voxels (4 m at 51³, 2 m at 101³, 1 m at 201³). Peak memory is
that of one solve in a fresh process, sigma and φ included, in float32 arrays of the grid: growth of the resident set on
CPU (the program's code and heap with it, which shows on small grids), the device's own peak on a GPU. `xla_arrays` is
what the compiled program reserves for temporaries. `batch` rows: `vmap` over scenes, time a scene.

Expected on two CPU cores at 101³: see results/potential.json; every peer that is a linear solver slower than ours.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib
import inspect
import io
import itertools
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jax import lax
from jaxtyping import Array, Float, Int32
from scipy import ndimage
from scipy.sparse import csr_matrix, dia_array, diags_array
from scipy.sparse.linalg import LinearOperator, cg

import maxjax
from benchmarks.common.harness import RESULTS, Row, Timing, keep, measure, save, show
from benchmarks.common.problems import problems
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
from maxjax.fields.certificate import uncertified
from maxjax.planning.ascent import Ascent
from maxjax.planning.planner import Route, Stopwatch, climb, judge
from maxjax.planning.problem import Problem, pose
from maxjax.planning.string_pulling import tighten
from maxjax.worlds.scenes import MAPS, make_scene, occupancy

# A preconditioner set up anew, or none.
Prepare = Callable[[], LinearOperator | None]

_MOST_ITERATIONS = 2048
_STALLED = 20  # looks without any progress before a peer is taken at its best
_SLACK = 1e-5
_WIDTH = 200.0  # of the city in the `size` rows [m]
_COPIED = 2**26  # numbers; far beyond any cache
_IN_WALLS = 1e-6  # speed in obstacles, for a method that knows none
_DECADES = 30.0  # that exp(-T / scale) spans

_solve = jax.jit(maxjax.solve_potential)
_pose = jax.jit(pose, static_argnames=("margin", "grid"))
_climb = jax.jit(climb, static_argnames="settings")
_tighten = jax.jit(tighten)

_PROBE = """
import json, sys
import jax, jax.numpy as jnp, numpy as np
import maxjax

def resident(key):
    with open("/proc/self/status") as lines:
        return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(key))

with np.load(sys.argv[1]) as given:
    sigma, goal = jnp.asarray(given["sigma"]), jnp.asarray(given["goal"])
solve = jax.jit(maxjax.solve_potential).lower(sigma, goal).compile()
stats = jax.devices()[0].memory_stats()
if stats is None:
    with open("/proc/self/clear_refs", "w") as reset:
        reset.write("5")  # the peak so far was the compiler's
    before = resident("VmRSS")
jax.block_until_ready(solve(sigma, goal))
peak = sigma.nbytes + resident("VmHWM") - before if stats is None else jax.devices()[0].memory_stats()["peak_bytes_in_use"]
print(json.dumps([peak / sigma.nbytes, solve.memory_analysis().temp_size_in_bytes / sigma.nbytes]))
"""  # noqa: E501


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        shape: of the grid of the `solve`, `field` and `batch` rows, voxels of 2 m around the origin.
        maps: maps to take problems from.
        crop: Warframe window, where the data folder exists; empty for none.
        data: folder of public inputs.
        sizes: edges of the cubes of the `size` rows.
        batches: scenes a call of the `batch` rows.
        repeats: timed calls of ours.
        peer_repeats: timed calls of a peer.
        starts: paths a scene.
        margin: [m]; the Warframe window has none.
        memory: whether to measure the peak memory, in a process a size.
        seed: of the cities and problems.
        json: print the saved document, alone, on stdout.
        out: where it goes.
    """

    shape: tuple[int, int, int] = (101, 101, 101)
    maps: tuple[str, ...] = MAPS
    crop: str = "Complex"
    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    sizes: tuple[int, ...] = (51, 101, 201)
    batches: tuple[int, ...] = (1, 4)
    repeats: int = 10
    peer_repeats: int = 1
    starts: int = 5
    margin: float = 8.0
    memory: bool = True
    seed: int = 0
    json: bool = False
    out: Path = RESULTS


@dataclasses.dataclass(frozen=True)
class Scene:
    """One map and goal, posed.

    Attributes:
        name: map or crop.
        grid: its grid.
        occupied, ground: (nx, ny, nz) bool.
        goal: [m].
        problems: as posed, one a start, all at the same margin; the first gives the system.
        starts: (k, 3) [m].
    """

    name: str
    grid: maxjax.Grid
    occupied: np.ndarray
    ground: np.ndarray
    goal: Float[np.ndarray, " 3"]
    problems: list[Problem]
    starts: list[Float[np.ndarray, " 3"]]

    @property
    def sigma(self) -> Float[Array, "nx ny nz"]:
        """Conductivity of the first problem."""
        return maxjax.conductivity(self.problems[0].blocked, self.problems[0].goal_index, self.grid)


def main(config: Config) -> list[Row]:
    """Measure everything; save and return the rows."""
    # Tables and progress must not mix with the document.
    with contextlib.redirect_stdout(sys.stderr) if config.json else contextlib.nullcontext():
        bandwidth, rows = _copy(config)
        for scene in scenes_of(config):
            print(scene.name, file=sys.stderr, flush=True)
            rows += _solve_rows(scene, bandwidth, config)
            keep("potential", config, rows, config.out)
        rows += _size_rows(bandwidth, config)
        keep("potential", config, rows, config.out)
        rows += _batch_rows(bandwidth, config)
        # One table of everything would be wider than any terminal.
        with contextlib.redirect_stdout(io.StringIO()):
            path = save("potential", config, rows, config.out)
        for subject, group in itertools.groupby(rows, lambda row: str(row["what"]).split(":")[0]):
            show(subject, list(group))
    if config.json:
        print(path.read_text(), end="")
    return rows


def _copy(config: Config) -> tuple[float, list[Row]]:
    """Bandwidth of one read and one write [bytes/s]."""
    array = jnp.ones(_COPIED, jnp.float32)
    # A negation, since a bare copy may be elided.
    timing = measure(functools.partial(jax.jit(jnp.negative), array), config.repeats)
    bandwidth = 2 * array.nbytes / timing.median_s
    what = "copy: one read and one write of 256 MiB"
    return bandwidth, [{"what": what, "unit": "GB/s", "median": round(bandwidth / 1e9, 1), "n": timing.n}]


def _row(what: str, timing: Timing, scenes: int = 1, **more: str | float | bool | None) -> dict[str, Any]:
    """Milliseconds a scene."""

    def milliseconds(seconds: float) -> float:
        return float(f"{1e3 * seconds / scenes:.4g}")

    return {
        "what": what,
        "unit": "ms" if scenes == 1 else "ms a scene",
        "median": milliseconds(timing.median_s),
        "min": milliseconds(timing.min_s),
        "max": milliseconds(timing.max_s),
        "n": timing.n,
        **more,
    }


def _timing(seconds: Sequence[float]) -> Timing:
    return Timing(0.0, statistics.median(seconds), min(seconds), max(seconds), len(seconds))


def _ours(what: str, timing: Timing, shape: Sequence[int], bandwidth: float, scenes: int = 1) -> dict[str, Any]:
    """A row of ours, beside the floor."""
    floor = scenes * 8 * float(np.prod(shape)) / bandwidth
    return _row(
        what, timing, scenes, compile_s=round(timing.compile_s, 2), times_floor=round(timing.median_s / floor, 1)
    )


def _peer(name: str) -> ModuleType | None:
    """An optional package."""
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


# Scenes


def scenes_of(config: Config) -> list[Scene]:
    """The scenes of the `solve` rows."""
    scenes = []
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    for name in config.maps:
        # Ten problems share a city; the others lend their starts.
        posed = problems(name, 10, config.seed, grid)
        starts = [problem.start for problem in posed]
        scenes.append(_scene(name, grid, posed[0].occupied, posed[0].ground, posed[0].goal, starts, config))
    file = config.data / "warframe" / f"crop101_{config.crop}.npz"
    if config.crop and file.is_file():
        crop = np.load(file, allow_pickle=False)
        occupied = crop["occupancy"]
        grid = maxjax.Grid(occupied.shape, 1.0, (0.0, 0.0, 0.0))
        starts = list(crop["start"].astype(np.float32))
        goal = crop["goal"][0].astype(np.float32)
        settings = dataclasses.replace(config, margin=0.0)
        scenes.append(_scene(config.crop, grid, occupied, np.zeros_like(occupied), goal, starts, settings))
    return scenes


def _scene(
    name: str,
    grid: maxjax.Grid,
    occupied: np.ndarray,
    ground: np.ndarray,
    goal: np.ndarray,
    candidates: list[np.ndarray],
    config: Config,
) -> Scene:
    """Pose the goal with the first start, then with more starts that keep the same margin."""
    posed: list[Problem] = []
    starts: list[np.ndarray] = []
    for start in candidates:
        problem = _pose(*map(jnp.asarray, (occupied, ground, start, goal)), margin=config.margin, grid=grid)
        if problem.status == maxjax.Status.OK and (not posed or problem.margin == posed[0].margin):
            posed.append(problem)
            starts.append(start)
        if len(posed) == config.starts:
            break
    if not posed:
        raise ValueError(f"{name}: expected a start joined to the goal, given none among {len(candidates)}")
    return Scene(name, grid, occupied, ground, goal, posed, starts)


# Linear solvers


def _solve_rows(scene: Scene, bandwidth: float, config: Config) -> list[Row]:
    sigma, goal = scene.sigma, scene.problems[0].goal_index
    timing = measure(functools.partial(_solve, sigma, goal), config.repeats)
    ours = _solve(sigma, goal)
    print(f"  maxjax: {timing.median_s:.3f} s", file=sys.stderr, flush=True)
    length = float(ours.screening_length)
    assembled = functools.partial(system, np.asarray(sigma), np.asarray(goal), length)

    def volume(phi: Float[np.ndarray, " n"], voxels: Mask) -> Volume:
        full = np.zeros(voxels.shape)
        full[voxels] = phi
        full[tuple(np.asarray(goal))] = 1.0
        return full

    matrix, source, component = assembled()
    scale, scaled, right = unit_diagonal(matrix, source)
    with blas_threads(1):
        exact = scale @ reference_of(scaled, right)
    angles = angles_of(volume(exact, component), component)
    enough = angles(np.asarray(ours.phi))

    rows: list[Row] = []

    def add(peer: str, spent: Timing, iterations: int, found: tuple[float, float], **more: Any) -> None:
        print(f"  {peer}: {spent.median_s:.3f} s", file=sys.stderr, flush=True)
        ratio = {"times_ours": round(spent.median_s / timing.median_s, 2)}
        what = f"solve, {scene.name}: {peer}"
        rows.append(_row(what, spent, iterations=iterations) | _reached(found, enough) | ratio | more)

    def scipy(
        peer: str, a: csr_matrix, b: np.ndarray, root: dia_array, voxels: Mask, prepare: Prepare = lambda: None
    ) -> None:
        def judged(x: np.ndarray) -> tuple[float, float]:
            return angles(volume(root @ x, voxels))

        count, found = _hindsight(judged, enough, a, b, prepare)
        spent, more = _conjugate_gradients(a, b, count, prepare, config.peer_repeats)
        add(peer, spent, count, found, **more)

    scipy("SciPy CG, Jacobi, component", scaled, right, scale, component)
    whole, whole_source, everywhere = assembled(whole=True)
    whole_scale, whole_scaled, whole_right = unit_diagonal(whole, whole_source)
    scipy("SciPy CG, Jacobi, whole grid", whole_scaled, whole_right, whole_scale, everywhere)
    scipy("SciPy CG, whole grid", whole, whole_source, diags_array(np.ones(len(whole_source))), everywhere)
    if pyamg := _peer("pyamg"):

        def hierarchy() -> LinearOperator:
            levels = pyamg.smoothed_aggregation_solver(matrix, improve_candidates=None)
            cycle: LinearOperator = levels.aspreconditioner(cycle="V")
            return cycle

        one = diags_array(np.ones(len(source)))
        scipy("PyAMG smoothed aggregation + CG, component", matrix, source, one, component, hierarchy)
    else:
        rows.append(_left_out(f"solve, {scene.name}: PyAMG", "not installed"))

    def jacobi(count: int) -> Array:
        return jnp.asarray(_jacobi_pcg(sigma, goal, jnp.float32(length), jnp.int32(count)))

    count = _least(lambda k: angles(np.asarray(jacobi(k))), enough)
    spent = measure(lambda: jacobi(count), config.repeats)
    add("JAX, Jacobi-PCG, whole grid", spent, count, angles(np.asarray(jacobi(count))))
    rows.append(_cupy_row(scene.name, scaled, right, scale, functools.partial(volume, voxels=component), angles,
                          enough, timing, config))  # fmt: skip

    paths, rivals = _field_rows(scene, ours, timing, component, config)
    first = _ours(f"solve, {scene.name}: maxjax", timing, scene.grid.shape, bandwidth)
    first |= _verdict(ours) | _reached(enough, enough) | {"free_share": round(float(component.mean()), 3)} | paths
    return [first, *rows, *rivals]


class _EnoughError(Exception):
    """Ends SciPy's iteration."""


def _hindsight(
    angles: Callable[[np.ndarray], tuple[float, float]],
    enough: tuple[float, float],
    a: csr_matrix,
    b: np.ndarray,
    prepare: Prepare,
) -> tuple[int, tuple[float, float]]:
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
            if _reached(now, enough)["as_good"] or count - best >= _STALLED * every:
                raise _EnoughError

    # A stalled iteration may divide by what has underflowed.
    with contextlib.suppress(_EnoughError), np.errstate(all="ignore"), blas_threads(1):
        cg(a, b, rtol=1e-300, atol=0.0, maxiter=_MOST_ITERATIONS, M=preconditioner, callback=look)
    return best, found


def _conjugate_gradients(
    a: csr_matrix, b: np.ndarray, count: int, prepare: Prepare, repeats: int
) -> tuple[Timing, dict[str, Any]]:
    """Time SciPy's CG, set-up included: (timing, what else is known of it).

    Threads help BLAS on an idle machine and ruin it on a busy one, so both are tried and the faster counts.
    """
    tried: list[tuple[Timing, dict[str, Any]]] = []
    for threads in (1, None):
        setups, solves = [], []
        with blas_threads(threads):
            for _ in range(repeats):
                begun = time.perf_counter()
                preconditioner = prepare()
                ready = time.perf_counter()
                cg(a, b, rtol=1e-300, atol=0.0, maxiter=count, M=preconditioner)
                setups.append(ready - begun)
                solves.append(time.perf_counter() - ready)
        more: dict[str, Any] = {"blas_threads": threads or "all"}
        if preconditioner is not None:
            more["setup_ms"] = round(1e3 * statistics.median(setups), 1)
            more["solve_ms"] = round(1e3 * statistics.median(solves), 1)
        tried.append((_timing([x + y for x, y in zip(setups, solves, strict=True)]), more))
    return min(tried, key=lambda found: found[0].median_s)


def _reached(found: tuple[float, float], enough: tuple[float, float]) -> dict[str, Any]:
    good = all(a >= b - _SLACK for a, b in zip(found, enough, strict=True))
    return {"within_1deg": round(found[0], 5), "within_5deg": round(found[1], 5), "as_good": good}


def _verdict(potential: maxjax.Potential) -> dict[str, Any]:
    """What a potential says of itself: certified, screening length and every count it carries."""
    counts = {
        field.name: int(value)
        for field in dataclasses.fields(potential)
        if field.name != "status" and jnp.issubdtype((value := getattr(potential, field.name)).dtype, jnp.integer)
    }
    return {
        "status": maxjax.Status(int(potential.status)).name,
        "certified": bool(potential.certified),
        "screening_length": round(float(potential.screening_length), 3),
    } | counts


def _left_out(what: str, why: str) -> Row:
    return {"what": what, "note": f"left out: {why}"}


def _least(angles: Callable[[int], tuple[float, float]], enough: tuple[float, float]) -> int:
    """The fewest iterations whose angles are good enough, by bisection; the cap where none are."""

    def good(count: int) -> bool:
        return bool(_reached(angles(count), enough)["as_good"])

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

    def step(_: Array, state: tuple[Array, ...]) -> tuple[Array, ...]:
        x, r, rho, p = state
        q = p - stencil.inflow(faces, p)
        curvature = jnp.sum(p * q)
        alpha = jnp.where(curvature > 0, 1 / jnp.where(curvature > 0, curvature, 1), 0)
        x = x + (rho * alpha) * p
        r = r - alpha * q
        shrink = jnp.sqrt(jnp.sum(r * r))
        r = r / jnp.where(shrink > 0, shrink, 1)
        return x, r, rho * shrink, r + shrink * p

    size = jnp.sqrt(jnp.sum(b * b))
    r = b / size
    x, *_ = lax.fori_loop(0, count, step, (jnp.zeros_like(b), r, size, r))
    return jnp.asarray(scale * x)


def _cupy_row(
    name: str,
    matrix: csr_matrix,
    right: np.ndarray,
    scale: dia_array,
    volume: Callable[[np.ndarray], Volume],
    angles: Angles,
    enough: tuple[float, float],
    ours: Timing,
    config: Config,
) -> Row:
    """CuPy's CG on the Jacobi-scaled system of the component, in float64 on the GPU."""
    what = f"solve, {name}: CuPy CG, Jacobi, component"
    cupy, sparse, linalg = (_peer(part) for part in ("cupy", "cupyx.scipy.sparse", "cupyx.scipy.sparse.linalg"))
    if jax.default_backend() != "gpu" or cupy is None or sparse is None or linalg is None:
        return _left_out(what, "needs a CUDA device and cupy")
    a, b = sparse.csr_matrix(matrix), cupy.asarray(right)
    # Its tolerance was renamed between versions.
    tolerance = "rtol" if "rtol" in inspect.signature(linalg.cg).parameters else "tol"

    def solve(count: int) -> Any:
        x, _ = linalg.cg(a, b, maxiter=count, **{tolerance: 1e-300})
        cupy.cuda.Device().synchronize()
        return x

    def judged(count: int) -> tuple[float, float]:
        return angles(volume(scale @ cupy.asnumpy(solve(count))))

    count = _least(judged, enough)
    timing = measure(lambda: solve(count), config.peer_repeats)
    reached = _reached(judged(count), enough)
    ratio = {"times_ours": round(timing.median_s / ours.median_s, 2)}
    return _row(what, timing, iterations=count) | reached | ratio


# Travel-time fields


def marching(scene: Scene, component: Mask) -> dict[str, Callable[[], np.ndarray] | None]:
    """Travel times from the goal at unit speed [voxels], by name; None for a package that is not there."""
    free = component.copy()
    free[tuple(np.asarray(scene.problems[0].goal_index))] = True
    index = tuple(int(i) for i in scene.problems[0].goal_index)
    ones = np.ones(free.shape)
    skfmm, eikonalfm = _peer("skfmm"), _peer("eikonalfm")

    def scikit() -> np.ndarray:
        front = np.ones(free.shape)
        front[index] = -1  # the front starts half a voxel around the goal
        assert skfmm is not None
        return np.ma.filled(skfmm.travel_time(np.ma.MaskedArray(front, ~free), ones, order=2), np.inf)

    speed = np.where(free, 1.0, _IN_WALLS)

    def plain() -> np.ndarray:
        assert eikonalfm is not None
        return np.asarray(eikonalfm.fast_marching(speed, index, (1.0, 1.0, 1.0), 2))

    def factored() -> np.ndarray:
        assert eikonalfm is not None
        dx = (1.0, 1.0, 1.0)
        tau = eikonalfm.factored_fast_marching(speed, index, dx, 2)
        return np.asarray(tau * eikonalfm.distance(free.shape, dx, index, indexing="ij"))

    return {
        "scikit-fmm, fast marching": scikit if skfmm else None,
        "eikonalfm, fast marching": plain if eikonalfm else None,
        "eikonalfm, factored fast marching": factored if eikonalfm else None,
    }


def as_potential(travel: np.ndarray, component: Mask, goal: tuple[int, ...]) -> Float[Array, "nx ny nz"]:
    """exp(−T / scale), within float32; 1 at the goal, 0 outside its component."""
    known = component & np.isfinite(travel)
    scale = max(float(travel[known].max()), 1.0) / (_DECADES * np.log(10))
    phi = np.where(known, np.exp(-np.where(known, travel, 0) / scale), 0)
    phi[goal] = 1.0
    return jnp.asarray(phi, jnp.float32)


def _field_rows(
    scene: Scene, ours: maxjax.Potential, timing: Timing, component: Mask, config: Config
) -> tuple[dict[str, Any], list[Row]]:
    """Travel-time fields beside ours: (what to add to the row of ours, the rows of the others)."""
    goal = tuple(int(i) for i in scene.problems[0].goal_index)
    fields = {"": ours.phi}
    times: dict[str, Timing] = {}
    rows: list[Row] = []
    for name, run in marching(scene, component).items():
        if run is None:
            rows.append(_left_out(f"field, {scene.name}: {name}", "not installed"))
            continue
        seconds = []
        for _ in range(config.peer_repeats):
            begun = time.perf_counter()
            travel = run()
            seconds.append(time.perf_counter() - begun)
        times[name] = _timing(seconds)
        fields[name] = as_potential(travel, component, goal)
        print(f"  {name}: {times[name].median_s:.2f} s", file=sys.stderr, flush=True)
    paths = _paths(scene, fields)
    for name, spent in times.items():
        whole = jnp.asarray(component).at[goal].set(True)
        stuck = uncertified(fields[name], whole, scene.problems[0].goal_index)
        rows.append(
            _row(f"field, {scene.name}: {name}", spent, certified=bool(stuck == 0), uncertified=int(stuck))
            | {"times_ours": round(spent.median_s / timing.median_s, 2)}
            | paths[name]
        )
    return paths[""], rows


def _paths(scene: Scene, fields: Mapping[str, Array]) -> dict[str, dict[str, Any]]:
    """Climb every field from every start; figures over the starts from which all of them arrived."""
    plans: dict[str, list[tuple[maxjax.Plan, float]]] = {}
    count = len(scene.starts)
    starts, goals = np.asarray(scene.starts), np.broadcast_to(scene.goal, (count, 3))
    margins = [float(problem.margin) for problem in scene.problems]
    blocked = np.stack([np.asarray(problem.blocked) for problem in scene.problems])
    obstacles = np.broadcast_to(scene.occupied & ~scene.ground, blocked.shape)
    own = np.arange(count)
    for name, phi in fields.items():
        routes, climbed = [], []
        for problem in scene.problems:
            for steps in (512, 2048, 8192):
                path, arrived, bits = _climb(
                    phi, problem.blocked, problem.start, problem.goal, settings=Ascent(steps=steps)
                )
                if arrived:
                    break
            status = maxjax.Status.OK if arrived else maxjax.Status.PATH_STALLED
            routes.append(Route(np.asarray(_tighten(bits, path)), status, certified=False))
            climbed.append(scene.grid.spacing * float(np.linalg.norm(np.diff(np.asarray(path), axis=0), axis=1).sum()))
        judged = judge(routes, starts, goals, own, margins, blocked, obstacles, scene.grid, Stopwatch(), name)
        plans[name] = list(zip(judged, climbed, strict=True))
    shared = [all(p[k][0].status == maxjax.Status.OK for p in plans.values()) for k in range(len(scene.starts))]
    figures: dict[str, dict[str, Any]] = {}
    for name, found in plans.items():
        figures[name] = {"starts": len(found), "arrived": sum(p.status == maxjax.Status.OK for p, _ in found)}
        both = list(itertools.compress(found, shared))
        if both:
            figures[name] |= {
                "ascent_m": round(statistics.mean(climbed for _, climbed in both), 2),
                "length_m": round(statistics.mean(p.length for p, _ in both), 2),
                "clearance_m": round(statistics.mean(p.clearance for p, _ in both), 2),
                "clearance_least_m": round(min(p.clearance for p, _ in both), 2),
            }
    return figures


# Sizes and batches


def _size_rows(bandwidth: float, config: Config) -> list[Row]:
    """The same city on ever finer voxels, and the exponent of its cost."""
    rows: list[Row] = []
    medians = []
    for edge in config.sizes:
        print(f"size {edge}", file=sys.stderr, flush=True)
        sigma, goal = city_at(edge, config)
        timing = measure(functools.partial(_solve, sigma, goal), config.repeats)
        medians.append(timing.median_s)
        row = _ours(f"size: downtown, {edge}³", timing, sigma.shape, bandwidth) | _verdict(_solve(sigma, goal))
        rows.append(row | (_peak_arrays(sigma, goal) if config.memory else {}))
    if len(config.sizes) > 1:
        slope, _ = np.polyfit(3 * np.log(config.sizes), np.log(medians), 1)
        rows.append({"what": "size: exponent of cost in voxels", "unit": "1", "median": round(float(slope), 3)})
    return rows


def city_at(edge: int, config: Config) -> tuple[Float[Array, "nx ny nz"], Int32[Array, " 3"]]:
    """Sigma of downtown on edge³ voxels; the goal is the voxel of the largest component nearest to (40, 40, 9) m."""
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), (edge, edge, edge), _WIDTH / (edge - 1))
    occupied, ground = occupancy(make_scene("downtown", config.seed).geoms, grid)
    blocked = maxjax.dilate(jnp.asarray(occupied), config.margin, grid, jnp.asarray(ground))
    labels, _ = ndimage.label(~np.asarray(blocked))
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    free = np.argwhere(labels == largest)
    away = np.linalg.norm(free * grid.spacing + np.array(grid.origin) - np.array([40.0, 40.0, 9.0]), axis=1)
    goal = jnp.asarray(free[np.argmin(away)], jnp.int32)
    return maxjax.conductivity(blocked, goal, grid), goal


def _peak_arrays(sigma: Array, goal: Array) -> dict[str, Any]:
    """Peak memory of one solve in a fresh process, in arrays of sigma's size; empty where it cannot be read."""
    # The parent may hold most of the device.
    here = {**os.environ, "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "system.npz"
        np.savez(file, sigma=np.asarray(sigma), goal=np.asarray(goal))
        done = subprocess.run([sys.executable, "-c", _PROBE, str(file)], capture_output=True, text=True, env=here)
    if done.returncode:
        return {"note": f"memory not measured: {(done.stderr.strip().splitlines() or ['no message'])[-1][:120]}"}
    peak, temporary = json.loads(done.stdout.splitlines()[-1])
    return {"peak_arrays": round(peak, 1), "xla_arrays": round(temporary, 1)}


def _batch_rows(bandwidth: float, config: Config) -> list[Row]:
    """Time a scene under `vmap`, scenes from all maps in turn."""
    if not config.batches or not config.maps:
        return []
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    most = max(config.batches)
    sources = [iter(problems(name, -(-most // len(config.maps)), config.seed, grid)) for name in config.maps]
    systems = []
    for problem in itertools.chain.from_iterable(zip(*sources, strict=True)):
        ends = jnp.asarray(problem.start), jnp.asarray(problem.goal)
        posed = _pose(
            jnp.asarray(problem.occupied), jnp.asarray(problem.ground), *ends, margin=config.margin, grid=grid
        )
        if posed.status == maxjax.Status.OK:
            systems.append((maxjax.conductivity(posed.blocked, posed.goal_index, grid), posed.goal_index))
    solve = jax.jit(jax.vmap(maxjax.solve_potential))
    rows: list[Row] = []
    for batch in config.batches:
        print(f"batch {batch}", file=sys.stderr, flush=True)
        # Scenes without a path are left out, the first ones come again in their place.
        sigma, goal = (jnp.stack(part) for part in zip(*itertools.islice(itertools.cycle(systems), batch), strict=True))
        timing = measure(functools.partial(solve, sigma, goal), config.repeats)
        certified = int(jnp.sum(solve(sigma, goal).certified))
        row = _ours(f"batch: {batch}", timing, config.shape, bandwidth, batch)
        rows.append(row | {"certified": certified == batch, "certified_scenes": certified})
    return rows


if __name__ == "__main__":
    main(tyro.cli(Config))
