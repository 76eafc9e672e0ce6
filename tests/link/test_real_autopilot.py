"""Ten missions by a real autopilot in software, at the address AUTOPILOT; its home is the start of round.toml.

    sim_vehicle.py -v ArduCopter --custom-location=47.00019789,7.99901388,0,0      ArduPilot's own simulation
    AUTOPILOT=udp://127.0.0.1:14550 make test-autopilot

Each goes to a place and back, five as items and five as set-points; the table is written to stdout.
"""

from __future__ import annotations

import asyncio
import os
from pathlib import Path

import numpy as np
import pytest

import maxjax
from maxjax.link.flight_task import Company, FlightTask
from maxjax.link.session import FOLLOWED, LinkFlight, fly_task
from maxjax.link.vehicle import connect
from maxjax.ui.cli.mission_command import plan_request
from maxjax.ui.request_files import load_mission

ADDRESS = os.environ.get("AUTOPILOT", "")
QUARTER = Path(__file__).parents[2] / "docs" / "samples" / "quarter.geojson"
START = (-75.0, 22.0, 5.0)
PLACES = ((-2.0, 62.0, 30.0), (55.0, -20.0, 8.0), (0.0, -3.0, 12.0), (60.0, 30.0, 25.0), (-50.0, 36.0, 15.0))

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(not ADDRESS, reason="needs an autopilot in software: AUTOPILOT=udp://127.0.0.1:14550"),
]


async def flown(task: FlightTask) -> LinkFlight:
    """Fly, and land where it ends."""
    flight = await fly_task(task, Company(asyncio.Event(), lambda _: None))
    async with connect(task.address, task.system, 30.0) as vehicle:
        if vehicle.armed:
            await vehicle.set_mode(next(number for number, name in vehicle.modes.names.items() if name == "LAND"))
        assert await vehicle.until(lambda: not vehicle.armed, 120.0)
    return flight


@pytest.mark.parametrize("setpoints", [False, True], ids=["items", "set-points"])
@pytest.mark.parametrize("place", PLACES, ids=str)
def test_a_mission_there_and_back(
    place: tuple[float, float, float], setpoints: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "way.toml"
    stops = "".join(f"[[waypoint]]\nat = {list(at)}\n" for at in (START, place))
    file.write_text(f'map = "{QUARTER}"\nradius = 1.5\nspeed = 8.0\nreturn_to_start = true\n{stops}')
    request = load_mission(file)
    planned, given = plan_request(request)
    limits = maxjax.FlightLimits(speed=8.0, acceleration=2.0, jerk=4.0)
    assert given.earth is not None
    ground = given.terrain.at(*START[:2])
    task = FlightTask(
        maxjax.trajectory(planned, limits), given.earth, ground, ADDRESS, tmp_path, arm=True, setpoints=setpoints,
        patience=120.0,
    )  # fmt: skip
    flight = asyncio.run(flown(task))
    looks = [look for look in flight.looks if look.stage in FOLLOWED and look.position[2] > START[2] - 0.5]
    errors, clearance = np.array([look.error for look in looks]), min(look.clearance for look in looks)
    with capsys.disabled():
        print(
            f"\n| {'set-points' if setpoints else 'items'} to {place} | {looks[-1].time - looks[0].time:.0f} of "
            f"{task.trajectory.duration:.0f} s | {errors.mean():.2f} / {errors.max():.2f} m | {clearance:.2f} m |"
        )
    assert flight.sentence == ""
    assert clearance >= planned.radius
