"""A* on the voxel grid: the classical rival, optimal among 26-neighbour paths that cut no corner.

    minimise  Σ ‖v_{k+1} − v_k‖ (n_k + n_{k+1}) / 2  over  v_0 = start, …, v_T = goal  with steps in {−1, 0, 1}³,

where a step is legal only if every voxel that it spans (2, 2×2 or 2×2×2 voxels) is free, and the price n ≥ 1 is that of
∫ n ds for n linear along the step. The heuristic h is the octile distance: the shortest length in empty space, hence
consistent, for a price is at least 1. Three ideas make it fast:

**Window codes and pruned successors.** The legal steps from a voxel, and which of them may be left out, are a
function of one integer (`planning.search.steps`).

**Buckets in place of a heap.** The proof uses no order of expansion. Open voxels lie in stacks by ⌊8 f⌋, and
the last one in leaves first, which breaks ties toward larger g. A voxel is expanded again whenever its label
improves; the search ends when no open f is below the goal's label.

Without a price labels are float64 multiples of 2⁻³³ (each step's length rounded to one), so that their sums are
exact and ties are true ties; the optimum differs from that in real numbers by less than 1e-11 of its length.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float64, Int32, UInt32

from maxjax.core.grid import Index3
from maxjax.core.status import Status
from maxjax.planning.search.steps import AT_START, COST, STEPS, length_of, onward, successors, window_codes


@dataclasses.dataclass(frozen=True)
class AstarResult:
    """Outcome of `astar`.

    Attributes:
        status: OK, or why there is no path.
        path: voxel indices from start to goal, both included; (0, 3) unless OK.
        length: Euclidean length of the path [voxels]; infinite unless OK.
        cost: what it pays, Σ ‖step‖ (n_k + n_{k+1}) / 2 [voxels]; its length where there is no price.
        expanded: number of expansions, repeated ones included.
    """

    status: Status
    path: Int32[np.ndarray, "t 3"]
    length: float
    cost: float
    expanded: int


def astar(
    blocked: Bool[np.ndarray, "nx ny nz"],
    start: Index3,
    goal: Index3,
    price: Float[np.ndarray, "nx ny nz"] | None = None,
) -> AstarResult:
    """Cheapest 26-neighbour path from `start` to `goal` through free voxels, cutting no corner.

    Args:
        blocked: True where the path must not go.
        start: voxel index.
        goal: voxel index; may equal `start`, which gives a path of one voxel.
        price: n of every voxel. None: 1, and the path is the shortest.

    Returns:
        The path, its length and cost [voxels] and a status: OK, START_OUTSIDE_MAP, GOAL_OUTSIDE_MAP, START_OCCUPIED,
        GOAL_OCCUPIED, or NO_VALID_PATH once every voxel that can be reached from the start was expanded.

    Raises:
        ValueError: unless `blocked` is a volume of bool, both indices have three components, and `price` has the shape
            of `blocked` and is finite and at least 1.
    """
    dearest = check_query(blocked, start, goal, price)
    status = status_of_ends(blocked, start, goal)
    if status is not Status.OK:
        return no_path(status)

    codes = window_codes(blocked)
    shape = codes.shape
    padded_start, padded_goal = (tuple(int(c) + 1 for c in index) for index in (start, goal))
    source, target = (int(np.ravel_multi_index(index, shape)) for index in (padded_start, padded_goal))
    heuristic = _octile(shape, padded_goal)
    halves = None if price is None or dearest == 1 else np.pad(0.5 * price.astype(np.float64), 1)
    came, expanded, found = _search(codes, heuristic, halves, source, target)
    if not found:
        return no_path(Status.NO_VALID_PATH, expanded)

    backward, node, offsets = [target], target, _offsets(shape)
    while node != source:
        node -= offsets[came[node]]
        backward.append(node)
    path = np.stack(np.unravel_index(backward[::-1], shape), axis=1).astype(np.int32) - 1
    return result_of_path(path, price, expanded)


def check_query(blocked: np.ndarray, start: Sequence[int], goal: Sequence[int], price: np.ndarray | None) -> float:
    """The highest price, at least 1; raises as `astar`."""
    if blocked.ndim != 3 or blocked.dtype != np.bool_:
        raise ValueError(f"blocked: expected bool of shape (nx, ny, nz), given {blocked.dtype} {blocked.shape}")
    for name, index in (("start", start), ("goal", goal)):
        if len(index) != 3:
            raise ValueError(f"{name}: expected three voxel indices, given {index}")
    if price is None:
        return 1.0
    if price.shape != blocked.shape:
        raise ValueError(f"price: expected shape {blocked.shape}, given {price.shape}")
    least, most = float(price.min(initial=1)), float(price.max(initial=1))
    if not (least >= 1 and most < math.inf):  # NaN is both
        raise ValueError(f"price: expected finite numbers of at least 1, given {least} to {most}")
    return most


def no_path(status: Status, expanded: int = 0) -> AstarResult:
    """The result without a path."""
    return AstarResult(status, np.empty((0, 3), np.int32), math.inf, math.inf, expanded)


def result_of_path(
    path: Int32[np.ndarray, "t 3"], price: Float[np.ndarray, "nx ny nz"] | None, expanded: int
) -> AstarResult:
    """The result of this path."""
    moved = np.bincount(np.abs(np.diff(path, axis=0)).sum(axis=1), minlength=4)
    length = math.fsum(count * math.sqrt(n) for n, count in enumerate(moved))
    return AstarResult(Status.OK, path, length, length if price is None else _paid(path, price), expanded)


def _paid(path: Int32[np.ndarray, "t 3"], price: Float[np.ndarray, "nx ny nz"]) -> float:
    """∫ n ds along a path of voxels [voxels]."""
    n = price[tuple(path.T)].astype(np.float64)
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1) @ (0.5 * (n[1:] + n[:-1])))


def status_of_ends(blocked: Bool[np.ndarray, "nx ny nz"], start: Index3, goal: Index3) -> Status:
    """OK, or what is wrong with start or goal."""
    for index, outside, occupied in (
        (start, Status.START_OUTSIDE_MAP, Status.START_OCCUPIED),
        (goal, Status.GOAL_OUTSIDE_MAP, Status.GOAL_OCCUPIED),
    ):
        if not all(0 <= c < n for c, n in zip(index, blocked.shape, strict=True)):
            return outside
        if blocked[tuple(index)]:
            return occupied
    return Status.OK


def _search(
    codes: UInt32[np.ndarray, "px py pz"],
    heuristic: Float64[np.ndarray, "px py pz"],
    halves: Float64[np.ndarray, "px py pz"] | None,
    source: int,
    target: int,
) -> tuple[bytearray, int, bool]:
    """Label voxels from `source` until `target` has its exact label.

    Indices are flat, in the padded grid. `halves` are those of the prices; with prices all legal steps but the way back
    are tried. Returns the step by which each voxel was reached (its place in `STEPS`), the number of expansions, and
    whether the target was reached.
    """
    moves_of = list(zip(_offsets(codes.shape), map(length_of, STEPS), range(len(STEPS)), strict=True))
    # Plain containers: one look-up in a NumPy array costs more than all the arithmetic on it.
    code, h = codes.reshape(-1).data, heuristic.reshape(-1).data
    half = None if halves is None else halves.reshape(-1).data
    onwards = successors if half is None else onward
    g = [math.inf] * codes.size
    came = bytearray(codes.size)
    moves: dict[int, list[tuple[int, float, int]]] = {}
    g[source], came[source] = -h[source], AT_START  # labels count from here, so that f starts at 0
    best = g[target]
    buckets = [[(g[source], source)]] if source != target else []
    expanded = 0
    for lower, bucket in enumerate(buckets):  # grows while we walk
        if lower >= best:
            break
        while bucket:
            g_i, i = bucket.pop()
            if g_i != g[i] or g_i + h[i] >= best:
                continue  # superseded by a better label, or of no use any more
            expanded += 1
            key = code[i] << 5 | came[i]
            try:
                steps = moves[key]
            except KeyError:
                steps = moves[key] = [moves_of[k] for k in onwards(code[i], came[i])]
            for offset, cost, k in steps:
                j = i + offset
                g_j = g_i + (cost if half is None else cost * (half[i] + half[j]))
                if g_j < g[j]:
                    f = g_j + h[j]
                    if f < best:
                        g[j], came[j] = g_j, k
                        if j == target:
                            best = f
                            continue
                        try:
                            buckets[int(f)].append((g_j, j))
                        except IndexError:
                            buckets.extend([] for _ in range(int(f) + 1 - len(buckets)))
                            buckets[int(f)].append((g_j, j))
    return came, expanded, best < math.inf


def _octile(shape: tuple[int, ...], goal: tuple[int, ...]) -> Float64[np.ndarray, "px py pz"]:
    """Length of the shortest path in empty space from every voxel to `goal` [1/8 voxel]."""
    a, b, c = (np.abs(np.arange(n) - at).astype(np.float64) for n, at in zip(shape, goal, strict=True))
    _, one, two, three = COST
    # Sorted, the offsets cost three·least + two·(middle − least) + one·(greatest − middle). By their sum,
    # that is (two − one)·sum + (2 one − two)·greatest + (three − 2 two + one)·least: little work, plane by
    # plane in the cache.
    b = b[:, None]
    greatest, least, rest = np.maximum(b, c), np.minimum(b, c), (two - one) * (b + c)
    h, term = np.empty(shape), np.empty(shape[1:])
    for a_x, h_x in zip(a, h, strict=True):
        np.maximum(greatest, a_x, out=h_x)
        h_x *= 2 * one - two
        np.minimum(least, a_x, out=term)
        term *= three - 2 * two + one
        h_x += term
        h_x += rest
        h_x += (two - one) * a_x
    return h


def _offsets(shape: tuple[int, ...]) -> list[int]:
    """Flat offset of every step."""
    return [(x * shape[1] + y) * shape[2] + z for x, y, z in STEPS]
