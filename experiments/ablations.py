"""Ablations: what each part of the planner buys, one part changed at a time.

    python -m experiments.ablations                       # 50 problems a map; an hour on two CPU cores
    python -m experiments.ablations --problems 8          # 9 minutes
    python -m experiments.ablations --closed-loop         # 50 trials a map and condition; one H200
    python -m experiments.ablations --groups kernels --trained OUT/paper_large    # weights that do not come with maxjax

Offline protocol (`experiments.random_problems`), both unseen maps. Every variant answers the same problems, and its
path is verified before the same judge. What the library leaves out on purpose is written here, in its slot:

- `plain` smoothing: the Gaussian filter of log φ without regard to walls, where walls and what no current reaches hold
  the least log φ of the rest, as zero does in a normalised field. `walls` is the library's.
- guards. `ours`: steps keep to free voxels, never to lower φ of the exact field, discrete step behind them; tightened
  (`planning.ascent`, `planning.string_pulling`). `smoothed`: the same, but φ *is* the smoothed field. `none`: the
  paper's bare ascent, x ← x + η m; it fails as soon as it enters a voxel within the margin, where there is no field (in
  the paper a reactive layer stands behind it, and the field is a network's; here it is exact).
- `uniform` conductivity: the same wherever current flows.

The paper's ascent is momentum on gradients smoothed by a plain Gaussian of 5 voxels; its predecessor's is ADAM. A field
is climbed here though it be uncertified; the library would refuse it. `certified` is about the field whose φ guards the
steps. Lengths: over the eikonal geodesic on the dilated grid (margin 8 m only) and over the default's on problems that
both solve; `climbed` is before tightening.

Expected: the default 100 % and certified. Plain smoothing fails in most problems at 1 voxel, in nearly all at 2 and 5.
Wall-aware smoothing with guards costs no success and only lengthens the climb (by a tenth at 5 voxels, 1 % after
tightening). Without guards momentum enters the margin in most problems, ADAM in all. κ = 0 is uncertified in most
problems, though the discrete step still arrives. Longer screening, longer climbs. Uniform conductivity changes little.
The paper's network alone arrives in hardly any problem, with kernels of 3³ or of up to 11³ (`paper_large`).
"""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jax import lax
from jaxtyping import Array, Bool, Float, Int32
from scipy import ndimage

import maxjax
from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, device, table
from benchmarks.common.oracle import judge
from benchmarks.common.problems import Problem, case_of, problems
from experiments.closed_loop import figures_of
from maxjax.campaigns.campaign import Campaign, fly_trials
from maxjax.campaigns.outcomes import summarise
from maxjax.fields import gradient as slope
from maxjax.fields.certificate import uncertified
from maxjax.fields.conductivity import SIGMA_FREE
from maxjax.nn.model import load_model, predict_potential, shipped
from maxjax.planning import planner
from maxjax.planning.ascent import Ascent
from maxjax.planning.planner import NO_PATH, Plan, Route, Stopwatch, climb
from maxjax.planning.problem import Problem as Posed
from maxjax.planning.problem import pose
from maxjax.planning.string_pulling import tighten
from maxjax.sim.flight import FlightConfig
from maxjax.solvers.potential import Potential, solve_potential

RESULTS = Path(__file__).parent / "results"
_STEPS = 2048
_BARE_STEPS = 4096
_ADAM_BETA2 = 0.999
_ARRIVED = 1.5  # voxels, along each axis

Rule = Literal["momentum", "adam"]
Kernel = Literal["walls", "plain"]
Guard = Literal["ours", "smoothed", "none"]


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


@dataclasses.dataclass(frozen=True)
class Source:
    """Where a potential comes from.

    Attributes:
        length: screening length [voxels]; None: what the solver chooses; 0: no leak, outer faces grounded.
        weighted: by distance to the goal, or the same everywhere.
        network: the name of one instead of the solver, alone.
        weights: its file; None: the one that comes with maxjax.
    """

    length: float | None = None
    weighted: bool = True
    network: str | None = None
    weights: Path | None = None


@dataclasses.dataclass(frozen=True)
class Variant:
    """A planner; the default is the library's.

    Attributes:
        source: of its potential.
        rule: of its ascent.
        smoothing: standard deviation [voxels].
        kernel: that smooths.
        guard: see the head of this module.
        margin: [m]; None: that of the configuration.
    """

    source: Source = Source()
    rule: Rule = "momentum"
    smoothing: float = 0.0
    kernel: Kernel = "walls"
    guard: Guard = "ours"
    margin: float | None = None


DEFAULT = Variant()
# The library's guards need the exact field, and smooth by walls only.
_KERNELS: dict[Guard, tuple[Kernel, ...]] = {
    "ours": ("walls",),
    "smoothed": ("walls", "plain"),
    "none": ("walls", "plain"),
}
_SMOOTHED = [
    Variant(smoothing=sigma, kernel=kernel, guard=guard)
    for sigma in (1.0, 2.0, 5.0)
    for guard, kernels in _KERNELS.items()
    for kernel in kernels
]
_PAPER = Variant(Source(length=0.0), "momentum", 5.0, "plain", "none")
GROUPS: dict[str, dict[str, Variant]] = {
    "smoothing": {
        "none; guards ours": DEFAULT,
        "none; guards none": Variant(guard="none"),
        **{f"σ = {v.smoothing:g}, {v.kernel}; guards {v.guard}": v for v in _SMOOTHED},
    },
    "rule": {
        "momentum; guards ours": DEFAULT,
        "ADAM; guards ours": Variant(rule="adam"),
        "momentum; guards none": Variant(guard="none"),
        "ADAM; guards none": Variant(rule="adam", guard="none"),
        "momentum, κ = 0; guards none": Variant(Source(length=0.0), guard="none"),
        "momentum, κ = 0, σ = 5 plain; guards none (the paper's)": _PAPER,
        "ADAM, κ = 0, σ = 5 plain; guards none (its predecessor's)": dataclasses.replace(_PAPER, rule="adam"),
    },
    "screening": {
        "default": DEFAULT,
        **{f"ℓ = {length} voxels": Variant(Source(length=float(length))) for length in (5, 10, 20, 50)},
        "κ = 0 (the paper's)": Variant(Source(length=0.0)),
    },
    "conductivity": {"distance-weighted": DEFAULT, "uniform": Variant(Source(weighted=False))},
    "margin": {f"{margin} m": Variant(margin=float(margin)) for margin in (0, 2, 4, 6, 8)},
    "kernels": {f"{name} alone": Variant(Source(network=name)) for name in ("paper", "paper_large")},
}
# Conditions of the closed loop: snapshot, gain of the reactive layer [m/s²].
FLIGHTS: dict[str, tuple[bool, float]] = {
    "fused map": (False, 0.0),
    "snapshot": (True, 0.0),
    "fused map, reactive layer": (False, 1.5),
    "snapshot, reactive layer (the paper's)": (True, 1.5),
}


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
    missing = {v for *_, v in asked if v.source.network and v.source.network not in (*own, *shipped())}
    chosen = list(dict.fromkeys([DEFAULT, *(v for *_, v in asked if v not in missing)]))
    rows: list[Row] = [
        {"group": group, "setting": setting, "map": "", "left_out": "no weights are shipped"}
        for group, setting, v in asked
        if v in missing
    ]
    for name in config.maps:
        results: dict[Variant, list[Result]] = {variant: [] for variant in chosen}
        geodesics: list[float] = []
        for k, problem in enumerate(problems(name, config.problems, config.seed, grid)):
            found = run(problem, chosen, config.margin, grid)
            for variant, result in found.items():
                results[variant].append(result)
            case = case_of(problem, found[DEFAULT].plan, config.margin, grid)
            geodesics.append(grid.spacing * judge(case).geodesic)
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


def run(problem: Problem, variants: Sequence[Variant], margin: float, grid: maxjax.Grid) -> dict[Variant, Result]:
    """The plans of all variants; what they share (dilation, potential, smoothing) is computed once."""
    margins = list(dict.fromkeys(margin if v.margin is None else v.margin for v in variants))
    occupied = jnp.asarray(problem.occupied | problem.ground)
    ends = jnp.asarray(problem.start), jnp.asarray(problem.goal)
    posed = {m: _pose(occupied, jnp.asarray(problem.ground), *ends, margin=m, grid=grid) for m in margins}

    @functools.cache
    def field(source: Source, m: float) -> Potential:
        sigma = _sigma(posed[m].blocked, posed[m].goal_index, source.weighted, grid)
        return _potential(source, sigma, posed[m].goal_index)

    @functools.cache
    def smoothed(source: Source, sigma: float, kernel: Kernel, m: float) -> Float[Array, "nx ny nz"]:
        return smooth(field(source, m).phi, ~posed[m].blocked, sigma, kernel)

    routes: list[Route] = []
    which: list[int] = []
    for v in variants:
        m = margin if v.margin is None else v.margin
        p = posed[m]
        if p.status != maxjax.Status.OK:
            found = Route(NO_PATH, maxjax.Status(int(p.status)), certified=False)
            walked = found
        elif v.guard == "none":
            u = smoothed(v.source, v.smoothing, v.kernel, m)
            path, status = bare(u, ~p.blocked, p.start, p.goal, v.rule)
            sure = bool(field(v.source, m).certified) if v.smoothing == 0 else _certified(u, p.blocked, p.goal_index)
            found = walked = Route(np.asarray(path), maxjax.Status(int(status)), sure)
        else:
            phi, sure, sigma = field(v.source, m).phi, bool(field(v.source, m).certified), v.smoothing
            if v.guard == "smoothed":
                u = smoothed(v.source, v.smoothing, v.kernel, m)
                phi, sure, sigma = jnp.exp(u), _certified(u, p.blocked, p.goal_index), 0.0
            found, walked = _guarded(phi, p, Ascent(v.rule, smoothing=sigma, steps=_STEPS), sure)
        routes += [found, walked]
        which += [margins.index(m)] * 2
    plans = planner.judge(
        routes,
        np.repeat(problem.start[None], len(routes), axis=0),
        np.repeat(problem.goal[None], len(routes), axis=0),
        np.asarray(which),
        [float(posed[m].margin) for m in margins],
        np.stack([np.asarray(posed[m].blocked) for m in margins]),
        np.stack([problem.occupied & ~problem.ground] * len(margins)),
        grid,
        Stopwatch(),
        "ablation",
    )
    climbed = [plan.length for plan in plans[1::2]]
    return {v: Result(plan, length) for v, plan, length in zip(variants, plans[::2], climbed, strict=True)}


_pose = jax.jit(pose, static_argnames=("margin", "grid"))
_climb = jax.jit(climb, static_argnames=("settings",))
_tighten = jax.jit(tighten)


@functools.cache
def _network(name: str, weights: Path | None) -> Callable[..., Potential]:
    return jax.jit(functools.partial(predict_potential, load_model(name, weights)))


_solve: Callable[..., Potential] = jax.jit(solve_potential, static_argnames=("setting",))


def _potential(source: Source, sigma: Float[Array, "nx ny nz"], goal: Int32[Array, " 3"]) -> Potential:
    if source.network:
        return _network(source.network, source.weights)(sigma, goal)
    if source.length == 0:
        return _solve(sigma, goal, setting="paper")
    # An array, so that all lengths are one program.
    return _solve(sigma, goal, screening_length=None if source.length is None else jnp.float32(source.length))


@functools.partial(jax.jit, static_argnames=("weighted", "grid"))
def _sigma(
    blocked: Bool[Array, "nx ny nz"], goal: Int32[Array, " 3"], weighted: bool, grid: maxjax.Grid
) -> Float[Array, "nx ny nz"]:
    return maxjax.conductivity(blocked, goal, grid) if weighted else jnp.where(blocked, 0.0, SIGMA_FREE)


@functools.partial(jax.jit, static_argnames=("sigma",))
def _aware(u: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"], sigma: float) -> Float[Array, "nx ny nz"]:
    return slope.smooth(u, free, sigma)


def smooth(
    phi: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"], sigma: float, kernel: Kernel
) -> Float[Array, "nx ny nz"]:
    """The smoothed log-potential, by the library's kernel or by the Gaussian that does not see walls."""
    u = slope.log_potential(phi)
    if kernel == "walls" or sigma == 0:
        return jnp.asarray(_aware(u, free, sigma))
    reached = np.asarray(phi) > 0
    values = np.asarray(u)
    blurred = ndimage.gaussian_filter(np.where(reached, values, values[reached].min()), sigma, mode="nearest")
    return jnp.asarray(blurred)


def _certified(u: Float[Array, "nx ny nz"], blocked: Bool[Array, "nx ny nz"], goal: Int32[Array, " 3"]) -> bool:
    labels, _ = ndimage.label(~np.asarray(blocked))
    component = labels == labels[tuple(np.asarray(goal))]
    return int(_stuck(u, jnp.asarray(component), goal)) == 0


# Heights above the least one: `uncertified` takes numbers that are not negative.
_stuck = jax.jit(lambda u, component, goal: uncertified(u - jnp.min(u), component, goal))


def _guarded(phi: Float[Array, "nx ny nz"], problem: Posed, settings: Ascent, certified: bool) -> tuple[Route, Route]:
    """The library's ascent: tightened, and as climbed."""
    path, arrived, bits = _climb(phi, problem.blocked, problem.start, problem.goal, settings=settings)
    if not arrived:
        nothing = Route(NO_PATH, maxjax.Status.PATH_STALLED, certified)
        return nothing, nothing
    taut = np.asarray(_tighten(bits, path))
    return Route(taut, maxjax.Status.OK, certified), Route(np.asarray(path), maxjax.Status.OK, certified)


@functools.partial(jax.jit, static_argnames=("rule",))
def bare(
    u: Float[Array, "nx ny nz"],
    free: Bool[Array, "nx ny nz"],
    start: Float[Array, " 3"],
    goal: Float[Array, " 3"],
    rule: Rule,
) -> tuple[Float[Array, "t 3"], Int32[Array, ""]]:
    """The ascent of `planning.ascent` without any guard: nothing keeps it out of walls, off lower ground or on the map.

    Args:
        u: log-potential, smoothed.
        free: voxels that are no walls.
        start, goal: index coordinates.
        rule: static.

    Returns:
        The path, its last point repeated, and its status: OK where it came within a voxel and a half of the goal,
        which is then its end; PATH_IN_COLLISION where it ran into a wall or off the map; PATH_STALLED where its
        steps ran out.
    """
    rate, beta = Ascent().rate, Ascent().momentum
    shape = jnp.asarray(u.shape)
    going, arrived, lost = jnp.int32(0), jnp.int32(1), jnp.int32(2)
    State = tuple[Array, Array, Array, Array, Array, Array]

    def step(state: State) -> State:
        x, m, v, k, _, path = state
        g = slope.gradient_at(u, free, x)
        if rule == "momentum":
            size = jnp.linalg.norm(g)
            m = beta * m + g / jnp.where(size > 0, size, 1)
            move = rate * m
        else:
            m = beta * m + (1 - beta) * g
            v = _ADAM_BETA2 * v + (1 - _ADAM_BETA2) * g**2
            move = rate * m / (1 - beta ** (k + 1)) / (jnp.sqrt(v / (1 - _ADAM_BETA2 ** (k + 1))) + 1e-12)
        x = x + move
        voxel = jnp.floor(x + 0.5).astype(jnp.int32)
        inside = jnp.all((voxel >= 0) & (voxel < shape))
        i, j, h = jnp.clip(voxel, 0, shape - 1)
        near = jnp.max(jnp.abs(goal - x)) <= _ARRIVED
        done = jnp.where(~inside | ~free[i, j, h], lost, jnp.where(near, arrived, going))
        return x, m, v, k + 1, done, path.at[k + 1].set(x)

    zero = jnp.zeros_like(start)
    path = jnp.broadcast_to(start, (_BARE_STEPS + 2, 3))
    first = (start, zero, zero, jnp.int32(0), going, path)
    x, _, _, k, done, path = lax.while_loop(lambda s: (s[3] < _BARE_STEPS) & (s[4] == going), step, first)
    end = jnp.where(done == arrived, goal, x)
    path = jnp.where(jnp.arange(len(path))[:, None] > k, end, path)
    statuses = [maxjax.Status.PATH_STALLED, maxjax.Status.OK, maxjax.Status.PATH_IN_COLLISION]
    return path, jnp.asarray([int(status) for status in statuses], jnp.int32)[done]


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
            flight = FlightConfig(snapshot=snapshot, reactive=gain)
            campaign = Campaign(name, config.seed, range(config.trials), "solver", flight)
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


_TITLES = {
    "smoothing": "Smoothing, with and without regard to walls",
    "rule": "Momentum and ADAM",
    "screening": "Screening length",
    "conductivity": "Conductivity",
    "margin": "Margin",
    "kernels": "Kernel sizes of the network",
}


def _ratio(value: float | None, digits: int = 3) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def section(document: Document) -> str:
    """RESULTS.md: a table for each ablation, and what it says."""
    if document["name"] == "ablations_closed_loop":
        return _section_flights(document)
    rows = [row for row in document["rows"] if row["map"]]
    config = document["config"]
    parts = [
        f"### Offline ({device(document)})\n\n"
        f"{config['problems']} problems a map, margin {config['margin']:g} m unless said. One part changed at a time;\n"
        "every path before the same verification. Climbed: length of the ascent before tightening, over the eikonal\n"
        "geodesic (between voxel centres: a taut path along faces is a little shorter); tight: after it.\n"
        "Means over a variant's own successes: who fails keeps the easier ones.\n"
        "Guards: `ours` steps by the exact field, `smoothed` by the smoothed one, `none` is the paper's bare ascent.\n"
    ]
    for group in dict.fromkeys(str(row["group"]) for row in rows):
        here = [row for row in rows if row["group"] == group]
        parts += [f"#### {_TITLES[group]}\n", table(_HEADS, map(_line, here), left=2), _said(here)]
    left = [f"{row['setting']} ({row['left_out']})" for row in document["rows"] if not row["map"]]
    return "\n".join(parts) + (f"\nLeft out: {', '.join(left)}.\n" if left else "")


_HEADS = (
    "map",
    "setting",
    "OK",
    "certified",
    "climbed / geodesic",
    "tight / geodesic",
    "length / default's",
    "length [m]",
    "mean clearance [m]",
    "least [m]",
    "mean margin [m]",
    "failed",
)


def _line(row: Mapping[str, Any]) -> list[str]:
    return [
        row["map"],
        row["setting"],
        f"{row['ok']} of {row['problems']}",
        str(row["certified"]),
        # Geodesics are known at the default's margin only.
        _ratio(row["climbed_over_geodesic_mean"] if row["group"] != "margin" else None),
        _ratio(row["over_geodesic_mean"] if "guards none" not in row["setting"] and row["group"] != "margin" else None),
        _ratio(row["over_default_mean"]),
        _ratio(row["length_m"], 1),
        _ratio(row["clearance_m"], 2),
        _ratio(row["clearance_least_m"], 2),
        _ratio(row["margin_m"], 1),
        row["failures"] or "–",
    ]


def _said(rows: Sequence[Mapping[str, Any]]) -> str:
    """A group in a sentence for each map, from its rows alone."""
    names = dict.fromkeys(row["map"] for row in rows)
    return "".join(f"{sentence}\n" for name in names for sentence in _says(name, rows))


def _says(name: str, rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    by = {row["setting"]: row for row in rows if row["map"] == name}
    solvable = next(iter(by.values()))["solvable"]
    full = {setting: row["over_default_mean"] for setting, row in by.items() if row["ok"] == solvable}
    text = f"- {name}: {len(full)} of {len(by)} settings solve all {solvable} problems that some margin solves."
    known = {setting: ratio for setting, ratio in full.items() if ratio is not None}
    if known:
        best, worst = min(known, key=known.__getitem__), max(known, key=known.__getitem__)
        # What differs by less than what is shown is no difference.
        if known[best] < 0.9995:
            text += f" Shorter than the default: `{best}`, at {known[best]:.3f} of its length."
        if known[worst] > 1.0005:
            text += f" The longest of these: `{worst}`, at {known[worst]:.3f}."
    clear = {setting: row["clearance_m"] for setting, row in by.items() if setting in full and row["clearance_m"]}
    if len(clear) > 1:
        most = max(clear, key=clear.__getitem__)
        text += f" Most clearance of these on average: `{most}`, {clear[most]:.2f} m."
    yield text


def _section_flights(document: Document) -> str:
    rows = document["rows"]
    lines = [
        [
            row["map"],
            row["condition"],
            f"{row['arrived']} of {row['trials']}",
            str(row["contacts"]),
            "–" if row["flown_m"] is None else f"{row['flown_m']:.1f} ± {row['flown_std_m']:.1f}",
            _ratio(row["plans"], 1),
            "–" if row["detour_p95"] is None else f"{row['detour_mean']:.3f} ({row['detour_p95']:.3f})",
            _ratio(row["clearance_least_m"], 2),
        ]
        for row in rows
    ]
    heads = ["map", "condition", "arrived", "contacts", "flown [m]", "plans", "flown / straight (95 %)", "least [m]"]
    said = []
    for name in dict.fromkeys(row["map"] for row in rows):
        by = {row["condition"]: row for row in rows if row["map"] == name}
        fused = by["fused map"]
        for condition, row in by.items():
            if row is not fused and None not in (row["flown_m"], fused["flown_m"]):
                said.append(
                    f"{name}, {condition}: {row['arrived']} of {row['trials']} arrive (fused map alone "
                    f"{fused['arrived']}), on {row['flown_m'] / fused['flown_m']:.3f} of the mean way."
                )
    return (
        f"### Closed loop ({device(document)})\n\n"
        "The same trials with the rolling map or with the latest scan alone, and with the reactive layer off or on "
        f"(gain {max(row['reactive_gain'] for row in rows):g} m/s²); the paper flies on a snapshot with a reactive "
        "layer.\n\n" + table(heads, lines, left=2) + "\n" + "\n".join(said) + "\n"
    )


if __name__ == "__main__":
    main(tyro.cli(Config))
