"""Meshes in glTF 2.0 files: binary (.glb), and text with its buffers in it or beside it (.gltf).

    x_map = x,   y_map = −z,   z_map = y          glTF's y axis is up
    p_world = M(root) … M(node) p                 down the tree of nodes, M = T · R · S or a matrix

Of every primitive of the scene the positions are read; materials and images are never opened. A buffer is in the file
itself, or a file of the same folder; compressed or sparse accessors, skins and instancing are refused, as they would
leave walls out.
"""

from __future__ import annotations

import base64
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float, Int64

from maxjax.core.files import MAX_TEXT_BYTES, FileError, parse_json, read_bytes, read_text
from maxjax.io.kinds.mesh import MAX_FACES, Mesh, mesh_of
from maxjax.io.kinds.point_cloud import MAX_POINTS
from maxjax.io.reading import PLAIN, Reading

_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_", "MSFT_texture_", "KHR_xmp")


def load_gltf(path: Path, reading: Reading = PLAIN) -> Mesh:
    """The primitives of a glTF file's scene, z up.

    Raises:
        FileError: if the file cannot be read, is truncated, or needs what is not supported.
    """
    document, binary = _chunks(path) if path.suffix.lower() == ".glb" else (_document(read_text(path), path), None)
    buffers = _buffers(document, binary, path)
    for name in document.get("extensionsRequired", []):
        if not str(name).startswith(_HARMLESS):
            raise FileError(f"{path}: needs the extension {name}, which is not supported; export it without")
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    count = total = 0
    for matrix, mesh in _placed(document, path):
        for primitive in document["meshes"][mesh]["primitives"]:
            if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
                raise FileError(f"{path}: holds compressed meshes; export it without Draco")
            points = _accessor(document, buffers, primitive["attributes"]["POSITION"], "VEC3", path)
            total += len(points)
            if total > MAX_POINTS:
                raise FileError(f"{path}: expected at most {MAX_POINTS} vertices, found more; crop or thin it")
            index = np.arange(len(points))
            if "indices" in primitive:
                index = _accessor(document, buffers, primitive["indices"], "SCALAR", path)[:, 0].astype(np.int64)
            found = _corners(index, int(primitive.get("mode", 4)), path)
            if len(found) and (found.min() < 0 or found.max() >= len(points)):
                raise FileError(f"{path}: a face names vertex {found.max()}, expected 0 to {len(points) - 1}; damaged")
            count += len(found)
            if count > MAX_FACES:
                raise FileError(f"{path}: expected at most {MAX_FACES} triangles, found more; crop or thin it")
            faces.append(found + total - len(points))
            vertices.append(points.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3])
    if not faces:
        raise FileError(f"{path}: expected a mesh, found none in its scene")
    return mesh_of(np.concatenate(vertices), np.concatenate(faces), path, reading, "y")


def _chunks(path: Path) -> tuple[dict[str, Any], bytes]:
    """The document and the binary chunk."""
    content = read_bytes(path)
    if len(content) < 20 or content[:4] != b"glTF":
        raise FileError(f"{path}: expected a binary glTF file, which starts with glTF")
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2 or length != len(content):
        raise FileError(f"{path}: expected glTF 2 of {len(content)} bytes, found version {version}, {length} bytes")
    found: dict[int, bytes] = {}
    at = 12
    while at + 8 <= len(content):
        size, kind = struct.unpack_from("<II", content, at)
        if at + 8 + size > len(content):
            raise FileError(f"{path}: a chunk claims {size} bytes, {len(content) - at - 8} follow; truncated")
        found.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    if (size := len(found.get(_JSON, b""))) > MAX_TEXT_BYTES:
        raise FileError(f"{path}: its JSON has {size} bytes, expected at most {MAX_TEXT_BYTES}; crop it")
    return _document(found.get(_JSON, b""), path), found.get(_BINARY, b"")


def _document(content: bytes, path: Path) -> dict[str, Any]:
    document = parse_json(content, path)
    if not isinstance(document, dict):
        raise FileError(f"{path}: expected a JSON object, found {type(document).__name__}")
    return document


def _buffers(document: dict[str, Any], binary: bytes | None, path: Path) -> list[bytes]:
    """The bytes of each buffer: of the binary chunk, of its own text, or of a file of the same folder."""
    found: list[bytes] = []
    # A binary chunk is the first buffer, even where nothing names it.
    for number, buffer in enumerate(document.get("buffers") or [{}] * (binary is not None)):
        uri = buffer.get("uri")
        if uri is None:
            if binary is None or number:
                raise FileError(f"{path}: buffer {number} has neither bytes nor a file; damaged")
            found.append(binary)
        elif str(uri).startswith("data:"):
            head, _, text = str(uri).partition(",")
            if not head.endswith(";base64"):
                raise FileError(f"{path}: buffer {number}: expected base64, found {head[:60]!r}")
            found.append(base64.b64decode(text, validate=True))
        else:
            name = unquote(str(uri))
            if Path(name).name != name:
                raise FileError(f"{path}: buffer {number}: expected a file of the same folder, found {name[:60]!r}")
            found.append(read_bytes(path.with_name(name)))
    return found


def _placed(document: dict[str, Any], path: Path) -> Iterator[tuple[Float[np.ndarray, "4 4"], int]]:
    """Every mesh of the scene with its place; of a file without scenes all."""
    nodes = document.get("nodes", [])
    if "scenes" in document:
        roots = list(document["scenes"][document.get("scene", 0)].get("nodes", []))
    else:
        roots = sorted(set(range(len(nodes))) - {child for node in nodes for child in node.get("children", [])})
    waiting = [(np.eye(4), root) for root in roots]
    seen: set[int] = set()
    while waiting:
        matrix, number = waiting.pop()
        if number in seen or not 0 <= number < len(nodes):
            raise FileError(f"{path}: expected a tree of nodes, found node {number} twice or missing; damaged")
        seen.add(number)
        node = nodes[number]
        if "skin" in node or "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            raise FileError(f"{path}: node {number} has a skin or instances, which are not supported; apply them")
        here = matrix @ _matrix(node)
        waiting += [(here, child) for child in node.get("children", [])]
        if "mesh" in node:
            yield here, node["mesh"]


def _matrix(node: dict[str, Any]) -> Float[np.ndarray, "4 4"]:
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    x, y, z, w = (float(q) for q in node.get("rotation", (0, 0, 0, 1)))
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), np.float64).reshape(3)
    matrix[:3, 3] = np.array(node.get("translation", (0, 0, 0)), np.float64).reshape(3)
    return matrix


def _accessor(document: dict[str, Any], buffers: list[bytes], number: Any, kind: str, path: Path) -> np.ndarray:
    """Rows of an accessor, checked against the bytes that are there."""
    if not isinstance(number, int) or not 0 <= number < len(document["accessors"]):
        raise FileError(f"{path}: expected accessors up to {len(document['accessors']) - 1}, found {number!r}; damaged")
    accessor = document["accessors"][number]
    if "sparse" in accessor or "bufferView" not in accessor:
        raise FileError(f"{path}: accessor {number} is sparse or without data, which is not supported")
    view = document["bufferViews"][accessor["bufferView"]]
    if accessor["type"] != kind or "EXT_meshopt_compression" in view.get("extensions", {}):
        raise FileError(f"{path}: accessor {number}: expected plain {kind} in the file, found {accessor['type']}")
    if accessor.get("normalized"):
        raise FileError(f"{path}: accessor {number} is normalised, which is not supported; export floats")
    binary = buffers[int(view.get("buffer", 0))]
    code, width = np.dtype(_TYPES[accessor["componentType"]]), 3 if kind == "VEC3" else 1
    count, begin = int(accessor["count"]), int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
    stride = int(view.get("byteStride", 0)) or code.itemsize * width
    end = begin + (count - 1) * stride + code.itemsize * width
    whole = int(view.get("byteOffset", 0)) + int(view["byteLength"])
    if count < 1 or begin < 0 or stride < code.itemsize * width or end > min(whole, len(binary)):
        raise FileError(f"{path}: accessor {number} claims bytes {begin} to {end} of {len(binary)}; damaged")
    return np.ndarray((count, width), code, binary, begin, (stride, code.itemsize))


def _corners(index: Int64[np.ndarray, " n"], mode: int, path: Path) -> Int64[np.ndarray, "t 3"]:
    """Triangles of a primitive; points and lines as flat ones."""
    n = len(index)
    k = np.arange(max(n - 2, 0))
    match mode:
        case 0:
            return np.stack([index] * 3, axis=1)
        case 1 | 2 | 3:
            first = index[: n - n % 2 : 2] if mode == 1 else index[:-1] if mode == 3 else index
            second = index[1::2] if mode == 1 else index[1:] if mode == 3 else np.roll(index, -1)
            return np.stack([first, second, second], axis=1)
        case 4 if n % 3 == 0:
            return index.reshape(-1, 3)
        case 5:
            return np.stack([index[k], index[k + 1], index[k + 2]], axis=1)
        case 6:
            return np.stack([index[0 * k], index[k + 1], index[k + 2]], axis=1)
    raise FileError(f"{path}: a primitive of mode {mode} has {n} corners; damaged")
