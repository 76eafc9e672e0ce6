"""Looks at a vehicle in flight, and what ends one early.

    asked to stop | nothing heard for a second | nearer to something than judged     the vehicle is told to hold
    another mode than the one it was told | disarmed                                 it is left to whoever flies it

A vehicle is told to hold by set-points at rest where it is, then by its own mode.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses

import numpy as np
from jaxtyping import Float64

from maxjax.link.clearance_watch import ClearanceWatch
from maxjax.link.errors import LinkError
from maxjax.link.flight_log import FlightLog, Look
from maxjax.link.flight_task import Company
from maxjax.link.frame import LocalFrame
from maxjax.link.vehicle import Vehicle, now

Point = Float64[np.ndarray, "3"]
LOST = 1.0  # without a position [s]
_AHEAD = 0.2  # how far a position is carried on by its velocity at most [s]
_REST = np.zeros((2, 3))


@dataclasses.dataclass(eq=False)
class Supervision:
    """A flight that is looked at.

    Attributes:
        vehicle: that flies.
        frame: of its positions.
        watch: what it has to keep.
        log: of what is seen.
        company: who is with it.
        stage: of the flight.
        mode: that it was told to be in; None: none yet.
    """

    vehicle: Vehicle
    frame: LocalFrame
    watch: ClearanceWatch
    log: FlightLog
    company: Company
    stage: str = "ready"
    mode: int | None = None

    def __post_init__(self) -> None:
        self.began = self._due = now()

    async def pause(self, seconds: float) -> None:
        """Wait until so long after the pause before this one ended."""
        self._due = max(self._due + seconds, now())
        await asyncio.sleep(min(self._due - now(), seconds))

    @property
    def local(self) -> Point:
        """North, east and down of the vehicle [m]: its last position, carried on to the present."""
        said, age = self.vehicle.last("LOCAL_POSITION_NED"), self.vehicle.age("LOCAL_POSITION_NED")
        place, velocity = (
            np.array([said[name] for name in names], np.float64) for names in ("xyz", ("vx", "vy", "vz"))
        )
        return np.asarray(place + min(max(age, 0.0), _AHEAD) * velocity, np.float64)

    @property
    def speed(self) -> float:
        """How fast it moves [m/s]."""
        said = self.vehicle.last("LOCAL_POSITION_NED")
        return float(np.linalg.norm([said["vx"], said["vy"], said["vz"]]))

    def look(self, planned: Point, pace: float = np.nan, *, judge: bool = True) -> Look:
        """Look at the vehicle, and write that down.

        Args:
            planned: where it should be in the map [m].
            pace: of the clock.
            judge: whether it has to keep its clearance; not on the upright ways, which lead from and to the ground.

        Raises:
            LinkError: where its flight is to end.
        """
        position = self.frame.in_map(self.local)
        clearance = self.watch.distance(position) if np.isfinite(position).all() else np.nan
        wrong = self._wrong(clearance, self.watch.least(planned) if judge else 0.0)
        look = self._look(position, planned, pace, clearance)
        if wrong is not None:
            self.log.add(dataclasses.replace(look, remark=str(wrong)))
            raise wrong
        self.log.add(look)
        return look

    def note(self, remark: str) -> None:
        """Write a remark down, with where the vehicle is."""
        position = self.frame.in_map(self.local)
        look = self._look(position, position, np.nan, self.watch.distance(position))
        self.log.add(dataclasses.replace(look, remark=remark))

    def _look(self, position: Point, planned: Point, pace: float, clearance: float) -> Look:
        vehicle = self.vehicle
        mode, battery = (
            vehicle.modes.name_of(vehicle.mode),
            int(vehicle.last("SYS_STATUS").get("battery_remaining", -1)),
        )
        when = now() - self.began
        return Look(when, self.stage, mode, vehicle.armed, position, planned, pace, clearance, battery)

    def _wrong(self, clearance: float, least: float) -> LinkError | None:
        vehicle, age = self.vehicle, self.vehicle.age("LOCAL_POSITION_NED")
        modes, said = vehicle.modes, vehicle.said
        if self.mode is not None and vehicle.mode != self.mode:
            return LinkError(
                f"mode: expected {modes.name_of(self.mode)}, given {modes.name_of(vehicle.mode)}{said}: its pilot or a "
                "failsafe of its own flies it now, and nothing more is sent to it",
                holds=False,
            )
        if self.mode is not None and not vehicle.armed:
            return LinkError(f"motors: expected armed, given disarmed in flight{said}; look for it there", holds=False)
        if self.company.stop.is_set():
            return LinkError("interrupted: the vehicle is told to hold; its pilot has to take over")
        if np.isnan(clearance):
            return LinkError("telemetry: expected a position, given one that is no number; the vehicle is told to hold")
        if age > LOST:
            return LinkError(
                f"telemetry: expected a position every {LOST:g} s, the last one is {age:.1f} s old; the vehicle is "
                "told to hold, and its own failsafe acts where it does not hear that: look for it"
            )
        if clearance < least:
            return LinkError(
                f"clearance: expected {least:.2f} m, as judged, given {clearance:.2f} m; the vehicle is told to hold: "
                "fly in less wind, or plan with more margin"
            )
        return None

    def send(self, ned: Float64[np.ndarray, "3 3"], yaw: float) -> None:
        """Send a set-point."""
        self.vehicle.send_setpoint(now() - self.began, ned, yaw)

    async def hold(self) -> None:
        """Tell the vehicle to stay where it is, and write down whether it says that it does."""
        vehicle, modes = self.vehicle, self.vehicle.modes
        with contextlib.suppress(Exception):  # whatever went wrong, it is told to hold
            if self.mode == modes.setpoints:
                self.send(np.vstack([self.local[None], _REST]), self.heading)
        held = await vehicle.set_mode(modes.hold)
        self.stage = "held" if held else "not held"
        with contextlib.suppress(Exception):
            self.note("holds" if held else "was told to hold, and did not say that it does")

    @property
    def heading(self) -> float:
        """Its yaw, from north to east [rad]; north where it is unknown."""
        hundredths = int(self.vehicle.last("GLOBAL_POSITION_INT").get("hdg", 65535))
        return 0.0 if hundredths == 65535 else float(np.deg2rad(0.01 * hundredths))
