"""When each of several flights departs, so that vehicles keep apart while they are in the air.

    in the air:   rise from the ground below the start, the trajectory, descent to what is below its end
    clear(d):     |x_i(t) − x_j(t − d)| ≥ apart at all times at which both are in the air

Flights are taken in the order in which their vehicles are ready, each vehicle's own one after the other, and depart as
soon as they are clear of all that were taken before: what waits does so on the ground at home. One that departs when
all others have landed is clear, so there is always a time. Distances are those of the swarm, from below
(`sim.swarm.separation`): between samples no vehicle comes nearer.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float64, Int32, Int64

from maxjax.energy.consumption import RISE, SINK
from maxjax.planning.mission import Mission
from maxjax.sim.swarm.separation import Sampled, chord_squares
from maxjax.trajectories.trajectory import Trajectory

_PERIOD = 0.25  # between samples [s]
_STEP = 2  # samples between departures that are tried
_TRIED = 64  # of them at a time

Samples = Float64[np.ndarray, "_ 3"]


@dataclasses.dataclass(frozen=True, eq=False)
class Departures:
    """When flights depart, from the ground.

    Attributes:
        apart: distance that was asked for [m].
        departs: (n,) of each flight [s].
        waits: (n,) how long after its vehicle was ready [s].
        lands: (n,) when it is on the ground again [s].
        least: no more than the least distance between two vehicles in the air [m]; infinite where none meet in time.
        before: the same, had each departed when its vehicle was ready [m].
        costs: by how much later the last one lands than it would then [s].
    """

    apart: float
    departs: Float64[np.ndarray, " n"]
    waits: Float64[np.ndarray, " n"]
    lands: Float64[np.ndarray, " n"]
    least: float
    before: float
    costs: float

    def __str__(self) -> str:
        if math.isinf(self.before):
            return f"vehicles keep {self.apart:g} m apart: no two are in the air at a time"
        late = [f"flight {k + 1} waits {wait:.1f} s" for k, wait in enumerate(self.waits.tolist()) if wait > 0.0]
        reached = "no two are then in the air at a time" if math.isinf(self.least) else f"{self.least:.1f} m at least"
        told = f"vehicles keep {self.apart:g} m apart: {reached}"
        if not late:
            return f"{told}, and none has to wait"
        first = f"{max(self.before, 0.0):.1f} m had each departed when it was ready"
        return f"{told}, {first}; {', '.join(late)} at home, and the last one lands {self.costs:.1f} s later"


def keep_apart(flights: Sequence[Trajectory], vehicles: Sequence[int], apart: float) -> Departures:
    """Departures of flights of several vehicles that keep them apart in the air.

    A vehicle on the ground, before it rises and after it landed, is not counted: who shares a home makes room there.

    Args:
        flights: trajectories on one map, each vehicle's own in the order in which it flies them.
        vehicles: of each flight, the number of its vehicle.
        apart: least distance between two vehicles in the air [m].

    Raises:
        ValueError: if there is no flight, not one vehicle a flight, or the distance is not positive.
    """
    if not flights or len(vehicles) != len(flights):
        raise ValueError(f"vehicles: expected one a flight, given {len(vehicles)} for {len(flights)} flights")
    if not 0.0 < apart < math.inf:
        raise ValueError(f"apart: expected a positive number of metres, given {apart}")
    sampled = Sampled(_PERIOD, 1, max(flight.limits.acceleration for flight in flights))
    middle = np.asarray(flights[0].origin)
    airborne = [_in_the_air(flight) - middle for flight in flights]
    ready = _in_turn(airborne, vehicles)
    starts, free = np.zeros(len(flights), np.int64), dict.fromkeys(vehicles, 0)
    waits, taken, queue = np.zeros(len(flights), np.int64), list[int](), _queues(vehicles)
    while queue:
        vehicle = min(queue, key=lambda one: (free[one], one))
        flight = queue[vehicle].pop(0)
        others = [(airborne[k], int(starts[k])) for k in taken]
        starts[flight] = _first_clear(airborne[flight], free[vehicle], others, apart + sampled.between)
        waits[flight] = starts[flight] - free[vehicle]
        free[vehicle] = int(starts[flight]) + len(airborne[flight]) - 1
        taken.append(flight)
        queue = {one: rest for one, rest in queue.items() if rest}
    lasts = np.array([len(samples) - 1 for samples in airborne])
    least, before = (_least(airborne, some, vehicles) - sampled.between for some in (starts, ready))
    costs = float((starts + lasts).max() - (ready + lasts).max())
    departs, lands = _PERIOD * starts, _PERIOD * (starts + lasts)
    return Departures(apart, departs, _PERIOD * waits, lands, least, before, _PERIOD * costs)


def _queues(vehicles: Sequence[int]) -> dict[int, list[int]]:
    """Numbers of each vehicle's flights."""
    found: dict[int, list[int]] = {}
    for flight, vehicle in enumerate(vehicles):
        found.setdefault(vehicle, []).append(flight)
    return found


def _in_turn(airborne: Sequence[Samples], vehicles: Sequence[int]) -> Int64[np.ndarray, " n"]:
    """Samples at which flights depart where each vehicle flies as soon as it is ready."""
    found, free = np.zeros(len(airborne), np.int64), dict.fromkeys(vehicles, 0)
    for flight, vehicle in enumerate(vehicles):
        found[flight] = free[vehicle]
        free[vehicle] += len(airborne[flight]) - 1
    return found


def _in_the_air(flight: Trajectory) -> Samples:
    """Where a vehicle is from the ground to the ground, by samples [m]; upright ways take whole numbers of them."""
    times = _PERIOD * np.arange(math.ceil(flight.duration / _PERIOD) + 1)
    way = flight.at(times).position
    plan = flight.plan
    ends = plan.landing_height if isinstance(plan, Mission) else flight.map.terrain.at(*way[-1, :2].tolist())
    rise = _upright(way[0], flight.map.terrain.at(*way[0, :2].tolist()), RISE)
    return np.concatenate([rise[::-1], way, _upright(way[-1], ends, SINK)])


def _upright(top: Float64[np.ndarray, "3"], foot: float, speed: float) -> Samples:
    """The way down from a place to a height, without the place; nothing where the height is unknown or above it."""
    if not foot < top[2]:
        return np.zeros((0, 3))
    count = math.ceil((top[2] - foot) / (speed * _PERIOD))
    heights = np.linspace(top[2], foot, count + 1)[1:]
    return np.column_stack([np.broadcast_to(top[:2], (count, 2)), heights])


def _first_clear(moving: Samples, ready: int, others: Sequence[tuple[Samples, int]], apart: float) -> int:
    """The first sample, from when a vehicle is ready on, at which it may depart."""
    last = max([ready, *(start + len(samples) for samples, start in others)])
    tried = [*range(ready, last, _STEP), last]
    for k in range(0, len(tried), _TRIED):
        some = np.resize(tried[k : k + _TRIED], _TRIED)
        near = np.min([_nearest(moving, other, some - start) for other, start in others], axis=0, initial=np.inf)
        clear = np.flatnonzero(near >= apart)
        if len(clear):
            return int(some[clear[0]])
    return last


def _least(airborne: Sequence[Samples], starts: Int64[np.ndarray, " n"], vehicles: Sequence[int]) -> float:
    """Least distance of the chords of any two flights of different vehicles [m]."""
    found = math.inf
    for i, j in itertools.combinations(range(len(airborne)), 2):
        if vehicles[i] != vehicles[j]:
            shift = np.full(_TRIED, starts[j] - starts[i])
            found = min(found, float(_nearest(airborne[j], airborne[i], shift)[0]))
    return found


def _nearest(moving: Samples, fixed: Samples, shifts: Int64[np.ndarray, " d"]) -> Float64[np.ndarray, " d"]:
    """How near the chords of a flight come to those of another one that departs so many samples before it [m]."""
    rows = 1 << max(len(moving), len(fixed)).bit_length()
    padded = [jnp.asarray(np.resize(one, (rows, 3)), jnp.float32) for one in (moving, fixed)]
    counts = jnp.array([len(moving), len(fixed)], jnp.int32)
    return np.asarray(_nearest_of(*padded, counts, jnp.asarray(shifts, jnp.int32)), np.float64)


@jax.jit
def _nearest_of(
    moving: Float[Array, "t 3"], fixed: Float[Array, "t 3"], counts: Int32[Array, "2"], shifts: Int32[Array, " d"]
) -> Float[Array, " d"]:
    """`_nearest` of samples that are filled up; infinite where the two are not in the air at a time."""
    sample = jnp.arange(len(moving))

    def of_one(shift: Array) -> Array:
        there = sample + shift
        both = (sample < counts[0]) & (there >= 0) & (there < counts[1])
        squared = chord_squares(moving, fixed[jnp.clip(there, 0, len(fixed) - 1)])
        return jnp.sqrt(jnp.min(jnp.where(both[:-1] & both[1:], squared, jnp.inf)))

    found: Array = jax.lax.map(of_one, shifts)
    return found
