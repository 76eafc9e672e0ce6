"""A trajectory as a stream of set-points at 20 Hz, by a clock that waits for the vehicle (`trajectories.follower`).

    stream where it stands → mode → arm → rise upright to the start → follow → rest at the goal → hold

Each set-point is sent once. Should the stream break off, the autopilot's own time-out ends the flight; ended by a
sentence, the vehicle is told to hold before.
"""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import Coroutine
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float64

from maxjax.link.arming import arm
from maxjax.link.errors import LinkError
from maxjax.link.supervision import Supervision
from maxjax.link.vehicle import TAKE_OFF, now
from maxjax.trajectories.follower import Follower
from maxjax.trajectories.trajectory import Trajectory

EVERY = 0.05  # [s]
_LONGEST = 2.0 * EVERY  # by which the clock moves at a time, whatever has passed [s]
_BEFORE = 1.0  # of streaming, without which PX4 takes no set-points [s]
_RISE = 1.0  # [m/s]
_SLOW = 0.3  # [m/s]
_PATIENCE = 30.0  # beyond what it should take [s]
_REST = np.zeros((2, 3))

Point = Float64[np.ndarray, "3"]
_T = TypeVar("_T")


@dataclasses.dataclass(frozen=True, eq=False)
class SetpointFlight:
    """A flight along set-points.

    Attributes:
        trajectory: that is flown.
        follower: its clock.
        watched: the vehicle.
    """

    trajectory: Trajectory
    follower: Follower
    watched: Supervision

    async def fly(self) -> None:
        """Fly it, from the ground to rest at the goal, where the vehicle holds.

        Raises:
            LinkError: if it ends early.
        """
        watched, vehicle = self.watched, self.watched.vehicle
        modes = vehicle.modes
        (start, goal), _ = watched.frame.states(self.trajectory.at([0.0, self.trajectory.duration]))
        foot = watched.local
        await self._stay(foot, _BEFORE)
        if not await self._beside(foot, vehicle.set_mode(modes.setpoints)):
            raise LinkError(
                f"mode: expected {modes.name_of(modes.setpoints)}, given {modes.name_of(vehicle.mode)}{vehicle.said}; "
                "clear its checks",
                holds=False,
            )
        await self._beside(foot, arm(vehicle))
        watched.mode = modes.setpoints
        await self._rise(foot, start[0])
        await self._follow()
        await self._settle(goal[0])

    async def _beside(self, place: Point, work: Coroutine[Any, Any, _T]) -> _T:
        """Do something that takes a while, with the stream going on."""
        task = asyncio.ensure_future(work)
        while not task.done():
            self.watched.send(np.vstack([place[None], _REST]), self.watched.heading)
            await asyncio.wait({task}, timeout=EVERY)
        return task.result()

    async def _stay(self, place: Point, seconds: float) -> None:
        end = now() + seconds
        while now() < end:
            self.watched.send(np.vstack([place[None], _REST]), self.watched.heading)
            await self.watched.pause(EVERY)

    async def _rise(self, foot: Point, start: Point) -> None:
        """Upright to the height of the start, then to it, until it rests there."""
        watched, vehicle = self.watched, self.watched.vehicle
        watched.stage, height = "rise", float(foot[2] - start[2])
        if vehicle.modes.label == "ArduCopter":  # which takes no set-points on the ground
            if answer := await vehicle.command(TAKE_OFF, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height):
                raise LinkError(
                    f"take-off: expected it to be accepted, given: {answer}{vehicle.said}; clear its checks"
                )
            own = True
        else:
            own = False
        began = now()
        while True:
            risen = min(_RISE * (now() - began), height)
            top = float(foot[2] - watched.local[2]) >= height - 0.5
            place = np.array([*foot[:2], foot[2] - risen])
            if own and top:
                own = False
            if top and risen >= height:
                place = start
            if not own:
                watched.send(np.vstack([place[None], _REST]), self._yaw(0.0))
            look = watched.look(self._planned(0.0), judge=False)
            if top and look.error < self.follower.tolerance and watched.speed < _SLOW:
                return
            if now() - began > height / _RISE + _PATIENCE:
                raise LinkError(
                    f"take-off: expected the start within {height / _RISE + _PATIENCE:.0f} s, it is {look.error:.1f} m "
                    "away; less wind is needed"
                )
            watched.company.tell(f"rises, {max(float(foot[2] - watched.local[2]), 0.0):.1f} of {height:.1f} m")
            await self.watched.pause(EVERY)

    async def _follow(self) -> None:
        watched, duration = self.watched, self.trajectory.duration
        watched.stage = "follow"
        time, last = 0.0, now()
        while time < duration:
            (ned,), (yaw,) = watched.frame.states(self.trajectory.at([time]))
            error = float(np.linalg.norm(ned[0] - watched.local))
            pace = float(self.follower.pace(error))
            velocity, acceleration = self.follower.scale(ned[1], ned[2], pace)
            watched.look(self._planned(time), pace)
            watched.send(np.stack([ned[0], velocity, acceleration]), yaw)
            watched.company.tell(f"{time:.1f} of {duration:.1f} s, {error:.2f} m off, pace {pace:.2f}")
            await watched.pause(EVERY)
            passed, last = now() - last, now()
            time = float(self.follower.advance(time, error, min(passed, _LONGEST), duration))

    async def _settle(self, goal: Point) -> None:
        """Stay at the last set-point until the vehicle rests there, then in its own hold."""
        watched, end = self.watched, now() + _PATIENCE
        watched.stage = "rest"
        while True:
            watched.send(np.vstack([goal[None], _REST]), self._yaw(self.trajectory.duration))
            look = watched.look(self._planned(self.trajectory.duration), 0.0)
            if look.error < self.follower.tolerance and watched.speed < _SLOW:
                break
            if now() > end:
                raise LinkError(
                    f"goal: expected it at rest within {self.follower.tolerance:g} m, given {look.error:.1f} m and "
                    f"{watched.speed:.1f} m/s; it is told to hold there"
                )
            await self.watched.pause(EVERY)
        modes, watched.mode = watched.vehicle.modes, None
        if not await self._beside(goal, watched.vehicle.set_mode(modes.hold)):
            raise LinkError(f"mode: expected {modes.name_of(modes.hold)} at the goal; its pilot has to take over")

    def _planned(self, time: float) -> Point:
        position: Point = self.trajectory.at([time]).position[0]
        return position

    def _yaw(self, time: float) -> float:
        return float(self.watched.frame.states(self.trajectory.at([time]))[1][0])
