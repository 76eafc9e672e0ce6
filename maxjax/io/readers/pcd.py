"""Points in PCD files of the Point Cloud Library (0.7): ascii, binary and binary_compressed.

    FIELDS x y z …   SIZE, TYPE, COUNT of each   POINTS n   DATA kind

`binary_compressed` holds one field after the other, packed by LZF: a byte c < 32 is followed by c + 1 bytes as they
are; else c >> 5, and where that is 7 a byte more, is a length of bytes to repeat, 2 less than it is, from c & 31 and
one byte more back. The sensor's pose (VIEWPOINT) is not applied, as in PCL itself.
"""

from __future__ import annotations

import sys
import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Shaped

from maxjax.core.files import FileError, read_bytes, text_lines
from maxjax.io.kinds.point_cloud import MAX_POINTS, PointCloud, local_cloud
from maxjax.io.reading import PLAIN, Reading

_KINDS = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}
_MAX_HEADER = 65_536
_MAX_BYTES = 2**31


def load_pcd(path: Path, reading: Reading = PLAIN) -> PointCloud:
    """The points of a .pcd file.

    Raises:
        FileError: if the file cannot be read, has no x, y, z, or fewer points than it claims.
    """
    content = read_bytes(path)
    header, kind, begin = _header(content, path)
    names, row = header["names"], header["row"]
    count = header["points"]
    if kind == "ascii":
        text = BytesIO(content)
        text.seek(begin)
        return local_cloud(_ascii(text, count, [header["place"][axis] for axis in "xyz"], path), path, reading)
    data = memoryview(content)[begin:]
    whole = count * row.itemsize
    if kind == "binary":
        if len(data) < whole:
            raise FileError(f"{path}: claims {count} points of {row.itemsize} bytes, found {len(data)}; truncated")
        rows = np.frombuffer(data, row, count)
        return local_cloud(np.stack([rows[f"p{names.index(axis)}"][..., 0] for axis in "xyz"], axis=1), path, reading)
    if len(data) < 8:
        raise FileError(f"{path}: expected two sizes before its compressed data; truncated")
    packed, unpacked = (int(n) for n in np.frombuffer(data, "<u4", 2))
    if unpacked != whole or packed > len(data) - 8:
        raise FileError(
            f"{path}: claims {packed} packed bytes for {unpacked}, found {len(data) - 8} for {whole}; damaged"
        )
    fields = _unpacked(bytes(data[8 : 8 + packed]), unpacked, path)
    axes, at = {}, 0
    for name, place in zip(names, row.names or (), strict=True):
        code = row[place]
        if name in "xyz":
            axes[name] = np.frombuffer(fields, code.base, count * code.itemsize // code.base.itemsize, at)[:count]
        at += count * code.itemsize
    return local_cloud(np.stack([axes[axis] for axis in "xyz"], axis=1), path, reading)


def _header(content: bytes, path: Path) -> tuple[dict[str, Any], str, int]:
    """Fields and number of points; the kind of data and where they begin."""
    found: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in found:
        end = content.find(b"\n", at, _MAX_HEADER)
        if end < 0:
            raise FileError(f"{path}: expected a line DATA within {_MAX_HEADER} bytes; truncated or no PCD")
        words = content[at:end].decode("latin1").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            found[words[0]] = words[1:]
    names = found.get("FIELDS", [])
    sizes, kinds = found.get("SIZE", []), found.get("TYPE", [])
    counts = found.get("COUNT", ["1"] * len(names))
    kind = " ".join(found["DATA"])
    numbers = [*sizes, *counts, *found.get("POINTS", ["?"])]
    if not all(word.isdigit() and len(word) < 12 for word in numbers) or not len(names) == len(sizes) == len(
        kinds
    ) == len(counts):
        raise FileError(f"{path}: expected FIELDS, SIZE, TYPE, COUNT of one length and POINTS; damaged or no PCD")
    if any(names.count(axis) != 1 for axis in "xyz") or kind not in ("ascii", "binary", "binary_compressed"):
        raise FileError(f"{path}: expected the fields x, y, z once each and known DATA, found {names[:12]}, {kind!r}")
    points, most = int(found["POINTS"][0]), sum(map(int, counts))
    if any(int(size) not in _SIZES.get(letter, ()) for size, letter in zip(sizes, kinds, strict=True)) or most > 1000:
        raise FileError(f"{path}: expected fields of the types F 4 8, I or U 1 2 4 8, found {kinds[:12]} {sizes[:12]}")
    if any(counts[names.index(axis)] != "1" for axis in "xyz"):
        raise FileError(f"{path}: expected one value in x, y and z each; damaged")
    if points > MAX_POINTS:
        raise FileError(f"{path}: claims {points} points, expected at most {MAX_POINTS}; crop or thin it")
    fields = zip(kinds, sizes, counts, strict=True)
    row = np.dtype([(f"p{i}", f"<{_KINDS[letter]}{size}", (int(n),)) for i, (letter, size, n) in enumerate(fields)])
    if points * row.itemsize > _MAX_BYTES:
        raise FileError(f"{path}: claims {points * row.itemsize} bytes, expected at most {_MAX_BYTES}; crop or thin it")
    first = np.cumsum([0, *map(int, counts)])
    place = {name: int(first[k]) for k, name in enumerate(names)}
    return {"names": names, "row": row, "points": points, "place": place}, kind, at


def _ascii(text: BytesIO, count: int, columns: list[int], path: Path) -> Shaped[np.ndarray, "n 3"]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about blank lines; the count below finds out
            lines = text_lines(text.readline, sys.maxsize, lambda message: FileError(f"{path}: {message}"))
            points = np.loadtxt(lines, np.float64, comments=None, usecols=columns, ndmin=2, max_rows=count)
    except ValueError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(f"{path}: expected {count} lines of numbers: {error}") from error
    if len(points) < count:
        raise FileError(f"{path}: claims {count} points, found {len(points)}; truncated")
    return points


def _unpacked(packed: bytes, size: int, path: Path) -> bytes:
    """LZF undone; at most `size` bytes are ever held."""
    out = bytearray()
    at, end = 0, len(packed)
    try:
        while at < end and len(out) <= size:
            code = packed[at]
            at += 1
            if code < 32:
                if at + code + 1 > end:
                    raise IndexError
                out += packed[at : at + code + 1]
                at += code + 1
                continue
            length = code >> 5
            if length == 7:
                length += packed[at]
                at += 1
            back = len(out) - ((code & 31) << 8) - packed[at] - 1
            at += 1
            if back < 0:
                raise IndexError
            length += 2
            piece = bytes(out[back : back + length])
            out += (piece * (length // len(piece) + 1))[:length]
    except IndexError as error:
        raise FileError(f"{path}: its compressed data are damaged") from error
    if len(out) != size:
        raise FileError(f"{path}: its compressed data unpack to another size than {size} bytes; damaged")
    return bytes(out)
