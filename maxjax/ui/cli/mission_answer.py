"""What is told of a mission that was planned: its table, mission.json, its files and its warnings."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from maxjax.core.status import Status
from maxjax.energy.charge_profile import ChargeProfile
from maxjax.energy.split_flights import BatteryFlight
from maxjax.inspection.landing_place import LandingPlace
from maxjax.planning.mission import Mission
from maxjax.trajectories.trajectory import Trajectory
from maxjax.ui.cli import exporting, report
from maxjax.ui.cli.map_task import MapTask
from maxjax.ui.cli.progress import progress
from maxjax.ui.energy_rows import HEADS, energy_cells, flight_energy, leg_energies
from maxjax.ui.looks import waypoint_table
from maxjax.ui.request import Request

_HEADS = ("leg", "to", "status", "length\n[m]", "clearance\n[m]", "speed\n[m/s]", "arrives\n[s]", "hovers\n[s]")
_GIVEN = ("speed\n[m/s]", "hovers\n[s]")  # left out where energy needs the room: the file has them
# What is in a plan's JSON and stands only once in that of a mission.
_ONCE = ("configuration", "versions", "device", "timings")


@dataclasses.dataclass(frozen=True, eq=False)
class MissionAnswer:
    """What is told of a mission.

    Attributes:
        mission: as it was planned.
        flight: that is shown and written, in time and with its energy: the mission, or its first legs; None: none.
        given: what it was planned in.
        request: what was asked, and where the answer goes.
    """

    mission: Mission
    flight: BatteryFlight | None
    given: MapTask
    request: Request

    @property
    def shown(self) -> Mission | None:
        """The mission that is shown."""
        return None if self.flight is None else self.flight.mission

    @property
    def landed(self) -> tuple[LandingPlace, ...]:
        """The roof that what is shown ends on, if any."""
        if self.shown is None or self.shown.touchdown is None:
            return ()
        return tuple(place for place in self.given.landings if place.waypoint.touchdown == self.shown.touchdown)

    @property
    def flown(self) -> Trajectory | None:
        """The same in time; None where it has none."""
        return None if self.flight is None else self.flight.trajectory


def write_answer(answer: MissionAnswer) -> tuple[dict[str, Any], list[object]]:
    """The content of mission.json, and the files that were written."""
    content = _document(answer)
    files: list[object] = []
    if answer.request.out is not None:
        files += _written(answer.request.out, content, answer)
    if answer.flown is not None:
        files += exporting.write_all(answer.request, answer.given, answer.flown)
    return content, files


def warn_of(answer: MissionAnswer) -> None:
    """Say on stderr what a user should know of what was written."""
    for choice in answer.mission.choices:
        report.complain(f"Note: {choice.describe(answer.given.places)}.")
    if answer.shown is not None and answer.flown is not None:
        for landing in answer.landed:
            report.complain(f"Note: {landing}.")
        report.warn_near(answer.shown, answer.given.places)
        report.warn_outside(answer.shown.path, answer.given)


def _document(answer: MissionAnswer) -> dict[str, Any]:
    """Content of mission.json: the mission, a plan for each leg, and what is needed to run it again."""
    mission, shown, flown = answer.mission, answer.shown, answer.flown
    given, request = answer.given, answer.request
    legs, energies = [], leg_energies(answer.flight, request.supply)
    for k, leg in enumerate(mission.legs):
        one = dataclasses.replace(given, task=given.task.some(slice(k, k + 1)))
        full = report.document(leg, one, report.explain(leg, one), {})
        own = {name: getattr(mission.waypoints[k + 1], name) for name in ("speed", "hover", "heading", "look_at")}
        told = {name: full[name] for name in full if name not in _ONCE}
        legs.append({"leg": k + 1, **own, **energies(k), **told})
    whole = mission if shown is None else shown
    times = None if flown is None else np.round(flown.passes, 6).tolist()
    last = report.document(
        mission.legs[0],
        given,
        "",
        {**request.configuration, "waypoints": [waypoint_table(waypoint) for waypoint in request.waypoints]},
    )
    content = {
        "status": mission.status.name,
        "message": mission.status.advice,
        "path": np.round(whole.path, 6).tolist(),
        **report.places_of(whole, given.earth),
        "length": whole.length,
        "clearance": whole.clearance,
        "duration": None if flown is None else flown.duration,
        **flight_energy(answer.flight, request.supply),
        "waypoints": [list(waypoint.position) for waypoint in mission.waypoints],
        "times": times,
        "landing": next((dataclasses.asdict(place) for place in answer.landed), None),
        "choices": [
            {
                "waypoint": one.number,
                "taken": one.taken,
                "costs": one.costs.tolist(),
                "places": [w.position for w in one.places],
            }
            for one in mission.choices
        ],
        "near_waypoints": [vars(one) for one in whole.near],
        "legs": legs,
        "timings": mission.timings,
        **{name: last[name] for name in ("configuration", "versions", "device")},
    }
    filled: dict[str, Any] = report.plain(content)
    return filled


def table_of(answer: MissionAnswer, title: str) -> Table:
    """One row a leg, and one for all."""
    mission, flown = answer.mission, answer.flown
    heads = (*_HEADS, *HEADS)
    rows, energies = [], energy_cells(answer.flight, answer.request.supply)
    for k, leg in enumerate(mission.legs):
        waypoint, ok = mission.waypoints[k + 1], leg.status == Status.OK
        lengths = [f"{x:.1f}" if ok else "" for x in (leg.length, leg.clearance)]
        arrives = f"{flown.passes[k + 1]:.1f}" if flown is not None and k + 1 < len(flown.passes) else ""
        speed = "" if waypoint.speed is None else f"{waypoint.speed:g}"
        hover = "" if waypoint.hover is None else f"{waypoint.hover:g}"
        place = ", ".join(f"{round(x, 2):.10g}" for x in waypoint.position)
        rows.append([str(k + 1), place, leg.status.name, *lengths, speed, arrives, hover, *energies(k)])
    if mission.status == Status.OK and flown is not None:
        lengths = [f"{x:.1f}" for x in (mission.length, mission.clearance)]
        rows.append(["all", "", mission.status.name, *lengths, "", f"{flown.duration:.1f}", "", *energies(None)])
    # Columns in which nothing stands are left out, and places break between coordinates: so 80 columns hold the rest.
    counted = any(row[-1] for row in rows)
    shown = [k for k in range(len(heads)) if any(row[k] for row in rows) and not (counted and heads[k] in _GIVEN)]
    table = Table(title=title, title_justify="left")
    for k in shown:
        table.add_column(heads[k], justify="left" if heads[k] == "status" else "right", no_wrap=heads[k] != "to")
    for row in rows:
        table.add_row(*(row[k] for k in shown), style="bold" if row[0] == "all" else None)
    return table


def _written(out: Path, content: dict[str, Any], answer: MissionAnswer) -> list[Path]:
    """The files of a mission in a folder; without a mission to show none, and those of an earlier one go."""
    mission, flown = answer.shown, answer.flown
    if mission is None or flown is None:
        report.remove_plans(out, "mission")
        return []
    from maxjax.ui.figures.missions import figure_mission

    with progress("Drawing"):
        charge = ChargeProfile.of(answer.flight, answer.request.supply)
        figure = figure_mission(mission, flown, Path(answer.request.map).name, answer.given.within, charge)
    return report.write_plan(out, content, figure, "mission")
