"""A whole flight over a link, in order: who is there, whether it is ready and at home, what it flies, and the log."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
from collections.abc import Coroutine
from typing import Any, TypeVar

import numpy as np

from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.export import export
from maxjax.link.clearance_watch import ClearanceWatch
from maxjax.link.errors import LinkError
from maxjax.link.flight_log import FlightLog, Look, open_log
from maxjax.link.flight_task import Company, FlightTask
from maxjax.link.mission_flight import MissionFlight
from maxjax.link.mission_transfer import transfer
from maxjax.link.readiness import frame_at_home, wait_until_ready
from maxjax.link.setpoint_flight import SetpointFlight
from maxjax.link.supervision import Supervision
from maxjax.link.vehicle import Vehicle, connect
from maxjax.trajectories.follower import Follower

Flight = SetpointFlight | MissionFlight
_T = TypeVar("_T")

LOG, PLAN = "flight.csv", "flight.plan"
FOLLOWED = ("follow", "rest", "mission")
"""Stages of a flight in which it follows what was planned."""


@dataclasses.dataclass(frozen=True, eq=False)
class LinkFlight:
    """What became of a flight over a link.

    Attributes:
        looks: at the vehicle, in order; none where nothing flew.
        sentence: what ended it; empty where it came to its end.
        interrupted: whether it was asked to stop.
    """

    looks: tuple[Look, ...]
    sentence: str = ""
    interrupted: bool = False


async def fly_task(task: FlightTask, company: Company) -> LinkFlight:
    """Fly over a link, as far as that is asked for; the log stands in `task.out`, whatever ends the flight.

    Raises:
        ValueError, ImportError, OSError: for what cannot be used; nothing was sent then.
    """
    with open_log(task.out / LOG) as log:
        try:
            async with contextlib.AsyncExitStack() as link:
                connecting = link.enter_async_context(connect(task.address, task.system, task.patience))
                vehicle = await _unless_stopped(company, connecting)
                flight = await _unless_stopped(company, _prepared(task, vehicle, company, log))
                if task.arm:
                    await _flown(flight)
        except LinkError as error:
            return LinkFlight(tuple(log.looks), str(error), company.stop.is_set())
    return LinkFlight(tuple(log.looks))


async def _unless_stopped(company: Company, work: Coroutine[Any, Any, _T]) -> _T:
    """Do something on the ground, and leave it where the flight is to end."""
    tasks = asyncio.ensure_future(work), asyncio.ensure_future(company.stop.wait())
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        if not tasks[0].done():
            raise LinkError("interrupted: nothing was armed", holds=False)
        return tasks[0].result()
    finally:
        for one in tasks:
            one.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def _prepared(task: FlightTask, vehicle: Vehicle, company: Company, log: FlightLog) -> Flight:
    """What is to be flown by a vehicle that is ready and at home; a mission is uploaded."""
    company.tell(f"{vehicle.modes.label}, system {vehicle.number}: waits for it to be ready")
    await wait_until_ready(vehicle, task.patience)
    trajectory = task.trajectory
    x, y, _ = trajectory.at([0.0]).position[0].tolist()
    frame = frame_at_home(vehicle, task.earth, (x, y), task.ground, 2.0 * task.tolerance)
    watch = ClearanceWatch(trajectory.map, trajectory.radius, task.tolerance)
    watched = Supervision(vehicle, frame, watch, log, company)
    watched.note("ready")
    if task.setpoints:
        return SetpointFlight(trajectory, Follower(task.tolerance), watched)
    sent = await transfer(vehicle, plan_for(task, vehicle))
    watched.note(f"{len(sent)} items uploaded, read back and compared")
    return MissionFlight(np.asarray(trajectory.plan.path, np.float64), len(sent), watched)


async def _flown(flight: Flight) -> None:
    """Fly; whatever ends it early, the vehicle is told to hold unless someone else flies it."""
    try:
        await flight.fly()
    except BaseException as error:
        if not isinstance(error, LinkError) or error.holds:
            await asyncio.shield(flight.watched.hold())
        raise


def plan_for(task: FlightTask, vehicle: Vehicle) -> str:
    """The text of the `.plan` that is uploaded, judged for this autopilot; it stands beside the log.

    Raises:
        ValueError: if it would lead too near to something.
    """
    autopilot = Autopilot.named(vehicle.modes.label.lower())
    file = task.out / PLAN
    export(file, task.trajectory, earth=task.earth, ground=task.ground, takeoff_and_landing=True, autopilot=autopilot)
    return file.read_text(encoding="utf-8")
