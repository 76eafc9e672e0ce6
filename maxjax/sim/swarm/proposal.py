"""Proposals of a vehicle of a swarm: a motion clear of movers, walls and all that it was told, that leads further on.

    cost = cost-to-go of its place of rest + price of nearness to movers + price of nearness to the other vehicles

Here only the nearest vehicles are looked at, and what the others decide meanwhile is unknown: that a swap keeps motions
apart is the agreement's to tell (`sim.swarm.agreement`). Frame: world.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.movers.choice import Around, Commitment, downhill, score
from maxjax.sim.movers.motions import MotionPrimitive, at, duration, motions
from maxjax.sim.movers.reachable_sets import Tracks, no_tracks
from maxjax.sim.swarm.agreement import NEVER, Agreement, Message
from maxjax.sim.swarm.separation import Scheduled, courses, separation

# A motion that leads no further than the present one by more than this is not worth a swap [m].
_FURTHER = 0.05


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Wish:
    """The motion that a vehicle would fly.

    Attributes:
        motion: which.
        wanted: whether it is clear of all that is known, and better than the present motion.
        holds: whether the present motion is clear of movers and walls, as far as it was promised to be.
        verified: for how long from where it was judged the present motion is clear of them [s].
    """

    motion: MotionPrimitive
    wanted: Bool[Array, ""]
    holds: Bool[Array, ""]
    verified: Float[Array, ""]


def others_told(told: Message, index: Int32[Array, ""]) -> Message:
    """The messages of all but one vehicle: one less along the leading axis."""
    rest = jnp.arange(len(told.sent) - 1)
    found: Message = jax.tree.map(lambda x: x[rest + (rest >= index)], told)
    return found


def nearest_of(
    told: Message, place: Float[Array, "3"], look: Int32[Array, ""], count: int, agreement: Agreement
) -> Message:
    """The messages of those who are committed to be nearest to a place at a look.

    Args:
        told: of others.
        place: [m].
        look: at which.
        count: how many at most. Static.
        agreement: static.
    """
    since = agreement.sampled.period * (look - told.committed.start).astype(jnp.float32)
    apart = jnp.linalg.norm(at(told.committed.motion, since)[0] - place, axis=-1)
    _, nearest = jax.lax.top_k(-apart, min(count, len(apart)))
    found: Message = jax.tree.map(lambda x: x[nearest], told)
    return found


def as_tracks(told: Message, look: Int32[Array, ""], agreement: Agreement, radius: float) -> Tracks:
    """Vehicles as movers, for the price of nearness: where they are told to be at a look, and how fast."""
    places = courses(told.committed, look, agreement.sampled)
    place, velocity = places[:, 0], (places[:, 1] - places[:, 0]) / agreement.sampled.period
    half, used = jnp.full_like(place, radius), jnp.ones(len(place), bool)
    return dataclasses.replace(no_tracks(len(place)), place=place, velocity=velocity, half=half, used=used)


def propose_motion(
    around: Around, left: Commitment, told: Message, at_look: Int32[Array, ""], how: Avoidance, agreement: Agreement
) -> Wish:
    """The best motion from where the present one leads by a later look, for which everything is given.

    Args:
        around: what is around, apart from the swarm.
        left: the rest of the present motion, and for how long that is promised to be clear of movers and walls.
        told: of the vehicles that are looked at.
        at_look: the look.
        how: motions, bounds, distances. Static.
        agreement: static.
    """
    choice, keeping, present = how.choice, how.keeping, left.motion
    tried = motions(choice, present, downhill(around.guide, present, choice))
    every = jax.tree.map(lambda x, y: jnp.concatenate([x[None], y]), present, tried)
    scored = score(around, every, choice, how.bounds, keeping)
    apart = jnp.min(_separations(every, told, at_look, agreement), axis=0, initial=jnp.inf)
    # The others know a motion until the horizon only.
    clear = (apart >= agreement.apart) & (duration(every) <= choice.horizon)
    price = keeping.nearness * jnp.square(jnp.maximum(1.0 - (apart - agreement.apart) / keeping.comfort, 0.0))
    cost = scored.cost + price

    verified = jnp.where(scored.verified[0], scored.promised[0], left.verified)
    holds = (verified >= keeping.step) & (scored.free[0] >= jnp.minimum(verified, choice.horizon)) & scored.allowed[0]
    holds &= ~scored.near[0]
    fit = clear & scored.verified
    best = jnp.argmin(jnp.where(fit, cost, jnp.inf))
    # Where nothing is verified and the present motion is not either: the longest out of the sets of movers.
    hope = scored.free + 0.5 * jnp.minimum(scored.margin, 1.0) - 0.02 * cost - 100.0 * ~scored.allowed
    last = jnp.argmax(jnp.where(clear, hope, -jnp.inf))
    taken = jnp.where(jnp.any(fit), best, last)
    better = fit[best] & ((cost[best] < cost[0] - _FURTHER) | ~holds)
    wanted = better | (~holds & clear[last] & ~jnp.any(fit))
    return Wish(jax.tree.map(lambda x: x[taken], every), wanted & (taken > 0), holds, verified)


def _separations(
    tried: MotionPrimitive, told: Message, at_look: Int32[Array, ""], agreement: Agreement
) -> Float[Array, "m n"]:
    """Of each vehicle, how near the nearer of its committed motion and its proposal comes to each motion [m]."""
    sampled = agreement.sampled
    mine = courses(Scheduled(tried, jnp.broadcast_to(at_look, tried.place.shape[:-1])), at_look, sampled)
    proposed = told.proposed != NEVER

    def of_one(told: Message, proposed: Array) -> Array:
        committed = separation(mine, courses(told.committed, at_look, sampled), sampled)
        other = separation(mine, courses(told.proposal, at_look, sampled), sampled)
        return jnp.where(proposed, jnp.minimum(committed, other), committed)

    return jax.vmap(of_one)(told, proposed)
