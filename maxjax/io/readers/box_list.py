"""Boxes in CSV files.

x_min, y_min, z_min, x_max, y_max, z_max [m]     named in the first line; other columns are ignored

lat0 37.79, lon0 -122.39                         colliders of Udacity's flying-car simulator
posX, posY, posZ, halfSizeX, halfSizeY, halfSizeZ [m]     north, east and up of that place
"""

from __future__ import annotations

import csv
import io
import re
from array import array
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from maxjax.core.files import FileError, read_text
from maxjax.io.geo.units_and_axes import Reference
from maxjax.io.kinds.boxes import MAX_BOXES, Boxes, boxes_in_metres
from maxjax.io.reading import PLAIN, Reading

COLUMNS = ("x_min", "y_min", "z_min", "x_max", "y_max", "z_max")
COLLIDERS = ("posx", "posy", "posz", "halfsizex", "halfsizey", "halfsizez")
_PLACE = re.compile(r"\s*lat0\s+([-+.\deE]+)\s*,\s*lon0\s+([-+.\deE]+)\s*", re.IGNORECASE)


def load_boxes(path: Path, reading: Reading = PLAIN) -> Boxes:
    """The boxes of a CSV file.

    Raises:
        FileError: if the file cannot be read, lacks a column, or a box is not finite or has no volume; if a place is
            none, or a reference system or a unit is given for boxes that lie about one.
    """
    try:
        text = read_text(path).decode("utf-8-sig")
        first, _, rest = text.partition("\n")
        place = _PLACE.fullmatch(first.rstrip("\r"))
        rows = csv.reader(io.StringIO(text if place is None else rest))
        numbers = _numbers(rows, COLUMNS if place is None else COLLIDERS, path)
    except (ValueError, IndexError, csv.Error) as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{path}: expected a line of numbers a box: {error}") from error
    if place is None:
        return boxes_in_metres(Boxes(_checked(numbers.reshape(-1, 2, 3), path), path.name), path, reading)
    if reading.crs or reading.unit or reading.vertical_unit:
        raise FileError(f"{path}: its boxes are in metres about lat0, lon0; leave --crs and units out")
    latitude, longitude = float(place[1]), float(place[2])
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
        raise FileError(f"{path}: expected lat0 within 90 and lon0 within 180 degrees, found {latitude}, {longitude}")
    middle, half = numbers[:, [1, 0, 2]], numbers[:, [4, 3, 5]]
    corners = _checked(np.stack([middle - half, middle + half], axis=1), path)
    return Boxes(corners, path.name, reference=Reference("EPSG:4326", (longitude, latitude)))


def _numbers(rows: Iterator[list[str]], columns: tuple[str, ...], path: Path) -> Float64[np.ndarray, "n 6"]:
    """Six named columns of all rows."""
    names = [name.strip().lower() for name in next(rows, [])]
    missing = [name for name in columns if names.count(name) != 1]
    if missing:
        raise FileError(f"{path}: expected the columns {', '.join(columns)} once each, found {', '.join(names[:12])}")
    places = [names.index(name) for name in columns]
    found = array("d")
    for line in filter(None, rows):
        found.extend([float(line[place]) for place in places])
        if len(found) > 6 * MAX_BOXES:
            raise FileError(f"{path}: expected at most {MAX_BOXES} boxes, found more; crop it")
    if not len(found):
        raise FileError(f"{path}: holds no box, expected at least one")
    numbers: Float64[np.ndarray, "n 6"] = np.frombuffer(found).reshape(-1, 6)
    return numbers


def _checked(corners: Float64[np.ndarray, "n 2 3"], path: Path) -> Float64[np.ndarray, "n 2 3"]:
    """The boxes themselves; raises a `FileError` for one that is none."""
    wrong = ~(np.isfinite(corners).all(axis=(1, 2)) & (corners[:, 0] < corners[:, 1]).all(axis=1))
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise FileError(
            f"{path}: box {row + 1}: expected finite minima below the maxima, found {corners[row].tolist()}"
        )
    return corners
