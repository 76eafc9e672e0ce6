"""The link over a bad radio: how long transfers and commands take, and how far off its path a flight gets.

    python -m benchmarks.link_loss            # two cores: eight minutes, most of it flown in real time

At the other end is a vehicle with the messages and rules of ArduCopter (`benchmarks.common.mavlink_endpoint`), over
loopback, where packets are lost and as many doubled, each way, and late, each way. A transfer sends a mission of six
items and a rally point, reads the mission back and compares it. A command is asked until it is answered. The flight
follows set-points round a corner at 8 m/s by the clock that waits; how far off its path it gets is what the vehicle
itself knows.

Expected: next to nothing fails; transfers of milliseconds without loss and delay, of seconds with either; a flight
gets no further off its path than twice the tolerance, and bad links cost it a second or two.
"""

from __future__ import annotations

import asyncio
import dataclasses
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np
from jaxtyping import Float64

from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, save
from benchmarks.common.link_course import CORNER, EARTH, GROUND, at_home, fly, free_port, time_path
from benchmarks.common.mavlink_endpoint import Endpoint, Faults
from maxjax.link.errors import LinkError
from maxjax.link.flight_task import FlightTask
from maxjax.link.mission_transfer import transfer
from maxjax.link.session import plan_for
from maxjax.link.vehicle import INTERVAL, Vehicle, connect

_UP = 2.7  # above which the vehicle is on its way [m]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        losses: shares of packets lost, each way.
        delays: of each packet, each way [s].
        transfers: of the mission, and back, at each of them.
        commands: that are answered, at each of them.
        flights: round the corner, at each of them.
        tolerance: of the clock that waits [m].
        out: where the JSON goes.
    """

    losses: tuple[float, ...] = (0.0, 0.1, 0.3)
    delays: tuple[float, ...] = (0.0, 0.1)
    transfers: int = 5
    commands: int = 20
    flights: int = 2
    tolerance: float = 1.0
    out: Path = RESULTS


TINY = Config(losses=(0.3,), delays=(0.0,), transfers=1, commands=2, flights=1)


def main(config: Config) -> list[Row]:
    """Measure all; save and return a row each."""
    rows = [measure_link(loss, delay, config) for delay in config.delays for loss in config.losses]
    save("link_loss", config, rows, config.out)
    return rows


def measure_link(loss: float, delay: float, config: Config) -> Row:
    """The row of one loss and delay."""
    faults = Faults(loss=loss, delay=delay)
    with tempfile.TemporaryDirectory() as folder:
        with at_home(free_port(), faults=faults) as vehicle:
            sent, asked = asyncio.run(_times(vehicle, Path(folder), config))
        flights = [_flight(faults, Path(folder), config.tolerance) for _ in range(config.flights)]
    flown = [one for one in flights if one is not None]
    return {
        "loss": loss,
        "delay": delay,
        "transfers_failed": config.transfers - len(sent),
        **_summary("transfer", sent),
        "commands_failed": config.commands - len(asked),
        **_summary("command", asked),
        "flights_ended": config.flights - len(flown),
        "error_m": round(max(error for error, _, _ in flown), 2) if flown else None,
        "off_path_m": round(max(aside for _, aside, _ in flown), 2) if flown else None,
        "later_s": round(max(later for _, _, later in flown), 1) if flown else None,
    }


def _flight(faults: Faults, folder: Path, tolerance: float) -> tuple[float, float, float] | None:
    """Greatest distances to set-point and path [m], and how much later than planned [s]; None: it was broken off."""
    with at_home(free_port(), faults=faults) as vehicle:
        flight = fly(vehicle, folder, path=CORNER, arm=True, setpoints=True, tolerance=tolerance)
    if flight.sentence:
        print(f"{faults.loss:.0%} lost, {faults.delay:g} s late: {flight.sentence}")
        return None
    follow = [look for look in flight.looks if look.stage == "follow"]
    later = follow[-1].time - follow[0].time - time_path(CORNER).duration
    return max(look.error for look in follow), _greatest_distance(vehicle), later


async def _times(endpoint: Endpoint, folder: Path, config: Config) -> tuple[list[float], list[float]]:
    """How long transfers and commands took that came to their end [s]."""
    sent, asked = list[float](), list[float]()
    task = FlightTask(time_path(CORNER[:2]), EARTH, GROUND, f"udp://127.0.0.1:{endpoint.port}", folder)
    async with connect(task.address, task.system, task.patience) as vehicle:
        plan = plan_for(task, vehicle)
        for _ in range(config.transfers):
            began = perf_counter()
            try:
                await transfer(vehicle, plan)
            except LinkError:
                continue
            sent.append(perf_counter() - began)
        for _ in range(config.commands):
            began = perf_counter()
            if not await _answered(vehicle):
                asked.append(perf_counter() - began)
    return sent, asked


async def _answered(vehicle: Vehicle) -> str:
    """Ask for a message as often as it comes already; what became of that if it was not accepted."""
    return await vehicle.command(INTERVAL, 32.0, 2e4)


def _summary(name: str, times: list[float]) -> dict[str, float | None]:
    """Median and worst [s]."""
    return {
        f"{name}_median_s": round(float(np.median(times)), 3) if times else None,
        f"{name}_worst_s": round(max(times), 3) if times else None,
    }


def _greatest_distance(vehicle: Endpoint) -> float:
    """From the path, of all places where the vehicle was once it was up [m]."""
    north, east = vehicle.origin
    track = np.array([place for _, place in vehicle.track]) + np.array([north, east, 0.0])
    places = np.stack([CORNER[0, 0] + track[:, 1], track[:, 0], -track[:, 2]], axis=1)
    first = int(np.argmax(places[:, 2] > _UP))
    return float(_distances(places[first:], CORNER).max())


def _distances(points: Float64[np.ndarray, "n 3"], path: Float64[np.ndarray, "p 3"]) -> Float64[np.ndarray, " n"]:
    """From points to the nearest place of a path [m]."""
    a, way = path[:-1], np.diff(path, axis=0)
    share = np.clip(((points[:, None] - a) * way).sum(-1) / (way**2).sum(-1), 0.0, 1.0)
    found: Float64[np.ndarray, " n"] = np.linalg.norm(a + share[..., None] * way - points[:, None], axis=-1).min(1)
    return found


if __name__ == "__main__":
    main(configured(TINY))
