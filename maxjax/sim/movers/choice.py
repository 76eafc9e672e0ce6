"""Choose a motion that is verified against the sets of all movers and the hard set, and keep it until a better one is.

    verified:  until it rests, and for m seconds at least, boxes that may hold movers are `radius` away; so are walls,
               and every voxel on the way was seen free
    chosen:    the verified motion of least  cost-to-go of its place of rest + price of nearness

Nothing is asked of what follows after a motion's own end: what may be where in two seconds is known to metres, and by
then another motion was chosen. So a vehicle that rests is promised the m seconds alone (`Keeping.promise`).

A motion that is flown is replaced only by a verified one; where there is none it is flown to its end, at which the
vehicle rests. If what is flown is not verified any more (a mover broke its bound, or appeared from nowhere) and nothing
is, that is flagged, and the same is asked of boxes that are likely to hold movers; if nothing stays out of these
either, the motion that does for longest is taken; if walls allow none, the one that comes least near to them.

Between two samples the vehicle is no further from the nearer one than half a step h takes it,
|v| h/2 + |a| h²/8 + j h³/48, which is added to what has to be clear; boxes are those that hold a mover at any time of a
step. Who is nearer to the box of some mover than that at the start may go on, but come no nearer to this one, and keeps
the distance to all others; the promise does not hold meanwhile. Who is that near to a wall may go along it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from maxjax.sim.movers.hard_set import HardSet, gaps, seen_free
from maxjax.sim.movers.local_value import LocalValue, cost_to_go
from maxjax.sim.movers.motions import MotionPrimitive, MotionSet, at, duration, motions
from maxjax.sim.movers.reachable_sets import Bounds, Tracks, likely_sets, reachable

# Distances are compared with so much room for rounding [m].
_SLACK = 1e-3
# Half the distance over which the slope of the cost-to-go is taken [voxels].
_SLOPE = 1.0
# Likely acceleration of movers, as a share of its bound.
_CALM = 0.25


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Keeping:
    """Distances that motions keep; static.

    Attributes:
        radius: to what may hold a mover [m]: of the vehicle, and how far it may be from its motion.
        wall: to the cubes of blocked voxels [m].
        promise: m, time for which a motion is verified at least, however soon it rests [s]: as long as a vehicle at
            rest is told beforehand that something may come near. The longer it is, the more often nothing is verified.
        step: between the samples of a motion [s].
        comfort: distance to a mover from which on nearness costs nothing [m].
        nearness: cost of touching a mover's likely place [m].
        turning: cost of another target velocity than the present motion's, by as much as the greatest speed [m].

    Raises:
        ValueError: unless all are positive.
    """

    radius: float = 1.0
    wall: float = 1.0
    promise: float = 0.8
    step: float = 0.1
    comfort: float = 3.0
    nearness: float = 4.0
    turning: float = 0.3

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0.0:
                raise ValueError(f"Keeping.{name}: expected a positive number, given {value!r}")


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Commitment:
    """The motion that is flown, and for how long from its start it was verified [s]; batch axes lead."""

    motion: MotionPrimitive
    verified: Float[Array, "*batch"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class MotionScores:
    """Scores of each motion; batch axes lead.

    Attributes:
        verified: against sets, walls and unseen space, for `promised`; against sets that are too near already, that it
            comes no nearer.
        promised: time for which it has to be clear: until it rests, and at least `Keeping.promise` [s].
        free: time up to which it stays out of the sets [s].
        hopeful: time up to which it stays out of where movers are likely to be [s].
        allowed: whether walls and unseen space allow it.
        nearer: how much nearer to walls than it may it comes, in the mean over the horizon [m].
        cost: the less, the better [m].
        margin: least distance to where movers are likely to be [m].
        near: whether it starts too near to the set of some mover.
    """

    verified: Bool[Array, "*batch n"]
    promised: Float[Array, "*batch n"]
    free: Float[Array, "*batch n"]
    hopeful: Float[Array, "*batch n"]
    allowed: Bool[Array, "*batch n"]
    nearer: Float[Array, "*batch n"]
    cost: Float[Array, "*batch n"]
    margin: Float[Array, "*batch n"]
    near: Bool[Array, "*batch n"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Around:
    """Obstacles and guide of motions; the box that they may not leave is static."""

    tracks: Tracks
    hard: HardSet
    guide: LocalValue
    within: tuple[tuple[float, float, float], tuple[float, float, float]] | None = dataclasses.field(
        default=None, metadata={"static": True}
    )


def choose_motion(
    around: Around, flown: Commitment, choice: MotionSet, bounds: Bounds, keeping: Keeping
) -> tuple[Commitment, Bool[Array, ""]]:
    """The motion to fly from now on, and whether its promise holds: no contact while it is verified.

    It does not while the vehicle is too near to some set: what is verified then, is so against all others.

    Args:
        around: what is around.
        flown: the motion that is flown, as left from now on, and how long it is verified from now on.
        choice: motions that are tried. Static.
        bounds: that movers are assumed to keep. Static.
        keeping: distances. Static.
    """
    present = flown.motion
    tried = motions(choice, present, downhill(around.guide, present, choice))
    every = jax.tree.map(lambda x, y: jnp.concatenate([x[None], y]), present, tried)
    scored = score(around, every, choice, bounds, keeping)
    # What was wanted at the last look is wanted a little more than what is as good.
    turned = jnp.linalg.norm(every.target - present.target, axis=-1) / choice.speed
    scored = dataclasses.replace(scored, cost=scored.cost + keeping.turning * turned)
    some = jnp.any(scored.verified)
    best = jnp.argmin(jnp.where(scored.verified, scored.cost, jnp.inf))
    keeps = (flown.verified >= keeping.step) & (scored.free[0] > flown.verified) & scored.allowed[0]
    last = jnp.argmax(last_resort(scored))
    taken = jnp.where(some, best, jnp.where(keeps, 0, last))
    verified = jnp.where(some, scored.promised[best], jnp.where(keeps, flown.verified, 0.0))
    motion: MotionPrimitive = jax.tree.map(lambda x: x[taken], every)
    return Commitment(motion, verified), (some | keeps) & ~scored.near[0]


def last_resort(scored: MotionScores) -> Float[Array, " n"]:
    """Rank of motions where none is verified; the greatest is flown.

    1. Those that walls and unseen space allow; then those that come less near to walls than they may not.
    2. Those out of where movers are likely to be for as long as motions are verified, by cost.
    3. The others by seconds out of there. A metre of margin, of the first one, counts as half a second; a second out of
       the sets as 0.2 s; a metre of cost as 0.02 s.
    """
    hope = scored.hopeful + 0.5 * jnp.minimum(scored.margin, 1.0) + 0.2 * scored.free
    hope = jnp.where(scored.hopeful > scored.promised, 100.0 - scored.cost, hope - 0.02 * scored.cost)
    return jnp.where(scored.allowed, hope, hope - 1e4 * (1.0 + scored.nearer))


# (around, flown, choice, bounds, keeping) ↦ (the motion to fly, whether its promise holds)
Chooser = Callable[[Around, Commitment, MotionSet, Bounds, Keeping], tuple[Commitment, Bool[Array, ""]]]


def score(around: Around, tried: MotionPrimitive, choice: MotionSet, bounds: Bounds, keeping: Keeping) -> MotionScores:
    """Judge motions that all start now."""
    steps = round(choice.horizon / keeping.step)
    times = keeping.step * jnp.arange(steps + 1)
    place, velocity, push = jax.vmap(lambda t: at(tried, t), out_axes=1)(times)  # (n, t, 3)
    half = 0.5 * keeping.step
    sweep = half * jnp.linalg.norm(velocity, axis=-1) + half**2 / 2.0 * jnp.linalg.norm(push, axis=-1)
    sweep += half**3 / 6.0 * choice.jerk

    free, _, near = _free(around.tracks, place, sweep, bounds, keeping)
    calm = dataclasses.replace(bounds, acceleration=_CALM * bounds.acceleration)
    hopeful, margin, _ = _free(likely_sets(around.tracks), place, sweep, calm, keeping)

    flat = place.reshape(-1, 3)
    wall = gaps(around.hard, flat).reshape(sweep.shape)
    needed = jnp.minimum(jnp.minimum(keeping.wall + sweep, 2.0 * around.hard.spacing), wall[:, :1]) - _SLACK
    nearer = jnp.mean(jnp.maximum(needed - wall, 0.0), axis=1)
    own = jnp.max(jnp.abs(place - place[:, :1]), axis=-1) < 0.5 * around.hard.spacing
    known = seen_free(around.hard, flat).reshape(sweep.shape) | own
    allowed = jnp.all((wall >= needed) & known, axis=1)
    if around.within is not None:
        low, high = (jnp.asarray(x, place.dtype) for x in around.within)
        # Whoever is outside may come back.
        beyond = jnp.maximum(jnp.max(jnp.maximum(low - place, place - high), axis=-1), 0.0)
        allowed &= jnp.all(beyond <= beyond[:, :1] + 1e-3, axis=1)

    price = keeping.nearness * jnp.square(jnp.maximum(1.0 - margin / keeping.comfort, 0.0))
    cost = cost_to_go(around.guide, place[:, -1]) + price
    promised = jnp.maximum(duration(tried), keeping.promise)
    verified = allowed & (free > promised) & (promised <= choice.horizon)
    return MotionScores(verified, promised, free, hopeful, allowed, nearer, cost, margin, near)


def _free(
    tracks: Tracks, place: Float[Array, "n t 3"], sweep: Float[Array, "n t"], bounds: Bounds, keeping: Keeping
) -> tuple[Float[Array, " n"], Float[Array, " n"], Bool[Array, " n"]]:
    """Time up to which motions stay out of sets [s], more than the last one if throughout.

    And how near they come [m], and whether they start too near. A sample stands for half a step before and after it.
    """
    times = keeping.step * jnp.arange(place.shape[1])
    edges = jnp.maximum(keeping.step * (jnp.arange(len(times) + 1) - 0.5), 0.0)
    least, greatest = reachable(tracks, edges, bounds)
    least, greatest = jnp.minimum(least[:-1], least[1:]), jnp.maximum(greatest[:-1], greatest[1:])
    needed = keeping.radius + sweep - _SLACK
    start = _apart(place[:, 0], least[0], greatest[0])  # (n, s)
    near = start < needed[:, :1] - _SLACK
    # Who is that near to a mover already may stay as near to it, but come no nearer.
    exempt = jnp.where(near, start - _SLACK, jnp.inf)

    def at_time(place: Array, needed: Array, least: Array, greatest: Array) -> tuple[Array, Array]:
        apart = _apart(place, least, greatest)
        spare = apart - jnp.minimum(needed[:, None], exempt)
        return jnp.min(spare, axis=1, initial=jnp.inf), jnp.min(apart, axis=1, initial=jnp.inf)

    spare, apart = jax.vmap(at_time, in_axes=(1, 1, 0, 0), out_axes=1)(place, needed, least, greatest)
    clear = spare >= 0.0
    first = jnp.where(jnp.all(clear, axis=1), len(times), jnp.argmin(clear, axis=1))
    free = jnp.maximum(keeping.step * (first - 0.5), 0.0)
    return free, jnp.min(apart, axis=1), jnp.any(near, axis=1)


def _apart(
    place: Float[Array, "n 3"], least: Float[Array, "s 3"], greatest: Float[Array, "s 3"]
) -> Float[Array, "n s"]:
    """From places to boxes [m]; to those that are NaN: infinity."""
    # Asked of what is given: whether a maximum of NaN is NaN depends on the compiler.
    nobody = jnp.any(jnp.isnan(least) | jnp.isnan(greatest), axis=-1)
    outside = jnp.maximum(jnp.maximum(least - place[:, None], place[:, None] - greatest), 0.0)
    return jnp.where(nobody, jnp.inf, jnp.linalg.norm(jnp.where(nobody[:, None], 0.0, outside), axis=-1))


def downhill(guide: LocalValue, flown: MotionPrimitive, choice: MotionSet) -> Float[Array, "3"]:
    """The greatest velocity down the cost-to-go [m/s]."""
    apart = _SLOPE * guide.spacing * jnp.eye(3)
    values = cost_to_go(guide, jnp.concatenate([flown.place - apart, flown.place + apart]))
    fall = values[:3] - values[3:]
    return choice.speed * fall / jnp.maximum(jnp.linalg.norm(fall), 1e-6)
