"""Places shared among vehicles, in rounds from their homes and back that their batteries allow.

    round:    home → places in order → home,   cost ≤ capacity
    vehicle:  one round after the other;   minimise the largest sum of a vehicle, then the sum of all

One round through all places is cut into as many parts as there are vehicles, none longer than it must be, from several
of its places on; places of the best of these then move to other parts, or change sides with others, while that shortens
the longest. What a vehicle cannot fly at once is
cut where that costs least (the cheapest cut of a given order, by dynamic programming), and each round is put in order
once more.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64

from maxjax.inspection.tour import improve, shortest_round

_ROUNDS = 200  # exchanges between vehicles, at most
_SHIFTS, _TRIED = 8, 3  # places from which an order is cut, and cuts that are improved
_SAME = 1e-9  # of a cost; what differs by less is the same

Costs = Float64[np.ndarray, "n n"]


@dataclasses.dataclass(frozen=True)
class Round:
    """A flight of a vehicle.

    Attributes:
        vehicle: its number, from 0 on.
        home: number of the home from which it starts, and at which it ends.
        places: numbers of the places that it visits, in order.
        cost: of all of it.
    """

    vehicle: int
    home: int
    places: tuple[int, ...]
    cost: float


@dataclasses.dataclass(frozen=True, eq=False)
class Sharing:
    """A problem of sharing: costs between homes and places, and who flies.

    Attributes:
        costs: (h + n, h + n) symmetric: homes first, then places.
        homes: how many homes.
        vehicles: of each vehicle, its home.
        capacity: what a round may cost; infinite: any.
    """

    costs: Costs
    homes: int
    vehicles: tuple[int, ...]
    capacity: float = math.inf

    def cost(self, home: int, places: Sequence[int]) -> float:
        """Of a round through some places."""
        nodes = [home, *(self.homes + k for k in places), home]
        return float(self.costs[nodes[:-1], nodes[1:]].sum())

    def check(self) -> None:
        """Raises a ValueError for a place that no vehicle reaches, or none within its capacity."""
        from_home = sorted(set(self.vehicles))
        there = (self.costs[from_home, self.homes :] + self.costs[self.homes :, from_home].T).min(axis=0)
        k = int(there.argmax()) if len(there) else 0
        if len(there) and not math.isfinite(there[k]):
            raise ValueError(f"place {k + 1} of {len(there)}: expected a way from home to it, found none")
        if len(there) and there[k] > self.capacity:
            raise ValueError(
                f"place {k + 1} of {len(there)}: expected a round of at most {self.capacity:.4g} from home and back, "
                f"and it alone takes {there[k]:.4g}; give more capacity, or a home that is nearer"
            )

    def ordered(self, home: int, places: Sequence[int]) -> tuple[int, ...]:
        """The places in the order of a short round from a home."""
        nodes = np.array([home, *(self.homes + k for k in places)])
        order = nodes[shortest_round(self.costs[np.ix_(nodes, nodes)])]
        return tuple((order[1:] - self.homes).tolist())

    def improved(self, home: int, places: Sequence[int]) -> tuple[int, ...]:
        """The places in an order that no exchange within the round shortens."""
        nodes = np.array([home, *(self.homes + k for k in places)])
        found = improve(self.costs[np.ix_(nodes, nodes)], np.arange(len(nodes)))
        order = nodes[np.roll(found, -int(np.flatnonzero(found == 0)[0]))]
        return tuple((order[1:] - self.homes).tolist())


def share_places(problem: Sharing) -> tuple[Round, ...]:
    """Rounds that visit all places once, by vehicle and in the order in which it flies them.

    Vehicles that have nothing to do have no round.

    Raises:
        ValueError: as `Sharing.check`.
    """
    problem.check()
    count = len(problem.costs) - problem.homes
    if not count:
        return ()
    order = problem.ordered(problem.vehicles[0], range(count))
    parts = min((_exchange(problem, one) for one in _cuts(problem, order)), key=lambda one: _length(problem, one))
    rounds = []
    for vehicle, (home, part) in enumerate(zip(problem.vehicles, parts, strict=True)):
        for places in split(problem, home, problem.ordered(home, part)):
            better = problem.improved(home, places)
            rounds.append(Round(vehicle, home, better, problem.cost(home, better)))
    return tuple(rounds)


def cut_order(problem: Sharing, order: Sequence[int]) -> tuple[Round, ...]:
    """Rounds that visit places in a given order, whose costs may differ by direction; raises as `Sharing.check`."""
    problem.check()
    rounds = []
    for vehicle, (home, part) in enumerate(zip(problem.vehicles, _cut(problem, order), strict=True)):
        for places in split(problem, home, part):
            rounds.append(Round(vehicle, home, places, problem.cost(home, places)))
    return tuple(rounds)


def split(problem: Sharing, home: int, order: Sequence[int]) -> list[tuple[int, ...]]:
    """Rounds of a given order that the capacity allows, with the least sum of costs."""
    if not order:
        return []
    nodes = np.array([problem.homes + k for k in order])
    along = np.concatenate([[0.0], np.cumsum(problem.costs[nodes[:-1], nodes[1:]])])
    out, back = problem.costs[home, nodes], problem.costs[nodes, home]
    best, first = np.full(len(order) + 1, np.inf), np.zeros(len(order) + 1, np.int64)
    best[0] = 0.0
    for end in range(1, len(order) + 1):
        begins = np.arange(end)
        costs = out[begins] + along[end - 1] - along[begins] + back[end - 1]
        total = np.where(costs <= problem.capacity * (1 + _SAME), best[begins] + costs, np.inf)
        first[end] = int(total.argmin())
        best[end] = total[first[end]]
    rounds, end = list[tuple[int, ...]](), len(order)
    while end > 0:
        rounds.append(tuple(order[first[end] : end]))
        end = int(first[end])
    return rounds[::-1]


def _length(problem: Sharing, parts: Sequence[tuple[int, ...]]) -> tuple[float, float]:
    """Cost of the longest part, and of all."""
    costs = [problem.cost(home, part) for home, part in zip(problem.vehicles, parts, strict=True)]
    return max(costs), sum(costs)


def _cuts(problem: Sharing, order: Sequence[int]) -> list[list[tuple[int, ...]]]:
    """Ways to cut an order into parts, one a vehicle, the best first."""
    if len(problem.vehicles) == 1:
        return [[tuple(order)]]
    found = []
    for shift in range(0, len(order), -(-len(order) // _SHIFTS)):
        turned = [*order[shift:], *order[:shift]]
        for way in (turned, turned[::-1]):
            parts = _assigned(problem, _cut(problem, way))
            found.append([problem.improved(home, part) for home, part in zip(problem.vehicles, parts, strict=True)])
    return sorted(found, key=lambda parts: _length(problem, parts))[:_TRIED]


def _assigned(problem: Sharing, parts: list[tuple[int, ...]]) -> list[tuple[int, ...]]:
    """The parts, each with the vehicle whose home suits it: the least sum of costs."""
    from scipy.optimize import linear_sum_assignment  # half a second that most commands can do without

    costs = [[problem.cost(home, part) for part in parts] for home in problem.vehicles]
    return [parts[k] for k in linear_sum_assignment(np.array(costs))[1].tolist()]


def _cut(problem: Sharing, order: Sequence[int]) -> list[tuple[int, ...]]:
    """The order in consecutive parts, one a vehicle, the longest as short as can be; spare vehicles have none."""
    if len(problem.vehicles) == 1:
        return [tuple(order)]

    def parts_within(most: float) -> list[tuple[int, ...]] | None:
        found, begin = list[tuple[int, ...]](), 0
        for home in problem.vehicles:
            nodes = np.array([problem.homes + k for k in order[begin:]], np.int64)
            along = np.concatenate([[0.0], np.cumsum(problem.costs[nodes[:-1], nodes[1:]])])[: len(nodes)]
            costs = problem.costs[home, nodes[:1]] + along + problem.costs[nodes, home]
            size = int(np.argmin(costs <= most)) if (costs > most).any() else len(nodes)
            found.append(tuple(order[begin : begin + size]))
            begin += size
        return found if begin == len(order) else None

    low, high = 0.0, sum(problem.cost(home, order) for home in problem.vehicles) + 1.0
    best = parts_within(high) or []
    while high - low > 1e-3 * high:
        middle = 0.5 * (low + high)
        found = parts_within(middle)
        low, high, best = (low, middle, found) if found is not None else (middle, high, best)
    return best


def _exchange(problem: Sharing, parts: list[tuple[int, ...]]) -> list[tuple[int, ...]]:
    """The parts after places moved, or changed sides, while that shortens the longest or, then, all together."""
    homes = problem.vehicles
    costs = [problem.cost(home, part) for home, part in zip(homes, parts, strict=True)]
    for _ in range(_ROUNDS if len(parts) > 1 else 0):
        longest = int(np.argmax(costs))
        best: tuple[float, int, tuple[int, ...], tuple[int, ...]] | None = None
        for other in (k for k in range(len(parts)) if k != longest):
            for mine, theirs in _moves(parts[longest], parts[other], problem, (homes[longest], homes[other])):
                after = max(problem.cost(homes[longest], mine), problem.cost(homes[other], theirs))
                if best is None or after < best[0]:
                    best = after, other, mine, theirs
        if best is None or best[0] >= costs[longest] * (1 - 1e-6):
            break
        _, other, mine, theirs = best
        for k, part in ((longest, mine), (other, theirs)):
            parts[k] = problem.improved(homes[k], part)
            costs[k] = problem.cost(homes[k], parts[k])
    return parts


def _moves(
    mine: tuple[int, ...], theirs: tuple[int, ...], problem: Sharing, homes: tuple[int, int]
) -> list[tuple[tuple[int, ...], tuple[int, ...]]]:
    """Parts after one place moved to the other, where that costs the other least, or took another one's place."""
    found = []
    for k, place in enumerate(mine):
        left = (*mine[:k], *mine[k + 1 :])
        found.append((left, _inserted(problem, homes[1], theirs, place)))
    near = np.argsort(
        problem.costs[np.ix_([problem.homes + k for k in mine], [problem.homes + k for k in theirs])], axis=None
    )[: 2 * len(mine)]
    for flat in near.tolist():
        k, j = divmod(flat, len(theirs)) if theirs else (0, 0)
        found.append(
            (
                _inserted(problem, homes[0], (*mine[:k], *mine[k + 1 :]), theirs[j]),
                _inserted(problem, homes[1], (*theirs[:j], *theirs[j + 1 :]), mine[k]),
            )
        )
    return found


def _inserted(problem: Sharing, home: int, places: tuple[int, ...], place: int) -> tuple[int, ...]:
    """The places with another one where it lengthens their round least."""
    nodes = np.array([home, *(problem.homes + k for k in places), home])
    node = problem.homes + place
    added = problem.costs[nodes[:-1], node] + problem.costs[node, nodes[1:]] - problem.costs[nodes[:-1], nodes[1:]]
    at = int(added.argmin())
    return (*places[:at], place, *places[at:])
