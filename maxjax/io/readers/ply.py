"""Points and meshes in PLY files (Stanford polygon format 1.0): ASCII, binary little endian and binary big endian.

A text header lists elements (`element vertex 69792`) and their properties in order of storage; the data follow in the
same order. Of the element `vertex` only x, y, z are used [m]. A file with faces is a mesh, and never the points of its
vertices: walls stand between them. Data behind vertices and faces are not read, so their truncation goes unseen; so
does that of an ASCII file within the last digits of its last number.
"""

from __future__ import annotations

import dataclasses
import io
import struct
import warnings
from array import array
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Int64, Shaped

from maxjax.core.files import FileError, read_bytes, text_lines
from maxjax.io.kinds.mesh import MAX_FACES, Mesh, fans, mesh_of
from maxjax.io.kinds.point_cloud import MAX_POINTS, PointCloud, local_cloud
from maxjax.io.reading import PLAIN, Reading

_MAX_HEADER = 65_536
_BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
_TYPES |= {"float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2"}
_TYPES |= {"int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}
_WHOLE = {name: code for name, code in _TYPES.items() if code[0] != "f"}
_INDICES = ("vertex_indices", "vertex_index")

Failure = Callable[[str], FileError]


@dataclasses.dataclass
class _Element:
    """One entry of the header. A property is (name, type of its values, type of its length if a list)."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]]


def load_ply(path: Path, reading: Reading = PLAIN) -> PointCloud | Mesh:
    """The mesh of a PLY file, or its vertices where it has no face.

    Raises:
        FileError: if the file cannot be read as PLY, has no x, y, z, surfaces other than faces, too much of anything,
            or less than its header claims.
    """
    fail = _failure(path)
    points: np.ndarray | None = None
    faces: np.ndarray | None = None
    # A copy of its own: a mapped file that another process cuts short would end this one.
    file = io.BytesIO(read_bytes(path))
    size = len(file.getvalue())
    order, elements = _read_header(file, fail)
    surface = [element.name for element in elements if element.count and element.name != "vertex"]
    if "tristrips" in surface:
        raise fail("holds triangle strips, which are not supported; export triangles")
    for element in elements:
        if points is not None and (faces is not None or "face" not in surface):
            break
        if element.name == "vertex":
            _check_vertices(element, order, size - file.tell(), fail)
            points = (_read_binary if order else _read_ascii)(file, element, order, fail)
        elif element.name == "face" and element.count:
            faces = _read_faces(file, element, order, fail)
        else:
            _skip(file, element, order, fail)
    if points is None:
        raise fail("expected an element vertex, found " + (", ".join(e.name for e in elements) or "none"))
    if faces is None:
        return local_cloud(points, path, reading)
    return mesh_of(points.astype(np.float64), faces, path, reading)


def _failure(path: Path) -> Failure:
    return lambda message: FileError(f"{path}: {message}")


def _read_header(file: io.BytesIO, fail: Failure) -> tuple[str, list[_Element]]:
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
            case ["property", "list", length, kind, name] if elements and length in _WHOLE and kind in _TYPES:
                elements[-1].properties.append((name, _TYPES[kind], _WHOLE[length]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append((name, _TYPES[kind], None))
            case _:
                raise fail(f"header line not understood: {' '.join(words)[:80]!r}")
    if order is None:
        raise fail("expected a line format ascii, binary_little_endian or binary_big_endian 1.0, found none")
    return order, elements


def _check_vertices(vertex: _Element, order: str, remaining: int, fail: Failure) -> None:
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


def _read_binary(file: io.BytesIO, vertex: _Element, order: str, fail: Failure) -> Shaped[np.ndarray, "n 3"]:
    row = _row(vertex, order)
    rows = np.frombuffer(file.read(vertex.count * row.itemsize), row)
    names = [name for name, _, _ in vertex.properties]
    return np.stack([rows[f"p{names.index(axis)}"] for axis in "xyz"], axis=1)


def _read_ascii(file: io.BytesIO, vertex: _Element, order: str, fail: Failure) -> Shaped[np.ndarray, "n 3"]:
    names = [name for name, _, _ in vertex.properties]
    columns = [names.index(axis) for axis in "xyz"]
    lines = text_lines(file.readline, vertex.count, fail)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about blank lines; the count below finds out
            points = np.loadtxt(lines, np.float64, comments=None, usecols=columns, ndmin=2, encoding="latin1")
    except ValueError as error:
        if isinstance(error, FileError):
            raise
        raise fail(f"expected {vertex.count} lines of {len(names)} numbers: {error}") from error
    if len(points) < vertex.count:
        raise fail(f"claims {vertex.count} vertices, found {len(points)}; the file is truncated")
    return points


def _skip(file: io.BytesIO, element: _Element, order: str, fail: Failure) -> None:
    """Step over an element that is not used."""
    if element.count > MAX_POINTS:
        raise fail(f"claims {element.count} of {element.name}, expected at most {MAX_POINTS}; truncated or too large")
    if not order:
        if sum(1 for _ in text_lines(file.readline, element.count, fail)) < element.count:
            raise fail(f"ends in element {element.name}; the file is truncated")
    elif any(length for _, _, length in element.properties):
        _find_lists(file, element, order, fail)
    else:
        end = file.tell() + element.count * _row(element, order).itemsize
        if end > len(file.getvalue()):
            raise fail(f"ends in element {element.name}; the file is truncated")
        file.seek(end)


def _read_faces(file: io.BytesIO, element: _Element, order: str, fail: Failure) -> Int64[np.ndarray, "t 3"]:
    """Triangles of the element `face`, as numbers of vertices."""
    lists = [(name, kind) for name, kind, length in element.properties if length and name in _INDICES]
    if len(lists) != 1 or lists[0][1][0] == "f":
        names = ", ".join(name for name, _, _ in element.properties[:16])
        raise fail(f"face: expected one list vertex_indices of whole numbers, found {names or 'nothing'}")
    if element.count > MAX_FACES:
        raise fail(f"claims {element.count} faces, expected at most {MAX_FACES}; crop or thin it")
    code = np.dtype(order + lists[0][1])
    if order:
        begin, length, raw = _find_lists(file, element, order, fail)
        _check_corners(int(length.sum()), fail)
        corners = np.empty(int(length.sum()), np.int64)
        place = np.cumsum(length) - length
        for count in np.unique(length[length > 0]).tolist():
            rows = np.flatnonzero(length == count)
            byte = begin[rows, None] + np.arange(count * code.itemsize)
            corners[place[rows, None] + np.arange(count)] = raw[byte].view(code)
    else:
        corners, length = _face_lines(file, element, fail)
        _check_corners(len(corners), fail)
    return fans(corners, length)


def _check_corners(count: int, fail: Failure) -> None:
    if count > 3 * MAX_FACES:
        raise fail(f"its faces have {count} corners, expected at most {3 * MAX_FACES}; crop or thin it")


def _find_lists(
    file: io.BytesIO, element: _Element, order: str, fail: Failure
) -> tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " n"], Shaped[np.ndarray, " bytes"]]:
    """First byte and length of each row's vertex list; the file's bytes. Leaves the file behind the element."""
    raw = file.getvalue()
    at, size = file.tell(), len(raw)
    steps = [
        (
            np.dtype(kind).itemsize,
            length and struct.Struct((order or "<") + np.dtype(length).char),
            name in _INDICES,
        )
        for name, kind, length in element.properties
    ]
    begin, lengths = array("q"), array("q")
    try:
        for _ in range(element.count):
            for width, counter, wanted in steps:
                if not counter:
                    at += width
                    continue
                (items,) = counter.unpack_from(raw, at)
                at += counter.size
                if wanted:
                    begin.append(at)
                    lengths.append(items)
                if items < 0:
                    raise fail(f"a list of element {element.name} claims {items} values; truncated or damaged")
                at += items * width
            if at > size:
                break
    except struct.error:
        at = size + 1
    if at > size:
        raise fail(f"ends in element {element.name}; the file is truncated")
    file.seek(at)
    return np.frombuffer(begin, np.int64), np.frombuffer(lengths, np.int64), np.frombuffer(raw, np.uint8)


def _face_lines(
    file: io.BytesIO, element: _Element, fail: Failure
) -> tuple[Int64[np.ndarray, " n"], Int64[np.ndarray, " m"]]:
    """Corners of all faces one after the other, and how many each has."""
    corners, lengths = array("q"), array("q")
    count = 0
    for line in text_lines(file.readline, element.count, fail):
        words, at = line.split(), 0
        try:
            for name, _, length in element.properties:
                items = int(words[at]) if length else 1
                at += bool(length)
                if items < 0 or at + items > len(words):
                    raise ValueError(f"expected {items} more numbers")
                if length and name in _INDICES:
                    corners.extend(map(int, words[at : at + items]))
                    lengths.append(items)
                at += items
        except (IndexError, ValueError, OverflowError) as error:
            raise fail(f"face {count}: {line[:60].decode('latin1')!r}: {error}; truncated or damaged") from error
        count += 1
    if count < element.count:
        raise fail(f"claims {element.count} faces, found {count}; the file is truncated")
    return np.frombuffer(corners, np.int64), np.frombuffer(lengths, np.int64)
