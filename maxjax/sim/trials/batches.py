"""A campaign in batches over devices, kept in its folder as they finish.

Each device flies an equal part of a batch, and the last batch is filled up with copies. On an accelerator a part is one
program under `vmap`, compiled for each size. A CPU gains nothing from a second flight at a time: it flies one
after the other by the programs of `watch`, the same for any size and for the film of a flight. With a folder, the
outcomes of each batch are in its ledger before the next one flies, and a campaign that was killed is resumed from
there.

Device work runs in daemon threads (`compile.threads`): KeyboardInterrupt leaves `fly_trials` at once, between two
writes of the ledger, while a device program that runs goes on; it does not keep the process alive.
"""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jax.errors import JaxRuntimeError
from jaxtyping import Array, Float, Key

from maxjax.compile.executable import stored
from maxjax.compile.threads import concurrently, interruptible
from maxjax.sim.loop.flight import FlightConfig, FlightLog, World, fly_all_closed_loop, fly_closed_loop, watch
from maxjax.sim.trials.batch_size import first_size, halve, round_up
from maxjax.sim.trials.campaign import Campaign, outcome_of
from maxjax.sim.trials.cities import TrialSite, trials_in
from maxjax.sim.trials.given_city import GivenCity
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import Outcome, Table, on_host
from maxjax.sim.trials.trial_movers import movers_key
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.movers import Movers
from maxjax.sim.worlds.populations import Population, place_movers
from maxjax.sim.worlds.solid_distance import distance


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
        batch: flights at a time, rounded up to a multiple of the number of devices; None: see `batch_size`.
        folder: where to keep outcomes and positions; made if missing. None: nowhere.
        devices: to fly on; None: all of this host's that this process may use.
        warn: called with a sentence when a batch did not fit and is split, and when what the folder holds lacks
            positions or was flown by other sources or versions.

    Yields:
        Outcomes, one a trial in all: first those that the folder holds already, then those of trials that cannot be
        flown, then those of each batch as it finishes.

    Raises:
        ValueError: if the folder holds another campaign, or damaged files, or another process flies into it; for a
            batch below 1.
        MemoryError: if not even one flight fits.
        OSError: if the folder cannot be written.
        KeyboardInterrupt: at once, without waiting for the batch that flies; the folder is whole.
    """
    devices = jax.local_devices() if devices is None else devices
    if batch is not None and batch < 1:
        raise ValueError(f"batch: expected at least 1, given {batch}")
    ledger = None if folder is None else campaign.ledger(folder)
    with contextlib.nullcontext() if ledger is None else ledger.held():
        if ledger is not None:
            for remark in filter(None, (ledger.lost_positions, ledger.other_makers)):
                warn(remark)
        yield from _fly_missing(campaign, batch, ledger, devices, warn)


def _fly_missing(
    campaign: Campaign,
    batch: int | None,
    ledger: Ledger | None,
    devices: Sequence[jax.Device],
    warn: Callable[[str], None],
) -> Iterator[list[Outcome]]:
    """Outcomes of a ledger, then the missing ones; arguments as of `fly_trials`."""
    known = {} if ledger is None else dict(ledger.outcomes)
    if known:
        yield list(known.values())
    if len(known) == len(campaign.trials):
        return

    drawn = interruptible(lambda: draw_trials(campaign))
    invalid = [outcome_of(campaign, drawn, int(row)) for row in np.nonzero(~drawn["valid"])[0]]
    invalid = [outcome for outcome in invalid if outcome.trial not in known]
    if invalid:
        if ledger is not None:
            ledger.append(invalid)
        yield invalid
    if np.any(drawn["valid"]):
        before = None if ledger is None else ledger.batch
        size = first_size(campaign.config, devices, batch or before, warn)
        yield from _fly_drawn(campaign, drawn, size, ledger, devices, warn)


def _fly_drawn(
    campaign: Campaign,
    drawn: Table,
    size: int,
    ledger: Ledger | None,
    devices: Sequence[jax.Device],
    warn: Callable[[str], None],
) -> Iterator[list[Outcome]]:
    """Fly the valid trials that the ledger lacks, `size` or fewer at a time; arguments as of `fly_trials`."""
    rows = np.nonzero(drawn["valid"])[0]
    known = frozenset() if ledger is None else frozenset(ledger.outcomes)
    size = min(size, round_up(len(rows), len(devices)))
    first = 0
    while first < len(rows):
        if ledger is not None:
            ledger.record_batch_size(size)
        chunk = rows[first : first + size]
        indices = [campaign.trials[row] for row in chunk]
        missing = [index for index in indices if index not in known]
        if missing:
            started = time.perf_counter()
            # The whole batch though some of it be known: the composition of a batch may change its rounding.
            try:
                log = fly_batch(campaign, drawn, chunk, size, devices)
            except JaxRuntimeError as error:
                if "RESOURCE_EXHAUSTED" not in str(error):
                    raise
                size = halve(size, devices, warn)
                continue
            outcomes = [outcome_of(campaign, drawn, int(row), log, place) for place, row in enumerate(chunk)]
            outcomes = [outcome for outcome in outcomes if outcome.trial in missing]
            if ledger is not None:
                ledger.record_positions(indices, log["position"])
                ledger.append(outcomes)
                ledger.record_time(indices, time.perf_counter() - started)
            yield outcomes
        first += len(chunk)


def fly_batch(
    campaign: Campaign, drawn: Table, rows: Sequence[int] | np.ndarray, size: int, devices: Sequence[jax.Device]
) -> Table:
    """The logs of some trials.

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
    # Trials of one simulated city share its solids; in a given one, each has those around its own way.
    own = filled if isinstance(campaign.map, GivenCity) else drawn["city"][filled]
    _, first, places = np.unique(own, return_index=True, return_inverse=True)
    each = [site_of(campaign, drawn, int(row)).solids for row in filled[first]]
    geoms: Geoms = jax.tree.map(lambda *x: jnp.stack(x)[places], *each)
    keys = jax.vmap(functools.partial(jax.random.fold_in, campaign.key))(jnp.asarray(filled + campaign.trials.start))
    movers = None if campaign.movers is None else _movers(campaign, campaign.movers, drawn, filled)
    # A flight without a place to start from has ended before its first iteration: what fills up a batch costs nothing.
    start = np.where((np.arange(size) < len(rows))[:, None], drawn["start"][filled], np.nan)
    batch = geoms, jnp.asarray(start, jnp.float32), jnp.asarray(drawn["goal"][filled]), keys
    logs = _fly_split(batch, campaign.flight, devices, movers)
    if movers is not None:
        logs |= beside_movers(logs, geoms, movers)
    return {name: values[: len(rows)] for name, values in logs.items()}


def beside_movers(logs: Table, geoms: Geoms, movers: Movers) -> Table:
    """Of flights among movers, how many of these have no way, and the distance to walls in the last place [m].

    Args:
        logs: of some flights.
        geoms, movers: of their cities; the batch axis leads.
    """
    ends = np.sum(np.isfinite(logs["position"]).all(axis=-1), axis=1) - 1
    last = jnp.asarray(logs["position"][np.arange(len(ends)), ends])
    return {
        "hidden": np.sum(~np.asarray(place_movers(movers)), axis=1),
        "to_walls": np.asarray(_to_walls(geoms, last)),
    }


@stored("distance to walls")
def _to_walls(geoms: Geoms, points: Float[Array, "b 3"]) -> Float[Array, " b"]:
    return jax.vmap(distance)(geoms, points)


def _movers(campaign: Campaign, how: Population, drawn: Table, rows: Sequence[int] | np.ndarray) -> Movers:
    """The movers of some trials; of each the same, bit for bit, in any selection."""
    each = [_movers_of(campaign, how, drawn, int(row)) for row in rows]
    stacked: Movers = jax.tree.map(lambda *x: jnp.stack(x), *each)
    return stacked


def _movers_of(campaign: Campaign, how: Population, drawn: Table, row: int) -> Movers:
    """The movers of one trial."""
    key = movers_key(campaign.map, campaign.seed, campaign.trials[row])
    return site_of(campaign, drawn, row).movers(how, key)


# Geoms, start, goal and key of each flight.
_Batch = tuple[Geoms, Float[Array, "b 3"], Float[Array, "b 3"], Key[Array, " b"]]


def _fly_split(
    batch: _Batch, config: FlightConfig, devices: Sequence[jax.Device], movers: Movers | None = None
) -> Table:
    """Fly a batch, an equal part on each device: the same program everywhere, without synchronisation between devices.

    A program that spans the devices would do the same work, but XLA crashes when it compiles this one for several GPUs.
    """
    share = len(batch[1]) // len(devices)

    def part(place: int) -> Table:
        own = jax.tree.map(lambda x: x[place * share : (place + 1) * share], (batch, movers))
        (geoms, start, goal, key), moving = jax.device_put(own, devices[place])
        flown = _one_by_one if devices[place].platform == "cpu" else _fly_part
        return on_host(flown(geoms, start, goal, key, config, moving))

    # In threads, so that the devices' programs are compiled at a time as well.
    parts = list(concurrently(part, range(len(devices)), len(devices)))
    return {name: np.concatenate([logs[name] for logs in parts]) for name in parts[0]}


@stored("flights")
def _fly_part(
    geoms: Geoms,
    start: Float[Array, "b 3"],
    goal: Float[Array, "b 3"],
    key: Key[Array, " b"],
    config: FlightConfig,
    movers: Movers | None = None,
) -> FlightLog:
    """The logs of a part of a batch, in one program."""
    if len(start) == 1:
        # A batch would be twice as much to compile.
        only = jax.tree.map(lambda x: x[0], geoms), start[0], goal[0], key[0]
        given = () if movers is None else (jax.tree.map(lambda x: x[0], movers),)
        logs: FlightLog = jax.tree.map(lambda x: x[None], fly_closed_loop(*only, config, *given))
        return logs
    air = jax.tree.map(lambda x: jnp.broadcast_to(jnp.asarray(x), len(start)), config.disturbances)
    return fly_all_closed_loop(World(geoms, start, goal, key, air, movers), config)


def _one_by_one(
    geoms: Geoms,
    start: Float[Array, "b 3"],
    goal: Float[Array, "b 3"],
    key: Key[Array, " b"],
    config: FlightConfig,
    movers: Movers | None = None,
) -> FlightLog:
    """The logs of a part of a batch, flight by flight."""
    logs = []
    for k in range(len(start)):
        own, moving = jax.tree.map(lambda x, k=k: x[k], (geoms, movers))
        world = World(own, start[k], goal[k], key[k], config.disturbances, moving)
        for flight in watch(world, config):
            last = flight.log
        logs.append(last)
    stacked: FlightLog = jax.tree.map(lambda *x: jnp.stack(x), *logs)
    return stacked


def draw_trials(campaign: Campaign) -> Table:
    """The trials of a campaign, in order."""
    return on_host(trials_in(campaign.map, campaign.seed, campaign.trials))


def site_of(campaign: Campaign, drawn: Table, row: int) -> TrialSite:
    """Where one trial is flown."""
    return TrialSite(campaign.map, int(drawn["city"][row]), drawn["start"][row], drawn["goal"][row])


def world_of(campaign: Campaign, drawn: Table, row: int) -> World:
    """The world of one trial, as its flight in a batch has it."""
    key = jax.random.fold_in(campaign.key, campaign.trials[row])
    start, goal = (jnp.asarray(drawn[end][row]) for end in ("start", "goal"))
    movers = None if campaign.movers is None else _movers_of(campaign, campaign.movers, drawn, row)
    geoms = site_of(campaign, drawn, row).solids
    return World(geoms, start, goal, key, campaign.flight.disturbances, movers)
