"""Octrees of OctoMap: binary trees (.bt) and trees of log-odds (.ot).

    text header (id, size, res), a line `data`, then the nodes from the root on, each before its children

    .bt: two bytes an inner node, two bits a child: 0 unknown, 1 free leaf, 2 occupied leaf, 3 inner node
    .ot: log-odds (float32; of a ColorOcTree three bytes of colour as well) and a byte of bits, one a child; a node
         without children is a leaf, occupied from log-odds 0 on

The root is a cube of 2¹⁶ leaves about (0, 0, 0); child i lies east, north, up of the middle by bits 0, 1, 2 of i. A
subtree ends where the nodes still owed, Σ (children − 1), first fall below what they were before it. So each
level of the tree is found as a whole, without a walk from node to node.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64, UInt8

from maxjax.core.files import FileError, read_bytes
from maxjax.io.kinds.boxes import MAX_BOXES, Boxes, boxes_in_metres
from maxjax.io.reading import PLAIN, Reading

_DEPTH = 16
_MAX_NODES = 20_000_000
_FREE, _OCCUPIED, _INNER = 1, 2, 3
_HEADERS = {"# Octomap OcTree binary file": True, "# Octomap OcTree file": False}
_NODE_BYTES = {"OcTree": 5, "ColorOcTree": 8}
_MAX_BYTES = _NODE_BYTES["ColorOcTree"] * _MAX_NODES
_CORNER = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])

Kinds = UInt8[np.ndarray, "n 8"]


def load_octomap(path: Path, reading: Reading = PLAIN) -> Boxes:
    """Occupied and free leaves of a .bt or .ot file.

    Raises:
        FileError: if the file cannot be read, is no octree of a known kind, or is truncated.
    """
    content = read_bytes(path, _MAX_BYTES)
    first, _, rest = content.partition(b"\n")
    title = first.decode("latin1").strip()
    if title not in _HEADERS:
        raise FileError(f"{path}: expected a first line {' or '.join(map(repr, _HEADERS))}, found {title[:60]!r}")
    header, mark, data = rest.partition(b"\ndata\n")
    fields = dict(re.findall(r"^(id|size|res)\s+(\S+)\s*$", header[:65_536].decode("latin1"), re.MULTILINE))
    kind, spacing = fields.get("id"), _number(fields.get("res", ""))
    if not mark or kind not in _NODE_BYTES or not 1e-6 < spacing < 1e4:
        raise FileError(
            f"{path}: expected id {' or '.join(_NODE_BYTES)}, res in metres and a line data, "
            f"found id {kind}, res {fields.get('res')}"
        )
    width = 2 if _HEADERS[title] else _NODE_BYTES[kind]
    if len(data) > width * _MAX_NODES:
        raise FileError(f"{path}: has {len(data) // width} nodes, expected at most {_MAX_NODES}; prune or crop it")
    nodes = _binary_nodes(data, path) if _HEADERS[title] else _full_nodes(data, width, path)
    found = _leaves(nodes, spacing, path)
    if not sum(map(len, found.values())):
        raise FileError(f"{path}: holds no leaf, expected at least one")
    return boxes_in_metres(Boxes(found[_OCCUPIED], path.name, found[_FREE], spacing), path, reading)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def _binary_nodes(data: bytes, path: Path) -> Kinds:
    """Kinds of the children of each inner node."""
    if len(data) < 2 or len(data) % 2:
        raise FileError(f"{path}: expected two bytes a node, found {len(data)}; truncated")
    pairs = np.frombuffer(data, np.uint8).reshape(-1, 2)
    bits = pairs[:, :, None] >> np.array([0, 2, 4, 6], np.uint8) & 3
    return np.asarray(bits.reshape(-1, 8), np.uint8)


def _full_nodes(data: bytes, width: int, path: Path) -> Kinds:
    """Kinds of the children of each inner node, leaves resolved by their log-odds."""
    if not data or len(data) % width:
        raise FileError(f"{path}: expected {width} bytes a node, found {len(data)}; truncated")
    rows = np.frombuffer(data, np.uint8).reshape(-1, width)
    odds = np.ascontiguousarray(rows[:, :4]).view("<f4")[:, 0]
    if not np.isfinite(odds).all():
        raise FileError(f"{path}: expected finite log-odds; damaged")
    has = (rows[:, -1:] >> np.arange(8, dtype=np.uint8) & 1).astype(bool)
    arity = has.sum(axis=1)
    own = np.where(arity > 0, _INNER, np.where(odds >= 0, _OCCUPIED, _FREE)).astype(np.uint8)
    if arity[0] == 0:
        raise FileError(f"{path}: expected a root with children, found a leaf; damaged or empty")
    kinds = np.zeros((len(rows), 8), np.uint8)
    kinds[has] = own[_children(has, path)]
    return np.asarray(kinds[arity > 0])


def _children(has: np.ndarray, path: Path) -> Int64[np.ndarray, " n"]:
    """Number of the node that is each child which there is, in the order of `has`."""
    arity = has.sum(axis=1).astype(np.int64)
    end = _ends(arity, path)
    parent = np.repeat(np.arange(len(has)), arity)
    rank = np.arange(len(parent)) - np.repeat(np.cumsum(arity) - arity, arity)
    node = parent + 1
    for step in range(1, 8):
        later = rank >= step
        node[later] = end[node[later]] + 1
    return np.asarray(node)


def _ends(arity: Int64[np.ndarray, " n"], path: Path) -> Int64[np.ndarray, " n"]:
    """Last node of each node's subtree."""
    owed = np.cumsum(arity - 1)
    count = len(arity)
    if owed[-1] != -1 or (owed[:-1] < 0).any():
        raise FileError(f"{path}: expected one whole tree in {count} nodes; truncated or damaged")
    # The first place from i on where one node less is owed than before i; sorted by (owed, place), the next in its row.
    keys = np.sort((owed + 1) * (count + 1) + np.arange(count))
    wanted = (owed - (arity - 1)) * (count + 1) + np.arange(count)
    return np.asarray(keys[np.searchsorted(keys, wanted)] % (count + 1))


def _leaves(kinds: Kinds, spacing: float, path: Path) -> dict[int, Float[np.ndarray, "_ 2 3"]]:
    """Cubes of occupied and of free leaves [m]."""
    inner = kinds == _INNER
    child = np.full(kinds.shape, -1)
    child[inner] = _children(inner, path)
    found: dict[int, list[np.ndarray]] = {_FREE: [], _OCCUPIED: []}
    nodes, corners = np.zeros(1, np.int64), np.full((1, 3), -(2 ** (_DEPTH - 1)))
    for depth in range(_DEPTH):
        edge = 2 ** (_DEPTH - 1 - depth)
        for kind, cubes in found.items():
            row, which = np.nonzero(kinds[nodes] == kind)
            low = corners[row] + edge * _CORNER[which]
            cubes.append(np.stack([low, low + edge], axis=1) * spacing)
        row, which = np.nonzero(inner[nodes])
        nodes, corners = child[nodes[row], which], corners[row] + edge * _CORNER[which]
    if len(nodes):
        raise FileError(f"{path}: expected at most {_DEPTH} levels, found more; damaged")
    if (count := sum(len(cube) for cubes in found.values() for cube in cubes)) > MAX_BOXES:
        raise FileError(f"{path}: holds {count} leaves, expected at most {MAX_BOXES}; prune or crop it")
    return {kind: np.concatenate(cubes) for kind, cubes in found.items()}
