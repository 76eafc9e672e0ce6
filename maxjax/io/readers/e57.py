"""Points of terrestrial scanners in ASTM E57 files (extra `e57`: pye57), all scans of a file in its common frame.

Coordinates are metres by the standard, z up; a scan's pose brings it to the frame of the file, whose reference system
the file may name. Points that a scanner marks as invalid are no returns, and are counted.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from maxjax.core.files import FileError, brief, open_regular
from maxjax.io.geo.units_and_axes import Stated
from maxjax.io.kinds.point_cloud import MAX_POINTS, Labels, PointCloud, local_cloud
from maxjax.io.reading import PLAIN, Reading

_MISSING = "reading E57 needs the extra e57: pip install 'maxjax[e57]'"
_MAGIC = b"ASTM-E57"
_AXES = ("cartesianX", "cartesianY", "cartesianZ")


def load_e57(path: Path, reading: Reading = PLAIN) -> PointCloud:
    """The points of all scans of an .e57 file.

    Raises:
        FileError: if the extra is missing, or the file is no E57, damaged, too large, or without points.
    """
    with open_regular(path) as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            raise FileError(f"{path}: expected an E57 file, which starts with {_MAGIC.decode()}")
    try:
        import pye57
    except ImportError as error:
        raise FileError(f"{path}: {_MISSING}") from error
    try:
        source = pye57.E57(str(path))
        try:
            claimed = [int(source.get_header(number).point_count) for number in range(source.scan_count)]
            if sum(claimed) > MAX_POINTS:
                raise FileError(f"{path}: holds {sum(claimed)} points, expected at most {MAX_POINTS}; crop or thin it")
            scans = [_scan(source, number) for number in range(len(claimed))]
            system = _system(source)
        finally:
            source.close()
    except FileError:
        raise
    except Exception as error:  # of a library that says so in many classes
        raise FileError(f"{path}: expected an intact E57 file: {brief(error)}") from error
    points = np.concatenate([np.zeros((0, 3)), *scans])
    lost = sum(claimed) - len(points)
    labels = Labels(withdrawn={"marked as invalid": lost} if lost else {})
    return local_cloud(points, path, reading, Stated(system, unit=1.0, vertical_unit=1.0), labels)


def _scan(source: Any, number: int) -> np.ndarray:
    """The valid points of a scan in the frame of the file."""
    found = source.read_scan(number, ignore_missing_fields=True, transform=True)
    return np.column_stack([np.asarray(found[axis], np.float64) for axis in _AXES])


def _system(source: Any) -> str | None:
    """The reference system that the file names; None where it names none."""
    root = source.root
    text = root["coordinateMetadata"].value() if root.isDefined("coordinateMetadata") else ""
    return str(text).strip() or None
