"""A surface as binary glTF 2.0, its material without light (KHR_materials_unlit).

    header | chunk of JSON | chunk of numbers: points, colours, faces

Colours are written as those that the viewer's tone curve (Narkowicz's and Hill's fit of ACES, as three.js has it)
turns into the ones that are meant.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from maxjax.ui.page.nodes import Surface

_JSON, _BINARY = 0x4E4F534A, 0x004E4942
_FLOAT, _UINT = 5126, 5125
_POINTS, _FACES = 34962, 34963


def glb(surface: Surface) -> bytes:
    """The file's content."""
    points = np.ascontiguousarray(surface.points, np.float32)
    colors = _before_tone(surface.colors)
    faces = np.ascontiguousarray(surface.faces, np.uint32)
    pieces = [points.tobytes(), colors.tobytes(), faces.tobytes()]
    offsets = np.cumsum([0, *map(len, pieces)]).tolist()
    targets = (_POINTS, _POINTS, _FACES)
    views = [
        {"buffer": 0, "byteOffset": offsets[k], "byteLength": len(pieces[k]), "target": targets[k]} for k in range(3)
    ]
    bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
    accessors = [
        {"bufferView": 0, "componentType": _FLOAT, "count": len(points), "type": "VEC3", **bounds},
        {"bufferView": 1, "componentType": _FLOAT, "count": len(colors), "type": "VEC3"},
        {"bufferView": 2, "componentType": _UINT, "count": faces.size, "type": "SCALAR"},
    ]
    look: dict[str, Any] = {
        "pbrMetallicRoughness": {"baseColorFactor": [1.0, 1.0, 1.0, surface.opacity]},
        "alphaMode": "OPAQUE" if surface.opacity == 1.0 else "BLEND",
        "extensions": {"KHR_materials_unlit": {}},
    }
    mesh = {"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0}]}
    content = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [mesh],
        "materials": [look],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offsets[-1]}],
    }
    text = json.dumps(content).encode()
    return _file([(_JSON, text + b" " * (-len(text) % 4)), (_BINARY, b"".join(pieces))])


def _file(chunks: list[tuple[int, bytes]]) -> bytes:
    body = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _before_tone(colors: UInt8[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Linear light of which the tone curve makes these sRGB colours; exact for greys.

    The curve is (v² + 0.0245786 v − 0.000090537) / (0.983729 v² + 0.4329510 v + 0.238081) at v = light / 0.6.
    """
    meant = np.minimum((np.arange(256) / 255.0) ** 2.2, 0.97)
    a, b, c = 1.0 - 0.983729 * meant, 0.0245786 - 0.4329510 * meant, -0.000090537 - 0.238081 * meant
    table = 0.6 * (-b + np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    light: Float[np.ndarray, "n 3"] = table.astype(np.float32)[colors]
    return light
