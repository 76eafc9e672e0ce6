"""The Hague and Venice (Los Angeles) as surveyed: plans and flights in city geometry that nobody here made.

    MAXJAX_DATA=... python -m experiments.real_cities --workers 16                        # a GPU
    MAXJAX_DATA=... python -m experiments.real_cities --problems 20 --windows 4 --trials 4    # two cores: 6 minutes

Windows of 200 x 200 m, side by side, those with the most built area of each city. Buildings become upright boxes on
level ground (`maxjax.sim.worlds.real_city`, which says what that covers and loses; `geometry` rows measure it). Outside
its window a city is empty.

- `offline`: the protocol and the judges of `experiments.random_problems`: ends 20 to 50 voxels apart, 3 to 15 m high,
  margin 8 m; A* beside the solver on the same problems.
- `closed loop`: the ends of `maxjax.sim.trials.trials` in these solids, flown by `maxjax.sim.loop.flight`: 50 to 80 m
  apart, 10 m clear of buildings, arrival within 2 m, never within 0.5 m of anything.

Expected: every solvable problem OK and certified at the largest feasible margin, no unsafe path, mean length at most
1.03 of the eikonal geodesic; every trial arrives, no contact. That geodesic, fast marching between voxel centres, turns
the corner of a wall about a voxel late (37.7 voxels around one come out as 38.7, 8.1 as 9.3), and among houses a path
has many to turn: a mean below 1 is the oracle's error, not the path's merit.
"""

from __future__ import annotations

import dataclasses
import functools
import multiprocessing
import os
import sys
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.oracle import judge
from benchmarks.common.paper import planned
from benchmarks.common.problems import case_of, draw_ends
from experiments import random_problems as offline
from experiments.city_windows import CITIES, Window, slots_of, windows
from maxjax import VoxelMap
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.sim.loop.flight import FlightConfig, FlightLog, fly_closed_loop
from maxjax.sim.trials import trials as rules
from maxjax.sim.trials.outcomes import on_host
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.real_city import TOLERANCE, city
from maxjax.sim.worlds.scenes import occupancy
from maxjax.ui.methods import planner_named

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        data: folder of public inputs.
        windows: a city.
        problems: offline, a window.
        trials: closed loop, a window; more than 50 are rounded up to a multiple of 50.
        methods: planners of the closed loop.
        half: half extent of a window [m].
        tolerance: of the boxes [m].
        margin: [m], offline.
        seed: of ends and flights.
        workers: processes that judge.
        out: where the JSON goes.
    """

    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    windows: int = 4
    problems: int = 250
    trials: int = 50
    methods: tuple[str, ...] = ("solver",)
    half: float = 100.0
    tolerance: float = TOLERANCE
    margin: float = 8.0
    seed: int = 0
    workers: int = 2
    out: Path = RESULTS

    @property
    def grid(self) -> maxjax.Grid:
        """Of the offline problems: a window in voxels of 2 m, the ground in the middle layer."""
        n = 2 * round(self.half / 2) + 1
        return maxjax.Grid.centered((0.0, 0.0, 0.0), (n, n, n), 2.0)


TINY = Config(windows=1, problems=2, trials=0, half=40.0, workers=1)


def main(config: Config, flight: FlightConfig | None = None) -> list[Row]:
    """Measure, plan, fly, save.

    Args:
        config: settings.
        flight: how to fly, None: the defaults; `config.methods` take the place of its planner.
    """
    cities = {
        name: windows(tuple(config.data / file for file in files), config.half, config.tolerance)[: config.windows]
        for name, files in CITIES.items()
    }
    slots = slots_of(one for found in cities.values() for one in found)
    rows: list[Row] = [_geometry(name, found) for name, found in cities.items()]

    def add(row: Row) -> None:
        rows.append(row)
        print(row, file=sys.stderr, flush=True)
        keep("real_cities", config, rows, config.out)

    with multiprocessing.get_context("spawn").Pool(config.workers) as pool:
        for name, found in cities.items():
            add({"city": name, "part": "offline", **_offline(name, found, slots, config, pool)})
    for method in config.methods if config.trials else ():
        for name, found in cities.items():
            planner = planner_named(method)
            settings = FlightConfig(planner=planner) if flight is None else dataclasses.replace(flight, planner=planner)
            row = _closed_loop(name, found, slots, settings, config)
            add({"city": name, "part": "closed loop", "method": method, **row})
    save("real_cities", config, rows, config.out)
    return rows


def _geometry(name: str, found: list[Window]) -> Row:
    weight = np.array([one.built for one in found])
    return {
        "city": name,
        "part": "geometry",
        "windows": len(found),
        "footprints": sum(one.footprints for one in found),
        "boxes": sum(len(one.rows) for one in found),
        "boxes_most": max(len(one.rows) for one in found),
        "excess_share": round(float(np.average([one.excess for one in found], weights=weight)), 4),
        "missed_share": round(float(np.average([one.missed for one in found], weights=weight)), 6),
        "relief_most_m": round(max(one.relief for one in found), 2),
        "highest_m": round(max(float(one.rows[:, 5].max()) for one in found), 2),
    }


def _offline(name: str, found: list[Window], slots: int, config: Config, pool: Any) -> dict[str, Any]:
    grid = config.grid
    tasks: list[Task] = []
    for k, one in enumerate(found):
        rng = np.random.default_rng([config.seed, zlib.crc32(name.encode()), k])
        occupied, ground = occupancy(city(one.rows, slots), grid)
        for _ in range(config.problems):
            start, goal = draw_ends(rng, occupied, grid)
            tasks.append(
                Task.of(VoxelMap.on(grid, occupied, ground), start[None], goal[None], Distances(margin=config.margin))
            )
    plans, rivals = (list(some) for some in zip(*(planned(task, "solver", "astar") for task in tasks), strict=True))
    cases = [case_of(task, plan) for task, plan in zip(tasks, plans, strict=True)]
    row = dict(offline.row_of(name, plans, rivals, pool.map(judge, cases), grid))
    del row["map"]
    solved = [plan.status == maxjax.Status.OK for plan in rivals]
    return row | {"astar_solved": sum(solved)}


def draw(geoms: Geoms, key: Key[Array, ""], first: int) -> tuple[Array, Array, Array, Array]:
    """Start, goal, valid and excluded of 50 trials in these solids, by the rules of `maxjax.sim.trials.trials`."""
    occupied, ground = occupancy(geoms, rules.TRUTH)
    air = rules.open_air(jnp.asarray(occupied), jnp.asarray(ground))
    ends: tuple[Array, Array, Array, Array] = rules.draw_in(geoms, air, key, jnp.int32(first))
    return ends


@jax.jit
def _flights(
    geoms: Geoms,
    start: Float[Array, "b 3"],
    goal: Float[Array, "b 3"],
    key: Key[Array, " b"],
    config: FlightConfig,
) -> FlightLog:
    """One city, many flights; a single one without `vmap`, which compiles in half the time."""
    if len(start) == 1:
        log: FlightLog = jax.tree.map(lambda x: x[None], fly_closed_loop(geoms, start[0], goal[0], key[0], config))
        return log
    logs: FlightLog = jax.vmap(fly_closed_loop, in_axes=(None, 0, 0, 0, None))(geoms, start, goal, key, config)
    return logs


def _closed_loop(name: str, found: list[Window], slots: int, settings: FlightConfig, config: Config) -> dict[str, Any]:
    batch = min(config.trials, rules.CITY_TRIALS)
    # On a CPU a batch gains nothing.
    size = 1 if jax.default_backend() == "cpu" else batch
    parts: list[dict[str, np.ndarray]] = []
    for k, one in enumerate(found):
        geoms = city(one.rows, slots)
        root = jax.random.fold_in(jax.random.fold_in(jax.random.key(config.seed), zlib.crc32(name.encode())), k)
        for first in range(0, config.trials, rules.CITY_TRIALS):
            start, goal, valid, excluded = (x[:batch] for x in draw(geoms, root, first))
            keys = jax.vmap(functools.partial(jax.random.fold_in, root))(first + jnp.arange(batch))
            # Where no pair was found the ends are NaN, and that flight is over at once.
            some = [slice(at, at + size) for at in range(0, batch, size)]
            logs = [on_host(_flights(geoms, start[few], goal[few], keys[few], settings)) for few in some]
            log = {key: np.concatenate([one[key] for one in logs]) for key in logs[0]}
            del log["position"], log["margin"]
            log |= {"straight": np.linalg.norm(np.asarray(goal - start), axis=1), "valid": np.asarray(valid)}
            log |= {"window": np.full(batch, k), "trial": first + np.arange(batch), "excluded": np.asarray(excluded)}
            parts.append(log)
            print(name, f"window {k}, trials {first} to {first + batch - 1}", file=sys.stderr, flush=True)
    return _flown({key: np.concatenate([part[key] for part in parts]) for key in parts[0]})


def _flown(logs: dict[str, np.ndarray]) -> dict[str, Any]:
    valid: Bool[np.ndarray, " n"] = logs["valid"]
    flown = {key: values[valid] for key, values in logs.items()}
    arrived = flown["status"] == maxjax.Status.OK
    names = [maxjax.Status(int(status)).name for status in flown["status"]]
    failed = [f"window {flown['window'][i]} trial {flown['trial'][i]}: {names[i]}" for i in np.flatnonzero(~arrived)]
    made = int((flown["planning_iterations"] - flown["failed_plans"]).sum())
    figures: dict[str, Any] = {
        "trials": int(valid.sum()),
        "not_drawn": int((~valid).sum()),
        "ends_passed_over": int(logs["excluded"].sum()),
        "arrived": int(arrived.sum()),
        "contacts": Counter(names)[maxjax.Status.IN_CONTACT.name],
        "certified_share": round(float(flown["certified"].sum()) / made, 4) if made else None,
        "failed_plans": int(flown["failed_plans"].sum()),
        "failures": "; ".join(failed) or None,
    }
    if not arrived.any():
        return figures
    length, plans = flown["flown_length"][arrived], flown["planning_iterations"][arrived]
    detour = length / flown["straight"][arrived]
    return figures | {
        "flown_m": round(float(length.mean()), 2),
        "flown_std_m": round(float(length.std()), 2),
        "plans": round(float(plans.mean()), 2),
        "detour_mean": round(float(detour.mean()), 4),
        "detour_p95": round(float(np.percentile(detour, 95)), 4),
        "clearance_least_m": round(float(flown["clearance"].min()), 3),
    }


def section(document: dict[str, Any]) -> str:
    """RESULTS.md: geometry, plans, flights."""
    parts: dict[str, list[dict[str, Any]]] = {"geometry": [], "offline": [], "closed loop": []}
    for row in document["rows"]:
        parts[row["part"]].append(row)
    tolerance = document["config"]["tolerance"]
    half = document["config"]["half"]
    measured = [
        f"{g['city']}, windows: {g['windows']}, footprints: {g['footprints']}, boxes: {g['boxes']} (at most "
        f"{g['boxes_most']} in one), {100 * g['excess_share']:.1f} % more area, floors up to "
        f"{g['relief_most_m']:g} m apart, which the level ground takes away"
        for g in parts["geometry"]
    ]
    lines = [
        "### Real cities",
        "",
        f"Windows of {2 * half:g} x {2 * half:g} m, buildings as boxes that cover their footprints and exceed them by "
        f"at most {tolerance:g} m along each axis: {'; '.join(measured)}.",
    ]
    lines += [
        "",
        "| offline | problems | solvable | solved | certified | unsafe | length / geodesic | worst | A* / ours "
        "| clearance [m] | least [m] | plan [ms] | A* [ms] |",
        "|---" * 13 + "|",
    ]
    lines += [
        f"| {r['city']} | {r['problems']} | {r['solvable']} | {r['solved']} | {r['certified']} | {r['unsafe']} | "
        f"{r['length_over_geodesic_mean']:.4f} | {r['length_over_geodesic_max']:.4f} | {r['astar_over_ours_mean']:.4f} "
        f"| {r['clearance_m']:g} | {r['clearance_least_m']:g} | {r['plan_ms_median']:g} | {r['astar_ms_median']:g} |"
        for r in parts["offline"]
    ]
    below = [r["city"] for r in parts["offline"] if r["length_over_geodesic_mean"] < 1]
    if below:
        lines += [
            "",
            f"A mean below 1 ({' and '.join(below)}) is the oracle's error: fast marching between voxel centres turns "
            "the corner of a wall late, so that its geodesic is an upper estimate.",
        ]
    faster = [r["city"] for r in parts["offline"] if r["astar_ms_median"] < r["plan_ms_median"]]
    shorter = [r["city"] for r in parts["offline"] if r["astar_over_ours_mean"] < 1]
    for cities, word in ((faster, "quicker"), (shorter, "shorter")):
        if cities:
            lines += ["", f"A* is {word} than ours in {' and '.join(cities)}."]
    if parts["closed loop"]:
        lines += [
            "",
            "| closed loop | method | trials | arrived | contacts | flown [m], to within 2 m | over straight | plans "
            "| least clearance [m] |",
            "|---" * 9 + "|",
        ]
    for r in parts["closed loop"]:
        flown = f"{r['flown_m']:.1f} ± {r['flown_std_m']:.1f}" if r["arrived"] else "–"
        rest = [f"{r[key]:g}" if r["arrived"] else "–" for key in ("detour_mean", "plans", "clearance_least_m")]
        counts = f"{r['trials']} | {r['arrived']} | {r['contacts']}"
        lines.append(f"| {r['city']} | {r['method']} | {counts} | {flown} | {' | '.join(rest)} |")
    for r in parts["closed loop"]:
        if r["failures"]:
            lines += ["", f"{r['city']}, {r['method']}, did not arrive: {r['failures']}."]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main(configured(TINY))
