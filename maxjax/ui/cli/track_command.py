"""`maxjax fly MAP --start … --goal …` and `maxjax fly MISSION.toml`: a trajectory flown in MJX with the map given.

A folder with a flight.json is complete: it is written last and removed first.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import sys
from pathlib import Path
from typing import Any

import numpy as np

from maxjax.api import trajectory
from maxjax.core.files import atomic_write
from maxjax.core.provenance import device, versions
from maxjax.core.status import Status
from maxjax.planning.mission import Mission
from maxjax.planning.plan import Plan
from maxjax.sim.loop.trajectory_flight import Tracking, fly
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.trajectory import Trajectory
from maxjax.ui.cli import mission_command as mission
from maxjax.ui.cli import report
from maxjax.ui.cli.load_request import load_request
from maxjax.ui.cli.options import FlyOptions
from maxjax.ui.cli.plan_command import plan_in
from maxjax.ui.cli.progress import progress
from maxjax.ui.methods import planner_named
from maxjax.ui.option_groups import ReadOptions
from maxjax.ui.request import Request
from maxjax.ui.request_files import load_mission, options_as_keys

Flight = tuple[Trajectory, Tracking]

# How a map is read, what only a trajectory takes, and what only trials do.
READ = tuple(field.name for field in dataclasses.fields(ReadOptions))
FOLLOWED = ("radius", "margin", "speed")
_TRIALS = (
    "trials", "trial", "batch", "noise", "dropout", "dead_sector", "blackout", "drift", "latency", "snapshot",
    "reactive", "movers", "mover_speed", "mover_kind", "fleet", "delay", "shard", "merge", "distributed",
)  # fmt: skip
ON_FILES = ("start", "goal", *READ, *FOLLOWED, *_TRIALS)
_FLOWN = "The vehicle followed the trajectory and touched nothing."
_COLUMNS = "t_s x_m y_m z_m vx_m_s vy_m_s vz_m_s asked_x_m asked_y_m asked_z_m error_m clearance_m"


def refuse(options: FlyOptions, names: tuple[str, ...], reason: str) -> None:
    """Refuse options that are given and do nothing.

    Raises:
        ValueError: for the first of `names` that differs from its default.
    """
    defaults = {field.name: field.default for field in dataclasses.fields(options)}
    for name in names:
        if getattr(options, name) != defaults[name]:
            raise ValueError(f"--{name.replace('_', '-')}: {reason}; leave it out")


def fly_given(options: FlyOptions) -> int:
    """Plan, time, fly, show and write. Returns the exit code: 0 where it followed its trajectory and touched nothing.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    request = Request.of(options)
    refuse(options, _TRIALS, "goes with trials, not with --start and --goal")
    report.check_output(options.out)
    limits = request.limits
    given = load_request(request)
    with progress(f"Planning, method {options.method}"):
        plan = plan_in(given, planner_named(options.method))
    if plan.status != Status.OK:
        failure = {"status": plan.status.name, "message": report.explain(plan, given)}
        return _told(options, failure, None)
    report.warn(plan, given.task, given.places)
    return _flown(options, plan, limits)


def fly_mission(options: FlyOptions) -> int:
    """Fly the mission of a TOML file; else as `run`.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    refuse(options, ON_FILES, "stands in a mission's file, or goes with trials")
    report.check_output(options.out)
    request = load_mission(Path(options.map))
    with options_as_keys(Path(options.map)):
        (found, _), limits = mission.plan_request(request), request.limits
    if found.status != Status.OK:
        which = f"leg {found.failed[0] + 1} of {len(found.legs)}: " if found.failed else ""
        return _told(options, {"status": found.status.name, "message": which + found.status.advice}, None)
    return _flown(options, found, limits)


def _flown(options: FlyOptions, planned: Plan | Mission, limits: FlightLimits) -> int:
    with progress("Flying"):
        asked = trajectory(planned, limits)
        flown = fly(asked, wind=options.wind, seed=options.seed)
    return _told(options, figures(asked, flown), (asked, flown))


def _told(options: FlyOptions, content: dict[str, Any], flight: Flight | None) -> int:
    """Show and write what became of a flight; returns the exit code."""
    name = Path(options.map).name
    origin = {"configuration": {k: v for k, v in vars(options).items() if k not in ("out", "json")}}
    content = report.plain({**content, **origin, "versions": versions(), "device": device()})
    files = _written(options.out, content, flight, name) if options.out is not None else []
    if options.json:
        sys.stdout.write(report.dumps(content))
    elif flight is not None:
        report.show(report.table(f"{name}, flown in MJX", {"": _rows(*flight)}))
        if files:
            print(*files, sep="\n")
    if content["status"] == Status.OK.name:
        return 0
    report.complain(content["message"])
    return 1


def figures(asked: Trajectory, flown: Tracking) -> dict[str, Any]:
    """Contents of flight.json; lengths [m], times [s]."""
    touched = np.flatnonzero(flown.contact)
    return {
        "status": flown.status.name,
        "message": _FLOWN if flown.status == Status.OK else f"{flown.status.name}: {flown.status.advice}",
        "duration": asked.duration,
        "flown_length": float(np.linalg.norm(np.diff(flown.position, axis=0), axis=1).sum()),
        "greatest_speed": float(np.linalg.norm(flown.velocity, axis=1).max()),
        "error_95": float(np.quantile(flown.error, 0.95)),
        "error_greatest": float(flown.error.max()),
        "clearance": float(flown.clearance.min()),
        "trajectory_clearance": asked.clearance,
        "first_contact": float(flown.time[touched[0]]) if touched.size else None,
    }


def _rows(asked: Trajectory, flown: Tracking) -> dict[str, str]:
    found, nearest = figures(asked, flown), int(flown.clearance.argmin())
    x, y, z = flown.position[nearest].tolist()
    rows = {
        "status": found["status"],
        "duration": f"{found['duration']:.1f} s",
        "flown length": f"{found['flown_length']:.1f} m",
        "greatest speed": f"{found['greatest_speed']:.1f} m/s",
        "tracking error, 95 %": f"{found['error_95']:.2f} m",
        "tracking error, greatest": f"{found['error_greatest']:.2f} m",
    }
    if np.isfinite(found["clearance"]):
        rows["least clearance"] = f"{found['clearance']:.2f} m at ({x:.1f}, {y:.1f}, {z:.1f}) m"
        rows["that of the trajectory"] = f"{found['trajectory_clearance']:.2f} m"
    if found["first_contact"] is not None:
        rows["first contact"] = f"after {found['first_contact']:.2f} s"
    return rows


def _written(out: Path, content: dict[str, Any], flight: Flight | None, title: str) -> list[Path]:
    """flight.json, and of a flight flight.csv and flight.png, each whole or not at all; those of an earlier one go."""
    out.mkdir(parents=True, exist_ok=True)
    summary, rows, picture = out / "flight.json", out / "flight.csv", out / "flight.png"
    for old in (summary, rows, picture):
        old.unlink(missing_ok=True)
    files = []
    if flight is not None:
        from maxjax.ui.figures.style import save_figure
        from maxjax.ui.figures.tracking_error import figure_tracking

        save_figure(figure_tracking(*flight, title), picture)
        atomic_write(rows, _csv(*flight))
        files = [picture, rows]
    atomic_write(summary, report.dumps(content))
    return [*files, summary]


def _csv(asked: Trajectory, flown: Tracking) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_COLUMNS.split())
    wanted = asked.at(flown.time).position
    table = [flown.time, flown.position, flown.velocity, wanted, flown.error, flown.clearance]
    writer.writerows(np.round(np.column_stack(table), 6).tolist())
    return text.getvalue()
