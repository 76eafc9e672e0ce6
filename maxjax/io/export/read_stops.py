"""Waypoints of DJI's and Litchi's files read back, as the programs that fly them do.

Nothing here uses what writes the files. What would make a vehicle cut a corner, or count its heights from elsewhere,
is refused.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float64

from maxjax.io.export.read_looks import HeadingLook
from maxjax.planning.look import AimedLook

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
        looks: what is done with a camera, by number of the waypoint.
    """

    places: Places
    take_off: float | None = None
    lands: bool = False
    looks: Mapping[int, HeadingLook] = dataclasses.field(default_factory=dict)


def read_wpml(content: bytes) -> ReadStops:
    """The waypoints of a `.kmz` file; raises a ValueError where its two files differ or it cuts a corner."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        waylines, template = (
            ElementTree.fromstring(archive.read(f"wpmz/{name}")) for name in ("waylines.wpml", "template.kml")
        )
    found, shown = _wpml(waylines, "executeHeight"), _wpml(template, "height")
    same = found.places.shape == shown.places.shape and bool((found.places == shown.places).all())
    if not same or (found.take_off, found.lands, found.looks) != (shown.take_off, shown.lands, shown.looks):
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
    lands = config["finishAction"] == "autoLand"
    return ReadStops(np.array(places), float(config["takeOffSecurityHeight"]), lands, _wpml_looks(root))


def _wpml_looks(root: ElementTree.Element) -> dict[int, HeadingLook]:
    """What is done with a camera at waypoints, and from one to another."""
    found = dict[int, HeadingLook]()
    for group in root.iterfind(".//w:actionGroup", _SPACES):
        first, last = (int(group.findtext(f"w:actionGroup{end}Index", "-1", _SPACES)) for end in ("Start", "End"))
        trigger = group.findtext("w:actionTrigger/w:actionTriggerType", "", _SPACES)
        heading, pitch, photo = None, None, False
        for action in group.iterfind("w:action", _SPACES):
            name = action.findtext("w:actionActuatorFunc", "", _SPACES)
            params = {child.tag.partition("}")[2]: child.text or "" for child in action.iterfind("*/*", _SPACES)}
            photo |= name == "takePhoto"
            heading = float(params["aircraftHeading"]) if name == "rotateYaw" else heading
            pitch = math.radians(float(params["gimbalPitchRotateAngle"])) if name == "gimbalRotate" else pitch
        own = found.get(first, HeadingLook(None, AimedLook()))
        if trigger == "multipleDistance" and photo:
            every = float(group.findtext("w:actionTrigger/w:actionTriggerParam", "nan", _SPACES))
            found[first] = dataclasses.replace(own, look=dataclasses.replace(own.look, every=every))
            end = found.get(last, HeadingLook(None, AimedLook()))
            found[last] = dataclasses.replace(end, look=dataclasses.replace(end.look, every=0.0))
        elif heading is not None or pitch is not None or photo:
            found[first] = HeadingLook(heading, AimedLook(pitch=pitch, photo=photo, every=own.look.every))
    return found


def read_litchi(text: str) -> ReadStops:
    """The waypoints of a `_litchi.csv` file; raises a ValueError where it cuts a corner or counts from elsewhere."""
    rows = list(csv.DictReader(io.StringIO(text)))
    for name, said in (("curvesize(m)", "no curves"), ("altitudemode", "heights above where it takes off")):
        if any(float(row[name]) != 0.0 for row in rows):
            raise ValueError(f"expected {said} ({name} 0), found others")
    columns, looks, every = ("latitude", "longitude", "altitude(m)"), dict[int, HeadingLook](), 0.0
    for k, row in enumerate(rows):
        photo = any(row[f"actiontype{n}"] == "1" for n in range(1, 16))
        pitch = math.radians(float(row["gimbalpitchangle"])) if row["gimbalmode"] == "2" else None
        now = max(float(row["photo_distinterval"]), 0.0)
        if photo or pitch is not None or now != every:
            heading = float(row["heading(deg)"]) if photo else None
            looks[k] = HeadingLook(heading, AimedLook(pitch=pitch, photo=photo, every=now if now != every else None))
        every = now
    return ReadStops(np.array([[float(row[name]) for name in columns] for row in rows]), looks=looks)
