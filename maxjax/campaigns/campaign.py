"""Campaigns: the trials (map, seed, index) of a table, flown in batches and kept as they finish.

    campaign = (map, seed, trials, method, config)          outcome of trial i = f(map, seed, i, method, config)

The key of a trial's flight is folded from map, seed and index, so that it depends on no other trial. A batch is
`fly` under `vmap`, one compiled program, each device with an equal part; the last one is filled up with copies. With a
folder, each batch's outcomes are in its ledger before the next one flies, and a campaign that was killed goes on from
there.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import os
import shlex
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.errors import JaxRuntimeError
from jaxtyping import Array, Float, Key, PRNGKeyArray

from maxjax.campaigns.ledger import Ledger
from maxjax.campaigns.outcomes import INVALID_DRAW, Outcome
from maxjax.campaigns.trials import Trial, draw_many
from maxjax.core.status import Status
from maxjax.core.streams import named
from maxjax.nn.model import network_potential
from maxjax.sim import astar_finder
from maxjax.sim.disturbances import Disturbances
from maxjax.sim.flight import Flight, FlightConfig, FlightLog, World, fly, stages_of, take_off
from maxjax.sim.flight_state import Finder, climb_field, climb_prediction
from maxjax.worlds.geoms import Geoms
from maxjax.worlds.layouts import MAPS
from maxjax.worlds.scenes import make_scene

FINDERS: dict[str, Finder] = {"solver": climb_field, "network": climb_prediction, "astar": astar_finder.search}
# The arrays of a dataclass, by field, on the host.
Table = dict[str, np.ndarray]

# Measured on a GPU at 101³: a flight of a batch, and what any batch takes [B].
_FLIGHT, _PROGRAM = 70e6 / 101**3, 1e9
# Larger batches are no quicker there.
_MOST = 256
# What `maxjax fly` calls them, in its order; latency is a switch.
_OPTIONS = {
    "wind": "--wind",
    "range_noise": "--noise",
    "dropout": "--dropout",
    "dead_sector": "--dead-sector",
    "blackout": "--blackout",
    "drift": "--drift",
}


@dataclasses.dataclass(frozen=True)
class Campaign:
    """What to fly.

    Attributes:
        map: one of `MAPS`.
        seed: of the first city.
        trials: their indices.
        method: path finder, one of `FINDERS`; it takes the place of `config.find`.
        config: how to fly; its disturbances are numbers.

    Raises:
        ValueError: for what cannot be flown.
    """

    map: str
    seed: int = 0
    trials: range = range(1)
    method: str = "solver"
    config: FlightConfig = FlightConfig()  # noqa: RUF009 (frozen)

    def __post_init__(self) -> None:
        if self.map not in MAPS:
            raise ValueError(f"map: expected one of {', '.join(MAPS)}, given {self.map!r}")
        if self.method not in FINDERS:
            raise ValueError(f"method: expected one of {', '.join(FINDERS)}, given {self.method!r}")
        if self.method == "network":
            network_potential()  # whose weights may be missing
        if len(self.trials) < 1 or self.trials.step != 1 or self.trials.start < 0:
            raise ValueError(f"trials: expected at least one, from 0 on, given {self.trials}")
        if not 0 <= self.seed < 2**31:
            raise ValueError(f"seed: expected 0 to 2^31 - 1, given {self.seed}")
        for name, value in self.strengths.items():
            most = {"dropout": 1.0, "dead_sector": 360.0, "latency": 1.0}.get(name, math.inf)
            if not (math.isfinite(value) and 0 <= value <= most):
                raise ValueError(f"{name}: expected a number from 0 to {most:g}, given {value:g}")
        if not (math.isfinite(self.config.reactive) and self.config.reactive >= 0):
            raise ValueError(f"reactive: expected a number of at least 0, given {self.config.reactive:g}")

    @property
    def strengths(self) -> dict[str, float]:
        """The disturbances."""
        return {name: float(value) for name, value in dataclasses.asdict(self.config.disturbances).items()}

    @property
    def flight(self) -> FlightConfig:
        """How to fly, by this campaign's method."""
        return dataclasses.replace(self.config, find=FINDERS[self.method], disturbances=Disturbances(**self.strengths))

    @property
    def key(self) -> PRNGKeyArray:
        """Key that the keys of all its flights are folded from."""
        return named(jax.random.key(self.seed), f"flights {self.map}")

    def configuration(self) -> dict[str, Any]:
        """All that the outcomes depend on, as JSON holds it."""
        config = dataclasses.asdict(self.config)
        del config["find"]
        own = {"map": self.map, "seed": self.seed, "first": self.trials.start, "trials": len(self.trials)}
        plain: dict[str, Any] = json.loads(json.dumps({**own, "method": self.method, **config}))
        return plain

    def ledger(self, folder: Path) -> Ledger:
        """The folder that keeps it, made if missing; raises as `Ledger.open`."""
        return Ledger.open(folder, self.configuration(), self.trials)

    def command(self, trial: int) -> str:
        """The command line that flies one trial again, by itself."""
        words = ["maxjax", "fly", self.map, "--seed", str(self.seed), "--trial", str(trial)]
        if self.method != "solver":
            words += ["--method", self.method]
        for name, option in _OPTIONS.items():
            if self.strengths[name]:
                words += [option, f"{self.strengths[name]:.12g}"]
        words += ["--latency"] * bool(self.strengths["latency"]) + ["--snapshot"] * self.config.snapshot
        words += ["--reactive", f"{self.config.reactive:.12g}"] if self.config.reactive else []
        return shlex.join(words)


def fly_trials(
    campaign: Campaign,
    *,
    batch: int | None = None,
    folder: Path | None = None,
    devices: Sequence[jax.Device] | None = None,
    warn: Callable[[str], None] = lambda _: None,
) -> Iterator[list[Outcome]]:
    """Fly a campaign, or what is missing of it.

    Args:
        campaign: what to fly.
        batch: flights at a time, rounded up to a multiple of the number of devices; None: what suits the devices.
        folder: where to keep outcomes and positions; made if missing. None: nowhere.
        devices: to fly on; None: all.
        warn: is told in a sentence when a batch did not fit and is split.

    Yields:
        Outcomes, one a trial in all: first those that the folder holds already, then those of trials that cannot be
        flown, then those of each batch as it finishes.

    Raises:
        ValueError: if the folder holds another campaign, or damaged files; for a batch below 1.
        MemoryError: if not even one flight fits.
        OSError: if the folder cannot be written.
    """
    devices = jax.devices() if devices is None else devices
    if batch is not None and batch < 1:
        raise ValueError(f"batch: expected at least 1, given {batch}")
    ledger = None if folder is None else campaign.ledger(folder)
    known = {} if ledger is None else dict(ledger.outcomes)
    if known:
        yield list(known.values())
    if len(known) == len(campaign.trials):
        return

    drawn = draw_trials(campaign)
    invalid = [outcome_of(campaign, drawn, int(row)) for row in np.nonzero(~drawn["valid"])[0]]
    invalid = [outcome for outcome in invalid if outcome.trial not in known]
    if invalid:
        if ledger is not None:
            ledger.append(invalid)
        yield invalid

    rows = np.nonzero(drawn["valid"])[0]
    size = _first_batch(campaign, batch, ledger, devices, warn) if len(rows) else 1
    size = min(size, _round_up(len(rows), len(devices)))
    at = 0
    while at < len(rows):
        if ledger is not None:
            ledger.note_batch(size)
        chunk = rows[at : at + size]
        indices = [campaign.trials[row] for row in chunk]
        missing = [index for index in indices if index not in known]
        if missing:
            begun = time.perf_counter()
            # The whole batch, though some of it be known: its flights keep their company.
            try:
                log = fly_batch(campaign, drawn, chunk, size, devices)
            except JaxRuntimeError as error:
                if "RESOURCE_EXHAUSTED" not in str(error):
                    raise
                size = _halved(size, devices, warn)
                continue
            outcomes = [outcome_of(campaign, drawn, int(row), log, place) for place, row in enumerate(chunk)]
            outcomes = [outcome for outcome in outcomes if outcome.trial in missing]
            if ledger is not None:
                ledger.keep_positions(indices, log["position"])
                ledger.append(outcomes)
                ledger.note_time(indices, time.perf_counter() - begun)
            yield outcomes
        at += len(chunk)


def fly_batch(
    campaign: Campaign, drawn: Table, rows: Sequence[int] | np.ndarray, size: int, devices: Sequence[jax.Device]
) -> Table:
    """The logs of some trials; one compiled program for each `size`.

    Args:
        campaign: what to fly.
        drawn: its trials, in order.
        rows: the ones to fly, `size` at most.
        size: of the batch, a multiple of the number of devices.
        devices: to fly on.
    """
    if size % len(devices) or not 0 < len(rows) <= size:
        raise ValueError(
            f"fly_batch: expected 1 to size rows and size a multiple of {len(devices)} devices, "
            f"given {len(rows)} rows, size {size}"
        )
    filled = np.asarray([*rows, *[rows[-1]] * (size - len(rows))])
    cities, places = np.unique(drawn["city"][filled], return_inverse=True)
    each = [_city(campaign.map, int(city)) for city in cities]
    geoms: Geoms = jax.tree.map(lambda *x: jnp.stack(x)[places], *each)
    keys = jax.vmap(functools.partial(jax.random.fold_in, campaign.key))(jnp.asarray(filled + campaign.trials.start))
    world = geoms, jnp.asarray(drawn["start"][filled]), jnp.asarray(drawn["goal"][filled]), keys
    logs = _fly_split(world, campaign.flight, devices)
    return {name: values[: len(rows)] for name, values in logs.items()}


# Geoms, start, goal and key of each flight.
_Batch = tuple[Geoms, Float[Array, "b 3"], Float[Array, "b 3"], Key[Array, " b"]]


def _fly_split(batch: _Batch, config: FlightConfig, devices: Sequence[jax.Device]) -> Table:
    """Fly a batch, an equal part on each device: the same program everywhere, and none waits for another.

    A program that spans the devices would do the same work, but XLA crashes when it compiles this one for several GPUs.
    """
    share = len(batch[1]) // len(devices)

    def part(place: int) -> Table:
        mine = jax.tree.map(lambda x: x[place * share : (place + 1) * share], batch)
        return on_host(_fly_part(*jax.device_put(mine, devices[place]), config))

    # In threads, so that the devices' programs are compiled at a time as well.
    with ThreadPoolExecutor(len(devices)) as pool:
        parts = list(pool.map(part, range(len(devices))))
    return {name: np.concatenate([logs[name] for logs in parts]) for name in parts[0]}


@jax.jit
def _fly_part(
    geoms: Geoms, start: Float[Array, "b 3"], goal: Float[Array, "b 3"], key: Key[Array, " b"], config: FlightConfig
) -> FlightLog:
    """`fly` for a part of a batch."""
    if len(start) == 1:
        # Under `vmap` there would be twice as much to compile.
        only = jax.tree.map(lambda x: x[0], geoms), start[0], goal[0], key[0]
        logs: FlightLog = jax.tree.map(lambda x: x[None], fly(*only, config))
    else:
        logs = jax.vmap(fly, in_axes=(0, 0, 0, 0, None))(geoms, start, goal, key, config)
    return logs


@functools.lru_cache(maxsize=256)
def _city(name: str, seed: int) -> Geoms:
    return make_scene(name, seed).geoms


def on_host(batch: Trial | FlightLog) -> Table:
    """Its arrays by name, fetched at once."""
    return {field.name: np.asarray(getattr(batch, field.name)) for field in dataclasses.fields(batch)}


def draw_trials(campaign: Campaign) -> Table:
    """The trials of a campaign, in order."""
    return on_host(draw_many(campaign.map, campaign.seed, campaign.trials))


def world_of(campaign: Campaign, drawn: Table, row: int) -> World:
    """The world of one trial, as its flight in a batch has it."""
    key = jax.random.fold_in(campaign.key, campaign.trials[row])
    start, goal = (jnp.asarray(drawn[end][row]) for end in ("start", "goal"))
    return World(_city(campaign.map, int(drawn["city"][row])), start, goal, key, campaign.flight.disturbances)


def watch(world: World, config: FlightConfig) -> Iterator[Flight]:
    """`fly`, from the host: the flight before its first planning iteration, and after each.

    Between two of them everything that the vehicle knows can be looked at.
    """

    @jax.jit
    def iterate(world: World, flight: Flight) -> Flight:
        for stage in stages_of(config):
            flight = stage(world, flight)
        return flight

    flight = jax.jit(functools.partial(take_off, config=config))(world)
    yield flight
    while not flight.done:
        flight = iterate(world, flight)
        yield flight


def outcome_of(campaign: Campaign, drawn: Table, row: int, logs: Table | None = None, place: int = 0) -> Outcome:
    """What became of a trial.

    Args:
        campaign: whose.
        drawn: its trials.
        row: which one of them.
        logs: of a batch; None: it was not flown, since it could not be drawn.
        place: of this trial in the batch.
    """
    trial = campaign.trials[row]
    nothing = Outcome(
        trial=trial,
        city=int(drawn["city"][row]),
        status=INVALID_DRAW,
        start=None,
        goal=None,
        distance=None,
        excluded=int(drawn["excluded"][row]),
        flown_length=None,
        duration=None,
        clearance=None,
        planning_iterations=0,
        failed_plans=0,
        margins={},
        certified=None,
        command=campaign.command(trial),
    )
    if logs is None:
        return nothing

    def millimetres(value: Any) -> float | None:
        return round(float(value), 3) if math.isfinite(value) else None

    log = {name: values[place] for name, values in logs.items()}
    found = int(log["planning_iterations"]) - int(log["failed_plans"])
    margins = Counter(log["margin"][np.isfinite(log["margin"])].tolist())
    return dataclasses.replace(
        nothing,
        status=Status(int(log["status"])).name,
        start=drawn["start"][row].tolist(),
        goal=drawn["goal"][row].tolist(),
        distance=millimetres(math.dist(drawn["start"][row], drawn["goal"][row])),
        flown_length=millimetres(log["flown_length"]),
        duration=millimetres(log["duration"]),
        clearance=millimetres(log["clearance"]),
        planning_iterations=int(log["planning_iterations"]),
        failed_plans=int(log["failed_plans"]),
        margins={f"{margin:g}": count for margin, count in sorted(margins.items(), reverse=True)},
        certified=round(float(log["certified"]) / found, 4) if found else None,
    )


def _first_batch(
    campaign: Campaign,
    asked: int | None,
    ledger: Ledger | None,
    devices: Sequence[jax.Device],
    warn: Callable[[str], None],
) -> int:
    """Flights at a time to begin with: as asked, as before, or what suits the devices; no more than memory holds."""
    count, on_cpu = len(devices), devices[0].platform == "cpu"
    each, free = _FLIGHT * math.prod(campaign.config.shape), free_memory(devices[0])
    fits = count * int(max(free - _PROGRAM, 0.0) / each / (count if on_cpu else 1))
    before = None if ledger is None else ledger.batch
    if asked is None and before is None:
        # Two cores gain nothing from a second flight, and lose where one takes longer than another.
        return count if on_cpu else count * min(_MOST, max(fits // count, 1))
    size = _round_up(asked or before or 1, count)
    # A GPU's allocator says itself when it is too much. A computer would begin to swap, and then end the process.
    while on_cpu and size > count and size > fits:
        size = _halved(size, devices, warn)
    return size


def free_memory(device: jax.Device) -> float:
    """Bytes that can be had on a device."""
    stats = device.memory_stats()
    if stats and "bytes_limit" in stats:
        return float(stats["bytes_limit"] - stats["bytes_in_use"])
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError, AttributeError):
        return math.inf


def _halved(size: int, devices: Sequence[jax.Device], warn: Callable[[str], None]) -> int:
    """The next smaller batch.

    Raises:
        MemoryError: if there is none.
    """
    count = len(devices)
    free = free_memory(devices[0]) / 1e9
    if size <= count:
        raise MemoryError(f"one flight does not fit into the {free:.1f} GB free on a device; free some memory")
    smaller = max(size // 2 // count, 1) * count
    warn(f"A batch of {size} flights does not fit into {free:.1f} GB of free memory; going on with {smaller}.")
    return smaller


def _round_up(size: int, count: int) -> int:
    return -(-size // count) * count
