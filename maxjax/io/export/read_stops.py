"""Waypoints of DJI's and Litchi's files read back, as the programs that fly them do.

Nothing here uses what writes the files. What would make a vehicle cut a corner, or count its heights from elsewhere,
is refused.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import xml.etree.ElementTree as ElementTree
import zipfile

import numpy as np
from jaxtyping import Float64

_SPACES = {"k": "http://www.opengis.net/kml/2.2", "w": "http://www.dji.com/wpmz/1.0.6"}
_STOPS = "toPointAndStopWithDiscontinuityCurvature"

Places = Float64[np.ndarray, "_ 3"]


@dataclasses.dataclass(frozen=True)
class ReadStops:
    """Waypoints of a file.

    Attributes:
        places: latitudes, longitudes [degrees] and heights above where it takes off [m].
        take_off: height to which it rises upright before it flies to the first one [m]; None: it does not take off.
        lands: whether it lands below the last one.
    """

    places: Places
    take_off: float | None = None
    lands: bool = False


def read_wpml(content: bytes) -> ReadStops:
    """The waypoints of a `.kmz` file; raises a ValueError where its two files differ or it cuts a corner."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        waylines, template = (
            ElementTree.fromstring(archive.read(f"wpmz/{name}")) for name in ("waylines.wpml", "template.kml")
        )
    found, shown = _wpml(waylines, "executeHeight"), _wpml(template, "height")
    same = found.places.shape == shown.places.shape and bool((found.places == shown.places).all())
    if not same or (found.take_off, found.lands) != (shown.take_off, shown.lands):
        raise ValueError("expected the same waypoints in template.kml and waylines.wpml, found others")
    return found


def _wpml(root: ElementTree.Element, height: str) -> ReadStops:
    modes = {
        mode.text for name in ("executeHeightMode", "heightMode") for mode in root.iterfind(f".//w:{name}", _SPACES)
    }
    if modes != {"relativeToStartPoint"}:
        raise ValueError("expected heights above where it takes off, found others")
    places = []
    for number, mark in enumerate(root.iterfind(".//k:Placemark", _SPACES)):
        if mark.findtext("w:index", "", _SPACES) != str(number):
            raise ValueError("expected waypoints in order, found others")
        turn = mark.findtext("w:waypointTurnParam/w:waypointTurnMode", "", _SPACES)
        if turn != _STOPS:
            raise ValueError(f"expected a stop at each waypoint, found {turn} at waypoint {number + 1}")
        east, north = mark.findtext("k:Point/k:coordinates", "", _SPACES).split(",")
        places.append([float(north), float(east), float(mark.findtext(f"w:{height}", "nan", _SPACES))])
    config = {child.tag.partition("}")[2]: child.text or "" for child in root.iterfind(".//w:missionConfig/*", _SPACES)}
    if config["flyToWaylineMode"] != "safely" or config["finishAction"] not in ("autoLand", "noAction"):
        raise ValueError("expected an upright take-off, and a landing or nothing at the end, found others")
    return ReadStops(np.array(places), float(config["takeOffSecurityHeight"]), config["finishAction"] == "autoLand")


def read_litchi(text: str) -> ReadStops:
    """The waypoints of a `_litchi.csv` file; raises a ValueError where it cuts a corner or counts from elsewhere."""
    rows = list(csv.DictReader(io.StringIO(text)))
    for name, said in (("curvesize(m)", "no curves"), ("altitudemode", "heights above where it takes off")):
        if any(float(row[name]) != 0.0 for row in rows):
            raise ValueError(f"expected {said} ({name} 0), found others")
    columns = ("latitude", "longitude", "altitude(m)")
    return ReadStops(np.array([[float(row[name]) for name in columns] for row in rows]))
