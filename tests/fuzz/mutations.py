"""Mutations of valid bytes and of valid JSON: the one way in which tests damage files and messages."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np

# Values that numbers in text are replaced by.
VALUES = [b"NaN", b"Infinity", b"-1", b"1e308", b"1e999", b"0", b"2.5", b"", b'""', b"null", b"[]", b"{}", 500 * b"9"]
VALUES += [5000 * b"7", b"181", b"-91", b"4294967296", b"'", b"\xff\xfe", b"true"]


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """One to three changes, one after another."""
    for _ in range(int(rng.integers(1, 4))):
        content = _changed(content, rng) if content else content
    return content


def _changed(content: bytes, rng: np.random.Generator) -> bytes:
    """Bytes changed, cut, doubled or left out; in text also numbers replaced."""
    place = int(rng.integers(len(content)))
    size = int(rng.integers(1, 9))
    match rng.integers(6):
        case 0:
            return content[:place]
        case 1:
            return content[:place] + rng.bytes(size) + content[place + size :]
        case 2:
            return content[:place] + content[place + size :]
        case 3:
            return content[: place + size] + content[place:]
    begin = place
    while begin < len(content) and content[begin : begin + 1] not in b"0123456789-.":
        begin += 1
    end = begin
    while end < len(content) and content[end : end + 1] in b"0123456789-.eE+":
        end += 1
    return content[:begin] + VALUES[rng.integers(len(VALUES))] + content[end:]


# What values of a JSON are replaced by.
ANYTHING: list[Any] = [None, True, False, "", 0, -1, 2.5, 181, -91, 1e308, -1e300, 10**400, math.inf, math.nan]
ANYTHING += ["x", "1e5", "NaN", [], {}, [[]], [1], [1, 2], [[[0, 0], [1, 1]]], {"a": 1}, "m", "ft", "AGL", "STD", 6]
ANYTHING += ["Point", "Polygon", "MultiPolygon", "GeometryCollection", "Circle", "9" * 500]


def altered(document: Any, rng: np.random.Generator) -> Any:
    """A JSON with one to three changes: values replaced, left out, doubled, or put in place of one another."""
    found = copy.deepcopy(document)
    for _ in range(int(rng.integers(1, 4))):
        places = [place for place in _places(found, ()) if place]
        if not places:
            break
        place = places[rng.integers(len(places))]
        *parents, last = place
        node = _at(found, parents)
        match rng.integers(4):
            case 0:
                del node[last]
            case 1 if isinstance(node, list):
                node.append(copy.deepcopy(node[last]))
            case 2:
                node[last] = copy.deepcopy(_at(found, places[rng.integers(len(places))]))
            case _:
                node[last] = copy.deepcopy(ANYTHING[rng.integers(len(ANYTHING))])
    return found


def _places(node: Any, here: tuple[Any, ...]) -> list[tuple[Any, ...]]:
    """Ways to all values in a JSON."""
    keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ()
    return [here, *(place for key in keys for place in _places(node[key], (*here, key)))]


def _at(node: Any, place: Any) -> Any:
    for key in place:
        node = node[key]
    return node
