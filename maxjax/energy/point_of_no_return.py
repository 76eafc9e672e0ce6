"""Whether a battery lasts for a flight, and from where on it would not bring the vehicle home.

    lasts:                E(end) ≤ usable
    can return at t:      E(t) + min(way back, rest of the flight) ≤ usable

The way back is the way that was flown, backwards: it is verified, and no other one is known everywhere. Where the
flight ends at home its own rest is a way home as well. The point of no return is the first one after which the way back
is more than what is left.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from maxjax.core.grid import Point3
from maxjax.core.status import Status
from maxjax.energy.battery import Battery
from maxjax.energy.consumption import Consumption
from maxjax.planning.problem.place_format import PlaceFormat
from maxjax.trajectories.trajectory import Trajectory


@dataclasses.dataclass(frozen=True)
class BatteryVerdict:
    """What a battery says of a flight.

    Attributes:
        status: OK: it lasts, with its reserve; CANNOT_RETURN: it does not.
        needed: for the whole flight [Wh].
        usable: of the battery, without its reserve [Wh].
        time: until which the way back is within that [s]; of a flight that is OK its end.
        place: where that is [m].
    """

    status: Status
    needed: float
    usable: float
    time: float
    place: Point3

    def describe(self, places: PlaceFormat | None = None) -> str:
        """A sentence without its full stop, in the words of whoever gave the places."""
        if self.status == Status.OK:
            return f"the flight takes {self.needed:.1f} of {self.usable:.1f} Wh above the reserve"
        x, y, z = (round(value, 1) for value in self.place)
        where = (places or PlaceFormat()).place((x, y, z))
        return (
            f"the flight takes {self.needed:.1f} Wh, the battery has {self.usable:.1f} Wh above its reserve; beyond "
            f"{where}, {self.time:.0f} s after the start, it does not bring the vehicle back"
        )


def judge_battery(trajectory: Trajectory, taken: Consumption, battery: Battery) -> BatteryVerdict:
    """Whether a battery lasts for a trajectory, and where not to go on.

    Args:
        trajectory: that is flown.
        taken: its consumption (`energy.consumption.measure_consumption`).
        battery: full at the start.
    """
    if taken.total <= battery.usable:
        x, y, z = trajectory.at([trajectory.duration]).position[0].tolist()
        return BatteryVerdict(Status.OK, taken.total, battery.usable, trajectory.duration, (x, y, z))
    lost = np.flatnonzero(taken.energy + taken.back > battery.usable)
    last = max(int(lost[0]) - 1, 0) if len(lost) else len(taken.time) - 1
    time = float(taken.time[last])
    x, y, z = trajectory.at([time]).position[0].tolist()
    return BatteryVerdict(Status.CANNOT_RETURN, taken.total, battery.usable, time, (x, y, z))
