"""Fleets that swap places in one air, each vehicle told the others' committed motions late.

    python -m experiments.fleets --sizes 10 --worlds circle level sphere --delays 0.1      # two cores: 5 minutes
    python -m experiments.fleets --sizes 32 --seeds 1000 --batch 16                             # one GPU

Worlds: `circle` and `sphere`, opposite points in open sky: all straight ways meet in one point, but for half a metre by
which starts are moved; `level`, the circle in a layer of air of 1 m, where nobody can give way upwards; `downtown`,
`midtown` and `suburb`, pairs 50 to 80 m apart that swap, by their own LiDAR and rolling map
(`maxjax.sim.trials.swaps`). Vehicles: 5 m/s, 6 m/s², radius 0.5 m; motions keep 2 m apart.

A contact is counted by the exact distance of bodies at every physics step. Deadlocks: vehicles that did not arrive by
the end and had not moved 2 m in the last 20 s. Bounds are those of Clopper and Pearson, 95 %, of flights.

Expected: no contact, and at most one flight in a hundred that does not arrive.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import beta

from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.markdown import Document, device, table
from maxjax.core.status import Status
from maxjax.planners import Field
from maxjax.sim.loop.flight import Flight, FlightConfig, World
from maxjax.sim.loop.follow import follow
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.movers.among import Flags
from maxjax.sim.movers.avoidance import Avoidance, straight_way
from maxjax.sim.swarm.swarm_flight import SwarmLog, fly_swarm
from maxjax.sim.swarm.together import Together
from maxjax.sim.trials.swaps import Swaps, antipodal
from maxjax.sim.trials.swarm_trials import SwarmTrial, fly_swarm_in_stages, stuck
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.geoms import ground_plane
from maxjax.trajectories.online import Sampling

RESULTS = Path(__file__).parent / "results"
OPEN = ("circle", "level", "sphere")
# Radius of the circle or sphere: starts are this far apart [m], and it has at least so much [m].
_APART, _LEAST = 5.0, 20.0
_JITTER = 0.5
# Height of the middle, and the air of `level` [m].
_HEIGHT = 60.0
_LAYER = ((-1e3, -1e3, _HEIGHT - 0.5), (1e3, 1e3, _HEIGHT + 0.5))


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        worlds: of those above.
        sizes: vehicles of a fleet.
        delays: of messages [s].
        first: seed of the first fleet.
        seeds: fleets of each row.
        batch: fleets at a time, as one program; 1: one after the other, as `maxjax fly` does.
        plans: seconds that a flight may take.
        name: of the result file.
        out: where the JSON goes.
    """

    worlds: tuple[str, ...] = ("circle", "level", "sphere", "downtown")
    sizes: tuple[int, ...] = (10, 32, 128)
    delays: tuple[float, ...] = (0.0, 0.1, 0.5)
    first: int = 0
    seeds: int = 1
    batch: int = 1
    plans: int = 100
    name: str = "fleets"
    out: Path = RESULTS


TINY = Config(worlds=("circle",), sizes=(4,), delays=(0.1,), plans=14)


def main(config: Config) -> list[Row]:
    """Fly every row; save and return them."""
    rows: list[Row] = []
    for world, size, delay in itertools.product(config.worlds, config.sizes, config.delays):
        logs = _flown(world, size, Together(delay), config)
        again = f"python -m experiments.fleets --worlds {world} --sizes {size} --delays {delay:g} --seeds 1 --first"
        failed = np.flatnonzero(np.any(np.asarray(logs.flights.status) != Status.OK, axis=1))
        what: Row = {"world": world, "vehicles": size, "delay": delay}
        told = "; ".join(f"{again} {config.first + k}" for k in failed[:20]) or None
        rows.append({**what, **_figures(logs), "again": told})
        print(rows[-1], file=sys.stderr, flush=True)
        keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    return rows


def _flown(world: str, size: int, together: Together, config: Config) -> SwarmLog:
    """All fleets of a row; the batch axis leads."""
    seeds = range(config.first, config.first + config.seeds)
    flight = _flight(world, size, together, config.plans)
    many = jax.jit(jax.vmap(functools.partial(fly_swarm, config=flight, together=together)))
    logs = []
    for begin in range(0, len(seeds), config.batch):
        some = [_worlds(world, size, together, flight, seed) for seed in seeds[begin : begin + config.batch]]
        if config.batch == 1:
            logs.append(jax.tree.map(lambda x: np.asarray(x)[None], fly_swarm_in_stages(some[0], flight, together)))
        else:
            logs.append(jax.device_get(many(jax.tree.map(lambda *x: jnp.stack(x), *some))))
    joined: SwarmLog = jax.tree.map(lambda *x: np.concatenate(x), *logs)
    return joined


def _flight(world: str, size: int, together: Together, plans: int) -> FlightConfig:
    """How each vehicle flies."""
    if world not in OPEN:
        return SwarmTrial(world, 0, size, together, FlightConfig(planner=Field(), plans=plans)).flight
    return FlightConfig(
        planner=Field(),
        extensions=(Avoidance(None, choice=together.motions(), within=_LAYER if world == "level" else None),),
        shape=(33, 33, 33),
        plans=plans,
        sampling=Sampling(0.5, 512),
        stages=(open_sky, straight_way, follow),
    )


def _worlds(world: str, size: int, together: Together, flight: FlightConfig, seed: int) -> World:
    if world not in OPEN:
        return SwarmTrial(world, seed, size, together, flight).worlds()
    swaps, key = open_swaps(world, size, seed), jax.random.key(seed)
    calm = jax.tree.map(jnp.float32, Disturbances())
    ends = jnp.asarray(swaps.start, jnp.float32), jnp.asarray(swaps.goal, jnp.float32)
    each = [World(ground_plane(), ends[0][k], ends[1][k], jax.random.fold_in(key, k), calm) for k in range(size)]
    stacked: World = jax.tree.map(lambda *x: jnp.stack(x), *each)
    return stacked


def open_swaps(world: str, size: int, seed: int) -> Swaps:
    """Opposite points high above the ground, the starts moved a little."""
    sphere = world == "sphere"
    around = _APART * (math.sqrt(size / (4.0 * math.pi)) if sphere else size / (2.0 * math.pi))
    radius = max(around, _LEAST)
    swaps, middle = antipodal(size, radius, sphere=sphere), np.array([0.0, 0.0, _HEIGHT])
    moved = np.random.default_rng(seed).uniform(-_JITTER, _JITTER, swaps.start.shape)
    moved[:, 2] *= world != "level"
    return Swaps(middle + swaps.start + moved, middle + swaps.goal)


def open_sky(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """A stage in place of scans: all around the vehicle was seen free."""
    known = mapping.recentre(flight.rolling_map, flight.vehicle.position)
    return dataclasses.replace(flight, rolling_map=dataclasses.replace(known, cells=jnp.full_like(known.cells, 128)))


def _figures(logs: SwarmLog) -> Row:
    status, seconds = np.asarray(logs.flights.status), np.asarray(logs.flights.duration)
    flagged = np.asarray(logs.flights.part(Flags).any_seconds)
    ok, met, rests = status == Status.OK, np.asarray(logs.touched) >= 0, stuck(logs)
    count, arrived, contacts = status.size, int(ok.sum()), int(met.sum())
    swaps, dropped = int(np.asarray(logs.swaps).sum()), int(np.asarray(logs.dropped).sum())
    return {
        "fleets": len(status),
        "flights": count,
        "arrived": arrived,
        "at_least": _percent(beta.ppf(0.025, arrived, count - arrived + 1) if arrived else 0.0),
        "met": contacts,
        "met_at_most": _percent(1.0 if contacts == count else beta.ppf(0.975, contacts + 1, count - contacts)),
        "walls": int(((status == Status.IN_CONTACT) & ~met).sum()),
        "stuck": int(rests.sum()),
        "late": int(((status == Status.OUT_OF_PLANS) & ~rests).sum()),
        "gap_m": round(float(np.asarray(logs.gap).min()), 3),
        "seconds": round(float(seconds[ok].mean()), 2) if arrived else None,
        "slowest": round(float(seconds[ok].max()), 2) if arrived else None,
        "dropped": round(dropped / max(swaps + dropped, 1), 4),
        "flagged": round(float(flagged.sum() / seconds.sum()), 5),
    }  # fmt: skip


def _percent(share: float) -> float:
    return round(float(100.0 * share), 2)


def section(document: Document) -> str:
    """RESULTS.md: who arrives of fleets that swap places."""
    lines = []
    for row in document["rows"]:
        seconds = "–" if row["seconds"] is None else f"{row['seconds']:.1f}; {row['slowest']:.1f}"
        lines.append([
            str(row["world"]), str(row["vehicles"]), f"{1000 * row['delay']:.0f}",
            f"{row['arrived']} of {row['flights']}", f"{row['at_least']:.1f}", str(row["met"]),
            f"{row['met_at_most']:.2f}", str(row["walls"]), str(row["stuck"]), str(row["late"]),
            f"{row['gap_m']:.2f}", seconds, f"{100 * row['dropped']:.1f}", f"{100 * row['flagged']:.2f}",
        ])  # fmt: skip
    heads = ["world", "vehicles", "delay [ms]", "arrived", "at least [%]", "in contact", "at most [%]", "walls",
             "deadlocked", "late", "least gap [m]", "mean; longest [s]", "dropped [%]", "flagged [%]"]  # fmt: skip
    failures = [f"- `{one}`\n" for row in document["rows"] if row["again"] for one in str(row["again"]).split("; ")]
    return (
        f"### Fleets that swap places ({device(document)})\n\n"
        "In contact: vehicles that another one came nearer to than the sum of radii, by exact distance at every\n"
        "physics step; walls: with anything else. Deadlocked: not there after "
        f"{document['config']['plans']} s, and not 2 m from where it was\n"
        "20 s before; late: not there, but on its way. Bounds of Clopper and Pearson, 95 %, of flights. Dropped:\n"
        "share of the proposals. In all but cities straight ways meet in one point; `level` is 1 m high.\n\n"
        + table(heads, lines, left=1)
        + ("\nNot all arrived, and the command that flies them again:\n\n" + "".join(failures) if failures else "")
    )  # fmt: skip


if __name__ == "__main__":
    main(configured(TINY))
