"""A mission that its battery does not last for: as flights that land at home, each shown and written as a mission is.

Flight k goes to the folder `flight_k` below --out, and into files of --export with `_k` before their ending.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

from maxjax.core.status import Status
from maxjax.energy.split_flights import BatteryFlight, Supply, split_mission
from maxjax.io.export.endings import number_file
from maxjax.planning.planner import Planner
from maxjax.planning.waypoint import legs_of
from maxjax.ui.cli import report
from maxjax.ui.cli.mission_answer import MissionAnswer, table_of, warn_of, write_answer
from maxjax.ui.cli.progress import progress


def run_flights(whole: MissionAnswer, planner: Planner, supply: Supply) -> int:
    """Split a mission, show and write its flights. Returns the exit code.

    Raises:
        ValueError, OSError: for what cannot be written.
    """
    request = whole.request
    if whole.flight is not None and whole.flight.verdict is not None:
        report.complain(f"Note: {whole.flight.verdict.describe(whole.given.places)}; it is split into flights.")
    with progress("Planning flights"):
        flights = split_mission(whole.given.task, whole.mission.waypoints, planner, request.limits, supply)
    if flights[-1].status != Status.OK:
        return _refused(whole, flights[-1])
    answers = [_answer_of(whole, flight, k) for k, flight in enumerate(flights, 1)]
    contents = []
    for k, answer in enumerate(answers, 1):
        content, files = write_answer(answer)
        contents.append(content)
        if not request.json:
            report.show(table_of(answer, f"{Path(request.map).name}, flight {k} of {len(answers)}"))
            if files:
                print(*files, sep="\n")
        warn_of(answer)
    if request.json:
        told = {"status": Status.OK.name, "message": Status.OK.advice, "flights": contents}
        sys.stdout.write(report.dumps(told))
    return 0


def _answer_of(whole: MissionAnswer, flight: BatteryFlight, number: int) -> MissionAnswer:
    """A flight as a mission of its own, with a folder and files of its own."""
    request, stops = whole.request, flight.mission.waypoints
    given = dataclasses.replace(whole.given, task=whole.given.task.with_ends(*legs_of(stops)), frame="map")
    out = None if request.out is None else request.out / f"flight_{number}"
    exports = tuple(number_file(file, number) for file in request.export)
    asked = dataclasses.replace(
        request, waypoints=stops, return_to_start=False, frame="map", out=out, export=exports, json=request.json
    )
    return MissionAnswer(flight.mission, flight, given, asked)


def _refused(whole: MissionAnswer, last: BatteryFlight) -> int:
    """Say on stderr why a place is in no flight; returns the exit code."""
    place = whole.given.places.place(last.mission.waypoints[1].position)
    reason = last.mission.status.advice if last.verdict is None else last.verdict.describe(whole.given.places)
    report.complain(f"{last.status.name}: to {place} and back: {reason}. {last.status.advice} Nothing was written.")
    if whole.request.json:
        told = {"status": last.status.name, "message": last.status.advice, "place": last.mission.waypoints[1].position}
        sys.stdout.write(report.dumps(told))
    return 1
