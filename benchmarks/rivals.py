"""The field beside a compiled A* with the same rules, prices and maps: one query, batches, a fleet.

    python -m benchmarks.rivals                 # two CPU cores: 4 minutes
    python -m benchmarks.rivals --batch 1024    # one GPU

Problems are those of `benchmarks.common.problems` on the three maps: 101³ voxels, margin 8 m, radius 1 m, with the
price and without. All rows are of one run, after a warm-up; each query and plan is timed three times, and the least
counts, as it does for fleets: machines are shared.

`query` rows: a search alone, from blocked voxels and prices to a path of voxels, by A* in Python and compiled, on one
core. `plan` rows: from the map to the verified path, by the field and by A* (its formulation, checks and judge are the
field's). `batch` rows: compiled searches on all cores, `plan_batch`, and with prices as many plans by A*, a process a
core. `fleet` rows, with prices: many starts for one goal on one map, 20 to 80 m from it or anywhere: the one field
alone, `plan_fleet` from the map to verified paths, compiled searches on all cores, and as many plans by A*, of which a
few are timed, one after the other. `sampled paths`: a thousand a problem through layers of random points
(`benchmarks.common.layered_sampling`), how many our verifier finds safe, and the shortest safe one beside the field's.
dijkstra3d's full distance fields (extra `bench`) count 26 neighbours too, but they
cut corners, and a price is paid by the voxel, not by the metre.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, keep, left_out, package, save
from benchmarks.common.layered_sampling import layered_paths
from benchmarks.common.problems import joined, problems, voxels_of
from benchmarks.common.processes import planned_by_processes
from maxjax import VoxelMap
from maxjax.baselines.astar_planner import voxel_of
from maxjax.fields.price import Price
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import problem_of
from maxjax.planning.run.shared_goal import formulate_shared_goal
from maxjax.planning.run.stages import potential_field
from maxjax.planning.search import astar, astar_compiled
from maxjax.planning.search.astar_compiled import Queries, Query, Search
from maxjax.sim.worlds.scenes import MAPS, make_scene, occupancy
from maxjax.solvers.potential import solve_potential
from maxjax.ui.methods import planner_named

NEAR = (20.0, 80.0)  # of a fleet's starts from their goal [m]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        maps: maps to take problems from.
        problems: problems a map, for queries and batches of searches.
        batch: plans of a call of `plan_batch`.
        sampled: paths through random layers, a problem.
        starts: of a fleet.
        plans: of these, planned by A* one by one.
        city: of the fleet: map and seed.
        shape: of the grid, voxels of 2 m.
        repeats: timed calls of what takes less than a second.
        margin: [m].
        seed: of the problems.
        out: where the JSON goes.
    """

    maps: tuple[str, ...] = MAPS
    problems: int = 10
    batch: int = 24
    sampled: int = 1000
    starts: int = 1000
    plans: int = 30
    city: tuple[str, int] = ("downtown", 0)
    shape: tuple[int, int, int] = (101, 101, 101)
    repeats: int = 5
    margin: float = 8.0
    seed: int = 0
    out: Path = RESULTS


TINY = Config(
    maps=("suburb",), problems=1, batch=1, sampled=20, starts=6, plans=1, city=("suburb", 0), shape=(51, 51, 33),
    repeats=1,
)  # fmt: skip


def main(config: Config) -> list[Row]:
    """Time all of them; save and return the rows."""
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    tasks = [task for name in config.maps for task in problems(name, config.problems, config.seed, grid, config.margin)]
    rows: list[Row] = []

    def add(some: list[Row]) -> None:
        rows.extend(some)
        keep("rivals", config, rows, config.out)

    priced, by_length = (
        [dataclasses.replace(t, distances=dataclasses.replace(t.distances, price=price)) for t in tasks]
        for price in (Price(), Price(height=0.0))
    )
    # What is planned by default first, single queries last: a long run may be cut.
    add(_batch_rows(priced, "priced", config))
    add([_planned_by_astar(priced, "priced", config)])
    for name, reach in (("near", NEAR), ("anywhere", (0.0, np.inf))):
        add(_fleet_rows(f"fleet of {config.starts:,} {name}", config, grid, reach))
    add(_query_rows(priced, "priced"))
    add(_batch_rows(by_length, "by length", config))
    add(_query_rows(by_length, "by length"))
    add([_sampled_row(by_length, config)])
    if not astar_compiled.available():
        rows.append(left_out("compiled A*", "no C++ compiler"))
    if package("dijkstra3d") is None:
        rows.append(left_out("dijkstra3d", "not installed"))
    save("rivals", config, rows, config.out)
    return rows


def _row(what: str, seconds: Sequence[float], each: int = 1, **more: Any) -> Row:
    """Seconds of calls that do so many things each, in milliseconds a thing."""
    times = np.array(seconds) * 1e3 / each
    figures = {"median": np.median(times), "mean": times.mean(), "p99": np.percentile(times, 99), "max": times.max()}
    return {"what": what, "unit": "ms", **{k: float(f"{v:.4g}") for k, v in figures.items()}, "n": len(times), **more}


def _seconds(call: Callable[[], Any]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def _least(call: Callable[[], Any], times: int = 3) -> float:
    return min(_seconds(call) for _ in range(times))


def _rate(row: Row) -> Row:
    """A row of a batch, with what comes out of it in a second."""
    return {**row, "per_second": float(f"{1e3 / float(row['median'] or 0):.4g}")}


def _query_of(task: Task) -> Query | None:
    """What A* is asked; None where there is nothing to search."""
    problem = problem_of(task)
    price = None if problem.price is None else np.asarray(problem.price)
    if problem.status != maxjax.Status.OK:
        return None
    start, goal = (voxel_of(np.asarray(end)) for end in (problem.start, problem.goal))
    return Query(np.asarray(problem.blocked), start, goal, price)


def _plan(task: Task, method: str) -> maxjax.Plan:
    planner = planner_named(method)
    return maxjax.plan(task.map, task.starts[0], task.goals[0], planner=planner, distances=task.distances)


def _query_rows(tasks: list[Task], told: str) -> list[Row]:
    queries = [query for task in tasks if (query := _query_of(task)) is not None]
    python = [_least(functools.partial(astar.astar, *query)) for query in queries]
    rows = [_row(f"query, {told}: A* in Python", python)]
    if astar_compiled.available():
        asked, search = [Queries([query]) for query in queries], Search(queries[0].blocked.shape)
        seconds = [_least(functools.partial(one.run, [search])) for one in asked]
        rows.append(_row(f"query, {told}: compiled A*", seconds))
    for method in ("solver", "astar"):
        for task in tasks[:: len(tasks) // 3 or 1]:
            _plan(task, method)
        plans = [[_plan(task, method) for _ in range(3)] for task in tasks]
        solved = sum(plan.status == maxjax.Status.OK for plan, *_ in plans)
        seconds = [min(plan.timings["total"] for plan in same) for same in plans]
        rows.append(_row(f"plan, {told}: {method}", seconds, solved=solved))
    return rows


def _searched(queries: list[Query], repeats: int) -> tuple[list[float], int]:
    """Seconds of compiled searches on all cores, and how many found a path."""
    asked, searches = Queries(queries), [Search(queries[0].blocked.shape) for _ in range(os.cpu_count() or 1)]
    asked.run(searches)
    seconds = [_seconds(lambda: asked.run(searches)) for _ in range(repeats)]
    return seconds, sum(asked.result(k).status is maxjax.Status.OK for k in range(len(asked)))


def _batch_rows(tasks: list[Task], told: str, config: Config) -> list[Row]:
    queries = [query for task in tasks if (query := _query_of(task)) is not None]
    rows: list[Row] = []
    if astar_compiled.available():
        seconds, solved = _searched(queries, config.repeats)
        rows.append(_rate(_row(f"batch, {told}: compiled A*", [min(seconds)], len(queries), solved=solved)))
    task = joined([tasks[k] for k in np.linspace(0, len(tasks) - 1, config.batch).astype(int)])

    def run() -> maxjax.Plans:
        return maxjax.plan_batch(task.map, task.starts, task.goals, distances=task.distances)

    solved = int(sum(run().status == maxjax.Status.OK))
    run()
    return [*rows, _rate(_row(f"batch, {told}: plan_batch", [_least(run)], len(task), solved=solved))]


def _planned_by_astar(tasks: list[Task], told: str, config: Config) -> Row:
    seconds, solved = planned_by_processes(tasks, "astar", config.batch, config.repeats)
    return _rate(_row(f"batch, {told}: plans by A*", [min(seconds)], config.batch, solved=solved))


def _sampled_row(tasks: list[Task], config: Config) -> Row:
    """Paths through random layers: how quick they are, how many of those found are safe, how long the best."""
    keys, seconds, found, safe, over = jax.random.split(jax.random.key(config.seed), config.sampled), [], 0, 0, []
    for task in tasks:
        plan, ends = _plan(task, "solver"), jnp.asarray(np.concatenate([task.starts, task.goals]))
        call = functools.partial(layered_paths, jnp.asarray(problem_of(task).blocked), ends, keys, task.grid)
        paths = np.asarray(call())
        seconds.append(_least(lambda call=call: jax.block_until_ready(call())))  # type: ignore[misc]
        verdicts = [
            maxjax.verify(path, task.map, radius=task.distances.radius, exemptions=plan.exemptions)
            for path in paths[np.isfinite(paths).all(axis=(1, 2))]
        ]
        found += len(verdicts)
        lengths = [verdict.length for verdict in verdicts if verdict.ok]
        safe += len(lengths)
        over += [min(lengths) / plan.length] if lengths and plan.status == maxjax.Status.OK else []
    row = _row("sampled paths", seconds, config.sampled, found=found, safe=safe, solved=len(over))
    return _rate({**row, "over": round(statistics.median(over), 4) if over else None})


def _fleet(config: Config, grid: maxjax.Grid, reach: tuple[float, float]) -> tuple[Task, list[Query]]:
    """A fleet whose starts open no voxel, and what A* is asked of each; the goal lies near the middle."""
    occupied, ground = occupancy(make_scene(*config.city).geoms, grid)
    rng = np.random.default_rng(config.seed)
    low, high = np.array([*np.array(grid.lower)[:2] + 2, 3.0]), np.array([*np.array(grid.upper)[:2] - 2, 15.0])
    middle = np.array([0.3, 0.3, 1.0])

    def drawn(low: np.ndarray, high: np.ndarray) -> np.ndarray:
        points = rng.uniform(low, high, (16 * config.starts, 3))
        return np.asarray(points[~occupied[tuple(voxels_of(points, grid).T)]])

    goal = drawn(middle * low, middle * high)[0]
    starts = drawn(low, high)
    apart = np.linalg.norm(starts - goal, axis=1)
    starts = starts[(apart >= reach[0]) & (apart <= reach[1])][: 2 * config.starts]
    distances = problems(config.maps[0], 1, config.seed, grid, config.margin)[0].distances
    task = Task.of(VoxelMap.on(grid, occupied, ground), starts, goal, distances)
    fleet = formulate_shared_goal(
        jnp.asarray(occupied), jnp.asarray(ground), jnp.asarray(task.ends), distances, grid.local
    )
    sound = np.flatnonzero(~np.asarray(fleet.opens) & (np.asarray(fleet.status) == maxjax.Status.OK))[: config.starts]
    blocked, price = np.asarray(fleet.blocked), np.asarray(fleet.around.price)
    inner, last = np.asarray(fleet.places.inner)[sound, 0], voxel_of(np.asarray(fleet.places.inner)[0, 1])
    return task.some(sound), [Query(blocked, voxel_of(start), last, price) for start in inner]


def _fleet_rows(what: str, config: Config, grid: maxjax.Grid, reach: tuple[float, float]) -> list[Row]:
    """Milliseconds of the whole fleet."""
    task, queries = _fleet(config, grid, reach)
    blocked, price, goal = queries[0].blocked, queries[0].price, queries[0].goal
    arrays = jnp.asarray(blocked), jnp.asarray(price), jnp.asarray(goal, jnp.int32)

    def field() -> Any:
        return potential_field(*arrays, solve_potential).log_phi

    def run() -> maxjax.Plans:
        return maxjax.plan_to_goal(task.map, task.starts, task.goals[0])

    field()
    rows = [_row(f"{what}: the field alone", [_least(field, config.repeats)])]
    plans = run()
    rows.append(_row(f"{what}: plan_fleet", [_least(run, 2)], solved=int(sum(plans.status == maxjax.Status.OK))))
    if astar_compiled.available():
        seconds, solved = _searched(queries, config.repeats)
        rows.append(_row(f"{what}: compiled A*", [min(seconds)], solved=solved))
    some = [_plan(task.some(slice(k, k + 1)), "astar").timings["total"] for k in range(1 + config.plans)][1:]
    rows.append(_row(f"{what}: plans by A*", [len(task) * statistics.fmean(some)], timed=len(some)))
    dijkstra3d = package("dijkstra3d")
    if dijkstra3d is not None:
        weights = np.asfortranarray(np.where(blocked, np.float32(np.inf), np.asarray(price)))
        free = np.asfortranarray(~blocked)
        for name, call in (
            ("distance_field", lambda: dijkstra3d.distance_field(weights, source=goal)),
            ("euclidean_distance_field", lambda: dijkstra3d.euclidean_distance_field(free, source=goal)),
        ):
            rows.append(_row(f"{what}: dijkstra3d.{name}", [_least(call, config.repeats)]))
    return rows


if __name__ == "__main__":
    main(configured(TINY))
