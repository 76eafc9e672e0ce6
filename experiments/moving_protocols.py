"""Public protocols with movers, flown by what the vehicle sees itself: SANDO's dynamic benchmark and P2M's world.

    python -m experiments.moving_protocols --seeds 1000 --batch 500                # one GPU
    python -m experiments.moving_protocols --seeds 10                              # two cores: 40 minutes
    python -m experiments.moving_protocols --protocols p2m --seeds 20 --sights true   # 3 minutes

Worlds: `experiments.moving_worlds`. Vehicles are points with the protocols' limits, as theirs are, and are judged by
the exact distance to every box at every physics step: contact within `radius`. SANDO: 5 m/s, arrived within 0.5 m,
100 s, radius 0.1 m and 0.3 m (theirs: 0). P2M: 5 m/s, below 4 m, arrived within 1 m, 60 s, radius 0.3 m.

Sights: `lidar`, ours, 32,768 rays; `theirs`, an emulation of the protocol's own sensor (SANDO: a depth camera of 10 m
and 76 x 47 degrees, turned to where the vehicle flies; P2M: 108 x 18 rays of 10 m, -7 to 52 degrees), with noise,
drop-out and a scan that takes its time, as real ones are; `cells`, P2M's as its code has it: there each of the cells
keeps the nearest exact point of all surfaces in it, all at once, so that nothing slips between rays; here three rays
along each side of a cell, exact and at once, ten times a second (there: 50); `true`: places, velocities and shapes of
all movers within 15 m (P2M: 10 m).

Methods: `ours`; `orca` (`experiments.orca`) on the same tracks; `static`, our motions with movers as nothing but voxels
of the map, which is fused once a second.

Bounds are those of Clopper and Pearson, 95 %. Flagged: share of the time in which an assumption was known not to hold.

Expected: 200 obstacles and more than 9 of 10 arrive by the vehicle's own LiDAR, all of them by true positions.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import operator
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import beta

from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.markdown import Document, device, table
from experiments.moving_cities import counted
from experiments.moving_worlds import (
    P2M_GOAL,
    P2M_START,
    SANDO_GOAL,
    SANDO_HEIGHT,
    SANDO_MOVING,
    SANDO_START,
    filled,
    p2m,
    sando,
)
from experiments.orca import orca
from maxjax.core.status import Status
from maxjax.planners import Field
from maxjax.sim.loop.flight import FlightConfig, FlightLog, World, fly_all_closed_loop, fly_closed_loop
from maxjax.sim.loop.flight_state import LOG_PERIOD
from maxjax.sim.loop.follow import follow
from maxjax.sim.loop.sensing import fuse
from maxjax.sim.movers.among import Flags, Perception
from maxjax.sim.movers.avoidance import Avoidance, straight_way
from maxjax.sim.movers.choice import Keeping
from maxjax.sim.movers.lidar_perception import LidarPerception
from maxjax.sim.movers.local_value import Crowding
from maxjax.sim.movers.motions import MotionSet
from maxjax.sim.movers.reachable_sets import Bounds
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.movers.true_tracks import TrueTracks
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.online import Sampling

RESULTS = Path(__file__).parent / "results"
Method = Literal["ours", "orca", "static"]
Sees = Literal["lidar", "theirs", "cells", "true"]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        protocols: of those above.
        obstacles: of SANDO's benchmark.
        scenarios: of P2M's world, moving + still.
        radii: of the vehicle in SANDO's benchmark [m].
        sights: how movers are seen.
        methods: who chooses motions.
        first: seed of the first world.
        seeds: worlds of each row.
        batch: flights at a time.
        name: of the result file.
        out: where the JSON goes.
    """

    protocols: tuple[str, ...] = ("sando", "p2m")
    obstacles: tuple[int, ...] = (50, 100, 200)
    scenarios: tuple[str, ...] = ("7+7", "13+13", "25+19")
    radii: tuple[float, ...] = (0.1, 0.3)
    sights: tuple[Sees, ...] = ("lidar", "theirs", "cells", "true")
    methods: tuple[Method, ...] = ("ours", "orca", "static")
    first: int = 0
    seeds: int = 10
    batch: int = 1
    name: str = "moving_protocols"
    out: Path = RESULTS


TINY = Config(protocols=("sando",), obstacles=(20,), radii=(0.1,), sights=("true",), methods=("ours",), seeds=1)


@dataclasses.dataclass(frozen=True)
class Contest:
    """A row of the table: what is flown in, and how."""

    what: dict[str, str | float]
    config: FlightConfig
    worlds: Callable[[Sequence[int]], list[World]]  # of seeds


def main(config: Config) -> list[Row]:
    """Fly every row; save and return them. Rows that differ by their worlds alone are flown by one program."""
    rows: list[Row] = []
    for _, same in itertools.groupby(_scenes(config), lambda contest: contest.config):
        contests, began = list(same), time.perf_counter()
        flown = list(_flown(contests, config))
        took = (time.perf_counter() - began) / len(contests)
        for contest, logs in zip(contests, flown, strict=True):
            rows.append({**contest.what, **_figures(logs, contest, config), "took_s": round(took, 1)})
            print(rows[-1], file=sys.stderr, flush=True)
        keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    return rows


def _scenes(config: Config) -> Iterator[Contest]:
    for sees, method in itertools.product(config.sights, config.methods):
        if method == "static" and sees == "true":
            continue  # nothing that it could be told
        by: dict[str, str | float] = {"method": method, "sees": sees}
        if "sando" in config.protocols and sees != "cells":
            for radius, count in itertools.product(config.radii, config.obstacles):
                what = {"protocol": "sando", "scenario": f"{count}", **by, "radius": radius}
                worlds = functools.partial(_sando_worlds, count, max(config.obstacles))
                yield Contest(what, _by(method, _sando_flight(sees, radius)), worlds)
        if "p2m" in config.protocols:
            numbers = [tuple(map(int, scenario.split("+"))) for scenario in config.scenarios]
            for scenario, (moving, still) in zip(config.scenarios, numbers, strict=True):
                what = {"protocol": "p2m", "scenario": scenario, **by, "radius": 0.3}
                worlds = functools.partial(_p2m_worlds, moving, still, tuple(map(max, zip(*numbers, strict=True))))
                yield Contest(what, _by(method, _p2m_flight(sees)), worlds)


def _by(method: Method, flight: FlightConfig) -> FlightConfig:
    """The same flight by another method."""
    moving = flight.extension(Avoidance)
    if method == "orca":
        moving = dataclasses.replace(moving, chooser=orca)
    if method == "static":
        moving = dataclasses.replace(moving, perception=TrueTracks(reach=0.0, slots=1))
    return flight.with_extension(moving)


def _world(geoms: Any, movers: Any, start: Any, goal: Any, seed: int) -> World:
    return World(geoms, jnp.array(start), jnp.array(goal), jax.random.key(seed), Disturbances(), movers)


def _sando_worlds(count: int, most: int, seeds: Sequence[int]) -> list[World]:
    moving = int(SANDO_MOVING * most)
    every = (filled(*sando(count, seed), 1 + most - moving, moving) for seed in seeds)
    return [_world(*world, SANDO_START, SANDO_GOAL, seed) for world, seed in zip(every, seeds, strict=True)]


def _p2m_worlds(moving: int, still: int, most: tuple[int, int], seeds: Sequence[int]) -> list[World]:
    every = (filled(*world, 5 + most[1], most[0]) for world in p2m(moving, still, seeds))
    return [_world(*world, P2M_START, P2M_GOAL, seed) for world, seed in zip(every, seeds, strict=True)]


def _sando_flight(sees: Sees, radius: float) -> FlightConfig:
    bounds = Bounds(speed=2.0, acceleration=1.2, size=1.0, turn=0.0)
    camera = Lidar(64, 64 * 360, -23.5, 23.5, max_range=10.0, width=76.0, reports_misses=True)
    lidar = {"theirs": camera}.get(sees, Lidar())
    reach = 10.0 if sees == "theirs" else 14.0
    sight = TrackingSettings(lidar=lidar, bounds=bounds, reach=reach, near=2.0, slots=64, detections=64)
    perception: Perception = TrueTracks(reach=15.0, slots=64) if sees == "true" else LidarPerception(sight)
    moving = Avoidance(
        perception,
        bounds,
        MotionSet(4.9, 20.0, 100.0, directions=64, shares=(1.0, 0.6, 0.25), brakes=(0.2, 0.6), horizon=1.3),
        Keeping(radius=radius + 0.2, wall=radius + 0.1, comfort=1.5),
        Crowding(reach=1.8, sweeps=45, shape=(28, 28, 6), cell=3, later=0.8),
        within=((-50.0, -50.0, SANDO_HEIGHT[0]), (150.0, 50.0, SANDO_HEIGHT[1])),
    )
    return _flight(moving, lidar, radius, 0.5, seconds=100, spacing=0.3)


def _p2m_flight(sees: Sees) -> FlightConfig:
    bounds = Bounds(speed=3.6, acceleration=1.5, size=(0.55, 0.55, 4.1), turn=0.0)
    lidar = Lidar(18, 18 * 108, -7.0, 52.0, max_range=10.0, reports_misses=True) if sees == "theirs" else Lidar()
    if sees == "cells":
        lidar = Lidar(54, 54 * 324, -8.1, 53.1, 10.0, range_noise=0.0, dropout=0.0, turn=1e-3, reports_misses=True)
    sight = TrackingSettings(lidar=lidar, bounds=bounds, reach=10.0, near=2.0, slots=48, detections=48)
    perception: Perception = TrueTracks(reach=10.0, slots=48) if sees == "true" else LidarPerception(sight)
    moving = Avoidance(
        perception,
        bounds,
        MotionSet(4.9, 10.0, 1000.0, directions=64, shares=(1.0, 0.6, 0.25), brakes=(0.1, 0.3), horizon=1.0),
        Keeping(radius=0.4, wall=0.35, comfort=1.5),
        Crowding(price=20.0, reach=1.8, sweeps=45, shape=(28, 28, 6), cell=3, later=0.8),
        within=((-5.9, -16.9, 0.6), (5.9, 16.9, 3.9)),
    )
    return _flight(moving, lidar, 0.3, 1.0, seconds=60, spacing=0.2)


def _flight(
    moving: Avoidance, lidar: Lidar, radius: float, tolerance: float, *, seconds: int, spacing: float
) -> FlightConfig:
    """A point that flies motions, the straight line for a guide."""
    return FlightConfig(
        planner=Field(),
        extensions=(moving,),
        lidar=lidar,
        exact=True,
        radius=radius,
        tolerance=tolerance,
        shape=(85, 85, 25),
        spacing=spacing,
        plans=seconds,
        limits=FlightLimits(speed=5.0, acceleration=8.0),
        sampling=Sampling(0.5, 256),
        stages=(fuse, straight_way, follow),
    )


def _flown(contests: list[Contest], config: Config) -> Iterator[FlightLog]:
    """All flights of each row."""
    seeds = range(config.first, config.first + config.seeds)
    worlds = [world for contest in contests for world in contest.worlds(seeds)]
    flight = contests[0].config
    one = jax.jit(lambda w: fly_closed_loop(w.geoms, w.start, w.goal, w.key, flight, w.movers))
    many = jax.jit(functools.partial(fly_all_closed_loop, config=flight))
    logs: list[FlightLog] = []
    for begin in range(0, len(worlds), config.batch):
        batch = worlds[begin : begin + config.batch]
        if config.batch == 1:
            logs.append(jax.device_get(jax.tree.map(lambda x: x[None], one(batch[0]))))
        else:
            logs.append(jax.device_get(many(jax.tree.map(lambda *x: jnp.stack(x), *batch))))
    every: FlightLog = jax.tree.map(lambda *x: np.concatenate(x), *logs)
    rows = range(0, len(worlds), config.seeds)
    for row in rows:
        part: FlightLog = jax.tree.map(operator.itemgetter(slice(row, row + config.seeds)), every)
        yield part


def _figures(logs: FlightLog, contest: Contest, config: Config) -> Row:
    status, seconds = np.asarray(logs.status), np.asarray(logs.duration)
    flags = logs.part(Flags)
    ok, hit = status == Status.OK, status == Status.IN_CONTACT
    last = np.asarray(flags.last).max(axis=1)
    before = last >= seconds - contest.config.extension(Avoidance).choice.horizon
    then = last >= seconds - LOG_PERIOD - 0.5 * contest.config.vehicle.timestep
    count, arrived = len(status), int(ok.sum())
    again = [f"{_command(contest)} --first {config.first + k}" for k in np.flatnonzero(hit)]
    return {
        "flights": count,
        "arrived": arrived,
        "at_least": round(float(100.0 * beta.ppf(0.025, arrived, count - arrived + 1)), 1) if arrived else 0.0,
        "contacts": int(hit.sum()),
        "late": int((status == Status.OUT_OF_PLANS).sum()),
        "unflagged": int((hit & ~before).sum()),
        "unflagged_at_contact": int((hit & ~then).sum()),
        "seconds": round(float(seconds[ok].mean()), 2) if arrived else None,
        "flown_m": round(float(np.asarray(logs.flown_length)[ok].mean()), 1) if arrived else None,
        "flagged": round(float(np.asarray(flags.any_seconds).sum() / seconds.sum()), 4),
        "least_m": round(float(np.asarray(logs.clearance).min()), 3),
        "again": "; ".join(again[:20]) or None,
    }


def _command(contest: Contest) -> str:
    what = contest.what
    chosen = (
        f"--obstacles {what['scenario']} --radii {what['radius']}"
        if what["protocol"] == "sando"
        else f"--scenarios {what['scenario']}"
    )
    script = f"python -m experiments.moving_protocols --protocols {what['protocol']}"
    return f"{script} --sights {what['sees']} --methods {what['method']} {chosen} --seeds 1"


# Success there [%], by protocol and scenario, for who sees for himself and for who is told.
_THEIRS = {
    ("sando", "50"): ("95", "100"), ("sando", "100"): ("90", "100"), ("sando", "200"): ("64", "100"),
    ("p2m", "7+7"): ("95", "–"), ("p2m", "13+13"): ("65", "–"), ("p2m", "25+19"): ("40", "–"),
}  # fmt: skip
# Commands of a row that the page shows; the file holds twenty.
_SHOWN = 3
_METHODS = {"ours": "verified motions", "orca": "ORCA", "static": "movers as map"}
_SEES = {
    "lidar": "own LiDAR",
    "theirs": "the protocol's sensor",
    "cells": "P2M's sensor, exact",
    "true": "true positions",
}


def _some(commands: str) -> list[str]:
    return commands.split("; ")[:_SHOWN]


def _told(document: Document) -> str:
    """What a heading says of worlds and sights, where there is one of them."""
    told = ""
    for name, words in (("protocol", ": {}"), ("sees", ", by {}")):
        values = {str(row[name]) for row in document["rows"]}
        if len(values) == 1:
            told += words.format(*(_SEES.get(value, value.upper()) for value in values))
    return told


def section(document: Document) -> str:
    """RESULTS.md: who arrives in whose world, and what was flagged."""
    lines = []
    for row in document["rows"]:
        told = _THEIRS.get((str(row["protocol"]), str(row["scenario"])), ("–", "–"))[row["sees"] == "true"]
        seconds = "–" if row["seconds"] is None else f"{row['seconds']:.1f}"
        lines.append([
            f"{str(row['protocol']).upper()} {row['scenario']}", _METHODS[str(row["method"])], _SEES[str(row["sees"])],
            f"{row['radius']}", f"{row['arrived']} of {row['flights']}", f"{row['at_least']:.1f}", told,
            str(row["contacts"]), counted(row, "unflagged"), counted(row, "unflagged_at_contact"), str(row["late"]),
            seconds, f"{100 * row['flagged']:.1f}",
        ])  # fmt: skip
    heads = ["world", "method", "sees by", "radius [m]", "arrived", "at least [%]", "best published [%]", "contacts",
             "unflagged", "no flag then", "late", "time [s]", "flagged [%]"]  # fmt: skip
    failures = [f"- `{one}`\n" for row in document["rows"] if row["again"] for one in _some(str(row["again"]))]
    return (
        f"### Public worlds with movers{_told(document)} ({device(document)})\n\n"
        "Arrived: never within the radius of anything, by exact distance at every physics step. At least: lower bound\n"
        "of Clopper and Pearson, 95 %. Best published: SANDO (arXiv 2604.07599), with a depth camera or with true\n"
        "positions, and P2M (arXiv 2511.16372), which judge the commanded point. Unflagged: contacts before which,\n"
        "within the horizon of a motion, no assumption was known to be broken; no flag then: those at whose moment\n"
        "none was. Late: neither arrived nor in contact in time. SANDO's own tracker assumes 0.5 m/s of\n"
        "its movers, which fly at 0.77 m/s in the mean.\n\n"
        + table(heads, lines, left=3)
        + (f"\nContacts, at most {_SHOWN} a row, and the command that flies them again:\n\n" if failures else "")
        + "".join(failures)
    )


if __name__ == "__main__":
    main(configured(TINY))
