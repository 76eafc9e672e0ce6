"""What the link flies in tests and benchmarks: short ways in an open block, and the vehicle's place on it."""

from __future__ import annotations

import asyncio
import dataclasses
import functools
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

import maxjax
from benchmarks.common.mavlink_endpoint import Endpoint
from maxjax.io.geo.earth import TangentPlane
from maxjax.link.flight_task import Company, FlightTask
from maxjax.link.session import LinkFlight, fly_task
from maxjax.planning.plan import no_plans
from maxjax.planning.problem.task import Task

EARTH = TangentPlane(52.07, 4.3, 10.0)
GROUND = 0.0
PATH = np.array([[-14.0, 0.0, 3.0], [14.0, 0.0, 3.0]])
CORNER = np.array([[-14.0, 0.0, 3.0], [14.0, 0.0, 3.0], [14.0, -28.0, 3.0]])


def trajectory() -> maxjax.Trajectory:
    """From west to east, 28 m at 3 m above the ground, beside a wall 7 m to the north."""
    return time_path(PATH)


def time_path(path: Float64[np.ndarray, "n 3"]) -> maxjax.Trajectory:
    """A way at 8 m/s in the block, whose one wall is 7 m north of the first leg; made once."""
    return _timed(tuple(map(tuple, path.tolist())))


@functools.cache
def _timed(path: tuple[tuple[float, float, float], ...]) -> maxjax.Trajectory:
    occupied = np.zeros((41, 41, 21), bool)
    occupied[:, 24:26, 1:] = True  # y from 7 m to 11 m
    ground = np.zeros(occupied.shape, bool)
    ground[:, :, 0] = True
    where = maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(-40.0, -40.0, -1.0), ground=ground)
    points = np.array(path)
    task = Task.of(where, points[:1], points[-1:], maxjax.Distances())
    (nothing,) = no_plans(task, maxjax.Status.OK, "field")
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    clear = np.full(len(points), 7.0)
    plan = dataclasses.replace(nothing, path=points, length=length, clearance=7.0, clearance_at=clear)
    return maxjax.trajectory(plan, maxjax.FlightLimits(speed=8.0, acceleration=2.5, jerk=5.0))


def free_port() -> int:
    """A port of loopback that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def at_home(port: int, aside: float = 0.0, **how: Any) -> Endpoint:
    """A vehicle on the ground below the start, or so many metres east of there."""
    place = EARTH.geodetic(np.array([[PATH[0, 0] + aside, PATH[0, 1], GROUND]]))[0]
    return Endpoint(port, float(place[0]), float(place[1]), **how)


def fly(
    vehicle: Endpoint,
    folder: Path,
    during: Callable[[Company, str], None] | None = None,
    path: Float64[np.ndarray, "n 3"] = PATH,
    **how: Any,
) -> LinkFlight:
    """Fly a way over a link; `during` hears what the flight tells."""

    async def run() -> LinkFlight:
        def tell(said: str) -> None:
            if during is not None:
                during(company, said)

        company = Company(asyncio.Event(), tell)
        task = FlightTask(time_path(path), EARTH, GROUND, f"udp://127.0.0.1:{vehicle.port}", folder, **how)
        return await asyncio.wait_for(fly_task(task, company), 90.0)

    return asyncio.run(run())
