"""Paths as lines on Earth: GeoJSON (RFC 7946) and KML 2.2, longitude first, heights above sea level or the ellipsoid.

A mission has a line for each leg, and a point for each waypoint between them.

Whichever of the two the map's heights count from, they are written as they are; KML reads them as above sea level.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from jaxtyping import Float64

_KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2">
  <Document>
    <name>{name}</name>
{placemarks}
  </Document>
</kml>
"""
_PLACEMARK = """    <Placemark>
      <name>{name}</name>
      <{kind}>
        <altitudeMode>absolute</altitudeMode>
        <coordinates>
{coordinates}
        </coordinates>
      </{kind}>
    </Placemark>"""


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
    def kind(self) -> str:
        """Of geometry, as both formats call it."""
        return "LineString" if len(self.places) > 1 else "Point"


def geojson_text(drawings: Sequence[Drawing]) -> str:
    """The text of a GeoJSON file."""
    features = []
    for one in drawings:
        line = [[round(east, 10), round(north, 10), round(up, 4)] for north, east, up in one.places.tolist()]
        geometry = {"type": one.kind, "coordinates": line if one.kind == "LineString" else line[0]}
        properties = {"name": one.name, **one.properties}
        features.append({"type": "Feature", "properties": properties, "geometry": geometry})
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=1, allow_nan=False) + "\n"


def kml_text(drawings: Sequence[Drawing], name: str) -> str:
    """The text of a KML file."""
    placemarks = []
    for one in drawings:
        rows = [f"          {east:.10f},{north:.10f},{up:.4f}" for north, east, up in one.places.tolist()]
        title = escape(one.name, quote=False)
        placemarks.append(_PLACEMARK.format(name=title, kind=one.kind, coordinates="\n".join(rows)))
    return _KML.format(name=escape(name, quote=False), placemarks="\n".join(placemarks))
