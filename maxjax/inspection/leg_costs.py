"""What it costs to fly between places: seconds from rest to rest, around what stands between them.

    c = max(h/v, u/v_up or d/v_down) + v/a        of a straight leg: horizontal way h, climb u or descent d

Legs that stay in free cells are straight. Others cost as much as the cheapest way over other places between which
straight legs are free. Groups of places that none of these join are joined by floods of the map's free voxels from some
of their places (`fields.geodesic`), which count steps. Costs are taken as the mean of both directions: what is climbed
on the way there is descended on the way back.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64

from maxjax.energy.airframe import Airframe
from maxjax.energy.power import power
from maxjax.fields.geodesic import geodesic
from maxjax.inspection.free_space import FreeSpace
from maxjax.planning.path.line_of_sight import Sight, clear, sight_of
from maxjax.trajectories.limits import PX4_MISSION, FlightLimits

Points = Float64[np.ndarray, "n 3"]
LegCost = Callable[[Points, Points], Float64[np.ndarray, " n"]]
"""Cost of straight legs from some places to others [m], in seconds or in any other unit that adds up."""

_TOGETHER = 2**14  # straight legs that are looked along at a time
_GATES = 4  # places of a group from which floods join it to others


@dataclasses.dataclass(frozen=True)
class TimeCost:
    """Seconds of straight legs from rest to rest, and of what is done at their end.

    Attributes:
        limits: of the vehicle.
        stay: at each place [s].
    """

    limits: FlightLimits = PX4_MISSION
    stay: float = 0.0

    def __call__(self, starts: Points, goals: Points) -> Float64[np.ndarray, " n"]:
        """See the module."""
        way = np.asarray(goals, np.float64) - starts
        limits, length = self.limits, np.linalg.norm(way, axis=1)
        level = np.hypot(way[:, 0], way[:, 1]) / limits.speed
        upright = np.maximum(way[:, 2] / limits.ascent, -way[:, 2] / limits.descent)
        # Too short a way to reach the speed: up and down in the time of a constant acceleration.
        braking = np.minimum(limits.speed / limits.acceleration, 2.0 * np.sqrt(length / limits.acceleration))
        return np.asarray(np.maximum(level, upright) + braking + self.stay)


@dataclasses.dataclass(frozen=True)
class EnergyCost:
    """Energy of straight legs from rest to rest, and of what is done at their end [Wh].

    The seconds of `TimeCost`, each at the power of hovering or of level flight, whichever is more. Work is shared by
    it; what a battery lasts for is judged by the flight as it is planned (`energy.point_of_no_return`).

    Attributes:
        airframe: that flies.
        time: its seconds.
        wind: speed of the air [m/s].
    """

    airframe: Airframe
    time: TimeCost = TimeCost()
    wind: float = 0.0

    def __call__(self, starts: Points, goals: Points) -> Float64[np.ndarray, " n"]:
        """See the class."""
        level = np.array([[self.wind, 0.0, 0.0], [self.time.limits.speed + self.wind, 0.0, 0.0]])
        return self.time(starts, goals) * float(power(self.airframe, level, np.zeros((2, 3))).max()) / 3600.0


def costs_between(places: Points, free: FreeSpace, cost: LegCost) -> Float64[np.ndarray, "n n"]:
    """What it costs to fly from each place to each, 0 to itself; infinite where no way is free.

    Args:
        places: in free air [m].
        free: the air.
        cost: of straight legs.
    """
    count = len(places)
    first, second = np.triu_indices(count, 1)
    straight = 0.5 * (cost(places[first], places[second]) + cost(places[second], places[first]))
    table = np.full((count, count), np.inf)
    np.fill_diagonal(table, 0.0)
    seen = straight_legs(places, first, second, free)
    table[first[seen], second[seen]] = table[second[seen], first[seen]] = straight[seen]
    joined = _over_others(table)
    gates = _gates(joined)
    for k in gates:
        joined[k] = joined[:, k] = np.minimum(joined[k], _flooded(places, k, free, cost))
    return _over_others(joined) if gates else joined


def straight_legs(places: Points, first: np.ndarray, second: np.ndarray, free: FreeSpace) -> Bool[np.ndarray, " k"]:
    """Whether the straight legs between pairs of places are free."""
    grid = free.grid
    sight = _sight(jnp.asarray(~free.free))
    index = ((places - np.array(grid.origin)) / grid.spacing).astype(np.float32)
    # Near pairs first, so that few calls are as long as the farthest.
    order = np.argsort(np.abs(index[first] - index[second]).max(axis=1), kind="stable")
    found = np.zeros(len(first), bool)
    for part in np.array_split(order, max(1, -(-len(order) // _TOGETHER))):
        rows = np.resize(part, _TOGETHER) if len(part) else part
        if len(part):
            found[part] = np.asarray(_clear(sight, index[first[rows]], index[second[rows]]))[: len(part)]
    return found


def _over_others(table: Float64[np.ndarray, "n n"]) -> Float64[np.ndarray, "n n"]:
    """The cheapest ways over other places (Floyd and Warshall)."""
    from scipy.sparse.csgraph import floyd_warshall  # half a second that most commands can do without

    return np.asarray(floyd_warshall(np.where(np.isfinite(table), table, np.inf), directed=False))


def _gates(table: Float64[np.ndarray, "n n"]) -> list[int]:
    """Some places of each group that is joined, but of the largest one."""
    group = np.isfinite(table).argmax(axis=1)  # the first place that each is joined to
    numbers, counts = np.unique(group, return_counts=True)
    small = numbers[np.argsort(counts, kind="stable")][:-1]
    found = list[int]()
    for number in small.tolist():
        members = np.flatnonzero(group == number)
        found += members[np.linspace(0, len(members) - 1, min(_GATES, len(members))).astype(int)].tolist()
    return found


def _flooded(places: Points, k: int, free: FreeSpace, cost: LegCost) -> Float64[np.ndarray, " n"]:
    """What it costs from a place to all, by a flood: as a level leg of its steps, or the straight one if dearer."""
    index = np.round((places - np.array(free.grid.origin)) / free.grid.spacing).astype(np.int32)
    reached, steps = (np.asarray(one) for one in _flood(jnp.asarray(free.free), jnp.asarray(index[k])))
    at = tuple(index.T)
    level = np.column_stack([free.grid.spacing * steps[at], np.zeros((len(places), 2))])
    here = np.repeat(places[k : k + 1], len(places), axis=0)
    straight = 0.5 * (cost(here, places) + cost(places, here))
    found = np.where(reached[at], np.maximum(cost(np.zeros_like(level), level), straight), np.inf)
    found[k] = 0.0
    return np.asarray(found)


@jax.jit
def _flood(air: Bool[Array, "nx ny nz"], seed: Array) -> tuple[Array, Array]:
    return geodesic(air, seed)


@jax.jit
def _sight(blocked: Bool[Array, "nx ny nz"]) -> Sight:
    return sight_of(blocked, room=0.5)


@jax.jit
def _clear(sight: Sight, a: Float[Array, "k 3"], b: Float[Array, "k 3"]) -> Bool[Array, " k"]:
    return clear(sight, a, b)
