"""Scenes of Mitsuba 3 in XML, as those of Sionna's cities: meshes in other files, each with its place.

    x_world = M_n … M_2 M_1 x        of the transforms of `to_world`, in their order

Read are shapes of type ply and obj, rectangles and cubes; others are counted. Coordinates are metres, z up.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from pathlib import Path
from xml.parsers import expat

import numpy as np
from jaxtyping import Float64

from maxjax.core.files import FileError, open_regular, read_text
from maxjax.io.kinds.mesh import Mesh, merge_meshes, mesh_of
from maxjax.io.readers.obj import load_obj
from maxjax.io.readers.ply import load_ply
from maxjax.io.reading import PLAIN, Reading

_PEEK, _DEEPEST, _MOST_SHAPES = 65_536, 16, 100_000
_SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
_CUBE = np.array([[x, y, z] for z in (-1.0, 1.0) for x, y in ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))])
_SIDES = np.array([[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]])
_AROUND = np.array(
    [[k, (k + 1) % 4, (k + 1) % 4 + 4] for k in range(4)] + [[k, (k + 1) % 4 + 4, k + 4] for k in range(4)]
)
_SHAPES = {"rectangle": (_SQUARE, _SIDES[2:] - 4), "cube": (_CUBE, np.concatenate([_SIDES, _AROUND]))}

Matrix = Float64[np.ndarray, "4 4"]


@dataclasses.dataclass
class _Element:
    """An element of the file."""

    tag: str
    given: dict[str, str]
    children: list[_Element] = dataclasses.field(default_factory=list)


def is_scene(path: Path) -> bool:
    """Whether an XML file is a scene, by its first element."""
    with open_regular(path) as file:
        return b"<scene" in file.read(_PEEK)


def load_mitsuba(path: Path, reading: Reading = PLAIN) -> Mesh:
    """The meshes of a scene as one.

    Raises:
        FileError: if the file is no scene, or names a mesh that is missing or lies outside of its folder, or a
            transform that is not supported.
    """
    root = _parsed(path)
    if root.tag != "scene":
        raise FileError(f"{path}: expected a <scene>, found <{root.tag}>")
    defaults = {c.given.get("name", ""): c.given.get("value", "") for c in root.children if c.tag == "default"}
    dropped: Counter[str] = Counter()
    found: list[Mesh] = []
    for element in root.children:
        if element.tag == "include":
            dropped["included scenes"] += 1
        elif element.tag == "shape":
            shape = _shape(element, defaults, path, reading)
            if shape is None:
                dropped[f"shapes of type {element.given.get('type', 'none')}"] += 1
            else:
                found.append(shape)
    if not found:
        kinds = ", ".join(f"{count} {kind}" for kind, count in dropped.items()) or "nothing"
        raise FileError(f"{path}: expected shapes of type ply, obj, rectangle or cube, found {kinds}")
    return merge_meshes(found, path.name, dropped)


def _shape(element: _Element, defaults: dict[str, str], path: Path, reading: Reading) -> Mesh | None:
    """A shape where it stands; None for one of another type, or of points alone."""
    kind = element.given.get("type", "")
    matrix = _to_world(element, defaults, path)
    if kind in _SHAPES:
        corners, faces = _SHAPES[kind]
        return mesh_of(_moved(corners, matrix), faces, path, reading)
    if kind not in ("ply", "obj"):
        return None
    names = [
        c.given.get("value", "") for c in element.children if c.tag == "string" and c.given.get("name") == "filename"
    ]
    if len(names) != 1:
        raise FileError(f"{path}: expected one filename in a shape of type {kind}, found {len(names)}")
    folder = path.resolve().parent
    file = (folder / _filled(names[0], defaults)).resolve()
    if not file.is_relative_to(folder) or not file.is_file():
        raise FileError(f"{path}: expected the mesh {names[0]!r} in the folder of its scene, found none")
    # Units and systems are those of the scene: they pass the gate once it is placed.
    mesh = load_ply(file) if kind == "ply" else load_obj(file)
    if not isinstance(mesh, Mesh):
        return None
    corners = mesh.triangles.reshape(-1, 3)
    return mesh_of(_moved(corners, matrix), np.arange(len(corners)).reshape(-1, 3), path, reading)


def _moved(corners: Float64[np.ndarray, "n 3"], matrix: Matrix) -> Float64[np.ndarray, "n 3"]:
    moved: Float64[np.ndarray, "n 3"] = corners @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


def _to_world(element: _Element, defaults: dict[str, str], path: Path) -> Matrix:
    """Where a shape is put."""
    matrix = np.eye(4)
    for child in element.children:
        if child.tag == "transform" and child.given.get("name") == "to_world":
            for step in child.children:
                given = {name: _filled(value, defaults) for name, value in step.given.items()}
                matrix = _step(step.tag, given, path) @ matrix
    return matrix


def _step(kind: str, given: dict[str, str], path: Path) -> Matrix:
    """One transform."""
    matrix = np.eye(4)
    try:
        numbers = [float(word) for word in given.get("value", "").replace(",", " ").split()]
        if kind == "translate":
            matrix[:3, 3] = _axes(given, numbers, 0.0)
        elif kind == "scale":
            matrix[[0, 1, 2], [0, 1, 2]] = _axes(given, numbers, 1.0)
        elif kind == "rotate":
            matrix[:3, :3] = _turn(np.array(_axes(given, numbers, 0.0)), np.radians(float(given["angle"])))
        elif kind == "matrix" and len(numbers) in (9, 16):
            edge = 3 if len(numbers) == 9 else 4
            matrix[:edge, :edge] = np.reshape(numbers, (edge, edge))
        else:
            raise ValueError(f"<{kind}> is not supported")
        if not np.isfinite(matrix).all() or (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any():
            raise ValueError(f"<{kind}> is no affine map")
    except (KeyError, ValueError) as error:
        raise FileError(f"{path}: transform: {error}; expected translate, scale, rotate or matrix") from error
    return matrix


def _axes(given: dict[str, str], numbers: list[float], otherwise: float) -> list[float]:
    """Three numbers: `value` (one or three), or x, y and z."""
    if len(numbers) in (1, 3):
        return numbers * (3 // len(numbers))
    if numbers:
        raise ValueError(f"expected one or three numbers, found {len(numbers)}")
    return [float(given.get(axis, otherwise)) for axis in "xyz"]


def _turn(axis: Float64[np.ndarray, " 3"], angle: float) -> Float64[np.ndarray, "3 3"]:
    """The rotation about an axis, by Rodrigues' formula."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Float64[np.ndarray, "3 3"] = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    return turned


def _filled(text: str, defaults: dict[str, str]) -> str:
    """A value with `$name` replaced by what the scene declares."""
    for name in sorted(defaults, key=len, reverse=True):
        text = text.replace(f"${name}", defaults[name])
    return text


def _parsed(path: Path) -> _Element:
    """The elements of the file; documents with a type, and so with entities, are refused."""
    parser = expat.ParserCreate()
    top: list[_Element] = []
    opened: list[_Element] = []
    shapes = 0

    def start(tag: str, given: dict[str, str]) -> None:
        nonlocal shapes
        shapes += tag == "shape"
        if len(opened) > _DEEPEST or shapes > _MOST_SHAPES:
            raise FileError(f"{path}: expected at most {_DEEPEST} levels and {_MOST_SHAPES} shapes, found more")
        element = _Element(tag, given)
        (opened[-1].children if opened else top).append(element)
        opened.append(element)

    def refuse(*_: object) -> None:
        raise FileError(f"{path}: expected no document type and no entities, found some")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: opened.pop()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(read_text(path), True)
    except expat.ExpatError as error:
        raise FileError(f"{path}: expected XML: {error}") from error
    return top[0]
