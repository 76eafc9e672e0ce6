"""A whole flight over a link, in order: who is there, whether it is ready and at home, what it flies, and the log."""

from __future__ import annotations

import asyncio
import dataclasses

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

LOG, PLAN = "flight.csv", "flight.plan"


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
            async with connect(task.address, task.system, task.patience) as vehicle:
                await _fly(task, vehicle, company, log)
        except LinkError as error:
            return LinkFlight(tuple(log.looks), str(error), company.stop.is_set())
    return LinkFlight(tuple(log.looks))


async def _fly(task: FlightTask, vehicle: Vehicle, company: Company, log: FlightLog) -> None:
    company.tell(f"{vehicle.modes.label}, system {vehicle.number}: waits for it to be ready")
    await wait_until_ready(vehicle, task.patience)
    trajectory = task.trajectory
    x, y, _ = trajectory.at([0.0]).position[0].tolist()
    frame = frame_at_home(vehicle, task.earth, (x, y), task.ground, 2.0 * task.tolerance)
    watch = ClearanceWatch(trajectory.map, trajectory.radius, task.tolerance)
    watched = Supervision(vehicle, frame, watch, log, company)
    flight: SetpointFlight | MissionFlight
    if task.setpoints:
        flight = SetpointFlight(trajectory, Follower(task.tolerance), watched)
    else:
        sent = await transfer(vehicle, plan_for(task, vehicle))
        company.tell(f"{len(sent)} items uploaded, read back and compared")
        flight = MissionFlight(np.asarray(trajectory.plan.path, np.float64), len(sent), watched)
    watched.look(watched.frame.in_map(watched.local), judge=False)
    if not task.arm:
        return
    try:
        await flight.fly()
    except BaseException as error:
        if not isinstance(error, LinkError) or error.holds:
            await asyncio.shield(_hold(watched))
        raise


async def _hold(watched: Supervision) -> None:
    held = await watched.hold()
    watched.stage = "held" if held else "not held"
    watched.note("holds" if held else "was told to hold, and did not answer")


def plan_for(task: FlightTask, vehicle: Vehicle) -> str:
    """The text of the `.plan` that is uploaded, judged for this autopilot; it stands beside the log.

    Raises:
        ValueError: if it would lead too near to something.
    """
    autopilot = Autopilot.named(vehicle.modes.label.lower())
    file = task.out / PLAN
    export(
        file, task.trajectory, earth=task.earth, ground=task.ground, takeoff_and_landing=True, autopilot=autopilot
    )
    return file.read_text(encoding="utf-8")
