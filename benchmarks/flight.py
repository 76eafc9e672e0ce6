"""Closed-loop flights: how long one takes, how many a second, and on what the time goes.

    python -m benchmarks.flight                                              # two CPU cores: 5 minutes
    python -m benchmarks.flight --batches 50 500                             # one GPU: 10 minutes, mostly compiling
    python -m benchmarks.flight --campaign 10000                             # one GPU: 6 minutes
    python -m benchmarks.flight --batches 500 --maps suburb --devices 1 2 4  # GPUs of one host: 8 minutes

`flights` rows: the first trials of a map and seed 0, whole flights in batches of each size (fewer trials than the batch
are repeated), after compilation; `seconds` from the batch's worlds to its logs on the host. `stage` rows: the four
stages of a planning iteration in the largest batch, each by itself, after the first iterations of those flights;
milliseconds a flight. `A* in the loop`: the same trials, sensing, map, controller and safety with A* as planner, which
runs on the host, one flight after the other.

With `--campaign` or `--devices` there are only such rows, in files of their own. `campaign`: a whole campaign as
`maxjax flights` flies it, from drawing the trials to outcomes on the host, after one of another seed; and how many of
its first 500 outcomes are the same, to the millimetre, where these fly without the others. `devices`: the largest batch
on each of so many devices, all in one call (weak scaling).

Expected: on two CPU cores one flight takes 0.6 to 0.9 s.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, keep, measure, save
from maxjax.core.status import Status
from maxjax.sim.loop.flight import Flight, FlightConfig, Stage, World, stages_of, take_off
from maxjax.sim.trials.batch_size import first_size, round_up
from maxjax.sim.trials.batches import draw_trials, fly_batch, fly_trials, world_of
from maxjax.sim.trials.campaign import Campaign, outcome_of
from maxjax.sim.trials.outcomes import Outcome, Table
from maxjax.ui.methods import planner_named

_STAGES = ("sense", "fuse", "plan", "follow")
# Iterations before the stages are timed: by then the map is about as full as it gets.
_BEFORE = 3
# Flights of a campaign that fly once more without the others.
_ALONE = 500


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        maps: maps to fly in.
        batches: flights at a time, a row each.
        devices: numbers of devices, a row each, and no other rows.
        astar: trials to fly with A* as well.
        campaign: trials of a campaign, a row for each map and no other rows.
        repeats: timed runs.
        out: where the JSON goes.
    """

    maps: tuple[str, ...] = ("downtown", "suburb")
    batches: tuple[int, ...] = (1,)
    devices: tuple[int, ...] = ()
    astar: int = 0
    campaign: int = 0
    repeats: int = 2
    out: Path = RESULTS


TINY = Config(maps=("suburb",), repeats=1)


def main(config: Config, flight: FlightConfig | None = None) -> list[Row]:
    """Time flights, then stages; save and return the rows.

    Args:
        config: settings.
        flight: how to fly. None: the defaults.
    """
    flight = FlightConfig(planner=planner_named("field")) if flight is None else flight
    rows: list[Row] = []
    file = "flight_devices" if config.devices else "flight_campaign" if config.campaign else "flight"

    def add(what: str, batch: int, figures: Row) -> None:
        rows.append({"what": what, "batch": batch, **figures})
        print(rows[-1], file=sys.stderr, flush=True)
        keep(file, config, rows, config.out)

    for name in config.maps:
        campaign = Campaign(name, 0, range(max(config.batches)), config=flight)
        if config.devices:
            for count, size, figures in _scaling(campaign, config):
                add(f"devices, {name}", size, {"devices": count, **figures})
            continue
        if config.campaign:
            add(
                f"campaign, {name}",
                config.campaign,
                _campaign(dataclasses.replace(campaign, trials=range(config.campaign))),
            )
            continue
        drawn = draw_trials(campaign)
        for size in config.batches:
            add(f"flights, {name}", size, _flights(campaign, drawn, size, 1, config.repeats))
        for stage, figures in _stages(campaign, drawn, max(config.batches), config.repeats):
            add(f"stage, {name}: {stage}", max(config.batches), figures)
        if config.astar:
            searching = dataclasses.replace(flight, planner=planner_named("astar"))
            few = dataclasses.replace(campaign, trials=range(config.astar), config=searching)
            add(f"A* in the loop, {name}", config.astar, _flights(few, draw_trials(few), config.astar, 1, 1))
    save(file, config, rows, config.out)
    return rows


def _scaling(campaign: Campaign, config: Config) -> Iterator[tuple[int, int, Row]]:
    """Devices, flights and their figures, for each number of devices that there is."""
    for count in config.devices:
        if count > jax.device_count():
            print(f"{count} devices: there are {jax.device_count()}", file=sys.stderr)
            continue
        # The same flights on every device, so that all have as much to do.
        size = len(campaign.trials)
        drawn = {name: np.concatenate([values] * count) for name, values in draw_trials(campaign).items()}
        many = dataclasses.replace(campaign, trials=range(size * count))
        yield count, size * count, _flights(many, drawn, size * count, count, config.repeats)


def _campaign(campaign: Campaign) -> Row:
    """Time and outcomes of a campaign, and whether its first flights are what they are without the others."""

    def fly(one: Campaign) -> tuple[dict[int, Outcome], float]:
        started = time.perf_counter()
        outcomes = {outcome.trial: outcome for some in fly_trials(one) for outcome in some}
        return outcomes, time.perf_counter() - started

    _, first = fly(dataclasses.replace(campaign, seed=campaign.seed + 1))
    outcomes, seconds = fly(campaign)
    drawn, devices = draw_trials(campaign), jax.local_devices()
    rows = np.flatnonzero(drawn["valid"])
    size = min(first_size(campaign.flight, devices, None, print), round_up(len(rows), len(devices)))
    few = rows[: min(_ALONE, size)]
    logs = fly_batch(campaign, drawn, few, size, devices)
    alone = [outcome_of(campaign, drawn, int(row), logs, place) for place, row in enumerate(few)]
    told = ("status", "flown_length", "duration", "clearance", "planning_iterations")
    lengths = [one.flown_length or 0.0 for one in outcomes.values() if one.status == Status.OK.name]
    return {
        "seconds": round(seconds, 2),
        "first_s": round(first, 1),
        "flights_per_s": round(len(rows) / seconds, 3),
        "arrived": len(lengths),
        "flown_m": round(float(np.mean(lengths)), 2) if lengths else None,
        "alone": len(alone),
        "same": sum(all(getattr(one, x) == getattr(outcomes[one.trial], x) for x in told) for one in alone),
    }


def _flights(campaign: Campaign, drawn: Table, size: int, devices: int, repeats: int) -> Row:
    """Time and outcome of one batch."""
    rows = np.flatnonzero(drawn["valid"])[:size]
    logs: Table = {}

    def run() -> None:
        logs.update(fly_batch(campaign, drawn, rows, size, jax.devices()[:devices]))

    timing = measure(run, repeats)
    arrived = logs["status"] == Status.OK
    return {
        "seconds": round(timing.median_s, 2),
        "min": round(timing.min_s, 2),
        "max": round(timing.max_s, 2),
        "n": timing.n,
        "compile_s": round(timing.compile_s, 1),
        "flights_per_s": round(len(rows) / timing.median_s, 3),
        "arrived": int(arrived.sum()),
        "planning_iterations": round(float(logs["planning_iterations"].mean()), 2),
        "flown_m": round(float(logs["flown_length"][arrived].mean()), 2) if arrived.any() else None,
    }


def _stages(campaign: Campaign, drawn: Table, size: int, repeats: int) -> Iterator[tuple[str, Row]]:
    """Milliseconds a flight of each stage, in a batch under way."""
    valid = np.flatnonzero(drawn["valid"])[:size]
    each: list[World] = [world_of(campaign, drawn, int(row)) for row in valid]
    config = campaign.flight
    begin = functools.partial(take_off, config=config)
    # A single flight runs by itself, as `fly_batch` has it.
    many = len(each) > 1
    worlds: World = jax.tree.map(lambda *x: jnp.stack(x), *each) if many else each[0]
    flights: Flight = jax.jit(jax.vmap(begin) if many else begin)(worlds)

    def step_of(stage: Stage) -> Callable[[World, Flight], Flight]:
        return lambda world, flight: stage(world, flight, config)

    steps = map(step_of, stages_of(config))
    stages = [jax.jit(jax.vmap(step) if many else step) for step in steps]
    for _ in range(_BEFORE):
        for stage in stages:
            flights = stage(worlds, flights)
    for name, stage in zip(_STAGES, stages, strict=True):
        timing = measure(functools.partial(stage, worlds, flights), max(repeats, 3))
        milliseconds = {
            key: round(1e3 * seconds / len(valid), 3)
            for key, seconds in (("ms_per_flight", timing.median_s), ("min", timing.min_s), ("max", timing.max_s))
        }
        yield name, {**milliseconds, "n": timing.n}
        flights = stage(worlds, flights)


if __name__ == "__main__":
    main(configured(TINY))
