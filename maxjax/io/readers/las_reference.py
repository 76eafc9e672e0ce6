"""The reference system of a LAS file: WKT, or the keys of GeoTIFF, in its variable records.

1024  model: 1 projected, 2 geographic        3072  projected system        3076  unit of the plane   3077  its metres
2048  geographic system                       4096  vertical system         4099  unit of heights

Codes are EPSG's; 32767 stands for what the file describes itself. WKT counts more than keys.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

from maxjax.core.files import FileError
from maxjax.io.geo.reference_system import reference_system, unit_of_code
from maxjax.io.geo.units_and_axes import Stated
from maxjax.io.reading import Reading

_OWN = 32767
_ELLIPSOIDS = range(5001, 5036)  # among vertical systems of GeoTIFF
_WKT = 2112
_MOST_RECORDS, _LONGEST = 256, 100_000
_FIRST_RECORD = 235  # where a header of LAS 1.4 says where the records behind the points begin, and how many there are


def read_records(records: Iterable[Any], trailing: str, reading: Reading, path: Path) -> Stated:
    """Statements of variable records.

    Args:
        records: as laspy has them.
        trailing: WKT behind the points (`trailing_wkt`), or nothing.
        reading: what the user says in its place.
        path: for messages.

    Raises:
        FileError: if coordinates are in a unit or a projection that the file names but does not tell.
    """
    keys: dict[int, int] = {}
    doubles: list[float] = []
    wkt = trailing
    for record in records:
        wkt = str(getattr(record, "string", "")).strip("\0 \n") or wkt
        doubles = list(getattr(record, "doubles", doubles))
        for key in getattr(record, "geo_keys", ()):
            place = int(key.value_offset)
            # Keys of doubles name a place in their list; those of text are none of ours.
            if int(key.tiff_tag_location) == 0 or int(key.id) == 3077:
                keys[int(key.id)] = place
    unit = _unit(keys.get(3076), doubles, keys.get(3077), reading.unit is not None, path)
    vertical_unit = _unit(keys.get(4099), [], None, reading.vertical_unit is not None, path)
    if wkt:
        return Stated(wkt, None, vertical_unit)
    flat, model = keys.get(3072), keys.get(1024)
    if flat is None and model != 1:
        flat = keys.get(2048)
        unit = None if flat else unit
    if (flat == _OWN or (flat is None and model == 1)) and unit is None and reading.crs is None and not reading.unit:
        raise FileError(
            f"{path}: its reference system has no code, and no unit of its coordinates is stated; "
            "--crs CODE names the system, or --unit the unit alone"
        )
    if flat is None or flat == _OWN:
        return Stated(None, unit, vertical_unit)
    return Stated(_with_heights(flat, keys.get(4096)), unit, vertical_unit)


def trailing_wkt(file: BinaryIO, size: int) -> str:
    """The WKT among the records behind the points of LAS 1.4; nothing where there is none."""
    file.seek(25)
    if file.read(1) < b"\x04":
        return ""
    file.seek(_FIRST_RECORD)
    raw = file.read(12)
    if len(raw) < 12:
        return ""
    place, count = struct.unpack("<QI", raw)
    for _ in range(min(count, _MOST_RECORDS)):
        if not 0 < place <= size - 60:
            return ""
        file.seek(place)
        user, number, length = struct.unpack("<2x16sHQ32x", file.read(60))
        if user.startswith(b"LASF_Projection") and number == _WKT and length <= _LONGEST:
            return file.read(length).decode("utf-8", "replace").strip("\0 \n")
        place += 60 + length
    return ""


def _unit(code: int | None, doubles: list[float], own: int | None, given: bool, path: Path) -> float | None:
    """Metres of the unit of a code, or of the file's own; None where none is stated, or the user's counts."""
    if code is None or code == 0 or given:
        return None
    if code == _OWN and own is not None and 0 <= own < len(doubles) and 1e-4 <= doubles[own] <= 1e5:
        return doubles[own]
    found = unit_of_code(code)
    if found is None:
        raise FileError(f"{path}: expected a unit of length, found the code {code}; --unit and --vertical-unit name it")
    return found


def _with_heights(flat: int, vertical: int | None) -> str:
    """The name of a system with its heights, where these are a system too."""
    if vertical in _ELLIPSOIDS:
        import pyproj

        return str(pyproj.CRS.from_epsg(flat).to_3d().to_wkt())
    if vertical:
        try:
            reference_system(both := f"EPSG:{flat}+{vertical}")
        except ValueError:
            pass
        else:
            return both
    return f"EPSG:{flat}"
