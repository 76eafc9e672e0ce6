"""Places shared among vehicles against all ways of sharing few, and what is refused."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from maxjax.inspection.sharing import Sharing, share_places, split


def problem(
    seed: int, count: int, homes: int = 1, vehicles: tuple[int, ...] = (0,), capacity: float = math.inf
) -> Sharing:
    """Places and homes in a square."""
    places = np.random.default_rng(seed).uniform(0.0, 100.0, (homes + count, 2))
    return Sharing(np.linalg.norm(places[:, None] - places, axis=2), homes, vehicles, capacity)


def best_round(asked: Sharing, home: int, places: tuple[int, ...]) -> float:
    """Over all orders."""
    return min(asked.cost(home, order) for order in itertools.permutations(places))


@pytest.mark.parametrize(
    ("count", "homes", "vehicles", "capacity"),
    [
        (30, 1, (0,), math.inf),
        (30, 1, (0, 0, 0), math.inf),
        (30, 2, (0, 1), math.inf),
        (30, 1, (0, 0), 260.0),
        (1, 1, (0,), math.inf),
    ],
)
def test_each_place_is_visited_once_within_the_capacity(
    count: int, homes: int, vehicles: tuple[int, ...], capacity: float
) -> None:
    """By rounds that cost what they say, from the homes of their vehicles."""
    asked = problem(1, count, homes, vehicles, capacity)
    rounds = share_places(asked)
    assert sorted(place for one in rounds for place in one.places) == list(range(count))
    for one in rounds:
        assert one.home == vehicles[one.vehicle]
        assert one.cost == pytest.approx(asked.cost(one.home, one.places))
        assert one.cost <= capacity * (1 + 1e-6)


def test_two_vehicles_against_all_ways_to_share() -> None:
    """The longest of two rounds through seven places, over all subsets and orders: within 5 %."""
    for seed in range(6):
        asked = problem(seed, 7, homes=2, vehicles=(0, 1))
        best = math.inf
        for size in range(8):
            for mine in itertools.combinations(range(7), size):
                theirs = tuple(k for k in range(7) if k not in mine)
                best = min(best, max(best_round(asked, 0, mine), best_round(asked, 1, theirs)))
        longest = max(one.cost for one in share_places(asked))
        assert best - 1e-9 <= longest <= 1.05 * best


def test_a_cut_of_an_order_against_all_cuts() -> None:
    """Of nine places in a given order, over all 256 cuts: the cheapest that the capacity allows."""
    for seed in range(6):
        asked = problem(seed, 9, capacity=230.0)
        order, best = tuple(range(9)), math.inf
        for cuts in itertools.product((False, True), repeat=8):
            edges = [0, *(k + 1 for k, cut in enumerate(cuts) if cut), 9]
            costs = [asked.cost(0, order[a:b]) for a, b in itertools.pairwise(edges)]
            best = min(best, sum(costs)) if max(costs) <= asked.capacity else best
        rounds = split(asked, 0, order)
        assert tuple(k for part in rounds for k in part) == order
        assert sum(asked.cost(0, part) for part in rounds) == pytest.approx(best)


def test_more_vehicles_than_places() -> None:
    """Three places, six vehicles: three fly at most, and the others stay."""
    rounds = share_places(problem(0, 3, vehicles=(0,) * 6))
    assert len({one.vehicle for one in rounds}) <= 3
    assert sorted(place for one in rounds for place in one.places) == [0, 1, 2]


def test_several_vehicles_are_faster_together() -> None:
    """The longest of four rounds is far shorter than one round through all."""
    one, four = (share_places(problem(2, 40, vehicles=(0,) * count)) for count in (1, 4))
    assert max(part.cost for part in four) < 0.5 * one[0].cost


def test_a_place_that_takes_too_much() -> None:
    """A sentence with what it takes and what there is; and one for a place that cannot be reached."""
    asked = problem(0, 4, capacity=20.0)
    with pytest.raises(ValueError, match=r"of 4: expected a round of at most 20 from home and back, and it"):
        share_places(asked)
    costs = asked.costs.copy()
    costs[3, :] = costs[:, 3] = math.inf
    with pytest.raises(ValueError, match=r"place 3 of 4: expected a way from home to it, found none"):
        share_places(Sharing(costs, 1, (0,)))


def test_nothing_to_share() -> None:
    """No place, no round."""
    assert share_places(problem(0, 0)) == ()
