"""What the link's tests fly: a short way in an open block with a wall beside it, and the vehicle's place on it."""

from __future__ import annotations

import asyncio
import functools
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import maxjax
from maxjax.io.geo.earth import TangentPlane
from maxjax.link.flight_task import Company, FlightTask
from maxjax.link.session import LinkFlight, fly_task
from tests.link.endpoint import Endpoint
from tests.planners import bare_plan

EARTH = TangentPlane(52.07, 4.3, 10.0)
GROUND = 0.0
PATH = np.array([[-14.0, 0.0, 3.0], [14.0, 0.0, 3.0]])


@functools.cache
def trajectory() -> maxjax.Trajectory:
    """From west to east, 28 m at 3 m above the ground, beside a wall 7 m to the north."""
    occupied = np.zeros((41, 41, 21), bool)
    occupied[:, 24:26, 1:] = True  # y from 7 m to 11 m
    ground = np.zeros(occupied.shape, bool)
    ground[:, :, 0] = True
    where = maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(-40.0, -40.0, -1.0), ground=ground)
    plan = bare_plan(where, PATH, length=28.0, clearance=7.0, clearance_at=np.full(len(PATH), 7.0))
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


def flown(
    vehicle: Endpoint, folder: Path, during: Callable[[Company, str], None] | None = None, **how: Any
) -> LinkFlight:
    """Fly over a link; `during` hears what the flight tells."""

    async def run() -> LinkFlight:
        told: list[str] = []
        company = Company(asyncio.Event(), lambda said: (told.append(said), during and during(company, said))[0])
        task = FlightTask(trajectory(), EARTH, GROUND, f"udp://127.0.0.1:{vehicle.port}", folder, **how)
        return await asyncio.wait_for(fly_task(task, company), 60.0)

    return asyncio.run(run())
