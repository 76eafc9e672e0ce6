"""Where a device's time goes, by steps of the method.

    python -m benchmarks.profile                        # one GPU: 1 minute
    python -m benchmarks.profile --scenes 1 --plans     # two CPU cores: half a minute; operations stand for kernels
    python -m benchmarks.profile --scenes --plans --cities 1 2          # GPUs of one host: 1 minute

Random problems of the three maps (offline protocol, margin 8 m), 101³ voxels. `solve` rows: `solve_potential` under
`vmap`, on scenes that lie on the device; `plan` rows: formulate, solve, ascend and tighten as one program, as
`maxjax.plan_batch` runs it. Each is traced by JAX's profiler after a warm-up. A kernel is booked on the innermost
`jax.named_scope` of the instruction whose name it bears, or on `other`; `waits` are copies to the host, by which a loop
asks whether to go on. `us` is the sum of kernel times a call, `kernels` their number; `wall` is the time of a call that
is not traced, and what it exceeds the sum by is spent between kernels.

`city` rows: the city of `benchmarks.city_scale`, on so many devices; kernels and their times are means over these.
`exchange` are collective operations, by which they hand layers of voxels and numbers to each other, waits included.

`change` is the last sweep of a cycle, with the look at what it changed; `settle` keeps the scenes of a batch that are
done apart from those that are not. `sweep` rows of a solve also say at what rate the longest kernel passes the six
arrays that a sweep cannot do without (three faces, the diagonal, φ before and after); `copy` is one array read and one
written, by a kernel of the same size: the floor.
"""

from __future__ import annotations

import dataclasses
import re
import statistics
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
from jax.profiler import ProfileData
from jax.stages import Compiled
from jaxtyping import Array

import maxjax
from benchmarks import city_scale
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, measure, save
from benchmarks.common.problems import joined, problems
from maxjax.fields.conductivity import conductivity
from maxjax.planning.path.route import Route
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.problem import Problem, formulate
from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.sim.worlds.scenes import MAPS
from maxjax.solvers.aggregation import pad_to_aggregates
from maxjax.solvers.potential import solve_potential

STEPS = (
    "formulate", "geodesic", "conductivity", "assemble", "guess", "lump", "relax", "sweep", "change", "settle",
    "conjugate gradients", "certify", "ascend", "tighten",
)  # fmt: skip
# Kernels that are no step of the method, by their names.
_SIGNS = {"waits": re.compile("D2H"), "exchange": re.compile("nccl|collective-permute|all-gather|all-reduce")}
# What a loop of a CPU's program takes holds what its operations take.
_CONTROL = ("while", "conditional", "call")
_SWEEP_ARRAYS = 6


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        scenes: scenes a call of the `solve` rows.
        plans: problems a call of the `plan` rows.
        cities: devices of the `city` rows.
        shape: of the grid, voxels of 2 m around the origin.
        city: voxels of the city.
        maps: maps to take problems from.
        repeats: traced calls.
        margin: [m].
        seed: of the problems.
        out: where the JSON goes.
    """

    scenes: tuple[int, ...] = (1, 64)
    plans: tuple[int, ...] = (1, 32)
    cities: tuple[int, ...] = ()
    shape: tuple[int, int, int] = (101, 101, 101)
    city: tuple[int, int, int] = (1024, 1024, 256)
    maps: tuple[str, ...] = MAPS
    repeats: int = 5
    margin: float = 8.0
    seed: int = 0
    out: Path = RESULTS


TINY = Config(scenes=(1,), plans=(), shape=(51, 51, 33), maps=("suburb",), repeats=1)


def main(config: Config) -> list[Row]:
    """Trace solves and plans; save and return the rows."""
    rows = _of_problems(config) if config.scenes or config.plans else []
    rows += _of_cities(config)
    save("profile", config, rows, config.out)
    return rows


def _of_problems(config: Config) -> list[Row]:
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape)
    rows: list[Row] = []
    climb = FieldPlanner(solve_potential)

    def formulated(occupied: Array, ground: Array, ends: Array) -> Problem:
        return formulate(occupied | ground, ground, ends, Distances(margin=config.margin), grid.local)

    def plan(*problem: Array) -> Route:
        return climb.route(formulated(*problem))

    most = _arrays(max((*config.scenes, *config.plans)), grid, config)

    def first(count: int) -> tuple[Array, ...]:
        return tuple(array[:count] for array in most)

    for count in config.scenes:
        found = jax.jit(jax.vmap(formulated))(*first(count))
        sigma = jax.jit(jax.vmap(lambda blocked, goal: conductivity(blocked, goal, grid)))(
            found.blocked, found.goal_index
        )
        solved = _rows(f"solve, {count}", solve_potential, (sigma, found.goal_index), config)
        volume = jax.vmap(pad_to_aggregates)(sigma)
        size = volume.size * volume.dtype.itemsize
        *_, copied = _rows(f"copy, {count}", lambda x: x * 2, (volume,), config)
        rows += [_at_rate(r, _SWEEP_ARRAYS * size) if str(r["what"]).endswith(": sweep") else r for r in solved]
        rows.append({**_at_rate(copied, 2 * size), "what": f"copy, {count}: copy"})
    for count in config.plans:
        rows += _rows(f"plan, {count}", plan, first(count), config)
    return rows


def _of_cities(config: Config) -> list[Row]:
    rows: list[Row] = []
    if not config.cities:
        return rows
    city = city_scale.city(city_scale.Config(config.city, margin=config.margin, seed=config.seed))
    for count in config.cities:
        sigma = city_scale.sharded(city, count)
        solve = city_scale.compile_solve(sigma, city.goal_index)
        rows += _booked(f"city, {count}", solve, (sigma, city.goal_index), config, count)
    return rows


def _arrays(count: int, grid: maxjax.Grid, config: Config) -> tuple[Array, ...]:
    """Occupied, ground and ends (index coordinates) of so many problems, on the device."""
    each = [problems(name, -(-count // len(config.maps)), config.seed, grid) for name in config.maps]
    task = joined([task for turn in zip(*each, strict=True) for task in turn][:count])
    arrays: tuple[Array, ...] = jax.device_put((task.barred, task.kept_off, task.ends))
    return arrays


def _rows(what: str, function: Callable[..., Any], arrays: tuple[Array, ...], config: Config) -> list[Row]:
    """`_booked` on this function of a batch; of one scene, without the batch."""
    single = arrays[0].shape[0] == 1  # what `vmap` adds is not free
    given = jax.block_until_ready([x[0] for x in arrays] if single else list(arrays))
    compiled = jax.jit(function if single else jax.vmap(function)).lower(*given).compile()
    return _booked(what, compiled, given, config)


def _booked(what: str, compiled: Compiled, given: Sequence[Any], config: Config, devices: int = 1) -> list[Row]:
    """A row a step, the longest first, and last one of all."""

    def call() -> Any:
        return jax.block_until_ready(compiled(*given))

    wall = measure(call, max(config.repeats, 3)).median_s
    steps = _scopes(compiled.as_text() or "")
    durations: dict[str, list[float]] = defaultdict(list)
    for name, seconds in _traced(call, config.repeats):
        durations[name].append(1e6 * seconds)
    spent: dict[str, float] = defaultdict(float)
    kernels: dict[str, float] = defaultdict(float)
    longest: dict[str, float] = defaultdict(float)
    for name, each in durations.items():
        step = next((step for step, sign in _SIGNS.items() if sign.search(name)), steps.get(_letters(name), "other"))
        spent[step] += sum(each) / (config.repeats * devices)
        kernels[step] += len(each) / (config.repeats * devices)
        longest[step] = max(longest[step], statistics.mean(each))
    busy = sum(spent.values())
    whole: Row = {
        "what": f"{what}: all", "us": round(busy, 1), "kernels": round(sum(kernels.values()), 1),
        "longest_us": round(max(longest.values()), 1), "share": 1.0, "wall_us": round(1e6 * wall, 1),
    }  # fmt: skip
    rows: list[Row] = [
        {
            "what": f"{what}: {step}",
            "us": round(us, 1),
            "kernels": round(kernels[step], 1),
            "longest_us": round(longest[step], 1),
            "share": round(us / busy, 4),
        }
        for step, us in sorted(spent.items(), key=lambda item: -item[1])
    ]
    return [*rows, whole]


def _at_rate(row: Row, size: int) -> Row:
    """The row with the rate at which its longest kernel passes so many bytes [GB/s]."""
    longest = row["longest_us"]
    assert isinstance(longest, float)
    return {**row, "gb_per_s": round(1e-3 * size / longest, 1)}


def _scopes(text: str) -> dict[str, str]:
    """Step of each instruction of a compiled program that belongs to one, by its name in `_letters`."""
    found = {}
    for name, path in re.findall(r'^\s*(?:ROOT )?%?([\w.\-]+) = .*op_name="([^"]*)"', text, re.MULTILINE):
        scopes = [re.sub(r"^(?:\w+\()*|\)*$", "", scope) for scope in path.split("/")]
        inner = next((scope for scope in reversed(scopes) if scope in STEPS), None)
        if inner is not None:
            found[_letters(name)] = inner
    return found


def _letters(name: str) -> str:
    """The name of an instruction as a GPU's kernel bears it."""
    return re.sub(r"\W", "_", name)


def _traced(call: Callable[[], Any], repeats: int) -> Iterator[tuple[str, float]]:
    """Name and duration [s] of every kernel of so many calls."""
    with tempfile.TemporaryDirectory() as folder:
        with jax.profiler.trace(folder):
            for _ in range(repeats):
                call()
        for path in Path(folder).rglob("*.xplane.pb"):
            for plane in ProfileData.from_file(str(path)).planes:
                on_cpu = plane.name.startswith("/host:CPU")
                for line in plane.lines:
                    if not on_cpu and not (plane.name.startswith("/device:") and "Stream" in line.name):
                        continue
                    for event in line.events:
                        name = dict(event.stats).get("hlo_op") if on_cpu else event.name
                        if name and not (on_cpu and str(name).startswith(_CONTROL)):
                            yield str(name), 1e-9 * event.duration_ns


if __name__ == "__main__":
    main(configured(TINY))
