"""An area with holes as pieces without: geofences know outlines alone.

The area is cut into level slabs at every corner of its rings. In a slab its edges, from west to east, bound trapezoids
by the even-odd rule; one that continues the only one below it over its whole width belongs to the same piece.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from maxjax.io.geo.columns import Ring

_SAME = 1e-9  # of an area's extent

_Trapezoid = tuple[float, float, float, float]  # its west and east end at the bottom, then at the top


def pieces_of(rings: Sequence[Ring]) -> list[Ring]:
    """Pieces that make up an area, side by side.

    Args:
        rings: its outline and holes, last point not repeated [m]; inside is where an odd number of them surround.
    """
    starts = np.concatenate([np.asarray(ring, np.float64) for ring in rings])
    ends = np.concatenate([np.roll(np.asarray(ring, np.float64), -1, axis=0) for ring in rings])
    levels = np.unique(starts[:, 1])
    same = _SAME * float(np.ptp(starts, axis=0).max())
    done, growing = list[list[tuple[float, _Trapezoid, float]]](), list[list[tuple[float, _Trapezoid, float]]]()
    for low, high in zip(levels[:-1].tolist(), levels[1:].tolist(), strict=True):
        found, grown = _slab(starts, ends, low, high), list[list[tuple[float, _Trapezoid, float]]]()
        for one in found:
            below = [piece for piece in growing if _meets(piece[-1][1], one, same)]
            beside = [other for other in found if below and _meets(below[0][-1][1], other, same)]
            if len(below) == 1 and len(beside) == 1 and _continues(below[0][-1][1], one, same):
                growing.remove(below[0])
                grown.append([*below[0], (low, one, high)])
            else:
                grown.append([(low, one, high)])
        done += growing
        growing = grown
    return [_outline(piece, same) for piece in [*done, *growing]]


def _slab(
    starts: Float64[np.ndarray, "n 2"], ends: Float64[np.ndarray, "n 2"], low: float, high: float
) -> list[_Trapezoid]:
    """Trapezoids of the area between two levels, from west to east."""
    spans = (np.minimum(starts[:, 1], ends[:, 1]) <= low) & (np.maximum(starts[:, 1], ends[:, 1]) >= high)
    a, step = starts[spans], (ends - starts)[spans]
    bottom, top = (a[:, 0] + (level - a[:, 1]) / step[:, 1] * step[:, 0] for level in (low, high))
    order = np.argsort(bottom + top, kind="stable")
    bottom, top = bottom[order], top[order]
    pairs = zip(bottom[::2].tolist(), bottom[1::2].tolist(), top[::2].tolist(), top[1::2].tolist(), strict=True)
    return list(pairs)


def _meets(below: _Trapezoid, above: _Trapezoid, same: float) -> bool:
    return min(below[3], above[1]) - max(below[2], above[0]) > same


def _continues(below: _Trapezoid, above: _Trapezoid, same: float) -> bool:
    return abs(below[2] - above[0]) <= same and abs(below[3] - above[1]) <= same


def _outline(piece: list[tuple[float, _Trapezoid, float]], same: float) -> Ring:
    """The ring around stacked trapezoids, counter-clockwise, without corners that lie in one place or in one line."""
    east = [(one[1], low) for low, one, _ in piece] + [(piece[-1][1][3], piece[-1][2])]
    west = [(one[0], low) for low, one, _ in piece] + [(piece[-1][1][2], piece[-1][2])]
    ring = np.array([*east, *west[::-1]])
    ring = ring[np.abs(ring - np.roll(ring, 1, axis=0)).max(axis=1) > same]
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    bent: Ring = ring[np.abs(turn) > same * np.linalg.norm(before, axis=1)]
    return bent
