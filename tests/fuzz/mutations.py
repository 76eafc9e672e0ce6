"""Mutations of valid bytes: the one way in which tests damage files and messages."""

from __future__ import annotations

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
