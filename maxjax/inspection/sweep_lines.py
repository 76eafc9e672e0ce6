"""Lines of a survey in plan: parallel ones through an area, or beside a line; in the order of a lawn-mower.

    n = ⌈width / step⌉ lines, width / n apart, the first and the last half of that from the border

Each line serves a strip of half a gap to both sides, and reaches as far as the area does anywhere in it. Lines run
along the edge of the area's hull across which it is narrowest, so that there are fewest turns, unless another heading
is asked for. Where the area is not convex a line has several parts; parts that lie beside each other on one line after
the other are flown to and fro together before the next such piece.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from jaxtyping import Float64

Line = Float64[np.ndarray, "_ 2"]
Outline = Float64[np.ndarray, "k 2"]
Part = tuple[float, float, float]  # of a row: begin, end and level

_SHORTEST = 1e-6  # of a line [m]
_DIGITS = 6  # of coordinates [m]
_INWARD = 1e-3  # of a slab between two corners, by which its ends are looked at from within
_MITRE = 2.0  # how much farther than its offset a corner beside a bend may lie, at most


@dataclasses.dataclass(frozen=True)
class Rows:
    """How lines lie in an area.

    Attributes:
        step: between lines, at most [m].
        beyond: how far lines lie and reach beyond it [m].
    """

    step: float
    beyond: float = 0.0


def lawn_mower(outline: Outline, how: Rows, heading: float | None, begin: Float64[np.ndarray, "2"]) -> list[Line]:
    """Lines through an area, each as it is flown, in order.

    Args:
        outline: of the area [m], last corner not repeated.
        how: lines lie in it.
        heading: of the lines, clockwise from north [deg]; None: that of fewest turns.
        begin: place near which the first line begins [m].
    """
    along = narrowest(outline) if heading is None else np.radians(90.0 - heading)
    axes = np.array([[math.cos(along), math.sin(along)], [-math.sin(along), math.cos(along)]])
    local = outline @ axes.T
    low, high = float(local[:, 1].min()) - how.beyond, float(local[:, 1].max()) + how.beyond
    count = max(1, math.ceil((high - low) / how.step - 1e-9))
    gap = (high - low) / count
    rows = [_parts(local, low + (k + 0.5) * gap, gap, how.beyond) for k in range(count)]
    pieces = [_serpentine(piece) for piece in _pieces(rows)]
    return [line @ axes for line in _chained(pieces, begin @ axes.T)]


def beside(line: Line, width: float, step: float) -> list[Line]:
    """Lines along another one, within half a width of it, flown to and fro.

    Args:
        line: (n, 2) corners [m].
        width: of the corridor [m].
        step: between lines, at most [m].
    """
    count = max(1, math.ceil(width / step - 1e-9))
    offsets = (np.arange(count) + 0.5) * width / count - 0.5 * width
    found = [_offset(line, float(offset)) for offset in offsets]
    return [one if k % 2 == 0 else one[::-1] for k, one in enumerate(found)]


def narrowest(outline: Outline) -> float:
    """Direction of the edge of an outline's hull across which it is narrowest [rad], from east to north."""
    from scipy.spatial import ConvexHull  # a quarter of a second that most commands can do without

    corners = outline[ConvexHull(outline).vertices]
    edges = np.roll(corners, -1, axis=0) - corners
    angles = np.arctan2(edges[:, 1], edges[:, 0])
    across = np.stack([-np.sin(angles), np.cos(angles)], axis=1) @ corners.T
    return float(angles[np.ptp(across, axis=1).argmin()])


def _parts(local: Outline, level: float, gap: float, beyond: float) -> list[Part]:
    """What a line is flown of an outline, and so far beyond: begin, end and level, from left to right.

    The line serves a strip of half a gap to both sides: its parts reach as far as the outline does anywhere in it. Of
    a strip beyond the outline they are those of the nearest one in it; parts that meet are one.
    """
    low, high = float(local[:, 1].min()), float(local[:, 1].max())
    bottom = min(max(level - 0.5 * gap, low), high - gap)
    top = max(min(level + 0.5 * gap, high), low + gap)
    between = local[(local[:, 1] > bottom) & (local[:, 1] < top), 1]
    cuts = np.unique(np.round(np.concatenate([[max(bottom, low)], between, [min(top, high)]]), _DIGITS))
    spans = list[tuple[float, float]]()
    for first, last in itertools.pairwise(cuts.tolist()):
        inward = _INWARD * (last - first)
        ends = (_crossings(local, first + inward), _crossings(local, last - inward))
        spans += [(min(a, c), max(b, d)) for (a, b), (c, d) in zip(*ends, strict=True)]
    found = list[Part]()
    for left, right in sorted((left - beyond, right + beyond) for left, right in spans):
        if found and left <= found[-1][1]:
            found[-1] = (found[-1][0], max(right, found[-1][1]), level)
        else:
            found.append((left, right, level))
    return found


def _crossings(local: Outline, level: float) -> list[tuple[float, float]]:
    """Where a level line is inside an outline, from left to right (even-odd)."""
    a, b = local, np.roll(local, -1, axis=0)
    crosses = (a[:, 1] <= level) != (b[:, 1] <= level)
    a, b = a[crosses], b[crosses]
    x = np.sort(a[:, 0] + (level - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]))
    return list(zip(x[::2].tolist(), x[1::2].tolist(), strict=True))


def _pieces(rows: list[list[Part]]) -> list[list[Part]]:
    """Parts of one line after the other that lie beside each other, one to one."""
    done, growing = list[list[Part]](), list[list[Part]]()
    for row in rows:
        grown = []
        for part in row:
            below = [piece for piece in growing if _overlap(piece[-1], part)]
            above = [other for other in row if below and _overlap(below[0][-1], other)]
            if len(below) == 1 and len(above) == 1:
                growing.remove(below[0])
                grown.append([*below[0], part])
            else:
                grown.append([part])
        done += growing
        growing = grown
    return [*done, *growing]


def _overlap(first: Part, second: Part) -> bool:
    return min(first[1], second[1]) > max(first[0], second[0])


def _serpentine(piece: list[Part]) -> list[Line]:
    """Parts to and fro."""
    lines = [np.array([[left, level], [right, level]]) for left, right, level in piece if right - left > _SHORTEST]
    return [line if k % 2 == 0 else line[::-1] for k, line in enumerate(lines)]


def _chained(pieces: list[list[Line]], begin: Float64[np.ndarray, "2"]) -> list[Line]:
    """All lines, piece by piece, the next one that begins nearest to where the last one ended, turned as that asks."""
    left, here, found = [piece for piece in pieces if piece], begin, list[Line]()
    while left:
        ways = [way for piece in left for way in _ways(piece)]
        gaps = [float(np.linalg.norm(way[0][0] - here)) for way in ways]
        best = int(np.argmin(gaps))
        found += ways[best]
        here = ways[best][-1][-1]
        left.pop(best // 4)
    return found


def _ways(piece: list[Line]) -> list[list[Line]]:
    """The four ways to fly a piece to and fro."""
    turned = [line[::-1] for line in piece]
    return [piece, turned, piece[::-1], turned[::-1]]


def _offset(line: Line, offset: float) -> Line:
    """A line beside another one, to its left [m]: its corners on the bisectors of bends."""
    edges = np.diff(line, axis=0)
    normals = np.stack([-edges[:, 1], edges[:, 0]], axis=1) / np.linalg.norm(edges, axis=1, keepdims=True)
    both = np.concatenate([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
    both /= np.maximum(np.linalg.norm(both, axis=1, keepdims=True), 1e-9)
    before = np.concatenate([normals[:1], normals])
    stretch = np.minimum(1.0 / np.maximum(np.einsum("nk,nk->n", both, before), 1.0 / _MITRE), _MITRE)
    moved: Line = line + offset * stretch[:, None] * both
    return moved
