"""Points in PLY files (Stanford polygon format 1.0): ASCII, binary little endian and binary big endian.

A text header lists elements (`element vertex 69792`) and their properties in order of storage; the data
follow in the same order. Only x, y, z of the element `vertex` are used [m]; everything else is skipped. Data
behind the vertices (faces, as a rule) are not read, so their truncation goes unseen; so does that of an ASCII
file within the last digits of its last number.
"""

from __future__ import annotations

import dataclasses
import os
import warnings
from collections.abc import Callable
from itertools import islice
from pathlib import Path
from typing import BinaryIO

import numpy as np
from jaxtyping import Shaped

from maxjax.maps.model import MAX_POINTS, MapError, PointCloud, local_cloud

_MAX_HEADER = 65_536
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_TYPES |= {"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"}
_TYPES |= {"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}


@dataclasses.dataclass
class _Element:
    """One entry of the header. A property is (name, type of its values, type of its length if a list)."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]]


def load_ply(path: Path) -> PointCloud:
    """The vertices of a PLY file.

    Raises:
        MapError: if the file cannot be read as PLY, has no x, y, z, too many vertices or fewer than its
            header claims.
    """
    fail = _failure(path)
    try:
        with open(path, "rb") as file:
            order, elements = _read_header(file, fail)
            remaining = os.fstat(file.fileno()).st_size - file.tell()
            for element in elements:
                if element.name == "vertex":
                    _check_vertices(element, order, remaining, fail)
                    read = _read_binary if order else _read_ascii
                    return local_cloud(read(file, element, order, fail), path)
                if order:
                    _skip_binary(file, element, order, fail)
                else:
                    skipped = sum(1 for _ in islice(file, min(element.count, remaining)))
                    if skipped < element.count:
                        raise fail(f"ends in element {element.name}; the file is truncated")
                remaining = os.fstat(file.fileno()).st_size - file.tell()
    except OSError as error:
        raise fail(f"cannot be read: {error.strerror or error}") from error
    raise fail("expected an element vertex, found " + (", ".join(e.name for e in elements) or "none"))


def _failure(path: Path) -> Callable[[str], MapError]:
    return lambda message: MapError(f"{path}: {message}")


def _read_header(file: BinaryIO, fail: Callable[[str], MapError]) -> tuple[str, list[_Element]]:
    """Byte order ("" for ASCII) and elements; leaves the file at the first byte of the data."""
    order: str | None = None
    elements: list[_Element] = []
    left = _MAX_HEADER
    if file.readline(8).strip() != b"ply":
        raise fail("expected a PLY file, whose first line is ply")
    while True:
        line = file.readline(left)
        left -= len(line)
        if not line.endswith(b"\n"):
            raise fail(f"expected end_header within {_MAX_HEADER} bytes; the header is truncated or not PLY")
        words = line.decode("ascii", "replace").split()
        match words:
            case ["end_header"]:
                break
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, "1.0"] if name in _BYTE_ORDERS:
                order = _BYTE_ORDERS[name]
            case ["element", name, count] if count.isdecimal():
                elements.append(_Element(name, int(count), []))
            case ["property", "list", length, kind, name] if elements and length in _TYPES and kind in _TYPES:
                elements[-1].properties.append((name, _TYPES[kind], _TYPES[length]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append((name, _TYPES[kind], None))
            case _:
                raise fail(f"header line not understood: {' '.join(words)[:80]!r}")
    if order is None:
        raise fail("expected a line format ascii, binary_little_endian or binary_big_endian 1.0, found none")
    return order, elements


def _check_vertices(vertex: _Element, order: str, remaining: int, fail: Callable[[str], MapError]) -> None:
    """Refuse what cannot be read or what the rest of the file cannot hold, before memory is taken."""
    names = [name for name, _, _ in vertex.properties]
    if any(names.count(axis) != 1 for axis in "xyz"):
        raise fail(f"vertex: expected properties x, y, z once each, found {', '.join(names[:16]) or 'none'}")
    if any(length for _, _, length in vertex.properties):
        raise fail("vertex: list properties are not supported; export the points without them")
    if vertex.count > MAX_POINTS:
        raise fail(f"claims {vertex.count} vertices, expected at most {MAX_POINTS}; crop or thin it")
    # ASCII: at least a digit and a blank or line end for each number, but for the last line end.
    row = _row(vertex, order).itemsize if order else 2 * len(names)
    needed = vertex.count * row - (0 if order else 1)
    if needed > remaining:
        raise fail(
            f"claims {vertex.count} vertices of at least {row} bytes, but only {remaining} bytes follow; "
            "the file is truncated"
        )


def _row(element: _Element, order: str) -> np.dtype[np.void]:
    """Layout of one row without lists. Fields go by number, since names may repeat."""
    return np.dtype([(f"p{i}", order + kind) for i, (_, kind, _) in enumerate(element.properties)])


def _read_binary(
    file: BinaryIO, vertex: _Element, order: str, fail: Callable[[str], MapError]
) -> Shaped[np.ndarray, "n 3"]:
    rows = np.fromfile(file, _row(vertex, order), vertex.count)
    if len(rows) < vertex.count:
        raise fail(f"claims {vertex.count} vertices, found {len(rows)}; the file is truncated")
    names = [name for name, _, _ in vertex.properties]
    return np.stack([rows[f"p{names.index(axis)}"] for axis in "xyz"], axis=1)


def _read_ascii(
    file: BinaryIO, vertex: _Element, order: str, fail: Callable[[str], MapError]
) -> Shaped[np.ndarray, "n 3"]:
    names = [name for name, _, _ in vertex.properties]
    columns = [names.index(axis) for axis in "xyz"]
    lines = islice(file, vertex.count)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about blank lines; the count below finds out
            points = np.loadtxt(lines, np.float64, comments=None, usecols=columns, ndmin=2, encoding="latin1")
    except ValueError as error:
        raise fail(f"expected {vertex.count} lines of {len(names)} numbers: {error}") from error
    if len(points) < vertex.count:
        raise fail(f"claims {vertex.count} vertices, found {len(points)}; the file is truncated")
    return points


def _skip_binary(file: BinaryIO, element: _Element, order: str, fail: Callable[[str], MapError]) -> None:
    """Step over an element that stands before the vertices."""
    truncated = fail(f"ends in element {element.name}; the file is truncated")
    size = os.fstat(file.fileno()).st_size
    if not any(length for _, _, length in element.properties):
        end = file.tell() + element.count * _row(element, order).itemsize
        if end > size:
            raise truncated
        file.seek(end)
        return
    for _ in range(element.count):
        for _, kind, length in element.properties:
            items = 1
            if length:
                code = np.dtype(order + length)
                raw = file.read(code.itemsize)
                if len(raw) < code.itemsize:
                    raise truncated
                items = int(np.frombuffer(raw, code)[0])
            end = file.tell() + items * np.dtype(kind).itemsize
            if items < 0 or end > size:
                raise truncated
            file.seek(end)
