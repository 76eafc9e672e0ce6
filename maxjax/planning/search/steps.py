"""The steps that A* tries from a voxel, looked up by the voxels around it.

**Window codes.** The 3×3×3 window of a voxel is packed into 27 bits, for all voxels at once by three passes
of shifts. The legal steps are a function of that one integer: looked up in the loop, not computed.

**Pruned successors.** A voxel x, reached by a step from p, skips the step x → n if a detour of one or two
legal steps inside the window, p → n or p → y → n with y ≠ x, is shorter than p → x → n, or as long but with a
shorter last step. In empty space 1, 3 or 7 of 26 steps remain. No optimum is lost: let g* be exact distances,
f* = g* + h, and suppose that some voxel with f* below the goal's final label never got its exact label. Let n
be one with the least g*. All its optimal predecessors have a smaller g* and, h being consistent, no larger
f*, so they got theirs and were expanded with it. Take among them an x with the shortest step to n. As it
skipped n, there was a detour from its parent p. A shorter detour contradicts that x is an optimal
predecessor; one as long makes y an optimal predecessor with a shorter step, against the choice of x. So there
is no such voxel, and the goal's label is exact.

Where prices differ, a detour of the same length may be dearer: all legal steps are tried then, and nothing is
pruned but the way back.
"""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np
from jaxtyping import Bool, UInt, UInt32

from maxjax.core.grid import Index3

STEPS: list[Index3] = [(x, y, z) for x, y, z in itertools.product((-1, 0, 1), repeat=3) if x or y or z]
AT_START = len(STEPS)  # the "direction" in which the start was reached
_RESOLUTION = 2.0**-33  # of lengths, which count eighths of a voxel; sums stay exact up to 2¹⁹ of these
COST = [round(8 * math.sqrt(n) / _RESOLUTION) * _RESOLUTION for n in range(4)]  # by number of axes moved along


def window_codes(blocked: Bool[np.ndarray, "nx ny nz"]) -> UInt32[np.ndarray, "px py pz"]:
    """The 3×3×3 window of every voxel as 27 bits, 1 for blocked; padded by one blocked layer.

    Bit 9 (x+1) + 3 (y+1) + (z+1) stands for the neighbour at (x, y, z) ∈ {−1, 0, 1}³. Codes of the padding
    itself wrap around and mean nothing: no legal step leads there.
    """
    padded = np.pad(blocked, 1, constant_values=True)
    _, ny, nz = padded.shape
    row = _with_neighbors(padded.reshape(-1).astype(np.uint8), 1, 1)
    plane = _with_neighbors(row.astype(np.uint16), nz, 3)
    return _with_neighbors(plane.astype(np.uint32), ny * nz, 9).reshape(padded.shape)


def _with_neighbors(code: UInt[np.ndarray, " n"], stride: int, bits: int) -> UInt[np.ndarray, " n"]:
    """Codes of `bits` bits, joined with their neighbours `stride` before and after into codes of 3 `bits`."""
    joined = code << bits
    joined[stride:] |= code[:-stride]
    joined[:-stride] |= code[stride:] << 2 * bits
    return joined


def length_of(step: Index3) -> float:
    """Length of a step [1/8 voxel]."""
    return COST[sum(map(abs, step))]


@functools.lru_cache(maxsize=2**16)
def successors(code: int, arrival: int) -> list[int]:
    """Steps (indices into `STEPS`) to try from a voxel with this window code, reached by step `arrival`."""
    return [k for k, span, detours in rules(arrival) if not code & span and all(code & detour for detour in detours)]


@functools.lru_cache(maxsize=2**16)
def onward(code: int, arrival: int) -> list[int]:
    """All legal steps (indices into `STEPS`) from a voxel with this window code but the way back."""
    # Steps are ordered, so that the opposite of step k is the k-th from the end; the start has none.
    return [k for k in successors(code, AT_START) if k != len(STEPS) - 1 - arrival]


@functools.cache
def rules(arrival: int) -> list[tuple[int, int, list[int]]]:
    """Steps on from a voxel reached by `arrival`: each its index, its span code, and the detours that prune it.

    Block and detours are window codes of the voxels that have to be free for them.
    """
    if arrival == AT_START:
        return [(k, _span_code((0, 0, 0), n), []) for k, n in enumerate(STEPS)]
    x, y, z = STEPS[arrival]
    p = (-x, -y, -z)
    found = []
    for k, n in enumerate(STEPS):
        if n == p:
            continue
        detours = {_span_code(p, n)} if _adjacent(p, n) else set()
        for via in STEPS:
            if _adjacent(p, via) and _adjacent(via, n):
                last = length_of(_difference(n, via))
                length = length_of(_difference(via, p)) + last
                through = length_of(p) + length_of(n)
                if length < through or (length == through and last < length_of(n)):
                    detours.add(_span_code(p, via) | _span_code(via, n))
        found.append((k, _span_code((0, 0, 0), n), sorted(detours, key=int.bit_count)))
    return found


def _difference(a: Index3, b: Index3) -> Index3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _adjacent(a: Index3, b: Index3) -> bool:
    return _difference(a, b) in STEPS


def _span_code(a: Index3, b: Index3) -> int:
    """Window code of all voxels that the step between window positions `a` and `b` spans."""
    spans = (range(min(p, q), max(p, q) + 1) for p, q in zip(a, b, strict=True))
    return sum(1 << 9 * (x + 1) + 3 * (y + 1) + (z + 1) for x, y, z in itertools.product(*spans))
