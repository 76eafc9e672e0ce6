"""The fastest of the files of waypoints that hold a mission, as autopilots fly them; all of them are judged.

    mission → thinned by each tolerance (`io.export.thinning`) → file, with its stops → judged → least time

Thinned files are tried in the order of the time that they take without stops; the search ends where no other one can be
faster. None is taken that is less clear than the file with all waypoints.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from maxjax.io.export.as_flown import AWAY, AsFlown, judge_lines
from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.read_back import Standing, lines_in
from maxjax.io.export.thinning import left_out, thinnings
from maxjax.io.export.waypoint_file import Made, WaypointFile
from maxjax.planning.mission import Mission
from maxjax.trajectories.trajectory import Trajectory

_WORTH = 0.98  # of the time: what gains less stays as it was planned


def judge_text(
    file: Path,
    text: str | bytes,
    mission: Mission,
    trajectory: Trajectory | None,
    standings: Sequence[Standing],
    autopilots: Sequence[Autopilot] = (),
) -> AsFlown:
    """The worst of what a text makes a vehicle fly, wherever it may stand."""
    found = [
        judge_lines(
            file, lines_in(file, text, standing), mission, trajectory, AWAY + k * standing.terrain.doubt, autopilots
        )
        for k, standing in enumerate(standings)
    ]
    return min(found, key=lambda one: one.clearance)


def fastest(given: WaypointFile, made: Made) -> tuple[str | bytes, AsFlown]:
    """The text that takes least time of those that are as clear as the one with all waypoints, and how it is flown.

    Args:
        given: the file with all waypoints.
        made: its text.

    Raises:
        ValueError: if that one would lead elsewhere, or too near to something.
    """
    flown = _judge(given, made)
    said = [*made.remarks]
    if flown.flights:
        whole, least = flown, flown.clearance - AWAY
        thinner = [given.without(mission) for mission in thinnings(given.mission)]
        hopes = [one.shortest() for one in thinner]
        for hope, one in sorted(zip(hopes, thinner, strict=True), key=lambda pair: pair[0]):
            if hope >= flown.duration or hope >= _WORTH * whole.duration:
                break
            text = one.made()
            try:
                found = _judge(one, text)
            except ValueError:
                continue  # which one with more waypoints may pass
            if found.clearance >= least and found.duration < min(flown.duration, _WORTH * whole.duration):
                made, flown = text, dataclasses.replace(found, left_out=left_out(given.mission, one.mission))
        by = " and ".join(f"{one.label} in {one.duration:.0f} s" for one in whole.flights)
        said = [*made.remarks, *([f"with all of its waypoints it would be flown by {by}"] if flown.left_out else [])]
        said += [str(one.halts) for one in flown.flights if one.halts is not None]
    flown = dataclasses.replace(
        flown,
        remarks=tuple(said),
        stops=made.stops,
        return_height=made.return_height,
        autopilots=made.autopilots,
    )
    return made.text, flown


def _judge(given: WaypointFile, made: Made) -> AsFlown:
    autopilots = given.autopilots if made.autopilots else ()
    return judge_text(given.file, made.text, given.mission, None, given.standings, autopilots)
