"""Downloads of a page: the plan as other programs' files, and the page itself."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path

from maxjax.api import trajectory
from maxjax.core.status import Status
from maxjax.io.airspace.airspace import Airspace
from maxjax.io.export.autopilot import Autopilot
from maxjax.io.export.export import export
from maxjax.io.geo.earth import Earth
from maxjax.ui.mission_text import mission_text
from maxjax.ui.page.air import air_lines, air_scene
from maxjax.ui.page.answer import Answer
from maxjax.ui.page.camera import hiding, over_way
from maxjax.ui.page.draw import answer_scene, city_scene, ends_scene, together
from maxjax.ui.page.page_map import City
from maxjax.ui.page.share import playing_page
from maxjax.ui.page.timeline import trajectory_film


def file_of(city: City, earth: Earth | None, ending: str, found: Answer) -> tuple[str, bytes]:
    """A file of an answer that is OK: its name and content.

    Args:
        city: the map.
        earth: where it lies; None: unknown.
        ending: one of `io.export.export`, `.toml` of the mission, or `.html`.
        found: the answer.

    Raises:
        ValueError: if the format needs a place on Earth or ground that is missing, or the file would lead elsewhere.
    """
    if ending == ".html":
        return "plan.html", page_of(city, found).encode()
    if ending == ".toml":
        return "mission.toml", mission_text(found.request).encode()
    flight = trajectory(found.verified, found.request.limits)
    # The folder is made for this file alone; nothing that a browser says becomes part of its path.
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"plan{ending}"
        x, y, _ = found.request.places[0]
        height = city.terrain.at(x, y)
        # What only voxels tell is left to the judgement, which then takes the ground for up to a voxel lower.
        ground = None if math.isnan(height) or city.terrain.doubt > 0.0 else height
        asked = found.request
        export(
            file,
            flight,
            earth=earth,
            ground=ground,
            airspace=Airspace(areas=city.areas),
            takeoff_and_landing=asked.takeoff_and_landing or None,
            autopilot=None if asked.autopilot is None else Autopilot.named(asked.autopilot),
        )
        return file.name, file.read_bytes()


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
    lines += air_lines(city, found.request)
    return playing_page(city, film, "\n".join(lines), dark=dark)
