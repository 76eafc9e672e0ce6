"""Every variant on every problem, or every condition of the closed loop: plans, verdicts and rows."""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32
from scipy import ndimage

import maxjax
from benchmarks.common.harness import Row, save
from benchmarks.common.oracle import judge
from benchmarks.common.paper import dilated
from benchmarks.common.problems import case_of, problems
from experiments.ablations.parts import Bare, bare, smooth
from experiments.ablations.variants import DEFAULT, FLIGHTS, GROUPS, Kernel, Source, Variant
from experiments.closed_loop import figures_of
from maxjax.fields.certificate import count_uncertified
from maxjax.fields.conductivity import SIGMA_FREE
from maxjax.fields.gradient import gradient
from maxjax.nn.model import load_model, predict_potential, shipped_networks
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.path.route import Route, Routes, no_route, route_of
from maxjax.planning.path.string_pulling import tighten
from maxjax.planning.plan import Plan
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.problem import Problem as Formulated
from maxjax.planning.problem.task import Task
from maxjax.planning.run.execution import complete_on_host, problem_of
from maxjax.planning.run.stages import climb
from maxjax.planning.run.verifying import verify_routes
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.trials.batches import fly_trials
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.outcomes import summarise
from maxjax.solvers.potential import Potential, solve_potential
from maxjax.ui.methods import planner_named

RESULTS = Path(__file__).parents[1] / "results"
_STEPS = 2048


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        problems: a map.
        maps: nothing was ever tuned or trained on them.
        groups: which ablations; all of `GROUPS`.
        shape: of the grid, voxels of 2 m around the origin.
        margin: of all variants but those of the margin [m].
        trained: folders that `maxjax train` left, of networks whose weights do not come with maxjax.
        seed: of cities and problems.
        closed_loop: fly the conditions of `FLIGHTS` instead.
        trials: a map and condition, in the closed loop.
        batch: flights at a time; None: what suits the device.
        keep: folder for every trial's outcome and positions.
        out: where the JSON goes.
    """

    problems: int = 50
    maps: tuple[str, ...] = ("downtown", "suburb")
    groups: tuple[str, ...] = ("smoothing", "rule", "screening", "conductivity", "margin", "kernels")
    shape: tuple[int, int, int] = (101, 101, 101)
    margin: float = 8.0
    trained: tuple[Path, ...] = ()
    seed: int = 0
    closed_loop: bool = False
    trials: int = 50
    batch: int | None = None
    keep: Path | None = None
    out: Path = RESULTS


# The other groups compile many more programs, and ask nothing else of this module.
TINY = Config(problems=1, maps=("suburb",), groups=("rule", "conductivity", "kernels"), shape=(51, 51, 33), trials=2)


def main(config: Config) -> list[Row]:
    """Run every variant on every problem, or fly every condition; save and return the rows."""
    if config.closed_loop:
        return _fly(config)
    unknown = [name for name in config.groups if name not in GROUPS]
    if unknown:
        raise ValueError(f"groups: expected some of {', '.join(GROUPS)}, given {unknown[0]!r}")
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    own = {folder.name: folder / f"{folder.name}.npz" for folder in config.trained}

    def found_weights(v: Variant) -> Variant:
        weights = own.get(v.source.network or "")
        return dataclasses.replace(v, source=dataclasses.replace(v.source, weights=weights)) if weights else v

    asked = [(group, setting, found_weights(v)) for group in config.groups for setting, v in GROUPS[group].items()]
    missing = {v for *_, v in asked if v.source.network and v.source.network not in (*own, *shipped_networks())}
    chosen = list(dict.fromkeys([DEFAULT, *(v for *_, v in asked if v not in missing)]))
    rows: list[Row] = [
        {"group": group, "setting": setting, "map": "", "left_out": "no weights are shipped"}
        for group, setting, v in asked
        if v in missing
    ]
    for name in config.maps:
        results: dict[Variant, list[Result]] = {variant: [] for variant in chosen}
        geodesics: list[float] = []
        for k, task in enumerate(problems(name, config.problems, config.seed, grid, config.margin)):
            found = run(task, chosen)
            for variant, result in found.items():
                results[variant].append(result)
            geodesics.append(grid.spacing * judge(case_of(task, found[DEFAULT].plan)).geodesic)
            print(f"{name}: {k + 1} of {config.problems}", file=sys.stderr, flush=True)
        rows += [
            {"group": group, "setting": setting, "map": name, **_figures(results[v], results[DEFAULT], geodesics)}
            for group, setting, v in asked
            if v not in missing
        ]
    save("ablations", config, rows, config.out)
    return rows


@dataclasses.dataclass(frozen=True)
class Result:
    """What a variant makes of a problem: its plan, and the length [m] climbed before it was tightened (NaN: none)."""

    plan: Plan
    climbed: float


def run(task: Task, variants: Sequence[Variant]) -> dict[Variant, Result]:
    """The plans of all variants; what they share (dilation, potential, smoothing) is computed once."""
    grid = task.grid.local
    margins = list(dict.fromkeys(task.distances.margin if v.margin is None else v.margin for v in variants))
    asked = {m: dataclasses.replace(task, distances=Distances(0.0, m)) for m in margins}
    maps = {m: dilated(asked[m]) for m in margins}
    formulated = {m: problem_of(maps[m].task) for m in margins}

    @functools.cache
    def field(source: Source, m: float) -> Potential:
        sigma = _sigma(formulated[m].blocked, formulated[m].goal_index, source.weighted, grid)
        return _potential(source, sigma, formulated[m].goal_index)

    @functools.cache
    def smoothed(source: Source, sigma: float, kernel: Kernel, m: float) -> Float[Array, "nx ny nz"]:
        return smooth(field(source, m).log_phi, ~formulated[m].blocked, sigma, kernel)

    plans: list[Plan] = []
    for v in variants:
        m = task.distances.margin if v.margin is None else v.margin
        p = formulated[m]
        if p.status != maxjax.Status.OK:
            taut = walked = no_route(p.status)
        elif v.guard == "none":
            u = smoothed(v.source, v.smoothing, v.kernel, m)
            path, status = bare(_gradient(u, ~p.blocked), ~p.blocked, p.start, p.goal, Bare(v.rule))
            sure = bool(field(v.source, m).certified) if v.smoothing == 0 else _certified(u, p.blocked, p.goal_index)
            taut = walked = Route(np.asarray(path), np.asarray(status), np.asarray(sure))
        else:
            log_phi, sure, sigma = field(v.source, m).log_phi, bool(field(v.source, m).certified), v.smoothing
            if v.guard == "smoothed":
                u = smoothed(v.source, v.smoothing, v.kernel, m)
                log_phi, sure, sigma = u, _certified(u, p.blocked, p.goal_index), 0.0
            taut, walked = _guarded(log_phi, p, Ascent(v.rule, smoothing=sigma, steps=_STEPS), sure)
        for route in (taut, walked):
            plans += maps[m].measured(
                verify_routes(Routes.of([complete_on_host(p, route)]).route, maps[m].task, "ablation")
            )
    climbed = [plan.length for plan in plans[1::2]]
    return {v: Result(plan, length) for v, plan, length in zip(variants, plans[::2], climbed, strict=True)}


_climb = jax.jit(climb, static_argnames=("settings", "room"))
_tighten = jax.jit(tighten)
_gradient = jax.jit(gradient)


@functools.cache
def _network(name: str, weights: Path | None) -> Callable[..., Potential]:
    return jax.jit(functools.partial(predict_potential, load_model(name, weights)))


_solve: Callable[..., Potential] = jax.jit(solve_potential, static_argnames=("solver",))


def _potential(source: Source, sigma: Float[Array, "nx ny nz"], goal: Int32[Array, " 3"]) -> Potential:
    if source.network:
        return _network(source.network, source.weights)(sigma, goal)
    if source.length == 0:
        return _solve(sigma, goal, solver=maxjax.PaperSetting())
    # An array, so that all lengths are one program.
    return _solve(sigma, goal, screening_length=None if source.length is None else jnp.float32(source.length))


@functools.partial(jax.jit, static_argnames=("weighted", "grid"))
def _sigma(
    blocked: Bool[Array, "nx ny nz"], goal: Int32[Array, " 3"], weighted: bool, grid: maxjax.Grid
) -> Float[Array, "nx ny nz"]:
    return maxjax.conductivity(blocked, goal, grid) if weighted else jnp.where(blocked, 0.0, SIGMA_FREE)


def _certified(u: Float[Array, "nx ny nz"], blocked: Bool[Array, "nx ny nz"], goal: Int32[Array, " 3"]) -> bool:
    labels, _ = ndimage.label(~np.asarray(blocked))
    component = labels == labels[tuple(np.asarray(goal))]
    return int(_stuck(u, jnp.asarray(component), goal)) == 0


# Heights above the least one: `uncertified` takes numbers that are not negative.
_stuck = jax.jit(lambda u, component, goal: count_uncertified(u - jnp.min(u), component, goal))


def _guarded(
    log_phi: Float[Array, "nx ny nz"], problem: Formulated, settings: Ascent, certified: bool
) -> tuple[Route, Route]:
    """The library's ascent: tightened, and as climbed."""
    ends, room = (problem.start, problem.goal), problem.room
    path, arrived, sight = _climb(log_phi, problem.blocked, *ends, settings=settings, room=room)
    if not arrived:
        nothing = no_route(maxjax.Status.PATH_STALLED, certified)
        return nothing, nothing
    return route_of(np.asarray(_tighten(sight, path)), certified), route_of(np.asarray(path), certified)


def _figures(results: Sequence[Result], defaults: Sequence[Result], geodesics: Sequence[float]) -> dict[str, Any]:
    solved = [k for k, result in enumerate(results) if result.plan.status == maxjax.Status.OK]
    # Ratios where both have a path; the geodesic is that at the margin of the default.
    both = [k for k in solved if defaults[k].plan.status == maxjax.Status.OK]
    same = [k for k in both if results[k].plan.margin == defaults[k].plan.margin]

    def figure(statistic: Callable[[Any], Any], values: Sequence[float], digits: int) -> float | None:
        known = [value for value in values if np.isfinite(value)]
        return round(float(statistic(known)), digits) if known else None

    plans = [result.plan for result in results]
    failures = Counter(plan.status.name for plan in plans if plan.status != maxjax.Status.OK)
    return {
        "problems": len(results),
        "ok": len(solved),
        "certified": sum(plan.certified for plan in plans),
        "solvable": sum(result.plan.status != maxjax.Status.NO_VALID_PATH for result in defaults),
        "failures": ", ".join(f"{status}: {count}" for status, count in sorted(failures.items())),
        "length_m": figure(np.mean, [plans[k].length for k in solved], 2),
        "over_geodesic_mean": figure(np.mean, [plans[k].length / geodesics[k] for k in same], 4),
        "over_geodesic_max": figure(np.max, [plans[k].length / geodesics[k] for k in same], 4),
        "climbed_over_geodesic_mean": figure(np.mean, [results[k].climbed / geodesics[k] for k in same], 4),
        "over_default_mean": figure(np.mean, [plans[k].length / defaults[k].plan.length for k in both], 4),
        "clearance_m": figure(np.mean, [plans[k].clearance for k in solved], 2),
        "clearance_least_m": figure(np.min, [plans[k].clearance for k in solved], 3),
        "margin_m": figure(np.mean, [plans[k].margin for k in solved], 2),
    }


def _fly(config: Config) -> list[Row]:
    """The conditions of the closed loop, over the trials of `experiments.closed_loop`."""
    rows: list[Row] = []
    for name in config.maps:
        for condition, (snapshot, gain) in FLIGHTS.items():
            flight = FlightConfig(planner=planner_named("field"), snapshot=snapshot, reactive=gain)
            campaign = Campaign(name, config.seed, range(config.trials), config=flight)
            kept = f"{name}-{'snapshot' if snapshot else 'fused'}{'-reactive' * bool(gain)}"
            folder = None if config.keep is None else config.keep / kept
            outcomes = [o for some in fly_trials(campaign, batch=config.batch, folder=folder) for o in some]
            statuses = summarise(outcomes)["statuses"]
            rows.append(
                {
                    "map": name,
                    "condition": condition,
                    "reactive_gain": gain,
                    **figures_of(outcomes),
                    "statuses": ", ".join(f"{status}: {count}" for status, count in statuses.items()),
                }
            )
            print(rows[-1], file=sys.stderr, flush=True)
    save("ablations_closed_loop", config, rows, config.out)
    return rows
