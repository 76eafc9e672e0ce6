"""What is flown over a link, and how: the mission in time, the place, the address."""

from __future__ import annotations

import asyncio
import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

from maxjax.io.geo.earth import Earth
from maxjax.trajectories.trajectory import Trajectory


@dataclasses.dataclass(frozen=True, eq=False)
class FlightTask:
    """One flight over a link.

    Attributes:
        trajectory: of a plan or a mission, which the vehicle is to follow.
        earth: where its map lies.
        ground: height of the ground at home, below its start [m].
        address: of the vehicle (`link.address`).
        system: its MAVLink system.
        arm: whether to arm it; else all is checked and nothing flies.
        setpoints: whether to stream set-points; else items are uploaded.
        tolerance: distance from its way within which the clock runs at full pace [m].
        out: folder for the log and the file that is flown.
        patience: how long to wait for the vehicle to be heard, and to be ready [s].

    Raises:
        ValueError: for numbers that are none of these.
    """

    trajectory: Trajectory
    earth: Earth
    ground: float
    address: str
    out: Path
    system: int = 1
    arm: bool = False
    setpoints: bool = False
    tolerance: float = 1.0
    patience: float = 30.0

    def __post_init__(self) -> None:
        if not 1 <= self.system <= 255:
            raise ValueError(f"--system: expected a MAVLink system, 1 to 255, given {self.system}")
        if not 0.0 < self.tolerance < math.inf:
            raise ValueError(f"--tolerance: expected a positive number of metres, given {self.tolerance}")
        if not math.isfinite(self.ground):
            raise ValueError(
                "--autopilot: expected a map with ground below the start, from which heights count; give the ground's "
                "height in the mission, as ground = 0.0"
            )


@dataclasses.dataclass(frozen=True, eq=False)
class Company:
    """Who is with a flight: one who may stop it, one who is told how it goes.

    Attributes:
        stop: set to end the flight where it is.
        tell: takes a sentence on its progress.
    """

    stop: asyncio.Event
    tell: Callable[[str], None]
