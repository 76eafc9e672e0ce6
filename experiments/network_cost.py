"""What the networks cost, and what a field gains from them before it is certified.

    python -m experiments.network_cost                                                       # two CPU cores: 9 minutes
    python -m experiments.network_cost --batches 1 16 --repeats 20 --name network_cost_h200  # one H200: 1 minute
    python -m experiments.network_cost --models --maps --name network_plans                  # two cores: 3 minutes

`forward` rows: one pass over a grid of 101³ voxels, in batches. `plain` is the definition, each convolution by XLA as
it stands, in float32; `folded` what `load_model` uses on this device (kernels folded, bfloat16 on a GPU).

`certificate` rows: from a start to a field that is certified, over problems of the offline protocol: positive sweeps,
64 at most, before the solver takes over. `nothing` holds φ at the goal and next to nothing elsewhere; `analytic` is the
closed law of free space; then the networks; `solver` is the multigrid solver by itself. `by_sweeps` counts the problems
certified without it. Time is the whole potential, from conductivity to certificate, after compilation.

`plan` rows: whole plans in cities of `benchmarks.city_plan`, ends 300 voxels apart or as far as the city is: the field
plans in windows, a network the whole map, as it was trained.

Expected: a few sweeps certify what the network says on both maps, what the closed law says in the suburb; on two CPU
cores the solver by itself is two to four times quicker than the network.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int32

import maxjax
from benchmarks.city_plan import SPACING, city, ends, shape_of
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, measure, save
from benchmarks.common.markdown import Document, device, number, table
from benchmarks.common.problems import problems
from maxjax.core.grid import Grid
from maxjax.fields.conductivity import conductivity
from maxjax.fields.price import SCREENING_LENGTH, lattice_price
from maxjax.nn.architecture import CONFIGS
from maxjax.nn.autoencoder import Params, apply, apply_folded, init_params
from maxjax.nn.encoding import Known, encode
from maxjax.nn.layers import count
from maxjax.nn.model import MAX_SWEEPS, LogPotential, Model, certify_prediction, load_model, shipped_networks
from maxjax.planning.problem.problem import formulate
from maxjax.solvers.potential import Potential, solve_potential

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        models: networks; None: all whose weights come with maxjax.
        batches: scenes at a time in a forward pass.
        repeats: timed passes.
        maps: of the problems to certify.
        problems: to certify, a map.
        shape: of the grid, voxels of 2 m.
        seed: of the problems.
        cities: to plan in, NXxNYxNZ voxels.
        name: of the result file.
        remark: what else a reader should know of the run.
        out: where the JSON goes.
    """

    models: tuple[str, ...] | None = None
    batches: tuple[int, ...] = (1,)
    repeats: int = 3
    maps: tuple[str, ...] = ("downtown", "suburb")
    problems: int = 10
    shape: tuple[int, int, int] = (101, 101, 101)
    seed: int = 0
    cities: tuple[str, ...] = ("128x128x64", "384x384x64")
    name: str = "network_cost"
    remark: str = ""
    out: Path = RESULTS


TINY = Config(models=(), maps=("suburb",), problems=1, repeats=1, shape=(41, 41, 33), cities=("48x48x32",))


def nothing(known: Known) -> Float[Array, "nx ny nz"]:
    """A start that knows the goal alone: everything else as far away as a prediction can say."""
    return jnp.full(known.sigma.shape, jnp.inf)


def analytic(known: Known) -> Float[Array, "nx ny nz"]:
    """The closed law of free space, walls and prices ignored: y₀ of `nn.encoding`."""
    return encode("free", False, known)[1]


def main(config: Config) -> list[Row]:
    """Time passes, then certificates; save and return the rows."""
    models = [load_model(name) for name in (shipped_networks() if config.models is None else config.models)]
    rows: list[Row] = []
    for model in models:
        rows += _forward(model, config)
        keep(config.name, config, rows, config.out)
    for text in config.cities:
        rows += _plans(text, config.repeats)
        keep(config.name, config, rows, config.out)
    starts: dict[str, LogPotential] = {"nothing": nothing, "analytic": analytic}
    starts |= {model.name: model.log_potential for model in models}
    by: dict[str, Callable[..., Potential]] = {"solver": solve_potential}
    by |= {name: functools.partial(certify_prediction, start, max_sweeps=MAX_SWEEPS) for name, start in starts.items()}
    grid = Grid.centered((0.0, 0.0, 0.0), config.shape, 2.0)
    systems = [_systems(name, config, grid) for name in config.maps]
    for method, potential in by.items():
        solve = jax.jit(potential)
        for name, given in zip(config.maps, systems, strict=True):
            rows.append(_certificate(method, name, solve, given, config.repeats))
            print(rows[-1], file=sys.stderr)
            keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    return rows


def _forward(model: Model, config: Config) -> list[Row]:
    network = CONFIGS[model.name]
    # What time a pass takes does not depend on the weights.
    plain: Params = init_params(jax.random.key(0), network)
    folded = functools.partial(apply_folded, config=network, by=model.by)
    ways: dict[str, tuple[Callable[..., Array], Params]] = {
        "plain": (functools.partial(apply, config=network), plain),
        "folded": (folded, model.params),
    }
    rows: list[Row] = []
    for way, (function, params) in ways.items():
        run = jax.jit(function)
        for batch in config.batches:
            x = jax.random.uniform(jax.random.key(1), (batch, *config.shape, network.inputs), jnp.float32)
            time = measure(functools.partial(run, params, x), config.repeats)
            rows.append(
                {
                    "what": "forward",
                    "network": model.name,
                    "weights": count(plain),
                    "how": way,
                    "batch": batch,
                    "ms_a_scene": round(1e3 * time.median_s / batch, 3),
                    "compile_s": round(time.compile_s, 1),
                }
            )
            print(rows[-1], file=sys.stderr)
    return rows


def _plans(text: str, repeats: int) -> list[Row]:
    """Plans through a city by the field and by the network."""
    shape = shape_of(text)
    occupied, ground = city(shape)
    where = maxjax.VoxelMap.on(Grid(shape, SPACING, (0.0,) * 3), occupied, ground)
    start, goal = ends(occupied, corners=False)
    rows: list[Row] = []
    for method, planner in (("field", maxjax.Field()), ("network", maxjax.Network())):
        plan = maxjax.plan(where, start, goal, planner=planner)
        time = measure(functools.partial(maxjax.plan, where, start, goal, planner=planner), repeats)
        rows.append(
            {
                "what": "plan",
                "city": text,
                "by": method,
                "status": plan.status.name,
                "certified": plan.certified,
                "length_m": round(plan.length, 2),
                "ms_median": round(1e3 * time.median_s, 2),
            }
        )
        print(rows[-1], file=sys.stderr)
    return rows


Given = tuple[Float[Array, "nx ny nz"], Int32[Array, " 3"], Float[Array, "nx ny nz"]]


def _systems(name: str, config: Config, grid: Grid) -> list[Given]:
    """Conductivity, goal and price of each problem, as the planner takes them."""
    given: list[Given] = []
    for task in problems(name, config.problems, config.seed, grid):
        maps = jnp.asarray(task.barred), jnp.asarray(task.kept_off)
        found = formulate(*maps, jnp.asarray(task.ends[0]), task.distances, grid.local)
        price = jnp.ones(grid.shape) if found.price is None else lattice_price(found.price, SCREENING_LENGTH)
        given.append((conductivity(found.blocked, found.goal_index, grid), found.goal_index, price))
    return given


def _certificate(method: str, name: str, solve: Callable[..., Potential], given: list[Given], repeats: int) -> Row:
    times, sweeps, certified, by_sweeps = [], [], 0, 0
    for each in given:
        found = solve(*each)
        times.append(measure(functools.partial(solve, *each), repeats).median_s)
        certified += bool(found.certified)
        by_sweeps += bool(found.certified) and int(found.iterations) == 0 and method != "solver"
        sweeps.append(int(found.sweeps))
    return {
        "what": "certificate",
        "from": method,
        "map": name,
        "problems": len(given),
        "certified": certified,
        "by_sweeps": by_sweeps,
        "sweeps_median": float(np.median(sweeps)),
        "ms_median": round(1e3 * float(np.median(times)), 2),
        "ms_max": round(1e3 * float(np.max(times)), 2),
    }


# The paper, section IV: a forward pass of its network [ms].
_PAPER = 95.0


def section(document: Document) -> str:
    """RESULTS.md: forward passes, then the way to the certificate from every start."""
    rows = document["rows"]
    passes = [
        [
            str(row["network"]),
            f"{row['weights']:,}",
            str(row["how"]),
            str(row["batch"]),
            number(row["ms_a_scene"]),
        ]
        for row in rows
        if row["what"] == "forward"
    ]
    ways = [
        [
            str(row["map"]),
            str(row["from"]),
            f"{row['certified']} of {row['problems']}",
            "" if row["from"] == "solver" else f"{row['by_sweeps']} of {row['problems']}",
            "" if row["from"] == "solver" else f"{row['sweeps_median']:g}",
            f"{number(row['ms_median'])} ({number(row['ms_max'])})",
        ]
        for row in sorted(rows, key=lambda row: str(row.get("map")))
        if row["what"] == "certificate"
    ]
    plans = [
        [
            str(row["city"]).replace("x", " × "),
            str(row["by"]),
            str(row["status"]),
            number(row["length_m"]),
            number(row["ms_median"]),
        ]
        for row in rows
        if row["what"] == "plan"
    ]
    remark = document["config"].get("remark")
    parts = [
        f"### {'What the networks cost and add' if passes else 'Whole plans by the network'} ({device(document)})\n"
    ]
    if passes:
        parts += [
            "A forward pass over 101³ voxels; plain: convolutions as they are defined, by XLA; folded: what maxjax "
            "uses.\n"
            f"The paper states {_PAPER:.0f} ms for its network on its machine.\n",
            table(["network", "weights", "how", "batch", "ms a scene"], passes),
        ]
    if ways:
        parts += [
            "To a certified field: positive sweeps, 64 at most, before the solver takes over; `solver` is\n"
            "the solver by itself. Time of the whole potential, median (largest), after compilation.\n"
            + (f"{remark}\n" if remark else ""),
            table(["map", "start", "certified", "by sweeps alone", "sweeps, median", "ms"], ways, left=2),
        ]
    if plans:
        parts += [
            "Through cities of `benchmarks.city_plan`, median, after compilation: the field in windows, the network\n"
            "over the whole map.\n",
            table(["city, voxels", "by", "status", "m", "ms"], plans, left=3),
        ]
    return "\n".join(parts)


if __name__ == "__main__":
    main(configured(TINY))
