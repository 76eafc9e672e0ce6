"""A short round through places: nearest insertion, then 2-opt and Or-opt to a local optimum, and kicks out of it.

    2-opt    a part of the round is reversed         Or-opt    up to three places move elsewhere, perhaps reversed

Both take the best move of all, as whole tables, until none is left. A kick exchanges two neighbouring parts of a round
(a double bridge); what is worse after another descent is undone. Costs are symmetric.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, Int64

_LEAST = 1e-9  # of what a move has to gain, relative to the round
_LONGEST = 3  # places that Or-opt moves together
_KICKED = 50  # places around a kick, at most
_FEW = 7  # places of which a kick leaves the round as it is
_KICKS, _WORK = 4, 4_000_000  # kicks a place, and times the square of places, at most

Costs = Float64[np.ndarray, "n n"]
Order = Int64[np.ndarray, " n"]


def round_cost(costs: Costs, order: Order) -> float:
    """Of a round, back to its first place."""
    return float(costs[order, np.roll(order, -1)].sum())


def shortest_round(costs: Costs, seed: int = 0) -> Order:
    """A round through all places, the first one first.

    Args:
        costs: (n, n) symmetric, 0 on the diagonal.
        seed: of the kicks.
    """
    order = improve(costs, nearest_insertion(costs))
    rng, best = np.random.default_rng(seed), round_cost(costs, order)
    kicks = min(_KICKS * len(order), _WORK // max(len(order), 1) ** 2) if len(order) >= _FEW else 0
    for _ in range(kicks):
        tried = _improve_part(costs, _kick(order, rng), rng)
        if (now := round_cost(costs, tried)) < best:
            order, best = tried, now
    return np.roll(order, -int(np.flatnonzero(order == 0)[0]))


def nearest_insertion(costs: Costs) -> Order:
    """A round made by putting the place nearest to it where it lengthens the round least, again and again."""
    count = len(costs)
    order, left = [0], np.arange(1, count)
    nearest = costs[0].copy()
    while len(left):
        k = int(left[nearest[left].argmin()])
        here = np.array(order)
        following = np.roll(here, -1)
        added = costs[here, k] + costs[k, following] - costs[here, following]
        order.insert(int(added.argmin()) + 1, k)
        left = left[left != k]
        nearest = np.minimum(nearest, costs[k])
    return np.array(order, np.int64)


def improve(costs: Costs, order: Order) -> Order:
    """The round after the best moves of 2-opt and Or-opt, until none is left."""
    order = np.asarray(order, np.int64).copy()
    least = _LEAST * float(np.abs(costs[order, np.roll(order, -1)]).sum())
    while len(order) >= 4:
        gain, moved = max((_two_opt(costs, order), _or_opt(costs, order)), key=lambda move: move[0])
        if gain <= least:
            break
        order = moved
    return order


def _two_opt(costs: Costs, order: Order) -> tuple[float, Order]:
    """The best reversal of a part, what it gains, and the round after it."""
    table = costs[np.ix_(order, order)]
    ahead = np.roll(table, -1, axis=1)
    edge = np.diagonal(ahead)
    # Edges (i, i+1) and (j, j+1) become (i, j) and (i+1, j+1).
    gain = edge[:, None] + edge[None, :] - table - np.roll(ahead, -1, axis=0)
    gain = np.where(np.isfinite(gain), gain, -np.inf)
    gain[np.tril_indices(len(order))] = -np.inf
    i, j = np.unravel_index(gain.argmax(), gain.shape)
    moved = order.copy()
    moved[i + 1 : j + 1] = moved[i + 1 : j + 1][::-1]
    return float(gain[i, j]), moved


def _or_opt(costs: Costs, order: Order) -> tuple[float, Order]:
    """The best move of a few places that follow each other, what it gains, and the round after it."""
    count = len(order)
    table = costs[np.ix_(order, order)]
    places = np.arange(count)
    edge = table[places, (places + 1) % count]
    best: tuple[float, Order] = (-np.inf, order)
    for length in range(1, min(_LONGEST, count - 3) + 1):
        last = (places + length - 1) % count
        before, after = (places - 1) % count, (last + 1) % count
        saved = edge[before] + edge[last] - table[before, after]
        for turned in (False, True):
            head, tail = (last, places) if turned else (places, last)
            # Between k and k + 1: k to the head, the tail to k + 1.
            added = table[:, head].T + table[tail][:, (places + 1) % count] - edge[None, :]
            gain = saved[:, None] - added
            for shift in range(-1, length):  # edges of the part itself, and those to it
                gain[places, (places + shift) % count] = -np.inf
            gain = np.where(np.isfinite(gain), gain, -np.inf)
            s, k = np.unravel_index(gain.argmax(), gain.shape)
            if gain[s, k] > best[0]:
                best = float(gain[s, k]), _moved(order, int(s), length, int(k), turned=turned)
    return best


def _moved(order: Order, start: int, length: int, behind: int, *, turned: bool) -> Order:
    """The round with a part moved behind the place at an index."""
    rolled = np.roll(order, -start)
    part, rest = rolled[:length], rolled[length:]
    at = (behind - start) % len(order) - length + 1
    return np.concatenate([rest[:at], part[::-1] if turned else part, rest[at:]])


def _kick(order: Order, rng: np.random.Generator) -> Order:
    """The round with two neighbouring parts exchanged, at its beginning."""
    count = len(order)
    rolled = np.roll(order, -int(rng.integers(count)))
    a, b, c = np.sort(rng.choice(np.arange(1, min(count, _KICKED)), 3, replace=False))
    return np.concatenate([rolled[:a], rolled[b:c], rolled[a:b], rolled[c:]])


def _improve_part(costs: Costs, order: Order, rng: np.random.Generator) -> Order:
    """The round improved around its beginning, where it was kicked: a path with fixed ends."""
    size = min(len(order), 2 * _KICKED)
    rolled = np.roll(order, size // 4)
    part = rolled[:size]
    if size == len(order):
        return improve(costs, order)
    # The ends are joined by an edge that no move can do without.
    table = costs[np.ix_(part, part)].copy()
    table[0, -1] = table[-1, 0] = -size * (1.0 + table[np.isfinite(table)].max())
    local = improve(table, np.arange(size, dtype=np.int64))
    local = np.roll(local, -int(np.flatnonzero(local == 0)[0]))
    if local[-1] != size - 1:
        local = np.roll(local[::-1], 1)
    return np.concatenate([part[local], rolled[size:]])
