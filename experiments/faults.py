"""Flights in which something fails: sensors, air, motors, planner and clock, each off, stuck, garbage, late, and so on.

    python -m experiments.faults --flights 4                                # two cores: an hour
    python -m experiments.faults --flights 200 --random 10000 --batch 512   # one GPU

What fails and how is the table of `maxjax.sim.faults.modes`; it begins at a time drawn from 1 to 8 s. A planner that
answers wrongly returns, of half its paths, the middle moved aside by three voxels, or points at random: nobody but the
check of every path stands between these and the vehicle. In the random flights each target fails with probability 1/3.

Counted: arrivals, contacts (exact distance at every physics step, within 0.5 m of the centre), states that are no
numbers, and times at which the vehicle was more than a voxel from any that was seen free. Bounds are those of Clopper
and Pearson, 95 %.

Expected: no number is lost, nobody flies into the unseen, and contact is made only where physics leaves no choice.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int32
from scipy.stats import beta

from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.markdown import Document, device, table, trials
from maxjax.compile.executable import Stored
from maxjax.core.rng_streams import named_key
from maxjax.core.status import Status
from maxjax.planners import Field
from maxjax.planning.path.route import Route
from maxjax.planning.planner import Planner
from maxjax.planning.problem.problem import Problem
from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.sim.faults.effects import Faults, account
from maxjax.sim.faults.modes import MEANINGLESS, Mode, Target, Unseen
from maxjax.sim.loop.flight import STAGES, FlightConfig, FlightLog, World, fly_all_closed_loop, watch
from maxjax.sim.loop.flight_state import LOG_PERIOD
from maxjax.sim.trials.trials import draw_many
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.scenes import make_scene

RESULTS = Path(__file__).parent / "results"
# When faults begin [s], and the share of targets that fail in random flights.
_ONSET = (1.0, 8.0)
_SHARE = 1.0 / 3.0
# Voxels by which the middle of a wrong path is moved, and within which points of a path of garbage lie.
_ASIDE, _ANYWHERE = 3.0, 20.0
_LIES = ("garbage", "wrong")
# A quadrotor with one of these does not stay level, whatever it is told.
_LEAVE_NO_CHOICE = (Mode.OFF, Mode.LATE)


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        flights: of each cell.
        random: flights with faults at random.
        map: to fly in.
        cells: which to fly, as "lidar-stuck"; None: all.
        first: trial.
        seed: of the first city.
        batch: flights at a time; 1: one after the other, as on a CPU.
        name: of the result file.
        out: where the JSON goes.
    """

    flights: int = 4
    random: int = 0
    map: str = "downtown"
    cells: tuple[str, ...] | None = None
    first: int = 0
    seed: int = 0
    batch: int = 1
    name: str = "faults"
    out: Path = RESULTS


TINY = Config(flights=1, map="suburb", cells=("none", "lidar-stuck"))


@dataclasses.dataclass(frozen=True)
class Liar(FieldPlanner):
    """The planner that climbs the exact field, and says something else of half the problems.

    Attributes:
        lie: "wrong", the middle of the path moved aside; "garbage", points at random around its start.
    """

    lie: str = "wrong"
    name: str = "liar"

    def route(self, problem: Problem) -> Route:
        """A route that says it is one."""
        found = super().route(problem)
        path = jnp.asarray(found.path)
        lies, side = jax.random.split(
            jax.random.wrap_key_data(jax.lax.bitcast_convert_type(problem.start[:2], jnp.uint32))
        )
        if self.lie == "wrong":
            inside = jnp.sin(jnp.pi * jnp.arange(len(path)) / (len(path) - 1))
            false = path + _ASIDE * inside[:, None] * jax.random.normal(side, (3,))
        else:
            anywhere = jax.random.uniform(side, path.shape, minval=-_ANYWHERE, maxval=_ANYWHERE)
            false = jnp.clip(path[0] + anywhere, 0.0, jnp.asarray(problem.blocked.shape) - 1.0)
            false = false.at[0].set(path[0]).at[-1].set(path[-1])
        return dataclasses.replace(found, path=jnp.where(jax.random.bernoulli(lies), false, path))


def main(config: Config, flight: FlightConfig | None = None) -> list[Row]:
    """Fly every cell; save and return a row for each.

    Args:
        config: settings.
        flight: how to fly; None: the defaults.
    """
    how = FlightConfig(planner=Field()) if flight is None else flight
    how = dataclasses.replace(how, stages=(*STAGES, account))
    rows: list[Row] = []
    for names, planner, modes in _cells(config, how.planner):
        log = _flown(config, dataclasses.replace(how, planner=planner), modes.reshape(-1, len(Target)), modes.shape[1])
        for cell, name in enumerate(names):
            own = slice(cell * modes.shape[1], (cell + 1) * modes.shape[1])
            rows.append(_row(config, name, jax.tree.map(lambda x, own=own: x[own], log), modes[cell]))
            print(rows[-1], file=sys.stderr, flush=True)
        keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    return rows


def _cells(config: Config, planner: Planner) -> Iterator[tuple[list[str], Planner, np.ndarray]]:
    """Names of cells that one planner flies, that planner, and the modes: (cells, flights, targets)."""
    pairs = {f"{t.name}-{m.name}".lower(): (t, m) for t in Target for m in Mode if _means(t, m)}
    known = ["none", *pairs, *(f"planner-{lie}" for lie in _LIES), "random"]
    for name in config.cells or ():
        if name not in known:
            raise ValueError(f"cells: expected some of {', '.join(known)}, given {name!r}")
    wanted = [name for name in known if config.cells is None or name in config.cells]
    names = [name for name in wanted if name == "none" or name in pairs]
    modes = np.zeros((len(names), config.flights, len(Target)), np.int32)
    for cell, name in enumerate(names):
        if name in pairs:
            modes[cell, :, pairs[name][0]] = pairs[name][1]
    if names:
        yield names, planner, modes
    if config.random and "random" in wanted:
        yield ["random"], planner, _at_random(config)[None]
    for lie in _LIES:
        if f"planner-{lie}" in wanted:
            assert isinstance(planner, FieldPlanner)
            liar = Liar(planner.potential, planner.ascent, planner.focus, lie=lie)
            yield [f"planner-{lie}"], liar, np.zeros((1, config.flights, len(Target)), np.int32)


def _means(target: Target, mode: Mode) -> bool:
    return mode != Mode.NONE and (target, mode) not in MEANINGLESS


def _at_random(config: Config) -> Int32[np.ndarray, "n 6"]:
    """Modes of flights in which anything may fail in any way that means something; each flight's by its trial alone."""
    choices = [[mode for mode in Mode if _means(target, mode)] for target in Target]
    rows = []
    for trial in range(config.first, config.first + config.random):
        draw = np.random.default_rng((config.seed, trial))
        rows.append([int(draw.choice(some)) if draw.random() < _SHARE else 0 for some in choices])
    return np.array(rows, np.int32)


def _flown(config: Config, how: FlightConfig, modes: Int32[np.ndarray, "n 6"], a_cell: int) -> FlightLog:
    """The logs of all flights; those of a cell fly its trials, from `first` on, by the same keys in every cell."""
    drawn = draw_many(config.map, config.seed, range(config.first, config.first + a_cell))
    onsets = [
        np.random.default_rng((config.seed, k)).uniform(*_ONSET) for k in range(config.first, config.first + a_cell)
    ]
    key = named_key(jax.random.key(config.seed), f"flights {config.map}")
    logs: list[FlightLog] = []
    for first in range(0, len(modes), config.batch):
        # The last batch is filled up with copies: another size would be another program.
        rows = np.minimum(first + np.arange(config.batch), len(modes) - 1)
        place = rows % a_cell
        cities, inverse = np.unique(np.asarray(drawn.city)[place], return_inverse=True)
        each = [_city(config.map, int(city)) for city in cities]
        worlds = World(
            jax.tree.map(lambda *x, inverse=inverse: jnp.stack(x)[inverse], *each),
            drawn.start[place],
            drawn.goal[place],
            jax.vmap(functools.partial(jax.random.fold_in, key))(jnp.asarray(config.first + place)),
            jax.tree.map(lambda _: jnp.zeros(config.batch), Disturbances()),
            extensions=(Faults(jnp.asarray(modes[rows]), jnp.asarray(np.array(onsets)[place], jnp.float32)),),
        )
        log = _fly(worlds, how)
        flown = range(first, min(first + config.batch, len(modes)))
        logs.append(jax.tree.map(lambda x, flown=flown: np.asarray(x)[: len(flown)], log))
        print(f"{flown.stop} of {len(modes)}", file=sys.stderr, flush=True)
    together: FlightLog = jax.tree.map(lambda *x: np.concatenate(x), *logs)
    return together


def _fly(worlds: World, how: FlightConfig) -> FlightLog:
    """A batch: one program on an accelerator; on a CPU a flight by itself is one after the other."""
    if len(worlds.start) > 1:
        return _FLY(worlds, how)
    *_, last = watch(jax.tree.map(lambda x: x[0], worlds), how)
    log: FlightLog = jax.tree.map(lambda x: x[None], last.log)
    return log


@functools.lru_cache(maxsize=256)
def _city(name: str, seed: int) -> Geoms:
    return make_scene(name, seed).geoms


def _row(config: Config, name: str, log: FlightLog, modes: Int32[np.ndarray, "n 6"]) -> Row:
    """What the flights of a cell came to."""
    status = np.asarray(log.status)
    steps = np.floor(np.asarray(log.duration) / LOG_PERIOD).astype(int)
    finite = np.isfinite(np.asarray(log.position)).all(axis=-1)
    lost = np.array([not row[:n].all() for row, n in zip(finite, steps, strict=True)]) | (
        status == Status.NONFINITE_STATE
    )
    arrived, contact = int(np.sum(status == Status.OK)), status == Status.IN_CONTACT
    n = len(status)
    lifting = contact & ~np.isin(modes[:, Target.MOTORS], _LEAVE_NO_CHOICE)
    blamed = Counter(_name(row) for row in modes[lifting])
    statuses = Counter(Status(int(one)).name for one in status)
    return {
        "cell": name,
        "flights": n,
        "arrived": arrived,
        "at_least": round(float(100.0 * beta.ppf(0.025, arrived, n - arrived + 1)), 1) if arrived else 0.0,
        "contacts": int(contact.sum()),
        "contacts_at_most": round(float(100.0 * beta.ppf(0.975, contact.sum() + 1, n - contact.sum())), 1)
        if contact.sum() < n
        else 100.0,
        "not_numbers": int(lost.sum()),
        "unseen": int(np.sum(np.asarray(log.part(Unseen).samples) > 0)),
        "statuses": ", ".join(f"{count} {one}" for one, count in statuses.most_common()),
        "lifting": int(lifting.sum()),
        "blamed": "; ".join(f"{count} {one}" for one, count in blamed.most_common()) or None,
        "again": "; ".join(
            f"python -m experiments.faults --map {config.map} --seed {config.seed} --cells {name} "
            f"--first {config.first + k} " + ("--flights 0 --random 1" if name == "random" else "--flights 1")
            for k in sorted(
                np.nonzero((status != Status.OK) | lost)[0], key=lambda k: (not lifting[k], not contact[k])
            )[:3]
        )
        or None,
    }


def _name(modes: Int32[np.ndarray, " 6"]) -> str:
    return " + ".join(f"{Target(t).name}-{Mode(m).name}".lower() for t, m in enumerate(modes) if m) or "none"


_FLY = Stored("flights with faults", fly_all_closed_loop)


_TITLES = {"faults_random": "Faults at random in flight"}


def section(document: Document) -> str:
    """RESULTS.md: who arrived with what fault, and what was never lost."""
    lines = [
        [
            str(row["cell"]), f"{row['arrived']} of {row['flights']}", f"{row['at_least']:.1f}", str(row["contacts"]),
            f"{row['contacts_at_most']:.1f}", str(row["not_numbers"]), str(row["unseen"]), str(row["statuses"]).lower(),
        ]
        for row in document["rows"]
    ]  # fmt: skip
    heads = ["fault", "arrived", "at least [%]", "contacts", "at most [%]", "no numbers", "unseen", "statuses"]
    failures = [
        f"- {row['cell']}: `{one}`\n"
        for row in document["rows"]
        for one in str(row["again"] or "").split("; ")[:1]
        if one
    ]
    at_random = [row for row in document["rows"] if row["cell"] == "random" and row["blamed"]]
    return (
        f"### {_TITLES.get(document['name'], 'Faults in flight')} ({device(document)})\n\n"
        f"These are {trials(document)}.\n"
        "What fails and how: the table of `sim.faults.modes`. It begins 1 to 8 s after take-off and does not end.\n"
        "No numbers: flights with a state that was none; unseen: those more than a voxel from any seen free.\n"
        "Bounds of Clopper and Pearson, 95 %. Random: each target fails with probability 1/3.\n\n"
        + table(heads, lines, left=1)
        + "".join(
            f"\nContacts at random with motors that lift: {row['lifting']} of {row['flights']}; "
            f"what failed: {row['blamed']}.\n"
            for row in at_random
        )
        + "\nThe first that did not arrive of each, and the command that flies it again:\n\n"
        + "".join(failures)
    )


if __name__ == "__main__":
    main(configured(TINY))
