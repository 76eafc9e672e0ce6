"""Points of airborne surveys: LAS and, compressed, LAZ (extra `las`: laspy with lazrs).

    x = X · scale + offset, X stored as int32

Classes follow the ASPRS LAS specification, whose 2 (ground), 9 (water) and 11 (road surface) are ground here:
what lies below them cannot be flown through. 6 (building) is solid, and so is, by default, what a tree or anything
unclassified hides (`airborne`), a bridge's deck (17, or 26 in the Dutch AHN) too: what is below was not seen. Under
wires one may fly. Noise (7, 18) and points flagged as withheld are dropped, since the survey itself disowns them.
"""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from maxjax.core.files import FileError, open_regular
from maxjax.io.kinds.point_cloud import MAX_POINTS, Labels, PointCloud, local_cloud
from maxjax.io.readers.las_reference import read_records, trailing_wkt
from maxjax.io.reading import PLAIN, Reading

_GROUND, _SOLID, _NOISE = (2, 9, 11), (6,), (7, 18)
_MISSING = "reading LAS needs the extra las: pip install 'maxjax[las]'"
_CHUNK_BYTES = 2**26
_MAX_RECORD = 1024
_LASZIP, _COMPRESSORS = 22204, (2, 3)

# The part of the public header block that every version shares, and what LAS 1.4 appends.
_HEADER = np.dtype(
    {
        "names": [
            "signature",
            "minor",
            "data",
            "vlrs",
            "format",
            "record",
            "count",
            "scale",
            "offset",
        ],
        "formats": ["S4", "u1", "<u4", "<u4", "u1", "<u2", "<u4", ("<f8", 3), ("<f8", 3)],
        "offsets": [0, 25, 96, 100, 104, 105, 107, 131, 155],
        "itemsize": 227,
    }
)
_COUNT_14 = 247


def load_las(path: Path, reading: Reading = PLAIN) -> PointCloud:
    """The points of a .las or .laz file, in chunks, with ground and solid from their classes.

    Raises:
        FileError: if the extra is missing, or the file is unreadable, truncated, too large or contradicts its
            header; as `reference`.
    """
    try:
        import laspy
    except ImportError as error:
        raise FileError(f"{path}: {_MISSING}") from error
    if not (backend := laspy.LazBackend.Lazrs).is_available():
        raise FileError(f"{path}: {_MISSING}")
    points = _Points(reading.drop_classes)
    claimed = np.zeros(0, np.int64)
    try:
        with _silent(), open_regular(path) as file:
            count, scale, offset = _check_header(path, file)
            trailing = trailing_wkt(file, os.fstat(file.fileno()).st_size)
            file.seek(0)
            # One thread reads the stream as it comes; the parallel one would trust the chunk table.
            with laspy.open(file, laz_backend=backend, read_evlrs=False, closefd=False) as reader:
                header = reader.header
                stated = read_records(header.vlrs, trailing, reading, path)
                record = header.point_format.size
                if header.are_points_compressed:
                    claimed = np.array(header.number_of_points_by_return, np.int64)
                    packed = reader.point_source.vlr.item_size()
                    if packed != record:
                        raise FileError(f"{path}: records of {record} bytes are packed as {packed}; damaged")
                for chunk in reader.chunk_iterator(max(1, _CHUNK_BYTES // record)):
                    points.add(chunk)
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror or error}") from error
    except BaseException as error:
        # lazrs is Rust: on damaged data it may panic, which arrives as a BaseException of a private type. It also
        # writes a line to stderr; to turn that away is to turn all threads' stderr away, Ctrl-C's sentence too.
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        raise FileError(f"{path}: expected an intact LAS or LAZ file, found a damaged one: {error}") from error
    if points.found != count:
        raise FileError(f"{path}: claims {count} points, found {points.found}; the file is truncated")
    if (end := _end_of_returns(points.returns, claimed)) is not None:
        raise FileError(f"{path}: claims {count} points, but counts the returns of its first {end} alone; damaged")
    return local_cloud(points.stored * scale + offset, path, reading, stated, points.labels)


class _Points:
    """Contents of a stream's chunks: places and classes of the points that are kept, counts of the others."""

    def __init__(self, drop_classes: Sequence[int]) -> None:
        self._drop_classes = drop_classes
        self._axes: list[np.ndarray] = []
        self._classes: list[np.ndarray] = []
        self._returns: list[np.ndarray] = []
        self._dropped = np.zeros(2, np.int64)
        self.found = 0

    def add(self, chunk: Any) -> None:
        """A chunk of laspy's points."""
        self.found += len(chunk)
        self._returns.append(np.asarray(chunk.return_number))
        noise = np.isin(chunk.classification, _NOISE) | (np.asarray(chunk.withheld) != 0)
        unwanted = ~noise & np.isin(chunk.classification, self._drop_classes)
        self._dropped += np.sum([noise, unwanted], axis=1)
        kept = ~noise & ~unwanted
        self._axes.append(np.stack([chunk.X, chunk.Y, chunk.Z], axis=1)[kept])
        self._classes.append(np.asarray(chunk.classification)[kept])

    @property
    def returns(self) -> np.ndarray:
        """Number of the return of each point, the dropped ones too."""
        return np.concatenate(self._returns)

    @property
    def stored(self) -> np.ndarray:
        """Coordinates as stored, unscaled."""
        return np.concatenate(self._axes)

    @property
    def labels(self) -> Labels:
        """Classes, with what they say, and how many points were dropped for what reason."""
        numbers = np.concatenate(self._classes)
        reasons = ("noise or withheld", "of classes that are dropped")
        withdrawn = {reason: n for reason, n in zip(reasons, self._dropped.tolist(), strict=True) if n}
        return Labels(np.isin(numbers, _GROUND), np.isin(numbers, _SOLID), numbers, withdrawn)


def _end_of_returns(returns: np.ndarray, claimed: np.ndarray) -> int | None:
    """How many points a header counts by return, if these are the first ones of a file that has more; else None.

    A compressed stream read beyond its end goes on with points like its last ones: then the counts end before them.
    Counts that are those of no beginning of the file are merely wrong, as programs that cut or join files leave them.

    Args:
        returns: return number of each point.
        claimed: points with return 1, 2, …
    """
    counted = np.flatnonzero((returns > 0) & (returns <= len(claimed)))
    total = int(claimed.sum())
    if not 0 < total < len(counted):
        return None
    first = counted[:total]
    same = np.array_equal(np.bincount(returns[first], minlength=len(claimed) + 1)[1:], claimed)
    return int(first[-1]) + 1 if same else None


def _check_header(path: Path, file: BinaryIO) -> tuple[int, np.ndarray, np.ndarray]:
    """Number of points, scale and offset; refuses claims that the file cannot hold."""
    size = os.fstat(file.fileno()).st_size
    raw = file.read(_COUNT_14 + 8)
    if not raw.startswith(b"LASF") or len(raw) < _HEADER.itemsize:
        raise FileError(f"{path}: expected a LAS file, which starts with LASF and a header of 227 bytes")
    header = np.frombuffer(raw, _HEADER, 1)[0]
    count, record, data = int(header["count"]), int(header["record"]), int(header["data"])
    if header["minor"] >= 4 and len(raw) == _COUNT_14 + 8:
        count = int.from_bytes(raw[_COUNT_14:], "little")
    if count == 0:
        raise FileError(f"{path}: holds no point, expected at least one")
    if count > MAX_POINTS:
        raise FileError(f"{path}: claims {count} points, expected at most {MAX_POINTS}; crop or thin it")
    if not 0 < record <= _MAX_RECORD:
        raise FileError(f"{path}: claims {record} bytes a point, expected 1 to {_MAX_RECORD}; damaged")
    compressed = bool(header["format"] & 0x80)
    needed = data if compressed else data + count * record
    if needed > size:
        raise FileError(f"{path}: claims {count} points up to byte {needed}, has {size} bytes; truncated")
    if int(header["vlrs"]) * 54 > data:
        raise FileError(f"{path}: claims {header['vlrs']} variable records in {data} bytes; damaged")
    if compressed:
        _check_compressor(path, file, int.from_bytes(raw[94:96], "little"), int(header["vlrs"]))
        _check_chunk_table(path, file, data, size)
    scale, offset = np.array(header["scale"]), np.array(header["offset"])
    if not (np.all(np.isfinite(scale)) and np.all(scale != 0) and np.all(np.isfinite(offset))):
        raise FileError(f"{path}: expected finite scales and offsets, found {scale} and {offset}; damaged")
    return count, scale, offset


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """No log of laspy: it also prints what it raises, and the user needs one sentence."""
    logger = logging.getLogger("laspy")
    level = logger.level
    logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        logger.setLevel(level)


def _check_compressor(path: Path, file: BinaryIO, place: int, records: int) -> None:
    """Refuse, by its name, a way of packing points that lazrs does not read."""
    for _ in range(records):
        file.seek(place)
        head = file.read(54)
        user, number, length = head[2:18].rstrip(b"\0"), int.from_bytes(head[18:20], "little"), head[20:22]
        if user == b"laszip encoded" and number == _LASZIP:
            kind = int.from_bytes(file.read(2), "little")
            if kind not in _COMPRESSORS:
                raise FileError(
                    f"{path}: its points are packed by LASzip's compressor {kind}"
                    f"{' (point by point)' if kind == 1 else ''}, expected chunks (2 or 3); write it anew with laszip"
                )
            return
        place += 54 + int.from_bytes(length, "little")


def _check_chunk_table(path: Path, file: BinaryIO, data: int, size: int) -> None:
    """LAZ ends with a table of its chunks, whose claimed length would otherwise be allocated unseen."""
    file.seek(data)
    table = int.from_bytes(file.read(8), "little", signed=True)
    if table == -1:  # written by a stream, which could not go back: the place stands at the very end
        file.seek(max(data, size - 8))
        table = int.from_bytes(file.read(8), "little", signed=True)
    if not data + 8 <= table <= size - 8:
        raise FileError(f"{path}: expected its chunk table before byte {size}, found {table}; truncated")
    file.seek(table + 4)
    chunks = int.from_bytes(file.read(4), "little")
    if chunks > table - data:
        raise FileError(f"{path}: claims {chunks} chunks in {table - data} bytes; damaged")
