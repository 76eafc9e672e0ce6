"""Downloads of a page: the plan as other programs' files, and the page itself."""

from __future__ import annotations

import contextlib
import math
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from maxjax.api import trajectory
from maxjax.core.status import Status
from maxjax.inspection.flown_files import FlownFiles
from maxjax.io.airspace.airspace import Airspace
from maxjax.io.export.as_flown import AsFlown
from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.endings import number_file
from maxjax.io.export.export import export
from maxjax.io.geo.earth import Earth
from maxjax.trajectories.trajectory import Trajectory
from maxjax.ui.mission_text import mission_text
from maxjax.ui.page.air import air_lines, air_scene
from maxjax.ui.page.answer import Answer
from maxjax.ui.page.camera import hiding, over_way
from maxjax.ui.page.draw import answer_scene, city_scene, ends_scene, together
from maxjax.ui.page.inspection_answer import InspectionAnswer
from maxjax.ui.page.page_map import City
from maxjax.ui.page.share import playing_page
from maxjax.ui.page.timeline import trajectory_film
from maxjax.ui.request import Request


@contextlib.contextmanager
def downloading(client: Any) -> Iterator[Callable[[str, bytes], Any]]:
    """What sends a file to a browser, by its name and content; an error within says there why there is none."""
    try:
        yield client.send_file_download
    except (ValueError, ImportError) as error:
        client.add_notification("Nothing to download", str(error), color="orange", auto_close_seconds=8.0)


def file_of(city: City, earth: Earth | None, ending: str, found: Answer) -> tuple[str, bytes]:
    """A file of an answer that is OK: its name and content.

    Args:
        city: the map.
        earth: where it lies; None: unknown.
        ending: one of `io.export.export`, `.toml` of the mission, or `.html`.
        found: the answer.

    Raises:
        ValueError: if the format needs a place on Earth or ground that is missing, the file would lead elsewhere, or
            the battery does not last for it.
    """
    if ending == ".html":
        return "plan.html", page_of(city, found).encode()
    if ending == ".toml":
        return "mission.toml", mission_text(found.request).encode()
    flight = trajectory(found.verified, found.request.limits)
    if found.flight is not None and found.flight.status != Status.OK and found.flight.verdict is not None:
        raise ValueError(f"{found.flight.status.name}: {found.flight.verdict.describe()}")
    # The folder is made for this file alone; nothing that a browser says becomes part of its path.
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"plan{ending}"
        _write(file, city, earth, flight, found.request)
        return file.name, file.read_bytes()


def inspection_files(
    city: City, earth: Earth | None, ending: str, found: InspectionAnswer | None, request: Request
) -> tuple[list[tuple[str, bytes]], str]:
    """Files of an inspection: the name and content of one a flight, and what their photos show, in words.

    Args:
        city: the map.
        earth: where it lies; None: unknown.
        ending: one of `io.export.export`.
        found: the inspection, whose flights are OK; None: there was none.
        request: says for whom the files are, and whether they have take-off and landing.

    Raises:
        ValueError: if there is no inspection, the battery does not last for it, the format needs a place on Earth or
            ground that is missing, or a file would lead elsewhere.
    """
    if found is None:
        raise ValueError('no building was inspected; choose that a click "inspects a building", and click one')
    inspection = found.verified
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"inspection{ending}"
        count = len(found.flights)
        files = [file] if count == 1 else [number_file(file, number) for number in range(1, count + 1)]
        flown = [
            _write(one, city, earth, flight.trajectory, request)
            for one, flight in zip(files, found.flights, strict=True)
            if flight.trajectory is not None
        ]
        said = str(FlownFiles.of(files, flown, inspection))
        return [(one.name, one.read_bytes()) for one in files], said


def _write(file: Path, city: City, earth: Earth | None, flight: Trajectory, asked: Request) -> AsFlown:
    """Write a trajectory as a request says, and judge it."""
    height = city.terrain.at(*flight.at([0.0]).position[0, :2].tolist())
    # What only voxels tell is left to the judgement, which then takes the ground for up to a voxel lower.
    ground = None if math.isnan(height) or city.terrain.doubt > 0.0 else height
    return export(
        file,
        flight,
        earth=earth,
        ground=ground,
        airspace=Airspace(areas=city.areas),
        takeoff_and_landing=asked.takeoff_and_landing or None,
        autopilot=None if asked.autopilot is None else Autopilot.named(asked.autopilot),
    )


def page_of(city: City, found: Answer, *, dark: bool = False) -> str:
    """The page of an answer that is OK: map, path, and a vehicle that flies its trajectory."""
    mission = found.verified
    flight = trajectory(mission, found.request.limits)
    ends = ends_scene(found.request.places, city.frame)
    air = air_scene(city, found.request)
    way = city.frame.page(found.dense)
    buildings = city_scene(city, hiding=hiding(city, over_way(city, way)[0], way))
    film = trajectory_film(flight, together(buildings, ends, answer_scene(found, city.frame), air), city.frame)
    certified = ", certified" if all(leg.certified for leg in mission.legs) else ""
    lines = [
        city.name,
        f"Verified path{certified}: {mission.length:.1f} m, flown in {flight.duration:.1f} s",
        f"Clearance {mission.cruise_clearance:.1f} m away from the ends, {mission.clearance:.1f} m at the least",
        f"Path coloured by clearance: red 0 m, green {found.request.margin:g} m and more",
    ]
    if found.beside is not None and found.beside.status == Status.OK:
        lines.append(f"Blue: A*, {found.beside.length:.1f} m, {found.beside.cruise_clearance:.1f} m clear")
    if found.flight is not None and found.flight.verdict is not None:
        lines.append(f"Battery: {found.flight.verdict.describe()}")
    lines += air_lines(city, found.request)
    return playing_page(city, film, "\n".join(lines), dark=dark)
