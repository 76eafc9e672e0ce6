"""A path as a line on Earth: GeoJSON (RFC 7946) and KML 2.2, longitude first, heights above sea level or the ellipsoid.

Whichever of the two the map's heights count from, they are written as they are; KML reads them as above sea level.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape

import numpy as np
from jaxtyping import Float64

_KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2">
  <Placemark>
    <name>{name}</name>
    <LineString>
      <altitudeMode>absolute</altitudeMode>
      <coordinates>
{coordinates}
      </coordinates>
    </LineString>
  </Placemark>
</kml>
"""


def geojson_text(places: Float64[np.ndarray, "n 3"], properties: Mapping[str, float | str]) -> str:
    """The text of a GeoJSON file.

    Args:
        places: latitude, longitude [degrees] and height [m] of each point.
        properties: of the line.
    """
    line = [[round(east, 10), round(north, 10), round(up, 4)] for north, east, up in places.tolist()]
    feature = {
        "type": "Feature",
        "properties": dict(properties),
        "geometry": {"type": "LineString", "coordinates": line},
    }
    return json.dumps({"type": "FeatureCollection", "features": [feature]}, indent=1, allow_nan=False) + "\n"


def kml_text(places: Float64[np.ndarray, "n 3"], name: str) -> str:
    """The text of a KML file."""
    lines = [f"        {east:.10f},{north:.10f},{up:.4f}" for north, east, up in places.tolist()]
    return _KML.format(name=escape(name, quote=False), coordinates="\n".join(lines))
