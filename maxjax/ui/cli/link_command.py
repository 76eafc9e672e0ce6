"""`maxjax fly MISSION.toml --autopilot URL`: a mission flown by a vehicle over a link, its log, a figure.

Ctrl-C tells the vehicle to hold, and ends the command when it has.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from maxjax.api import trajectory
from maxjax.core.files import atomic_write
from maxjax.core.interruption import INTERRUPTED, ending_by
from maxjax.core.provenance import versions
from maxjax.core.status import Status
from maxjax.link.address import connection_of
from maxjax.link.flight_task import Company, FlightTask
from maxjax.link.session import FOLLOWED, LOG, LinkFlight, fly_task
from maxjax.ui.cli import mission_command as mission
from maxjax.ui.cli import report
from maxjax.ui.cli import track_command as tracking
from maxjax.ui.cli.options import FlyOptions
from maxjax.ui.cli.progress import telling
from maxjax.ui.request_files import load_mission, options_as_keys

ONLY = ("system", "arm", "setpoints", "tolerance")
"""Options that go with an autopilot's address alone."""
_OUT = Path("maxjax-flight")
_DONE = "The vehicle flew to its goal."
_CHECKED = "All is ready, and nothing was armed; --arm flies it."


def fly_over_link(options: FlyOptions) -> int:
    """Plan a mission, fly it over a link, show and write. Returns the exit code: 0 where it came to its end.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    connection_of(options.autopilot or "")
    if not options.map.lower().endswith(".toml"):
        raise ValueError(f"--autopilot: expected a mission's TOML file to fly, given {options.map}")
    tracking.refuse(options, (*tracking.ON_FILES, "method", "wind", "seed"), "does nothing with --autopilot")
    out = options.out or _OUT
    report.check_output(out)
    request = load_mission(Path(options.map))
    with options_as_keys(Path(options.map)):
        (planned, given), limits = mission.plan_request(request), request.limits
    if planned.status != Status.OK:
        report.complain(f"{planned.status.name}: {planned.status.advice}")
        return 1
    if given.earth is None:
        raise ValueError(
            f"{options.map}: expected a map with a place on Earth, to find the vehicle on it; give place or crs"
        )
    ground = given.terrain.at(*given.task.starts[0, :2].tolist())
    out.mkdir(parents=True, exist_ok=True)
    asked = {name: getattr(options, name) for name in ONLY}
    task = FlightTask(trajectory(planned, limits), given.earth, ground, options.autopilot or "", out, **asked)
    with telling("Connecting") as tell:
        flight = asyncio.run(_flown(task, tell))
    return _told(options, task, flight)


async def _flown(task: FlightTask, tell: Callable[[str], None]) -> LinkFlight:
    loop, stop = asyncio.get_running_loop(), asyncio.Event()

    def end() -> None:
        loop.call_soon_threadsafe(stop.set)

    with ending_by(end):
        return await fly_task(task, Company(stop, tell))


def _told(options: FlyOptions, task: FlightTask, flight: LinkFlight) -> int:
    """Show and write what became of a flight; returns the exit code."""
    name = Path(options.map).name
    content = report.plain({**flight_figures(task, flight), "autopilot": task.address, "versions": versions()})
    files = [task.out / LOG, task.out / "flight.json"]
    if task.arm and flight.looks:
        from maxjax.ui.figures.flown import figure_flown
        from maxjax.ui.figures.style import save_figure

        files.append(task.out / "flight.png")
        save_figure(figure_flown(task.trajectory, flight.looks, name), files[-1])
    atomic_write(files[1], report.dumps(content))
    if options.json:
        sys.stdout.write(report.dumps(content))
    else:
        rows = {key.replace("_", " "): f"{value:.2f}" for key, value in content.items() if isinstance(value, float)}
        report.show(report.table(f"{name}, {task.address}", {"": rows}))
        print(*([] if flight.sentence else [content["message"]]), *files, sep="\n")
    if flight.sentence:
        report.complain(flight.sentence)
        return INTERRUPTED if flight.interrupted else 1
    return 0


def flight_figures(task: FlightTask, flight: LinkFlight) -> dict[str, Any]:
    """Contents of flight.json; lengths [m], times [s], of what was flown between start and goal."""
    looks = [look for look in flight.looks if look.stage in FOLLOWED]
    content: dict[str, Any] = {
        "message": flight.sentence or (_DONE if task.arm else _CHECKED),
        "ended": not flight.sentence,
        "planned_duration": task.trajectory.duration,
        "planned_clearance": task.trajectory.clearance,
    }
    if not looks:
        return content
    errors = np.array([look.error for look in looks])
    return content | {
        "duration": looks[-1].time - looks[0].time,
        "error_mean": float(errors.mean()),
        "error_greatest": float(errors.max()),
        "clearance": min(look.clearance for look in looks),
    }
