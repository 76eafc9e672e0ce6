"""Points in text: .xyz, .pts, .asc and .txt, a point a line, whatever stands between its numbers.

    x y z …        columns in this order, or where a first line of names has them
    n              a first line of one number, as .pts files have, is how many points follow

Spaces, tabs, commas and semicolons part numbers; lines that begin with # or // are comments. Nothing says what the
coordinates are: metres with z up, unless the user says otherwise.
"""

from __future__ import annotations

import itertools
import re
import warnings
from io import BytesIO
from pathlib import Path

import numpy as np

from maxjax.core.files import FileError, brief, open_regular, read_bytes
from maxjax.io.kinds.point_cloud import MAX_POINTS, PointCloud, local_cloud
from maxjax.io.reading import PLAIN, Reading

_HEAD = 65_536  # bytes within which comments and names end
_PARTS = re.compile(r"[\s,;]+")
_GRID = (b"ncols", b"nrows")
_NAMES = {"x": 0, "y": 1, "z": 2, "easting": 0, "northing": 1, "height": 2, "elevation": 2, "altitude": 2}


def is_grid(path: Path) -> bool:
    """Whether an .asc file is a grid of Esri, which begins with the number of its columns."""
    with open_regular(path) as file:
        return file.read(16).lstrip().lower().startswith(_GRID)


def load_text_points(path: Path, reading: Reading = PLAIN) -> PointCloud:
    """The points of a text file.

    Raises:
        FileError: if the file cannot be read, has no three columns of numbers, or another number of points than it
            claims.
    """
    content = read_bytes(path)
    skipped, columns, claimed = _head(content, path)
    between = next((mark for mark in (";", ",") if mark.encode() in _line(content, skipped)), None)
    try:
        with warnings.catch_warnings(action="ignore"):  # about a file without points, which is refused
            table = np.loadtxt(
                BytesIO(content),
                np.float64,
                comments=["#", "//"],
                delimiter=between,
                skiprows=skipped,
                usecols=columns,
                ndmin=2,
                max_rows=MAX_POINTS + 1,
                encoding="latin1",
            )
    except ValueError as error:
        raise FileError(f"{path}: expected lines of numbers x y z: {brief(error)}") from error
    if len(table) > MAX_POINTS:
        raise FileError(f"{path}: holds more than {MAX_POINTS} points, expected at most that many; crop or thin it")
    if claimed is not None and len(table) != claimed:
        raise FileError(f"{path}: claims {claimed} points in its first line, found {len(table)}; truncated?")
    return local_cloud(table, path, reading)


def _head(content: bytes, path: Path) -> tuple[int, list[int], int | None]:
    """How many lines come before the points, the columns of x, y and z, and how many points the file claims."""
    claimed: int | None = None
    text = content[:_HEAD].decode("latin1")
    for number, line in enumerate(text.splitlines()):
        words = [word for word in _PARTS.split(line.strip().lstrip("#/").strip()) if word]
        if not words:
            continue
        named = [_NAMES.get(word.lower().strip('"')) for word in words]
        if {0, 1, 2} <= set(named):
            return number + 1, [named.index(axis) for axis in range(3)], claimed
        if line.lstrip().startswith(("#", "//")):
            continue
        if len(words) == 1 and words[0].isdigit() and claimed is None and len(words[0]) < 12:
            claimed = int(words[0])
            continue
        if len(words) >= 3 and all(map(_is_number, words[:3])):
            return number, [0, 1, 2], claimed
        raise FileError(f"{path}: line {number + 1}: expected numbers x y z, or names, found {brief(line)[:80]!r}")
    raise FileError(f"{path}: expected lines of numbers x y z, found none")


def _line(content: bytes, number: int) -> bytes:
    """A line of a file's beginning, not a comment."""
    lines = itertools.islice(content[:_HEAD].splitlines(), number, None)
    return next((line for line in lines if line.strip() and not line.lstrip().startswith((b"#", b"//"))), b"")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
