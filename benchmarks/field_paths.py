"""Paths by travel-time fields beside ours: the `field` rows of `benchmarks.potential`.

Each field is climbed from the same starts by the same ascent, tightened and verified (travel time T as
φ = exp(−T / scale)), so that only the field differs.
"""

from __future__ import annotations

import itertools
import statistics
import sys
import time
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import maxjax
from benchmarks.common.harness import Row, Timing, left_out, timed_row, timing_of
from benchmarks.common.scenes import Instance
from benchmarks.common.screened_system import Mask
from benchmarks.common.travel_time import as_potential, marching
from maxjax.fields.certificate import count_uncertified
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.path.route import Route, Routes, no_route, route_of
from maxjax.planning.path.string_pulling import tighten
from maxjax.planning.run.execution import complete_on_host
from maxjax.planning.run.stages import climb
from maxjax.planning.run.verifying import verify_routes

_climb = jax.jit(climb, static_argnames=("settings", "room"))
_tighten = jax.jit(tighten)


def rows_of(
    scene: Instance, ours: maxjax.Potential, timing: Timing, component: Mask, repeats: int
) -> tuple[dict[str, Any], list[Row]]:
    """Travel-time fields beside ours: (what to add to the row of ours, the rows of the others).

    Args:
        scene: to plan in.
        ours: the potential by maxjax.
        timing: its run time.
        component: free voxels that are joined to the goal.
        repeats: timed calls of a peer.
    """
    goal = tuple(int(i) for i in scene.problems[0].goal_index)
    fields = {"": ours.log_phi}
    times: dict[str, Timing] = {}
    rows: list[Row] = []
    for name, run in marching(component, goal).items():
        if run is None:
            rows.append(left_out(f"field, {scene.name}: {name}", "not installed"))
            continue
        seconds = []
        for _ in range(repeats):
            start = time.perf_counter()
            travel = run()
            seconds.append(time.perf_counter() - start)
        times[name] = timing_of(seconds)
        fields[name] = as_potential(travel, component, goal)
        print(f"  {name}: {times[name].median_s:.2f} s", file=sys.stderr, flush=True)
    paths = _paths(scene, fields)
    for name, spent in times.items():
        whole = jnp.asarray(component).at[goal].set(True)
        stuck = count_uncertified(fields[name], whole, scene.problems[0].goal_index)
        rows.append(
            timed_row(f"field, {scene.name}: {name}", spent, certified=bool(stuck == 0), uncertified=int(stuck))
            | {"times_ours": round(spent.median_s / timing.median_s, 2)}
            | paths[name]
        )
    return paths[""], rows


def _paths(scene: Instance, fields: Mapping[str, Array]) -> dict[str, dict[str, Any]]:
    """Climb every field from every start; figures over the starts from which all of them arrived."""
    plans: dict[str, list[tuple[maxjax.Plan, float]]] = {}
    for name, log_phi in fields.items():
        routes: list[Route] = []
        climbed: list[float] = []
        for problem in scene.problems:
            for steps in (512, 2048, 8192):
                ends = problem.start, problem.goal
                settings, room = Ascent(steps=steps), problem.room
                path, arrived, sight = _climb(log_phi, problem.blocked, *ends, settings=settings, room=room)
                if arrived:
                    break
            taut = np.asarray(_tighten(sight, path))
            route = route_of(taut, certified=False) if arrived else no_route(maxjax.Status.PATH_STALLED)
            routes.append(complete_on_host(problem, route))
            climbed.append(
                scene.task.grid.spacing * float(np.linalg.norm(np.diff(np.asarray(path), axis=0), axis=1).sum())
            )
        plans[name] = list(zip(verify_routes(Routes.of(routes).route, scene.task, name), climbed, strict=True))
    shared = [all(p[k][0].status == maxjax.Status.OK for p in plans.values()) for k in range(len(scene.task))]
    figures: dict[str, dict[str, Any]] = {}
    for name, own in plans.items():
        figures[name] = {"starts": len(own), "arrived": sum(p.status == maxjax.Status.OK for p, _ in own)}
        both = list(itertools.compress(own, shared))
        if both:
            figures[name] |= {
                "ascent_m": round(statistics.mean(climbed for _, climbed in both), 2),
                "length_m": round(statistics.mean(p.length for p, _ in both), 2),
                "clearance_m": round(statistics.mean(p.clearance for p, _ in both), 2),
                "clearance_least_m": round(min(p.clearance for p, _ in both), 2),
            }
    return figures
