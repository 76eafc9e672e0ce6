"""Paths as lines on Earth: GeoJSON (RFC 7946) and KML 2.2, longitude first, heights above sea level.

A mission has a line for each leg, and a point for each waypoint between them. A line across 180 degrees is cut there in
two, as RFC 7946 asks, so that it does not lead around the Earth.

Each file says what its heights count from. GeoJSON may hold heights above the ellipsoid; KML reads its own as above
sea level.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from jaxtyping import Float64

from maxjax.io.geo.earth import Earth
from maxjax.planning.mission import Mission

_KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2">
  <Document>
    <name>{name}</name>
    <description>{said}</description>
{placemarks}
  </Document>
</kml>
"""
_PLACEMARK = """    <Placemark>
      <name>{name}</name>
{geometry}
    </Placemark>"""
_GEOMETRY = """      <{kind}>
        <altitudeMode>absolute</altitudeMode>
        <coordinates>
{coordinates}
        </coordinates>
      </{kind}>"""


@dataclasses.dataclass(frozen=True)
class Drawing:
    """A line, or a point.

    Attributes:
        name: what it is called.
        places: (n, 3) latitude, longitude [degrees] and height [m] of each point; one: a point.
        properties: what is known of it.
    """

    name: str
    places: Float64[np.ndarray, "n 3"]
    properties: Mapping[str, float | str]

    @property
    def pieces(self) -> list[Float64[np.ndarray, "_ 3"]]:
        """The line cut where it crosses 180 degrees, where each piece has an end."""
        found, first = list[np.ndarray](), np.zeros((0, 3))
        begin = 0
        for k, (here, there) in enumerate(itertools.pairwise(self.places)):
            if abs(there[1] - here[1]) <= 180.0:
                continue
            side = math.copysign(180.0, here[1])
            share = (side - here[1]) / (there[1] + 2.0 * side - here[1])
            cut = here + share * (there - here + np.array([0.0, 2.0 * side, 0.0]))
            found.append(np.vstack([first, self.places[begin : k + 1], [[cut[0], side, cut[2]]]]))
            first, begin = np.array([[cut[0], -side, cut[2]]]), k + 1
        found.append(np.vstack([first, self.places[begin:]]))
        return found


def geojson_text(drawings: Sequence[Drawing], said: str) -> str:
    """The text of a GeoJSON file; `said` of its coordinates."""
    features = []
    for one in drawings:
        lines = [
            [[round(east, 10), round(north, 10), round(up, 4)] for north, east, up in piece.tolist()]
            for piece in one.pieces
        ]
        geometry: dict[str, object] = {"type": "MultiLineString", "coordinates": lines}
        if len(one.places) == 1:
            geometry = {"type": "Point", "coordinates": lines[0][0]}
        elif len(lines) == 1:
            geometry = {"type": "LineString", "coordinates": lines[0]}
        properties = {"name": one.name, **one.properties, "coordinates": said}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1, allow_nan=False) + "\n"


def kml_text(drawings: Sequence[Drawing], name: str, said: str) -> str:
    """The text of a KML file; `said` of its coordinates."""
    placemarks = []
    for one in drawings:
        kind = "LineString" if len(one.places) > 1 else "Point"
        shapes = [
            _GEOMETRY.format(
                kind=kind,
                coordinates="\n".join(
                    f"          {east:.10f},{north:.10f},{up:.4f}" for north, east, up in piece.tolist()
                ),
            )
            for piece in one.pieces
        ]
        geometry = "\n".join(shapes)
        if len(shapes) > 1:
            geometry = f"      <MultiGeometry>\n{geometry}\n      </MultiGeometry>"
        placemarks.append(_PLACEMARK.format(name=escape(one.name, quote=False), geometry=geometry))
    return _KML.format(name=escape(name, quote=False), said=escape(said, quote=False), placemarks="\n".join(placemarks))


def drawings_of(mission: Mission, earth: Earth, speed: float) -> list[Drawing]:
    """A line for each leg, and a point for each waypoint between them."""
    places, drawings = earth.geodetic(mission.path), []
    for k, leg in enumerate(mission.legs):
        first, last = mission.places[k : k + 2].tolist()
        known: dict[str, float | str] = {
            "length_m": leg.length,
            "radius_m": leg.radius,
            "clearance_m": _finite(leg.clearance),
        }
        known["speed_m_s"] = min(mission.waypoints[k + 1].speed or speed, speed)
        said = "; ".join(str(one) for one in mission.near if one.number in (k, k + 1))
        known |= {"radius_not_kept": said} if said else {}
        drawings.append(Drawing(f"leg {k + 1}", places[first : last + 1], known))
    for k, waypoint in enumerate(mission.waypoints[1:-1], 1):
        at = mission.places[k]
        drawings.append(Drawing(f"waypoint {k}", places[at : at + 1], {"hover_s": waypoint.hover or 0.0}))
    return drawings


def _finite(number: float) -> float | str:
    return number if math.isfinite(number) else "infinite"
