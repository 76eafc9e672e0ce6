"""Following movers from scan to scan: guaranteed estimation of place and velocity.

    place      ←  (place, propagated to the time of the measurement) ∩ measured
    velocity   ←  velocity ∩ those that follow from earlier looks at its middle and its faces (`marks`)

Where an intersection is empty,
the mover broke its bound, or the measurement is another one's: the slot is flagged, and its set begins again.

A track of a mover that was not seen is propagated. In plain view it is given up after some looks; hidden, beyond reach
or outside the field of view it is kept until its set says nothing any more.

What rests is measured as before, and its set grows from rest by the bounds. Where no more is seen of it than that
something stands where it stopped (at a wall), it is there, give or take the margin m of ranges, and no faster than
√(4 A m), with which it would have left. Walls that were taken for movers never prove to have moved: no set of a mark
ever lay beside its first one.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from maxjax.sim.movers.ambiguity import is_ambiguous
from maxjax.sim.movers.assignment import assign
from maxjax.sim.movers.body_marks import (
    History,
    Marks,
    append_marks,
    forget_marks,
    no_history,
    propagate_marks,
    velocities,
)
from maxjax.sim.movers.detection import Detections
from maxjax.sim.movers.estimate import Estimate, correct, predict
from maxjax.sim.movers.reachable_sets import Bounds, Tracks, no_tracks, propagate
from maxjax.sim.movers.tracking_settings import TrackingSettings

# A measurement that no set expects, but this near to where a track was expected, is its [m].
_BROKE = 1.5
# A mover slower than this that can be told no more from what it is at has come to rest there [m/s].
_SETTLING = 1.0
# Looks in which a new track has to be seen again.
_TENTATIVE = 2


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class TrackerState:
    """Tracks and what they are made from; batch axes lead.

    Attributes:
        tracks: at `time`.
        estimate: of their places and velocities.
        marks: sets of the middles, those of `tracks`, and of the faces, at `time`.
        history: of these, each when it was measured.
        first: sets of the marks when each was seen first [m].
        moved: whether each has moved since, beyond doubt.
        rested: how long each has not moved [s].
        time: of the last look [s]; -infinity before the first.
    """

    tracks: Tracks
    estimate: Estimate
    marks: Marks
    history: History
    first: Marks
    moved: Bool[Array, "*batch s"]
    rested: Float[Array, "*batch s"]
    time: Float[Array, "*batch"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class ExpectedView:
    """The view of a scan where each mover is expected; batch axes lead.

    Attributes:
        plain: it would be seen.
        stands: something does, in front of its middle.
        margin: how far what stands there may be from what is measured [m].
    """

    plain: Bool[Array, "*batch s"]
    stands: Bool[Array, "*batch s"]
    margin: Float[Array, "*batch s"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Association:
    """Association of one look's measurements with tracks; batch axes lead.

    Attributes:
        of_track: the measurement of each slot, or -1.
        broken: slots whose set did not hold what was measured, or that are larger than assumed.
        appeared: slots that were confirmed just now.
        left_out: whether a measurement found no slot.
    """

    of_track: Int32[Array, "*batch s"]
    broken: Bool[Array, "*batch s"]
    appeared: Bool[Array, "*batch s"]
    left_out: Bool[Array, "*batch"]


def initial_tracker_state(sight: TrackingSettings) -> TrackerState:
    """No tracks."""
    s = sight.slots
    zero, marks = jnp.zeros((s, 3)), Marks(jnp.zeros((3, s, 3)), jnp.zeros((3, s, 3)))
    estimate = Estimate(zero, zero, zero, zero, zero)
    no, never = jnp.zeros(s, bool), jnp.asarray(-jnp.inf)
    return TrackerState(no_tracks(s), estimate, marks, no_history(s), marks, no, jnp.zeros(s), never)


def predict_tracks(state: TrackerState, time: Float[Array, ""], sight: TrackingSettings) -> TrackerState:
    """The tracks at a later time, without measurements."""
    passed = jnp.where(jnp.isfinite(state.time), jnp.maximum(time - state.time, 0.0), 0.0)
    tracks, marks = _propagated(state.tracks, state.marks, passed, sight.bounds)
    estimate = predict(state.estimate, jnp.reshape(passed, (1, 1)))
    return dataclasses.replace(state, tracks=tracks, marks=marks, estimate=estimate, time=time)


def update_tracks(
    state: TrackerState, seen: Detections, view: ExpectedView, time: Float[Array, ""], sight: TrackingSettings
) -> tuple[TrackerState, Association]:
    """The tracks after a look.

    Args:
        state: after the last look.
        seen: bodies in the scan.
        view: what the scan shows where movers are expected.
        time: of the end of the scan [s].
        sight: settings. Static.
    """
    later = predict_tracks(state, time, sight)
    consistent = _consistent(later.tracks, seen, sight)
    chosen = assign(_cost(later, seen, consistent))
    matched = chosen >= 0
    unclear = is_ambiguous(later.tracks, seen, consistent, chosen, view.plain)
    after, broken = _measured(state, later, seen, jnp.where(unclear, -1, chosen), sight)
    stands = state.moved & _slower(state, _SETTLING) & ~matched & view.stands
    after = _standing(state, after, stands, view.margin, sight.bounds)
    tracks, estimate = after.tracks, after.estimate
    missed = jnp.where(matched | stands, 0, tracks.missed + (view.plain & ~_covered(tracks, seen)))
    tracks = dataclasses.replace(tracks, seen=tracks.seen + matched, missed=missed)
    confirmed = tracks.used & (tracks.confirmed | (tracks.seen >= 2))
    appeared = confirmed & ~tracks.confirmed
    patience = jnp.where(confirmed, sight.misses, _TENTATIVE)
    known = jnp.all(tracks.high - tracks.low <= 2.0 * sight.lost, axis=1)
    used = tracks.used & (missed < patience) & known
    tracks = dataclasses.replace(tracks, used=used, confirmed=confirmed & used)

    passed = jnp.where(jnp.isfinite(state.time), jnp.maximum(time - state.time, 0.0), 0.0)
    still = used & _slower(after, sight.still)
    rested = jnp.where(still, later.rested + jnp.where(matched | stands, passed, 0.0), 0.0)
    after = dataclasses.replace(after, tracks=tracks, rested=rested)
    after, chosen, left_out = _born(after, seen, chosen, sight)
    estimate = after.estimate
    place_deviation, velocity_deviation = map(jnp.sqrt, (estimate.place_variance, estimate.velocity_variance))
    deviations = {"place_deviation": place_deviation, "velocity_deviation": velocity_deviation}
    after = dataclasses.replace(after, tracks=dataclasses.replace(after.tracks, **deviations))
    # What is larger than assumed may have moved otherwise than its marks say.
    grown = jnp.any(after.tracks.half > state.tracks.half + 1e-3, axis=1) & matched
    top, larger = sight.bounds.speed, grown[:, None]
    slowest, fastest = jnp.where(larger, -top, after.tracks.slowest), jnp.where(larger, top, after.tracks.fastest)
    after = dataclasses.replace(after, tracks=dataclasses.replace(after.tracks, slowest=slowest, fastest=fastest))
    return after, Association(chosen, (broken | grown) & used, appeared & used, left_out)


def has_stopped(state: TrackerState, sight: TrackingSettings) -> Bool[Array, " s"]:
    """Slots whose mover has stopped: the map may take it over."""
    return state.tracks.used & (state.rested >= sight.rest)


def is_parked(state: TrackerState, sight: TrackingSettings) -> Bool[Array, " s"]:
    """Those of them that were movers once, and may start again."""
    return has_stopped(state, sight) & state.moved


def _slower(state: TrackerState, speed: float) -> Bool[Array, " s"]:
    slower: Array = jnp.linalg.norm(state.estimate.velocity, axis=1) < speed
    return state.tracks.used & slower


def _standing(
    state: TrackerState, after: TrackerState, stands: Bool[Array, " s"], margin: Float[Array, " s"], bounds: Bounds
) -> TrackerState:
    """The tracks, of which some stand, give or take a margin [m], where they were measured last."""
    room = margin[:, None]
    low, high = state.history.low[0] - room, state.history.high[0] + room
    top = jnp.minimum(jnp.sqrt(4.0 * bounds.acceleration * room), bounds.speed)
    rest, top = jnp.zeros_like(low[0]), jnp.broadcast_to(top, low[0].shape)
    there = dataclasses.replace(state.tracks, low=low[0], high=high[0], slowest=-top, fastest=top, velocity=rest)
    tracks, marks, estimate = jax.tree.map(
        lambda a, b: jnp.where(stands[:, None] if a.ndim > 1 else stands, a, b),
        (there, Marks(low, high), dataclasses.replace(state.estimate, velocity=rest)),
        (after.tracks, after.marks, after.estimate),
    )
    return dataclasses.replace(after, tracks=tracks, marks=marks, estimate=estimate)


def _consistent(tracks: Tracks, seen: Detections, sight: TrackingSettings) -> Bool[Array, "s d"]:
    """Whether the set of a track holds a measurement."""
    moved = sight.bounds.speed * seen.age[None, :, None]
    overlap = (tracks.low[:, None] <= seen.high[None] + moved) & (seen.low[None] - moved <= tracks.high[:, None])
    return jnp.all(overlap, axis=-1) & tracks.used[:, None] & seen.used[None]


def _cost(later: TrackerState, seen: Detections, consistent: Bool[Array, "s d"]) -> Float[Array, "s d"]:
    """Distance from where a track was expected when a body was measured [m]; infinite where it cannot be the same."""
    tracks, age = later.tracks, seen.age[None, :, None]
    expected = tracks.place[:, None] - age * tracks.velocity[:, None]
    distance = jnp.linalg.norm(expected - seen.place[None], axis=-1)
    possible = consistent | ((distance < _BROKE) & tracks.used[:, None] & seen.used[None])
    # Confirmed tracks choose first.
    return jnp.where(possible, distance + jnp.where(tracks.confirmed, 0.0, 0.5)[:, None], jnp.inf)


def _measured(
    state: TrackerState, later: TrackerState, seen: Detections, chosen: Int32[Array, " s"], sight: TrackingSettings
) -> tuple[TrackerState, Bool[Array, " s"]]:
    """Sets and estimates with the measurements that belong to them, at the time of the look; whether one was empty."""
    matched, index = (chosen >= 0)[:, None], jnp.maximum(chosen, 0)
    age = jnp.where(matched, seen.age[index][:, None], 0.0)
    passed = jnp.where(jnp.isfinite(state.time), jnp.maximum(later.time - state.time, 0.0), 0.0)
    age = jnp.minimum(age, passed)
    when, bounds = later.time - age, sight.bounds
    measured = Marks(seen.marks.low[:, index], seen.marks.high[:, index])
    # At the time of the measurement.
    then, marks = _propagated(state.tracks, state.marks, passed - age, bounds)
    marks = Marks(jnp.maximum(marks.low, measured.low), jnp.minimum(marks.high, measured.high))
    slowest, fastest = velocities(state.history, marks, when, bounds)
    slowest, fastest = jnp.maximum(then.slowest, slowest), jnp.minimum(then.fastest, fastest)
    empty = jnp.any(jnp.any(marks.low > marks.high, axis=0) | (slowest > fastest + 1e-3), axis=1) & matched[:, 0]
    again = empty[:, None]
    marks = Marks(jnp.where(again, measured.low, marks.low), jnp.where(again, measured.high, marks.high))
    slowest = jnp.where(again, -bounds.speed, jnp.minimum(slowest, fastest))
    fastest = jnp.where(again, bounds.speed, fastest)
    estimate = correct(predict(state.estimate, passed - age), seen.place[index], seen.variance[index])
    estimate = dataclasses.replace(
        estimate,
        place=jnp.clip(estimate.place, marks.low[0], marks.high[0]),
        velocity=jnp.clip(estimate.velocity, slowest, fastest),
    )
    known = dataclasses.replace(
        then, low=marks.low[0], high=marks.high[0], slowest=slowest, fastest=fastest, half=seen.half[index],
        place=estimate.place, velocity=estimate.velocity,
    )  # fmt: skip
    history = append_marks(forget_marks(state.history, empty), marks, when[:, 0], matched[:, 0])
    beside = jnp.any((marks.low > state.first.high) | (marks.high < state.first.low), axis=(0, 2))
    moved = state.moved | (beside & matched[:, 0] & ~empty)
    first = jax.tree.map(lambda a, b: jnp.where(again, a, b), marks, state.first)
    known, marks = _propagated(known, marks, age, bounds)
    tracks, marks, estimate = jax.tree.map(
        lambda a, b: jnp.where(matched if a.ndim > 1 else matched[:, 0], a, b),
        (known, marks, predict(estimate, age)),
        (later.tracks, later.marks, later.estimate),
    )
    found = {"tracks": tracks, "estimate": estimate, "marks": marks, "history": history, "first": first, "moved": moved}
    return dataclasses.replace(later, **found), empty


def _propagated(tracks: Tracks, marks: Marks, time: Array, bounds: Bounds) -> tuple[Tracks, Marks]:
    """Tracks and marks a time later [s], without a measurement."""
    after = propagate(tracks, time, bounds)
    return after, propagate_marks(marks, (tracks.low - after.low, after.high - tracks.high), time, bounds)


def _covered(tracks: Tracks, seen: Detections) -> Bool[Array, " s"]:
    """Tracks in whose place something moves, though it was taken for another one."""
    low, high = tracks.place - tracks.half, tracks.place + tracks.half
    meets = jnp.all((low[:, None] <= seen.seen_high[None]) & (seen.seen_low[None] <= high[:, None]), axis=-1)
    return jnp.any(meets & seen.used[None], axis=1)


def _born(
    state: TrackerState, seen: Detections, chosen: Int32[Array, " s"], sight: TrackingSettings
) -> tuple[TrackerState, Int32[Array, " s"], Bool[Array, ""]]:
    """New tracks from measurements that belong to none, nearest first, in free slots."""
    tracks, count = state.tracks, seen.used.shape[0]
    taken = jnp.zeros(count + 1, bool).at[jnp.where(chosen >= 0, chosen, count)].set(True)[:count]
    # What is seen within the body of a track is a part of it.
    middle = 0.5 * (seen.seen_low + seen.seen_high)
    least, greatest = tracks.low - tracks.half, tracks.high + tracks.half
    within = jnp.all((least[:, None] <= middle[None]) & (middle[None] <= greatest[:, None]), axis=-1)
    part = jnp.any(within & (tracks.confirmed & (chosen >= 0))[:, None], axis=0)
    new = seen.used & ~taken & ~part & (seen.count >= 2)
    order = jnp.cumsum(new) - 1
    free = ~tracks.used
    place_of = jnp.cumsum(free) - 1
    number = jnp.where(new, order, count)
    # The k-th new one goes to the k-th free slot.
    which = jnp.full(count + 1, -1).at[number].set(np.arange(count), mode="drop")
    which = which.at[count].set(-1)
    source = jnp.where(free, which[jnp.minimum(place_of, count)], -1)
    born, index = (source >= 0)[:, None], jnp.maximum(source, 0)
    top = sight.bounds.speed
    zero = jnp.zeros_like(tracks.low)
    fresh = Tracks(
        low=seen.low[index], high=seen.high[index], slowest=zero - top, fastest=zero + top, half=seen.half[index],
        used=born[:, 0], confirmed=jnp.zeros_like(tracks.used), place=seen.place[index], velocity=zero,
        place_deviation=zero, velocity_deviation=zero,
        rests=jnp.zeros_like(tracks.used),
        seen=jnp.ones_like(tracks.seen), missed=jnp.zeros_like(tracks.missed),
    )  # fmt: skip
    marks, age = Marks(seen.marks.low[:, index], seen.marks.high[:, index]), seen.age[index][:, None]
    history = append_marks(forget_marks(state.history, born[:, 0]), marks, (state.time - age)[:, 0], born[:, 0])
    first = jax.tree.map(lambda a, b: jnp.where(born, a, b), marks, state.first)
    fresh, marks = _propagated(fresh, marks, age, sight.bounds)
    guess = Estimate(seen.place[index], zero, seen.variance[index], zero, zero + top**2 / 3.0)
    guess = predict(guess, age)

    def either(a: Array, b: Array) -> Array:
        return jnp.where(born if a.ndim > 1 else born[:, 0], a, b)

    after = dataclasses.replace(
        state,
        tracks=jax.tree.map(either, fresh, tracks),
        estimate=jax.tree.map(either, guess, state.estimate),
        marks=jax.tree.map(either, marks, state.marks),
        history=history,
        first=first,
        moved=state.moved & ~born[:, 0],
        rested=jnp.where(born[:, 0], 0.0, state.rested),
    )
    return after, jnp.where(born[:, 0], source, chosen).astype(jnp.int32), jnp.sum(new) > jnp.sum(free)
