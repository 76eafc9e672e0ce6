"""Exported files read back as lines in the map: from their text alone, as their reader flies them.

    heights above home     z = terrain under home + the height      whatever height the file says that home has
    heights above sea      z = that of the place on Earth
    heights of `.kmz` and `_litchi.csv`, which name no home: above the ground below their first waypoint
    set-points             of a `_ned` file above where it has its origin, which stands on the terrain as home does

A vehicle is armed on the ground, wherever a file says that the ground is. Nothing here uses what writes the files.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

from maxjax.core.terrain import Terrain
from maxjax.io.export.endings import ending_of, is_ned
from maxjax.io.export.read_looks import Aimed, looks_in
from maxjax.io.export.read_stops import ReadStops, read_litchi, read_wpml
from maxjax.io.geo.earth import Earth, TangentPlane
from maxjax.planning.look import AimedLook

_TAKE_OFF, _LAND, _WAYPOINT, _CHANGE_SPEED, _RELATIVE = 22, 21, 16, 178, 3  # MAVLink's numbers
_DIGITS = 1e-3  # by which those of a file may move a place [m]
_NUMBER = r"(-?[0-9.]+(?:e-?[0-9]+)?)"
_KML = {"k": "http://www.opengis.net/kml/2.2"}

Points = Float64[np.ndarray, "_ 3"]


@dataclasses.dataclass(frozen=True)
class Standing:
    """Where a vehicle stands on the ground of a map.

    Attributes:
        earth: where the map lies; None where that is unknown.
        terrain: the ground.
        stated: its height at home where the terrain has none, or leaves it in doubt [m].
    """

    earth: Earth | None
    terrain: Terrain
    stated: float | None = None

    def level(self, x: float, y: float, otherwise: float) -> float:
        """True height of the ground at a place [m]; `otherwise` where nothing tells it."""
        stated = otherwise if self.stated is None else self.stated
        # On the border of two columns it is that of either.
        around = [self.terrain.at(x + dx, y + dy) for dx in (-_DIGITS, _DIGITS) for dy in (-_DIGITS, _DIGITS)]
        known = [min(max(stated, height - self.terrain.doubt), height) for height in around if not math.isnan(height)]
        return min(known, key=lambda height: abs(height - stated), default=stated)

    @property
    def place(self) -> Earth:
        """The place on Earth; raises a ValueError where none is known."""
        if self.earth is None:
            raise ValueError("expected a place on Earth to read places on Earth")
        return self.earth

    def placed(self, places: Points) -> Points:
        """Points of the map [m] at latitudes, longitudes [degrees] and heights [m]."""
        return self.place.local(places)

    def lifted(self, home: Points, places: Points) -> Points:
        """Points of the map [m] at heights above home, which stands on the ground.

        Args:
            home: (1, 3) latitude, longitude [degrees] and the height that the file gives it [m].
            places: latitudes, longitudes [degrees] and heights above home [m].
        """
        ((x, y, z),) = self.placed(home).tolist()
        foot = np.array([[x, y, self.level(x, y, z)]])
        return self.placed(places + np.array([0.0, 0.0, self.place.geodetic(foot)[0, 2]]))

    def foot(self, latitude: float, longitude: float) -> Points:
        """Latitude, longitude [degrees] and height [m] of the ground at a place; raises a ValueError without any."""
        height = 0.0
        for _ in range(2):  # a plane's place depends on the height
            ((x, y, _),) = self.placed(np.array([[latitude, longitude, height]])).tolist()
            ground = self.level(x, y, math.inf)
            if math.isinf(ground):
                raise ValueError("expected ground below the waypoint, to count heights from")
            height = float(self.place.geodetic(np.array([[x, y, ground]]))[0, 2])
        return np.array([[latitude, longitude, height]])


@dataclasses.dataclass(frozen=True)
class Lines:
    """Lines that a file says to fly.

    Attributes:
        parts: (n, 3) points of the map each [m], in order.
        times: of the points of the only part [s]; None where the file has none.
        rise, descent: to the first point, and from the last one, where the file has them.
        holds: how long each point of the only part is held [s], and
        accepted: within which it counts as reached [m], as its item says, and
        speeds: greatest on the way to it [m/s], NaN where nothing says it; None where the file has no such items.
        looks: what is done with a camera at points of the only part, by number.
    """

    parts: tuple[Points, ...]
    times: Float64[np.ndarray, " n"] | None = None
    rise: Points | None = None
    descent: Points | None = None
    holds: Float64[np.ndarray, " n"] | None = None
    accepted: Float64[np.ndarray, " n"] | None = None
    speeds: Float64[np.ndarray, " n"] | None = None
    looks: Mapping[int, AimedLook] = dataclasses.field(default_factory=dict)


def lines_in(file: Path, text: str | bytes, standing: Standing) -> Lines:
    """The lines of an exported file's text; a bag's are read by `lines_in_bag`.

    Args:
        file: whose name says the format.
        text: its content; bytes of a `.kmz`.
        standing: where the vehicle is armed.
    """
    ending = ending_of(file)
    if isinstance(text, bytes):
        return _stops(read_wpml(text), standing)
    if ending == "_litchi.csv":
        return _stops(read_litchi(text), standing)
    if ending == ".plan":
        return _plan(text, standing)
    if ending == ".waypoints":
        return _waypoint_list(text, standing)
    if ending == ".geojson":
        return _geojson(text, standing)
    if ending == ".kml":
        return _kml(text, standing)
    if ending == ".tum":
        table = np.array([[float(word) for word in row.split()] for row in text.splitlines()])
        return Lines((table[:, 1:4],), table[:, 0])
    return _setpoints(text, standing, ned=is_ned(file))


def lines_in_bag(folder: Path) -> Lines:
    """The line of a ROS 2 bag."""
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(folder) as bag:
        ((connection, _, raw),) = bag.messages()
        path: Any = types.deserialize_cdr(raw, connection.msgtype)
    stamps = [pose.header.stamp for pose in path.poses]
    places = [pose.pose.position for pose in path.poses]
    return Lines(
        (np.array([[place.x, place.y, place.z] for place in places]),),
        np.array([stamp.sec + 1e-9 * stamp.nanosec for stamp in stamps]),
    )


def _plan(text: str, standing: Standing) -> Lines:
    mission = json.loads(text)["mission"]
    items = [
        (item["command"], item["frame"], [math.nan if value is None else float(value) for value in item["params"]])
        for item in mission["items"]
    ]
    return _items(np.array([mission["plannedHomePosition"]], np.float64), items, standing)


def _waypoint_list(text: str, standing: Standing) -> Lines:
    rows = [row.split("\t") for row in text.splitlines()[1:]]
    items = [(int(row[3]), int(row[2]), [float(word) for word in row[4:11]]) for row in rows]
    return _items(np.array([items[0][2][4:]]), items[1:], standing)


def _items(home: Points, items: list[tuple[int, int, list[float]]], standing: Standing) -> Lines:
    found: dict[int, list[list[float]]] = {_TAKE_OFF: [], _WAYPOINT: [], _LAND: []}
    said, speed = list[list[float]](), math.nan
    for command, frame, params in items:
        speed = params[1] if command == _CHANGE_SPEED else speed
        if frame == _RELATIVE and command in found:
            found[command].append(params[4:])
        if frame == _RELATIVE and command == _WAYPOINT:
            said.append([*params[:2], speed])
    rise, line, descent = (standing.lifted(home, np.array(places).reshape(-1, 3)) for places in found.values())
    foot = standing.lifted(home, np.array([[*home[0, :2], 0.0]]))
    holds, accepted, speeds = np.array(said).reshape(-1, 3).T
    return Lines(
        (line,),
        rise=np.concatenate([foot, rise, line[:1]]) if len(rise) else None,
        descent=np.concatenate([line[-1:], descent]) if len(descent) else None,
        holds=holds,
        accepted=accepted,
        speeds=speeds,
        looks=looks_in(items, Aimed(standing.place, line, standing.lifted, home)),
    )


def _stops(found: ReadStops, standing: Standing) -> Lines:
    """Lines of a vehicle that stops at each waypoint, and is armed on the ground below the first one."""
    foot = standing.foot(*found.places[0, :2].tolist())
    line = standing.placed(found.places + np.array([0.0, 0.0, foot[0, 2]]))
    rise = descent = None
    if found.take_off is not None:
        top = foot + np.array([0.0, 0.0, max(found.take_off, found.places[0, 2])])
        rise = np.concatenate([standing.placed(np.concatenate([foot, top])), line[:1]])
    if found.lands:
        descent = np.concatenate([line[-1:], standing.placed(standing.foot(*found.places[-1, :2].tolist()))])
    looks = {k: look.turned(standing.place, line[k]) for k, look in found.looks.items()}
    return Lines((line,), rise=rise, descent=descent, looks=looks)


def _geojson(text: str, standing: Standing) -> Lines:
    parts = []
    for feature in json.loads(text)["features"]:
        geometry = feature["geometry"]
        if geometry["type"] == "Point":
            continue
        lines = geometry["coordinates"] if geometry["type"] == "MultiLineString" else [geometry["coordinates"]]
        east, north, up = np.array([place for line in lines for place in line]).T
        parts.append(standing.placed(np.column_stack([north, east, up])))
    return Lines(tuple(parts))


def _kml(text: str, standing: Standing) -> Lines:
    parts = []
    for mark in ElementTree.fromstring(text).iterfind(".//k:Placemark", _KML):
        lines = mark.findall(".//k:LineString", _KML)
        if not lines:
            continue
        if {line.findtext("k:altitudeMode", namespaces=_KML) for line in lines} != {"absolute"}:
            raise ValueError("expected absolute heights in all of its lines, found others")
        rows = [row for line in lines for row in line.findtext("k:coordinates", "", _KML).split()]
        east, north, up = np.array([[float(number) for number in row.split(",")] for row in rows]).T
        parts.append(standing.placed(np.column_stack([north, east, up])))
    return Lines(tuple(parts))


def _setpoints(text: str, standing: Standing, *, ned: bool) -> Lines:
    rows = [row for row in text.splitlines()[1:] if not row.startswith("#")]
    table = np.array([[float(word) for word in row.split(",")] for row in rows])
    times, points = table[:, 0], table[:, 1:4]
    if not ned:
        return Lines((points,), times)
    east_north_up = points[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    (said,) = [row for row in text.splitlines() if row.startswith("#")]
    on_earth = re.search(rf"latitude {_NUMBER}, longitude {_NUMBER}, height {_NUMBER} m", said)
    in_map = re.search(rf"x {_NUMBER}, y {_NUMBER}, z {_NUMBER} m", said)
    if on_earth is not None and standing.earth is not None:
        latitude, longitude, height = (float(number) for number in on_earth.groups())
        height = float(_height_of(standing, latitude, longitude, height))
        plane, above = TangentPlane(latitude, longitude, height), height + east_north_up[:, 2]
        for _ in range(2):  # the third number is a height above the origin, and the plane itself leaves the Earth
            east_north_up[:, 2] += above - plane.geodetic(east_north_up)[:, 2]
        return Lines((standing.placed(plane.geodetic(east_north_up)),), times)
    if in_map is None:
        raise ValueError("expected a line that names the origin, found none")
    x, y, z = (float(number) for number in in_map.groups())
    return Lines((east_north_up + np.array([x, y, standing.level(x, y, z)]),), times)


def _height_of(standing: Standing, latitude: float, longitude: float, height: float) -> float:
    """Height [m] of the ground where a file has its origin."""
    ((x, y, z),) = standing.placed(np.array([[latitude, longitude, height]])).tolist()
    return float(standing.place.geodetic(np.array([[x, y, standing.level(x, y, z)]]))[0, 2])
