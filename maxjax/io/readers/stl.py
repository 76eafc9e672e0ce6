"""Triangles in STL files, binary and ASCII.

    binary: 80 bytes of anything, the number of triangles (uint32), then 50 bytes each: normal, three corners, attribute
    ASCII:  solid … facet … vertex x y z (three times) … endfacet … endsolid

Normals are ignored. The format has neither units nor an up axis: metres and z up are assumed.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from maxjax.core.files import FileError, read_bytes, read_text
from maxjax.io.kinds.mesh import MAX_FACES, Mesh, mesh_of
from maxjax.io.reading import PLAIN, Reading

_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84
_VERTEX = re.compile(rb"\bvertex\s+(\S{1,64})\s+(\S{1,64})\s+(\S{1,64})(?!\S)")


def load_stl(path: Path, reading: Reading = PLAIN) -> Mesh:
    """The triangles of an STL file.

    Raises:
        FileError: if the file cannot be read, or holds fewer or more triangles than it claims.
    """
    content = read_bytes(path)
    claimed = int.from_bytes(content[80:_HEADER], "little")
    if len(content) == _HEADER + claimed * _ROW.itemsize:
        if claimed > MAX_FACES:
            raise FileError(f"{path}: claims {claimed} triangles, expected at most {MAX_FACES}; crop or thin it")
        corners = np.frombuffer(content, _ROW, claimed, _HEADER)["corners"].reshape(-1, 3)
    elif content.lstrip()[:5].lower() == b"solid" and b"facet" in content[:4096].lower():
        corners = _ascii(read_text(path).lower(), path)
    else:
        raise FileError(
            f"{path}: claims {claimed} triangles, which take {_HEADER + claimed * _ROW.itemsize} bytes, "
            f"found {len(content)}; damaged or no STL"
        )
    return mesh_of(corners.astype(np.float64), np.arange(len(corners)).reshape(-1, 3), path, reading)


def _ascii(content: bytes, path: Path) -> np.ndarray:
    found = _VERTEX.findall(content)
    facets = len(re.findall(rb"\bendfacet\b", content))
    if len(found) != 3 * facets or len(re.findall(rb"\bvertex\b", content)) != len(found):
        raise FileError(f"{path}: expected three vertices a facet, found {len(found)} in {facets}; damaged")
    if content.rfind(b"endsolid") < content.rfind(b"endfacet"):
        raise FileError(f"{path}: expected endsolid behind the last facet; the file is truncated")
    return np.array(found, dtype="S").astype(np.float64).reshape(-1, 3)
