"""The flights of the link's tests, each in a process of its own: MAVSDK does not take several clients in one.

A worker flies one after another; what became of a flight is returned as data.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.link_course import at_home, fly, free_port
from benchmarks.common.mavlink_endpoint import Endpoint, Faults
from maxjax.link.flight_task import Company
from maxjax.link.session import LinkFlight

HEAD_WIND = (0.0, -8.0, 0.0)  # against a flight to the east
_MIDWAY = "3."  # what is told of a flight on its way


@dataclasses.dataclass(frozen=True)
class Flown:
    """What became of a flight: as the link tells it, and as the vehicle does."""

    flight: LinkFlight
    folder: Path
    mode: str
    armed: bool
    arm_requests: int
    timed_out: int
    commands: tuple[int, ...]
    set_points: np.ndarray  # time [s], north, east, down [m]

    @property
    def errors(self) -> np.ndarray:
        """Distances to the set-point of the same time [m]."""
        return np.array([look.error for look in self.flight.looks if look.stage in ("follow", "rest")])

    @property
    def rows(self) -> list[dict[str, str]]:
        """Of its log."""
        with open(self.folder / "flight.csv", newline="") as file:
            return list(csv.DictReader(file))


def fail_battery(vehicle: Endpoint, _: Company) -> None:
    """The vehicle's own failsafe flies it home."""
    vehicle.say("Battery 1 is low 10.2V used 2500 mAh")
    vehicle.set_mode("RTL")


def blow(vehicle: Endpoint, _: Company) -> None:
    """A storm drives it to the wall."""
    vehicle.wind, vehicle.drag = (14.0, 0.0, 0.0), 0.1


def jump(vehicle: Endpoint, _: Company) -> None:
    """The vehicle's clock goes back by an hour."""
    vehicle.faults.clock -= 3600.0


def silence(vehicle: Endpoint, _: Company) -> None:
    """It tells its place no longer."""
    vehicle.faults.local = False


def take_over(vehicle: Endpoint, _: Company) -> None:
    """Its pilot takes over."""
    vehicle.set_mode("LOITER")


def stop(_: Endpoint, company: Company) -> None:
    """Ctrl-C."""
    company.stop.set()


Act = Callable[[Endpoint, Company], None]
FLIGHTS: dict[str, tuple[dict[str, Any], dict[str, Any], Act | None]] = {
    # Name: the vehicle, the flight, what happens midway.
    "mission": ({}, {}, None),
    "mission of PX4": ({"autopilot": "px4"}, {}, None),
    "lossy mission": ({"faults": Faults(loss=0.3)}, {}, None),
    "waits": ({"wind": HEAD_WIND}, {"setpoints": True}, None),
    "by time": ({"wind": HEAD_WIND}, {"setpoints": True, "tolerance": 1e3}, None),
    "lossy": ({"autopilot": "px4", "faults": Faults(loss=0.3)}, {"setpoints": True}, jump),
    "interrupted": ({}, {"setpoints": True}, stop),
    "taken over": ({}, {"setpoints": True}, take_over),
    "battery": ({"autopilot": "px4"}, {"setpoints": True}, fail_battery),
    "blown aside": ({}, {"setpoints": True, "tolerance": 4.0}, blow),
    "silent": ({}, {"setpoints": True}, silence),
    # What flies nowhere.
    "unheard": ({"faults": Faults(silent=True)}, {"patience": 1.0}, None),
    "another system": ({"system": 7}, {"patience": 1.0}, None),
    "armed": ({"armed": True}, {"patience": 3.0}, None),
    "in the air": ({"armed": True, "start_height": 20.0, "mode": "LOITER"}, {"patience": 3.0, "setpoints": True}, None),
    "elsewhere": ({"aside": 35.0}, {"patience": 3.0}, None),
    "no estimate": ({"faults": Faults(ekf=1 | 2)}, {"patience": 3.0}, None),
    "no local position": ({"faults": Faults(local=False)}, {"patience": 3.0, "setpoints": True}, None),
    "not healthy": ({"faults": Faults(healthy=False)}, {"patience": 3.0}, None),
    "item refused": ({"faults": Faults(refused=3)}, {}, None),
    "item altered": ({"faults": Faults(altered=3)}, {}, None),
    "arming refused": ({"faults": Faults(deny_arming="PreArm: Compass not calibrated")}, {}, None),
    "not asked": ({}, {"arm": False}, None),
    "not asked, set-points": ({"autopilot": "px4"}, {"arm": False, "setpoints": True}, None),
}


def fly_named(name: str, folder: Path) -> Flown:
    """Fly one of `FLIGHTS`, armed."""
    about, how, act = FLIGHTS[name]
    done: list[bool] = []
    folder.mkdir()
    with at_home(free_port(), **about) as vehicle:

        def during(company: Company, said: str) -> None:
            if act is not None and not done and said.startswith(_MIDWAY):
                done.append(True)
                act(vehicle, company)

        flight = fly(vehicle, folder, during, **{"arm": True, **how})
        points = np.array([[time, *place] for time, place in vehicle.set_points]).reshape(-1, 4)
        commands = tuple(item.command for item in vehicle.items)
        return Flown(
            flight, folder, vehicle.mode, vehicle.armed, vehicle.arm_requests, vehicle.timed_out, commands, points
        )
