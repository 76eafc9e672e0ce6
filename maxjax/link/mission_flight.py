"""A mission that the autopilot flies by its own clock: armed, started, looked at until it has landed."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float64

from maxjax.link.arming import arm
from maxjax.link.errors import LinkError
from maxjax.link.supervision import Supervision
from maxjax.link.vehicle import START_MISSION

EVERY = 0.1  # between looks [s]
_UPRIGHT = 2.0  # from the first or last place, horizontally, within which a way is taken for upright [m]
_LANDED = 3.0  # from the goal, horizontally, at most [m]

Point = Float64[np.ndarray, "3"]


@dataclasses.dataclass(frozen=True, eq=False)
class MissionFlight:
    """A flight of the items that a vehicle holds.

    Attributes:
        path: of the plan [m].
        items: how many the vehicle holds.
        watched: the vehicle.
    """

    path: Float64[np.ndarray, "n 3"]
    items: int
    watched: Supervision

    async def fly(self) -> None:
        """Fly it, until the vehicle has landed and disarmed.

        Raises:
            LinkError: if it ends early, or elsewhere.
        """
        watched, vehicle = self.watched, self.watched.vehicle
        modes = vehicle.modes
        # Neither arms in the mode of missions by default.
        first = modes.setpoints if modes.label == "ArduCopter" else modes.hold
        if not await vehicle.set_mode(first):
            raise LinkError(
                f"mode: expected {modes.name_of(first)} to arm in, given {modes.name_of(vehicle.mode)}{vehicle.said}; "
                "clear its checks",
                holds=False,
            )
        await arm(vehicle)
        started = await self._start()
        if not started:
            raise LinkError(
                f"mission: expected {modes.name_of(modes.mission)}, given {modes.name_of(vehicle.mode)}{vehicle.said}; "
                "it is told to hold: disarm it"
            )
        watched.stage, watched.mode = "mission", modes.mission
        while vehicle.armed:
            planned = self._nearest(watched.frame.in_map(watched.local))
            look = watched.look(planned, judge=not self._upright(watched.frame.in_map(watched.local)))
            number = int(vehicle.last("MISSION_CURRENT").get("seq", 0))
            watched.company.tell(f"item {number} of {self.items}, {look.error:.2f} m off, {watched.speed:.1f} m/s")
            await self.watched.pause(EVERY)
        watched.stage, watched.mode = "landed", None
        landed = watched.look(self.path[-1], judge=False).position
        away = float(np.linalg.norm((landed - self.path[-1])[:2]))
        if away > _LANDED:
            raise LinkError(
                f"landing: expected it within {_LANDED:g} m of the goal, it disarmed {away:.1f} m away; look for it "
                "there",
                holds=False,
            )

    async def _start(self) -> bool:
        vehicle, modes = self.watched.vehicle, self.watched.vehicle.modes
        if modes.label != "ArduCopter":
            return await vehicle.set_mode(modes.mission)
        answer = await vehicle.command(START_MISSION)
        return not answer and await vehicle.until(lambda: vehicle.mode == modes.mission, 3.0)

    def _nearest(self, point: Point) -> Point:
        """The nearest point of the path."""
        a, b = self.path[:-1], self.path[1:]
        way = b - a
        share = np.clip(((point - a) * way).sum(1) / np.maximum((way * way).sum(1), 1e-12), 0.0, 1.0)
        feet = a + share[:, None] * way
        found: Point = feet[np.linalg.norm(feet - point, axis=1).argmin()]
        return found

    def _upright(self, point: Point) -> bool:
        """Whether it is below an end of the path, on its way from or to the ground."""
        ends = self.path[[0, -1]]
        below = point[2] < ends[:, 2] - 0.2
        return bool((below & (np.linalg.norm((point - ends)[:, :2], axis=1) < _UPRIGHT)).any())
