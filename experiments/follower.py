"""Flights in wind by time against flights by a clock that waits: errors, clearance, contacts and durations.

    python -m experiments.follower                       # 24 flights a wind: minutes on two cores
    python -m experiments.follower --flights 500         # on a GPU: all flights of a wind are one batch

Plans of random problems (`experiments.problem_sets`) are given times within 8 m/s, 2 m/s² and 4 m/s³ and flown in MJX
(`maxjax.fly`) in a mean wind of a random direction with gusts in proportion, twice in the same wind: by time alone, and
by `maxjax.Follower` with a tolerance of 1 m. The vehicle leans 25° at most, so that thrust saturates against 8 m/s and
more. With the controller's own 45° it follows in 10 m/s, and nothing has to wait; with 20° gusts at 10 m/s carry it
away even while the clock stands, which no clock can help.

The error is the distance to the set-point of the present time, by either clock; clearances are exact distances to the
cubes of occupied voxels. A contact is anything within 0.5 m of the vehicle's centre.

Expected: by time alone, errors of metres from 8 m/s on; by the clock that waits none beyond 2 m, at the price of some
seconds; in 4 m/s no difference.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, device, table
from experiments.problem_sets import problem_set
from maxjax.sim.loop.trajectory_flight import follow_setpoints, summarize_tracking
from maxjax.sim.loop.waiting_flight import follow_waiting
from maxjax.sim.vehicle.controller import Controller
from maxjax.sim.vehicle.quadrotor import Vehicle

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        maps: of `maxjax.sim.worlds.scenes.MAPS`, which take turns.
        winds: mean speeds [m/s].
        flights: of each wind and clock.
        tolerance: of the follower [m].
        tilt: the most that the vehicle leans [deg].
        speed, acceleration, jerk: greatest of the trajectories [m/s], [m/s²], [m/s³].
        seed: of cities, ends and winds.
        half: half extent of a map [m].
        name: of the result file.
        out: where the JSON goes.
    """

    maps: tuple[str, ...] = ("downtown", "suburb")
    winds: tuple[float, ...] = (4.0, 6.0, 8.0, 10.0)
    flights: int = 24
    tolerance: float = 1.0
    tilt: float = 25.0
    speed: float = 8.0
    acceleration: float = 2.0
    jerk: float = 4.0
    seed: int = 0
    half: float = 100.0
    name: str = "follower"
    out: Path = RESULTS


TINY = Config(maps=("suburb",), winds=(8.0,), flights=2, half=40.0)


def trajectories(config: Config) -> list[maxjax.Trajectory]:
    """Of random problems that have a plan, in equal numbers of each map."""
    limits = maxjax.FlightLimits(speed=config.speed, acceleration=config.acceleration, jerk=config.jerk)
    found = list[maxjax.Trajectory]()
    for k, name in enumerate(config.maps):
        wanted = config.flights // len(config.maps) + (k < config.flights % len(config.maps))
        drawn = problem_set(name, wanted + wanted // 4 + 2, config.seed, half=config.half)
        timed = list[maxjax.Trajectory]()
        for problem in drawn:
            if len(timed) == wanted:
                break
            plan = maxjax.plan(problem.map, problem.start, problem.goal)
            if plan.status == maxjax.Status.OK:
                timed.append(maxjax.trajectory(plan, limits))
        found += timed
    return found


def fly(flights: Sequence[maxjax.Trajectory], wind: float, config: Config, *, waits: bool) -> list[maxjax.Tracking]:
    """Fly all at a time, by time alone or by the clock that waits, in the same winds."""
    vehicle, controller = Vehicle(), Controller(tilt=config.tilt)
    if not waits:
        timed = follow_setpoints(flights, wind, config.seed, vehicle, controller)
        return [summarize_tracking(one, *how, one.map) for one, how in zip(flights, timed, strict=True)]
    follower = maxjax.Follower(config.tolerance)
    waited = follow_waiting(flights, follower, wind, config.seed, vehicle, controller)
    return [summarize_tracking(one, *how[:3], one.map, how[3]) for one, how in zip(flights, waited, strict=True)]


def row_of(wind: float, clock: str, asked: Sequence[maxjax.Trajectory], flown: Sequence[maxjax.Tracking]) -> Row:
    """Figures of the flights in one wind by one clock."""
    worst = np.array([one.error.max() for one in flown])
    later = [one.time[-1] - own.duration - 2.0 for one, own in zip(flown, asked, strict=True)]
    nearer = [one.clearance.min() < own.clearance - 1.0 for one, own in zip(flown, asked, strict=True)]
    return {
        "wind": wind,
        "clock": clock,
        "flights": len(flown),
        "error_median": float(np.median(worst)),
        "error_95": float(np.quantile(worst, 0.95)),
        "error_greatest": float(worst.max()),
        "contacts": sum(bool(one.contact.any()) for one in flown),
        "nearer": sum(map(bool, nearer)),
        "later_mean": float(np.mean(later)),
        "later_most": float(np.max(later)),
    }


def main(config: Config) -> list[Row]:
    """Fly all winds by both clocks; save and return their rows."""
    asked, rows = trajectories(config), list[Row]()
    for wind in config.winds:
        for clock in ("time", "waits"):
            flown = fly(asked, wind, config, waits=clock == "waits")
            rows.append(row_of(wind, clock, asked, flown))
    save(config.name, config, rows, config.out)
    return rows


def section(document: Document) -> str:
    """RESULTS.md: one line a wind and clock."""
    config = document["config"]
    lines = [
        [
            f"{row['wind']:g}",
            {"time": "time alone", "waits": "waits"}[row["clock"]],
            f"{row['flights']:,}",
            *(f"{row[f'error_{name}']:.2f}" for name in ("median", "95", "greatest")),
            f"{row['nearer']:,}",
            f"{row['contacts']:,}",
            f"{row['later_mean']:.1f} / {row['later_most']:.1f}",
        ]
        for row in document["rows"]
    ]
    return (
        f"### A clock that waits ({device(document)})\n\n"
        f"Trajectories of random plans at {config['speed']:g} m/s in mean winds of random directions with gusts, flown "
        f"in MJX by a vehicle\nthat leans {config['tilt']:g}° at most, twice in the same wind: by time alone and by "
        f"`maxjax.Follower` with a tolerance of {config['tolerance']:g} m.\nErrors are the greatest of each flight, to "
        "the set-point of the present time; nearer: came more than 1 m nearer to something than planned.\n\n"
        + table(
            ["wind [m/s]", "clock", "flights", "error [m]: median", "95 %", "greatest", "nearer", "contacts",
             "later [s]: mean / most"],
            lines,
        )
    )  # fmt: skip


if __name__ == "__main__":
    main(configured(TINY))
