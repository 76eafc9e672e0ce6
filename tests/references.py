"""Oracles shared by the tests: slow, plain, and sharing no code or idea with what they judge."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
from scipy import sparse


def grid_graph(blocked: np.ndarray) -> sparse.csr_matrix:
    """Graph of all 26-neighbour steps whose spanned block is free; node i is voxel i of the ravelled grid.

    Weights are Euclidean lengths in voxels. Every step stands there in both directions.
    """
    nodes = np.arange(blocked.size).reshape(blocked.shape)
    rows, columns, weights = [], [], []
    for step in itertools.product((-1, 0, 1), repeat=3):
        if step <= (0, 0, 0):
            continue  # each of the 13 axes once
        source = tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip(step, blocked.shape, strict=True))
        target = tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in zip(step, blocked.shape, strict=True))
        free = np.ones(nodes[source].shape, bool)
        for part in itertools.product(*({0, s} for s in step)):
            span = tuple(slice(c.start + p, c.stop + p) for c, p in zip(source, part, strict=True))
            free &= ~blocked[span]
        rows.append(nodes[source][free])
        columns.append(nodes[target][free])
        weights.append(np.full(free.sum(), np.linalg.norm(step)))
    row, column, weight = (np.concatenate(x) for x in (rows, columns, weights))
    half = sparse.coo_matrix((weight, (row, column)), shape=(blocked.size, blocked.size))
    return (half + half.T).tocsr()


def cuts_no_corner(path: np.ndarray, blocked: np.ndarray) -> bool:
    """Whether consecutive voxels are neighbours, and every voxel of every block that a step spans is free."""
    for a, b in itertools.pairwise(path.tolist()):
        if max(abs(p - q) for p, q in zip(a, b, strict=True)) != 1:
            return False
        if any(blocked[v] for v in itertools.product(*({p, q} for p, q in zip(a, b, strict=True)))):
            return False
    return not blocked[tuple(path[0])]


def entry_time(
    a: tuple[Fraction, ...], b: tuple[Fraction, ...], voxel: tuple[int, ...], grown: Fraction
) -> Fraction | None:
    """First t ∈ [0, 1] at which a + t (b − a) is in the closed cube [voxel − grown, voxel + 1 + grown]."""
    first, last = Fraction(0), Fraction(1)
    for p, q, v in zip(a, b, voxel, strict=True):
        lower, upper = v - grown, v + 1 + grown
        if p == q:
            if not lower <= p <= upper:
                return None
            continue
        s, t = sorted(((lower - p) / (q - p), (upper - p) / (q - p)))
        first, last = max(first, s), min(last, t)
    return first if first <= last else None


def touched(
    a: np.ndarray, b: np.ndarray, shape: tuple[int, ...], grown: float = 0.0
) -> dict[tuple[int, ...], Fraction]:
    """Voxels of the grid whose closed, `grown` cube meets the segment, with the exact time of entry.

    Coordinates are voxels, voxel i being [i, i + 1]; floats are taken at their exact values.
    """
    start, stop = (tuple(map(Fraction, p.tolist())) for p in (a, b))
    times = {v: entry_time(start, stop, v, Fraction(grown)) for v in itertools.product(*map(range, shape))}
    return {v: t for v, t in times.items() if t is not None}
