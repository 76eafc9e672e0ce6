"""Ways in which points are packed in LAZ: chunks of one size, of any size as in COPC, and what no reader here knows."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maxjax.core.files import FileError
from maxjax.io import PointCloud, read_map

laspy = pytest.importorskip("laspy", reason="needs the extra las")


def survey(count: int = 500) -> Any:
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = [0.01] * 3, [1000.0, 2000.0, 0.0]
    las = laspy.LasData(header)
    rng = np.random.default_rng(0)
    las.x, las.y, las.z = rng.uniform(0, 50, (3, count)) + np.array([[1000.0], [2000.0], [0.0]])
    las.classification = np.resize([2, 6], count)
    las.return_number[:] = las.number_of_returns[:] = 1
    return las


def test_an_unknown_compressor_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.laz"
    survey().write(path)
    content = bytearray(path.read_bytes())
    place = content.index(b"laszip encoded") - 2 + 54
    assert content[place] in (2, 3)
    content[place] = 1
    path.write_bytes(content)
    with pytest.raises(FileError, match=r"compressor 1 \(point by point\), expected chunks"):
        read_map(path)


def test_chunks_of_any_size_are_read(tmp_path: Path) -> None:
    """As COPC has them: the table of chunks says how many points each holds."""
    lazrs = pytest.importorskip("lazrs")
    las, plain = survey(), io.BytesIO()
    las.write(plain, do_compress=False)
    raw = plain.getvalue()
    data, record = int.from_bytes(raw[96:100], "little"), int.from_bytes(raw[105:107], "little")
    vlr = lazrs.LazVlr.new_for_compression(6, 0, True)
    packed = bytes(vlr.record_data())
    entry = b"\0\0" + b"laszip encoded".ljust(16, b"\0") + (22204).to_bytes(2, "little")
    entry += len(packed).to_bytes(2, "little") + bytes(32) + packed
    head = bytearray(raw[:data])
    head[96:100] = (data + len(entry)).to_bytes(4, "little")
    head[100:104] = (int.from_bytes(head[100:104], "little") + 1).to_bytes(4, "little")
    head[104] |= 0x80
    path = tmp_path / "a.copc.laz"
    with open(path, "wb") as file:
        file.write(bytes(head) + entry)
        compressor = lazrs.LasZipCompressor(file, vlr)
        for first, last in ((0, 7), (7, 300), (300, 500)):
            points = np.frombuffer(raw[data + first * record : data + last * record], np.uint8)
            compressor.compress_many(points)
            if last < 500:
                compressor.finish_current_chunk()
        compressor.done()
    found = read_map(path)
    assert isinstance(found, PointCloud)
    np.testing.assert_allclose(found.points + found.offset, las.xyz, atol=6e-3)
