"""Meshes in Wavefront OBJ files.

    v x y z         a vertex [m]
    f a b c …       a face: numbers of vertices from 1 on, or from the last one backwards (-1); a/t/n names others too
    l a b …         a line, an obstacle along its whole length

Texture coordinates, normals, groups and materials are ignored; free-form curves and surfaces are refused. The format
has neither units nor an up axis: metres and z up, unless the user says otherwise.
"""

from __future__ import annotations

import itertools
from array import array
from pathlib import Path

import numpy as np

from maxjax.core.files import FileError, read_text
from maxjax.io.kinds.mesh import MAX_FACES, Mesh, fans, mesh_of
from maxjax.io.kinds.point_cloud import MAX_POINTS
from maxjax.io.reading import PLAIN, Reading

_IGNORED = {b"vt", b"vn", b"vp", b"g", b"o", b"s", b"mg", b"usemtl", b"mtllib", b"maplib", b"usemap", b"lod", b"bevel"}
_IGNORED |= {b"c_interp", b"d_interp", b"shadow_obj", b"trace_obj", b"p"}


def load_obj(path: Path, reading: Reading = PLAIN) -> Mesh:
    """Faces and lines of an OBJ file.

    Raises:
        FileError: if the file cannot be read, or holds a statement that is not understood or no face.
    """
    vertices, corners, lengths = array("d"), array("q"), array("q")
    for number, line in enumerate(read_text(path).replace(b"\r\n", b"\n").replace(b"\\\n", b" ").split(b"\n"), 1):
        words = line.split()
        if not words or words[0].startswith(b"#"):
            continue
        try:
            match words[0]:
                case b"v":
                    x, y, z = words[1:4]
                    vertices.extend((float(x), float(y), float(z)))
                case b"f" | b"l":
                    count = len(vertices) // 3
                    for word in words[1:]:
                        index = int(word.partition(b"/")[0])
                        if index == 0:
                            raise ValueError("vertices are numbered from 1 on")
                        corners.append(index - 1 if index > 0 else count + index)
                    if words[0] == b"f":
                        lengths.append(len(words) - 1)
                    else:
                        _as_segments(corners, lengths, len(words) - 1)
                case statement if statement not in _IGNORED:
                    raise ValueError("this statement is not supported")
        except (ValueError, OverflowError) as error:
            raise FileError(f"{path}: line {number}, {line[:60].decode('latin1')!r}: {error}") from error
    if len(vertices) // 3 > MAX_POINTS or len(corners) > 3 * MAX_FACES:
        raise FileError(
            f"{path}: holds {len(vertices) // 3} vertices and {len(lengths)} faces, expected at most {MAX_POINTS} "
            f"and {MAX_FACES}; crop or thin it"
        )
    if not lengths:
        raise FileError(f"{path}: expected a mesh, found no face")
    faces = fans(np.frombuffer(corners, np.int64), np.frombuffer(lengths, np.int64))
    return mesh_of(np.frombuffer(vertices).reshape(-1, 3), faces, path, reading)


def _as_segments(corners: array[int], lengths: array[int], count: int) -> None:
    """Replace the last corners, a line, by faces of two corners."""
    line = corners[len(corners) - count :]
    del corners[len(corners) - count :]
    for a, b in itertools.pairwise(line):
        corners.extend((a, b))
        lengths.append(2)
