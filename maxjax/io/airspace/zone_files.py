"""Files of zones in every format in which they are published, as the areas of an `Airspace`.

    file → format, by what it holds → zones in degrees (`zone`) → areas in the map (`zone_areas`)

Times are not read: a zone always holds.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from maxjax.core.files import FileError, brief, parse_json, read_text
from maxjax.core.grid import Grid
from maxjax.io.airspace.airspace import Airspace
from maxjax.io.airspace.ed269 import is_ed269, read_ed269
from maxjax.io.airspace.ed318 import is_geojson, read_ed318
from maxjax.io.airspace.facility_map import is_facility_map, read_facility_map
from maxjax.io.airspace.kml import is_kml, is_kmz, read_kml, read_kmz
from maxjax.io.airspace.openaip import is_openaip, read_openaip
from maxjax.io.airspace.plan_fence import is_plan, read_plan_fence
from maxjax.io.airspace.zone import MALFORMED, Published, UnclearError, ZoneFile
from maxjax.io.airspace.zone_areas import areas_in
from maxjax.io.geo.earth import Earth


@dataclasses.dataclass(frozen=True)
class ZoneFormat:
    """A format of zones.

    Attributes:
        title: what it is called.
        recognise: whether a file is of it, by its content.
        read: its zones; what it raises is said of the whole file.
    """

    title: str
    recognise: Callable[[ZoneFile], bool]
    read: Callable[[ZoneFile], Published]


FORMATS = (
    ZoneFormat("KMZ", is_kmz, read_kmz),
    ZoneFormat("KML", is_kml, read_kml),
    ZoneFormat("plan of QGroundControl", is_plan, read_plan_fence),
    ZoneFormat("ED-269", is_ed269, read_ed269),
    ZoneFormat("openAIP", is_openaip, read_openaip),
    ZoneFormat("UAS Facility Map", is_facility_map, read_facility_map),
    ZoneFormat("GeoJSON", is_geojson, read_ed318),
)
"""All of them, the first that recognises a file reads it."""


def load_airspace(
    path: str | os.PathLike[str],
    earth: Earth,
    grid: Grid,
    *,
    floor: float | None = None,
    ceiling: float | None = None,
    highest: float | None = None,
) -> Airspace:
    """Zones of a file as an `Airspace`; those that lie outside the map are left out.

    Args:
        path: ED-318 or other GeoJSON, ED-269, KML, KMZ, openAIP, a UAS Facility Map, or a plan of QGroundControl
            with a geofence (docs/airspace.md).
        earth: where the map lies, as the file of a loaded map says.
        grid: the map's.
        floor, ceiling, highest: as in `Airspace`.

    Raises:
        FileError: if the file cannot be used, or nothing in it lies in the map (a ValueError).
        ValueError: for heights that are none.
    """
    file = Path(path)
    try:
        areas, remarks = areas_in(read_zones(file), earth, grid, file)
    except MALFORMED as error:
        if isinstance(error, FileError):
            raise FileError(brief(error)) from error.__cause__
        raise FileError(f"{file}: {brief(error)}") from error
    return Airspace(floor, ceiling, highest, areas, remarks)


def read_zones(file: Path) -> Published:
    """The zones of a file, in degrees.

    Raises:
        FileError: if the file cannot be read, or is of no known format.
    """
    content = read_text(file)
    binary = any(known(ZoneFile(file, content, None)) for known in (is_kmz, is_kml))
    given = ZoneFile(file, content, None if binary else parse_json(content, file))
    try:
        known = next((form for form in FORMATS if form.recognise(given)), None)
        if known is not None:
            return known.read(given)
    except UnclearError as error:
        raise FileError(f"{file}: {error}") from error
    except MALFORMED as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{file}: malformed zones: {type(error).__name__}: {brief(error)}") from error
    raise FileError(
        f"{file}: expected a FeatureCollection of GeoJSON (ED-318), or {', '.join(one.title for one in FORMATS[:-1])}; "
        f"found {_kind(given.document)}"
    )


def _kind(document: Any) -> str:
    """What a JSON is, in words."""
    if isinstance(document, dict):
        return (
            f"JSON of type {brief(repr(document['type']))[:80]}"
            if "type" in document
            else "JSON with " + (", ".join(brief(key)[:40] for key in list(document)[:6]) or "nothing in it")
        )
    return f"JSON that is a {type(document).__name__}"
