"""A replanner among movers on board: ten scans a second in, a motion out, in a simulated city.

    python -m benchmarks.onboard_movers            # two cores: a few minutes, with compiling
    python -m benchmarks.onboard_movers --movers 30 --speed 8

A vehicle flies the motions that `maxjax.Replanner` commits it to through a downtown that it does not know, by clouds of
its simulated LiDAR: points in the frame of the sensor, in no order. Calls alone are timed, from the points to the
motion. `wall` is the time of a clock; `cpu` that of all threads of the process, which others on the same cores do not
lengthen much. Contacts are counted by the exact distance to all solids every hundredth of a second.

Expected: no compilation, no contact. Asked for on two cores is 60 ms or less in 99 of 100 calls, with ten movers; the
calls that tell the map of a scan, or plan, are the longest.
"""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64, PRNGKeyArray

from benchmarks.common.command import configured
from benchmarks.common.compilations import compilations
from benchmarks.common.harness import RESULTS, Row, save
from maxjax import Distances, Grid, MoverSettings, Replanned, Replanner, SensorScan
from maxjax.compile.executable import stored
from maxjax.core.grid import Index3, Point3
from maxjax.sim.movers.lookout import ON_BOARD
from maxjax.sim.movers.reachable_sets import Bounds
from maxjax.sim.sensors.lidar import Lidar, directions, scan
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.movers import Movers, Moving, solids_at
from maxjax.sim.worlds.populations import Population, population
from maxjax.sim.worlds.scenes import make_scene
from maxjax.sim.worlds.solid_distance import distance

_ARRIVED = 2.0  # [m]
_STEPS = 10  # places a period at which contact is looked for


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        city: seed of the simulated downtown.
        start, goal: [m].
        center: middle of the grid [m].
        shape: of the grid [voxels].
        spacing: of its voxels [m].
        radius, margin: that plans keep [m].
        movers: drones.
        speed: of them [m/s].
        period: from one scan to the next [s].
        flights: with movers of their own.
        cycles: of a flight at most.
        out: where the JSON goes.
    """

    city: int = 0
    start: Point3 = (-68.0, 2.0, 6.8)
    goal: Point3 = (4.0, 6.0, 6.5)
    center: Point3 = (-32.0, 4.0, 38.0)
    shape: Index3 = (101, 101, 41)
    spacing: float = 2.0
    radius: float = 1.0
    margin: float = 8.0
    movers: int = 10
    speed: float = 5.0
    period: float = 0.1
    flights: int = 3
    cycles: int = 400
    out: Path = RESULTS


TINY = Config(cycles=3, flights=1)


@dataclasses.dataclass(frozen=True)
class SimulatedWorld:
    """Solids, movers and a sensor, for a vehicle that is where its motion is.

    Attributes:
        geoms: at rest.
        movers: the others.
        lidar: the sensor.
        seed: of its noise, and of the order of its points.
    """

    geoms: Geoms
    movers: Movers
    lidar: Lidar
    seed: int = 0

    def scan_at(self, place: Float64[np.ndarray, " 3"], when: float, number: int) -> Float64[np.ndarray, "n 3"]:
        """Returns of a level sensor in its own frame [m], in no order; beams without one are left out."""
        key = jax.random.fold_in(jax.random.key(self.seed), number)
        far = np.asarray(_scan(self.geoms, self.movers, _f32(place), key, _f32(when), lidar=self.lidar))
        hit = np.isfinite(far)
        points = far[hit, None].astype(np.float64) * np.asarray(directions(self.lidar), np.float64)[hit]
        return np.random.default_rng([self.seed, number]).permutation(points)

    def gap(self, places: Float64[np.ndarray, "n 3"], times: Float64[np.ndarray, " n"]) -> float:
        """The least exact distance from places to all solids as they are then [m]."""
        return float(_gap(self.geoms, self.movers, _f32(places), _f32(times)))


@dataclasses.dataclass(frozen=True, eq=False)
class Cycle:
    """One call, where the vehicle was, how near solids came until the next [m], and what it took on processors [s]."""

    found: Replanned
    place: Float64[np.ndarray, " 3"]
    gap: float
    processor: float


def fly_cycles(
    replanner: Replanner, world: SimulatedWorld, start: Point3, goal: Point3, deadline: float, period: float = 0.1
) -> Iterator[Cycle]:
    """Fly the motions that a warm replanner commits a vehicle to, call by call, until it arrives.

    Args:
        replanner: whose calls these are.
        world: that the vehicle is in.
        start, goal: [m].
        deadline: of a call [s].
        period: from one scan to the next [s].
    """
    now, place, velocity, number = 0.0, np.array(start), np.zeros(3), 0
    while np.linalg.norm(place - goal) > _ARRIVED:
        points = world.scan_at(place, now, number)
        given = SensorScan(points, place, np.eye(3), velocity, now)
        began = time.process_time()
        found = replanner.replan(given, place, goal, deadline)
        processor = time.process_time() - began
        assert found.traffic is not None
        times = now + period * np.arange(1, _STEPS + 1) / _STEPS
        flown = found.traffic.motion.at(times)
        yield Cycle(found, place, world.gap(flown.positions, times), processor)
        now, number = now + period, number + 1
        place, velocity = flown.positions[-1], flown.velocities[-1]


def main(config: Config) -> list[Row]:
    """Fly; save and return a row a flight, and one of all."""
    lidar = Lidar()
    bounds = Bounds(speed=1.1 * config.speed, acceleration=2.2)
    grid = Grid.centered(config.center, config.shape, config.spacing)
    settings = MoverSettings(dataclasses.replace(ON_BOARD, lidar=lidar, bounds=bounds))
    replanner = Replanner(grid, distances=Distances(config.radius, config.margin), movers=settings)
    began = time.perf_counter()
    replanner.warmup()
    warm = time.perf_counter() - began
    geoms = make_scene("downtown", config.city).geoms
    rows: list[Row] = []
    everything: list[Cycle] = []
    compiled_in_all = 0
    for flight in range(config.flights):
        how = Population(config.movers, config.speed, "drones")
        movers = population(geoms, _f32(config.start), _f32(config.goal), jax.random.key(flight), how=how)
        world = SimulatedWorld(geoms, movers, lidar, flight)
        world.gap(np.tile(config.start, (_STEPS, 1)), np.zeros(_STEPS))
        world.scan_at(np.array(config.start), 0.0, 0)  # compiled before it counts
        replanner.warmup()  # forgets the flight before
        with compilations() as compiled:
            flight_cycles = fly_cycles(replanner, world, config.start, config.goal, config.period, config.period)
            cycles = list(itertools.islice(flight_cycles, config.cycles))
        rows.append({"flight": str(flight), **_figures(cycles, len(compiled), config)})
        everything += cycles
        compiled_in_all += len(compiled)
    rows.append({"flight": "all", **_figures(everything, compiled_in_all, config), "warmup_s": round(warm, 1)})
    save("onboard_movers", config, rows, config.out)
    return rows


def _figures(cycles: list[Cycle], compiled: int, config: Config) -> dict[str, Any]:
    wall = 1e3 * np.array([cycle.found.seconds for cycle in cycles])
    cpu = 1e3 * np.array([cycle.processor for cycle in cycles])
    traffic = [cycle.found.traffic for cycle in cycles]
    flags = Counter(flag for one in traffic if one is not None for flag in one.flags)
    figures: dict[str, Any] = {"cycles": len(cycles), "seconds": round(config.period * len(cycles), 1)}
    for name, taken in (("wall", wall), ("cpu", cpu)):
        figures |= {f"{name}_p50_ms": round(float(np.median(taken)), 1)}
        figures |= {f"{name}_p99_ms": round(float(np.percentile(taken, 99)), 1)}
        figures |= {f"{name}_max_ms": round(float(taken.max()), 1)}
    return figures | {
        "compilations": compiled,
        "tracks": round(float(np.mean([one.confirmed.sum() for one in traffic if one is not None])), 1),
        "flagged": round(float(np.mean([bool(one.flags) for one in traffic if one is not None])), 3),
        "flags": ", ".join(f"{name} {count}" for name, count in sorted(flags.items())) or None,
        "least_gap_m": round(min(cycle.gap for cycle in cycles), 2),
        "left_m": round(float(np.linalg.norm(cycles[-1].place - config.goal)), 1),
    }


def _f32(x: Any) -> Float[Array, "..."]:
    return jnp.asarray(x, jnp.float32)


@stored("scan among movers", static=("lidar",))
def _scan(
    geoms: Geoms, movers: Movers, place: Float[Array, "3"], key: PRNGKeyArray, when: Float[Array, ""], *, lidar: Lidar
) -> Float[Array, " r"]:
    return scan(geoms, lidar, place, jnp.eye(3), key, Moving(movers, when)).distance


@stored("gap among movers")
def _gap(geoms: Geoms, movers: Movers, places: Float[Array, "n 3"], times: Float[Array, " n"]) -> Float[Array, ""]:
    def one(place: Array, when: Array) -> Array:
        return jnp.minimum(distance(geoms, place), distance(solids_at(movers, when), place))

    return jnp.min(jax.vmap(one)(places, times))


if __name__ == "__main__":
    main(configured(TINY))
