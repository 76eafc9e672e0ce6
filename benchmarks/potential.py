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
import io
import itertools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import maxjax
from benchmarks import field_paths, linear_solvers
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, Timing, keep, measure, save, show, timed_row
from benchmarks.common.problems import problems
from benchmarks.common.scenes import Instance, Selection, city_at, scenes_of
from maxjax.planning.problem.problem import formulate
from maxjax.sim.worlds.scenes import MAPS

_COPIED = 2**26  # numbers; far beyond any cache

_solve = jax.jit(maxjax.solve_potential)
_formulate = jax.jit(formulate, static_argnames=("distances", "grid"))

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


TINY = Config(
    shape=(21, 21, 21), maps=("downtown",), crop="", sizes=(21,), batches=(), repeats=1, starts=1, margin=2.0,
    memory=False,
)  # fmt: skip


def main(config: Config) -> list[Row]:
    """Measure everything; save and return the rows."""
    # Tables and progress must not mix with the document.
    with contextlib.redirect_stdout(sys.stderr) if config.json else contextlib.nullcontext():
        bandwidth, rows = _copy(config)
        selection = Selection(
            config.shape, config.maps, config.crop, config.data, config.starts, config.margin, config.seed
        )
        for scene in scenes_of(selection):
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


def _ours(what: str, timing: Timing, shape: Sequence[int], bandwidth: float, scenes: int = 1) -> dict[str, Any]:
    """A row of ours, beside the floor."""
    floor = scenes * 8 * float(np.prod(shape)) / bandwidth
    return timed_row(
        what, timing, scenes, compile_s=round(timing.compile_s, 2), times_floor=round(timing.median_s / floor, 1)
    )


def _solve_rows(scene: Instance, bandwidth: float, config: Config) -> list[Row]:
    """Ours beside linear solvers and travel-time fields, on one scene."""
    sigma, goal = scene.sigma, scene.problems[0].goal_index
    timing = measure(functools.partial(_solve, sigma, goal), config.repeats)
    ours = _solve(sigma, goal)
    print(f"  maxjax: {timing.median_s:.3f} s", file=sys.stderr, flush=True)
    repeats = config.repeats, config.peer_repeats
    enough, component, rows = linear_solvers.rows_of(scene.name, sigma, goal, ours, timing, repeats)
    paths, rivals = field_paths.rows_of(scene, ours, timing, component, config.peer_repeats)
    first = _ours(f"solve, {scene.name}: maxjax", timing, scene.task.grid.shape, bandwidth)
    first |= _verdict(ours) | linear_solvers.reached(enough, enough)
    return [first | {"free_share": round(float(component.mean()), 3)} | paths, *rows, *rivals]


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


def _size_rows(bandwidth: float, config: Config) -> list[Row]:
    """The same city on ever finer voxels, and the exponent of its cost."""
    rows: list[Row] = []
    medians = []
    for edge in config.sizes:
        print(f"size {edge}", file=sys.stderr, flush=True)
        sigma, goal = city_at(edge, config.margin, config.seed)
        timing = measure(functools.partial(_solve, sigma, goal), config.repeats)
        medians.append(timing.median_s)
        row = _ours(f"size: downtown, {edge}³", timing, sigma.shape, bandwidth) | _verdict(_solve(sigma, goal))
        rows.append(row | (_peak_arrays(sigma, goal) if config.memory else {}))
    if len(config.sizes) > 1:
        slope, _ = np.polyfit(3 * np.log(config.sizes), np.log(medians), 1)
        rows.append({"what": "size: exponent of cost in voxels", "unit": "1", "median": round(float(slope), 3)})
    return rows


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
    sources = [
        iter(problems(name, -(-most // len(config.maps)), config.seed, grid, config.margin)) for name in config.maps
    ]
    systems = []
    for task in itertools.chain.from_iterable(zip(*sources, strict=True)):
        maps = jnp.asarray(task.barred), jnp.asarray(task.kept_off)
        found = _formulate(*maps, jnp.asarray(task.ends[0]), distances=task.distances, grid=grid.local)
        if found.status == maxjax.Status.OK:
            systems.append((maxjax.conductivity(found.blocked, found.goal_index, grid), found.goal_index))
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
    main(configured(TINY))
