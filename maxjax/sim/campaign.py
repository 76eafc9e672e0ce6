"""Campaigns: the trials (map, seed, index) of a table, flown in batches and kept as they finish.

    campaign = (map, seed, trials, method, config)          outcome of trial i = f(map, seed, i, method, config)

The key of a trial's flight is folded from map, seed and index, so that it depends on no other trial. Batches are one
compiled program, `fly` under `vmap` and split over the devices; the last one is filled up with copies. With a folder,
each batch's outcomes are appended to `trials.jsonl` as whole lines and flushed to the disk; a campaign that was killed
goes on from there. Nothing in these files but `times.json` depends on the clock, so a campaign that was interrupted
leaves the same ones as one that was not.
"""

from __future__ import annotations

import dataclasses
import functools
import io
import json
import math
import os
import shlex
import statistics
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.errors import JaxRuntimeError
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float, Key, PRNGKeyArray

from maxjax.core.serialize import atomic_write, read_npz
from maxjax.core.status import Status
from maxjax.sim import astar_finder
from maxjax.sim.disturbances import Disturbances
from maxjax.sim.flight import Finder, Flight, FlightConfig, FlightLog, World, climb_field, fly, stages_of, take_off
from maxjax.sim.geoms import Geoms
from maxjax.sim.layouts import MAPS
from maxjax.sim.scenes import make_scene
from maxjax.sim.trials import Trial, draw_many

FINDERS: dict[str, Finder] = {"solver": climb_field, "astar": astar_finder.search}
# The status of a trial whose city offers no pair of ends: it is not flown, and no `Status`.
INVALID_DRAW = "INVALID_DRAW"

# The arrays of a dataclass, by field, on the host.
Table = dict[str, np.ndarray]

CONFIG, ROWS, POSITIONS, TIMES = "config.json", "trials.jsonl", "positions", "times.json"

# Measured on a GPU at 101³: a flight of a batch, and what any batch takes [B].
_FLIGHT, _PROGRAM = 70e6 / 101**3, 1e9
# Larger batches are no quicker there.
_MOST = 256
_AXIS = "flights"
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
        return jax.random.fold_in(jax.random.key(self.seed), zlib.crc32(f"flights {self.map}".encode()))

    def configuration(self) -> dict[str, Any]:
        """All that the outcomes depend on, as JSON holds it."""
        config = dataclasses.asdict(self.config)
        del config["find"]
        own = {"map": self.map, "seed": self.seed, "first": self.trials.start, "trials": len(self.trials)}
        plain: dict[str, Any] = json.loads(json.dumps({**own, "method": self.method, **config}))
        return plain

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


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of one trial: a line of `trials.jsonl`. Lengths in metres to the millimetre.

    Attributes:
        trial: its index.
        city: seed of its city.
        status: name of a `Status`, or INVALID_DRAW.
        start, goal: [m]; None where none were found.
        distance: straight from start to goal [m].
        excluded: pairs of ends passed over because no path joins them.
        flown_length: [m].
        duration: [s].
        clearance: least distance from the centre of the vehicle to any solid [m].
        planning_iterations: plans asked for.
        failed_plans: those that found no path.
        margins: number of plans by the margin that they kept [m].
        certified: share of the paths found that climbed a certified field; None where none were found.
        command: that flies it again.
    """

    trial: int
    city: int
    status: str
    start: list[float] | None
    goal: list[float] | None
    distance: float | None
    excluded: int
    flown_length: float | None
    duration: float | None
    clearance: float | None
    planning_iterations: int
    failed_plans: int
    margins: dict[str, int]
    certified: float | None
    command: str

    @property
    def arrived(self) -> bool:
        """Whether the goal was reached without contact."""
        return self.status == Status.OK.name

    @property
    def flown(self) -> bool:
        """Whether there was anything to fly."""
        return self.status != INVALID_DRAW


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
    ledger = None if folder is None else Ledger.open(folder, campaign)
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
    mesh = Mesh(np.asarray(devices), (_AXIS,))
    world = (geoms, drawn["start"][filled], drawn["goal"][filled], keys)
    placed = jax.device_put(world, NamedSharding(mesh, PartitionSpec(_AXIS)))
    logs = on_host(_flyer(mesh)(*placed, campaign.flight))
    return {name: values[: len(rows)] for name, values in logs.items()}


@functools.cache
def _flyer(mesh: Mesh) -> Callable[..., FlightLog]:
    """`fly` for a batch, each device its own part: no device waits for the flights of another."""
    split, whole = PartitionSpec(_AXIS), PartitionSpec()

    def part(
        geoms: Geoms,
        start: Float[Array, "b 3"],
        goal: Float[Array, "b 3"],
        key: Key[Array, " b"],
        config: FlightConfig,
    ) -> FlightLog:
        if len(start) == 1:
            # Under `vmap` there would be twice as much to compile.
            only = jax.tree.map(lambda x: x[0], geoms), start[0], goal[0], key[0]
            logs: FlightLog = jax.tree.map(lambda x: x[None], fly(*only, config))
        else:
            logs = jax.vmap(fly, in_axes=(0, 0, 0, 0, None))(geoms, start, goal, key, config)
        return logs

    specs = (split, split, split, split, whole)
    return jax.jit(jax.shard_map(part, mesh=mesh, in_specs=specs, out_specs=split, check_vma=False))


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
    log = {name: values[place] for name, values in logs.items()}
    found = int(log["planning_iterations"]) - int(log["failed_plans"])
    margins = Counter(log["margin"][np.isfinite(log["margin"])].tolist())
    return dataclasses.replace(
        nothing,
        status=Status(int(log["status"])).name,
        start=drawn["start"][row].tolist(),
        goal=drawn["goal"][row].tolist(),
        distance=_millimetres(math.dist(drawn["start"][row], drawn["goal"][row])),
        flown_length=_millimetres(log["flown_length"]),
        duration=_millimetres(log["duration"]),
        clearance=_millimetres(log["clearance"]),
        planning_iterations=int(log["planning_iterations"]),
        failed_plans=int(log["failed_plans"]),
        margins={f"{margin:g}": count for margin, count in sorted(margins.items(), reverse=True)},
        certified=round(float(log["certified"]) / found, 4) if found else None,
    )


def _millimetres(value: Any) -> float | None:
    return round(float(value), 3) if math.isfinite(value) else None


def summarise(campaign: Campaign, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The figures of a campaign. Means and standard deviations (of the sample as it is) are over arrivals.

    `detour` is the flown length over the straight distance, which the shortest way around the buildings exceeds.
    """
    ordered = sorted(outcomes, key=lambda outcome: outcome.trial)
    flown = [outcome for outcome in ordered if outcome.flown]
    arrived = [outcome for outcome in flown if outcome.arrived]
    detour = [float(o.flown_length) / float(o.distance) for o in arrived if o.flown_length and o.distance]
    return {
        "trials": len(ordered),
        "flown": len(flown),
        "invalid_draws": len(ordered) - len(flown),
        "successes": len(arrived),
        "success_rate": len(arrived) / len(flown) if flown else None,
        "collisions": sum(outcome.status == Status.IN_CONTACT.name for outcome in flown),
        "statuses": dict(sorted(Counter(outcome.status for outcome in ordered).items())),
        "flown_length": _mean([float(o.flown_length) for o in arrived if o.flown_length is not None]),
        "planning_iterations": _mean([float(o.planning_iterations) for o in arrived]),
        "failed_plans": sum(outcome.failed_plans for outcome in flown),
        "detour": {**_mean(detour), "p95": round(float(np.percentile(detour, 95)), 4) if detour else None},
        "clearance": {"least": min((o.clearance for o in flown if o.clearance is not None), default=None)},
        "failures": [
            {"index": outcome.trial, "status": outcome.status, "command": outcome.command}
            for outcome in flown
            if not outcome.arrived
        ],
        "configuration": campaign.configuration(),
    }


def _mean(values: list[float]) -> dict[str, float | None]:
    if not values:
        return {"mean": None, "std": None}
    return {"mean": round(statistics.fmean(values), 4), "std": round(statistics.pstdev(values), 4)}


class Ledger:
    """The folder of a campaign: what it is, the outcomes so far, positions, times.

    Attributes:
        folder: where.
        outcomes: by trial.
        batch: flights at a time when it was last flown; None for a new folder.
    """

    def __init__(self, folder: Path, campaign: Campaign, outcomes: dict[int, Outcome], batch: int | None) -> None:
        self.folder, self.campaign, self.outcomes, self.batch = folder, campaign, outcomes, batch

    @classmethod
    def open(cls, folder: Path, campaign: Campaign) -> Ledger:
        """Make the folder, or check that it holds this campaign and read what it has.

        Raises:
            ValueError: if it holds another campaign, or a damaged one.
            OSError: if it cannot be written.
        """
        (folder / POSITIONS).mkdir(parents=True, exist_ok=True)
        config, rows = folder / CONFIG, folder / ROWS
        if not config.exists():
            if rows.exists():
                raise ValueError(f"{folder}: holds {ROWS} but no {CONFIG}; choose another folder")
            ledger = cls(folder, campaign, {}, None)
            ledger._write_config()
            return ledger
        try:
            written = json.loads(config.read_text())
            before, batch = dict(written["campaign"]), written["batch"]
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{config}: expected the configuration of a campaign; choose another folder") from error
        now = campaign.configuration()
        differing = [name for name in {**before, **now} if before.get(name) != now.get(name)]
        if differing:
            name = differing[0]
            raise ValueError(
                f"{folder}: holds another campaign: {name} was {before.get(name)} there, is {now.get(name)} here; "
                "choose another folder"
            )
        return cls(folder, campaign, _read(rows, campaign), batch)

    def append(self, outcomes: Sequence[Outcome]) -> None:
        """Add whole lines, on the disk when this returns."""
        if not outcomes:
            return
        lines = "".join(json.dumps(dataclasses.asdict(o), allow_nan=False) + "\n" for o in outcomes)
        with open(self.folder / ROWS, "ab") as file:
            file.write(lines.encode())
            file.flush()
            os.fsync(file.fileno())
        self.outcomes.update({outcome.trial: outcome for outcome in outcomes})

    def keep_positions(self, trials: Sequence[int], position: Float[np.ndarray, "b t 3"]) -> None:
        """One file a batch; NaN after the end of a flight."""
        longest = int(np.isfinite(position).all(axis=-1).sum(axis=1).max())
        content = io.BytesIO()
        np.savez_compressed(content, trial=np.asarray(trials), position=position[:, :longest])
        atomic_write(self.folder / POSITIONS / f"{trials[0]:06d}.npz", content.getvalue())

    def positions(self) -> dict[int, Float[np.ndarray, "t 3"]]:
        """Positions every 0.1 s [m] of the trials that have an outcome."""
        found = {}
        for file in sorted((self.folder / POSITIONS).glob("*.npz")):
            arrays = read_npz(file)
            for trial, position in zip(arrays["trial"].tolist(), arrays["position"], strict=True):
                if trial in self.outcomes:
                    found[trial] = position[np.isfinite(position).all(axis=-1)]
        return found

    def note_batch(self, size: int) -> None:
        """Remember the size of the batches, with which a campaign goes on."""
        if size != self.batch:
            self.batch = size
            self._write_config()

    def note_time(self, trials: Sequence[int], seconds: float) -> None:
        """Add the time that a batch took; the first one of a process compiles."""
        path = self.folder / TIMES
        try:
            times = json.loads(path.read_text())["batches"]
        except (OSError, ValueError, KeyError):
            times = []
        times.append({"first": trials[0], "trials": len(trials), "seconds": round(seconds, 3)})
        atomic_write(path, json.dumps({"batches": times}) + "\n")

    def _write_config(self) -> None:
        content = {"campaign": self.campaign.configuration(), "batch": self.batch}
        atomic_write(self.folder / CONFIG, json.dumps(content, indent=2) + "\n")


def _read(path: Path, campaign: Campaign) -> dict[int, Outcome]:
    """Outcomes of a file of lines; a last one that was not written to its end is taken off."""
    if not path.exists():
        return {}
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.truncate(path, whole)
    outcomes = {}
    for number, line in enumerate(content[:whole].splitlines(), 1):
        try:
            outcome = Outcome(**json.loads(line))
        except (ValueError, TypeError) as error:
            raise ValueError(
                f"{path}: line {number} is no outcome; remove the file or choose another folder"
            ) from error
        if outcome.trial not in campaign.trials:
            raise ValueError(f"{path}: line {number} is about trial {outcome.trial}, which is not of this campaign")
        outcomes[outcome.trial] = outcome
    return outcomes


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
