"""The stage of a swarm that moves: as `sim.loop.follow`, along motions that are swapped by the agreement.

It runs under `vmap` with the axis `SWARM`, over which messages and places are gathered: what a vehicle is told of the
others is `Together.wait` looks old. Nobody leaves the motion that it is committed to but by a swap; where that is not
clear of movers or walls any more, or the vehicle is not where it leads, a flag is up. Who has arrived flies the motion
to its end, at which it stays in the air. Contacts are counted by the exact distance of bodies at every physics step.
Frame: world.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.status import Status
from maxjax.sim.loop.flight_state import LOG_PERIOD, Flight, FlightConfig, World, estimated_position
from maxjax.sim.loop.follow import fly_period, step_alone, unless
from maxjax.sim.movers.among import Among, flags_of_look
from maxjax.sim.movers.avoidance import Avoidance, guide_around, hard_around
from maxjax.sim.movers.choice import Around, Commitment
from maxjax.sim.movers.motions import MotionSet, duration, later
from maxjax.sim.movers.reachable_sets import Tracks, propagate
from maxjax.sim.swarm.agreement import Agreement, proposing, swap_proposal
from maxjax.sim.swarm.member import NOBODY, Member, place_of_commitment, saying
from maxjax.sim.swarm.proposal import as_tracks, nearest_of, others_told, propose_motion
from maxjax.sim.swarm.separation import Sampled, Scheduled

# Greatest jerk that the vehicle follows in any state: it turns by 2.5 rad/s at most, with its weight for thrust [m/s³].
_JERK = 20.0
# More than any motion takes [s].
_AMPLE = 1e3

SWARM = "swarm"
"""Axis of the vehicles."""


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Together:
    """A planning period of a vehicle of a swarm; static, a stage.

    Attributes:
        delay: of messages at most [s]. Besides, what is decided at a look is known to nobody before the next one.
        neighbours: vehicles that a proposal looks at, the nearest ones; a swap looks at all.

    Raises:
        ValueError: for a delay that is not a finite number of at least 0, or no neighbours.
    """

    delay: float = 0.0
    neighbours: int = 16

    def __post_init__(self) -> None:
        if not 0.0 <= self.delay < math.inf:
            raise ValueError(f"delay: expected a finite number of seconds, at least 0, given {self.delay}")
        if self.neighbours < 1:
            raise ValueError(f"neighbours: expected at least 1, given {self.neighbours}")

    @property
    def wait(self) -> int:
        """Looks from a proposal to its swap: as old as messages may be."""
        return 1 + math.ceil(self.delay / LOG_PERIOD - 1e-6)

    def motions(self, choice: MotionSet = MotionSet()) -> MotionSet:  # noqa: B008 (frozen)
        """Motions that go on until the next but one proposal can replace them, with the limits of a set."""
        brakes = tuple(round(LOG_PERIOD * self.wait + more, 3) for more in (0.1, 0.4))
        # Nobody leaves a commitment, so nobody may be asked for turns that it cannot follow at once.
        calm = dataclasses.replace(choice, jerk=min(choice.jerk, _JERK), brakes=brakes, horizon=_AMPLE)
        return dataclasses.replace(calm, horizon=math.ceil(10.0 * calm.lasts) / 10.0)

    def agreement(self, how: Avoidance) -> Agreement:
        """The agreement of all vehicles that fly like this."""
        steps = math.ceil(how.choice.horizon / LOG_PERIOD)
        return Agreement(self.wait, 2.0 * how.keeping.radius, Sampled(LOG_PERIOD, steps, how.choice.acceleration))

    def __call__(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        """One planning period."""
        return fly_period(world, flight, config, self._steer, _step)

    def _steer(self, world: World, flight: Flight, config: FlightConfig, number: Int32[Array, ""]) -> Flight:
        """Swap, propose, and send the message of this look; `number`: of it in its period."""
        how, member, among = config.extension(Avoidance), flight.part(Member), flight.part(Among)
        agreement, index = self.agreement(how), lax.axis_index(SWARM)
        told, own = lax.all_gather(member.oldest, SWARM), member.latest
        look = own.sent + 1
        due = own.proposed + self.wait == look
        own, swaps = swap_proposal(own, told, index, look, agreement)

        since = LOG_PERIOD * (look - own.committed.start).astype(jnp.float32)
        promised = jnp.maximum(duration(own.committed.motion), how.keeping.promise)
        verified = jnp.where(swaps, promised, among.flown.verified - among.since)
        start = look + self.wait
        present = later(own.committed.motion, since + LOG_PERIOD * self.wait)
        near = nearest_of(others_told(told, index), present.place, start, self.neighbours, agreement)
        ahead = LOG_PERIOD * self.wait
        around, appeared = _around(
            flight, config, present.place, as_tracks(near, start, agreement, config.radius), ahead
        )
        wish = propose_motion(around, Commitment(present, verified - ahead), near, start, how, agreement)
        own = proposing(own, Scheduled(wish.motion, start), wish.wanted & ~flight.done, look)

        flown = Commitment(own.committed.motion, wish.verified + ahead + since)
        counted = dataclasses.replace(member, swaps=member.swaps + swaps, dropped=member.dropped + (due & ~swaps))
        up = _up(world, flight, config, appeared, ~wish.holds)
        from_now = Commitment(later(flown.motion, since), flown.verified - since)
        after = flight.with_part(dataclasses.replace(among, flown=flown, since=since))
        after = unless(flight.done, flight, how.log_choice(after, from_now, up, number))
        return after.with_part(saying(counted, own))


def _around(
    flight: Flight, config: FlightConfig, place: Float[Array, "3"], others: Tracks, ahead: float
) -> tuple[Around, Bool[Array, ""]]:
    """Obstacles and guide around a place of the vehicle some time ahead [s], and whether something appeared near it.

    The way is dear where others may be.
    """
    how, among = config.extension(Avoidance), flight.part(Among)
    tracks = propagate(among.seen.tracks, ahead, how.bounds)
    priced = jax.tree.map(lambda x, y: jnp.concatenate([x, y]), tracks, others)
    guide = guide_around(flight, config, place, priced)
    hard, appeared = hard_around(flight, config, place)
    return Around(tracks, hard, guide, how.within), appeared


def _up(
    world: World, flight: Flight, config: FlightConfig, appeared: Bool[Array, ""], trapped: Bool[Array, ""]
) -> Bool[Array, " f"]:
    """The flags that are up."""
    how, among, member = config.extension(Avoidance), flight.part(Among), flight.part(Member)
    # Where it believes to be: map, sets and motions are in that frame.
    position = estimated_position(world, flight, config)
    drifted = jnp.linalg.norm(place_of_commitment(member, LOG_PERIOD) - position) > how.drift
    return flags_of_look(among.seen.flags, drifted, trapped, appeared)


def _step(world: World, flight: Flight, config: FlightConfig, noise: Float[Array, "3"]) -> Flight:
    """One time step, and how near the others are after it."""
    flight = step_alone(world, flight, config, noise)
    member = dataclasses.replace(flight.part(Member), since=flight.part(Member).since + config.vehicle.timestep)
    place = jnp.where(flight.done, place_of_commitment(member, LOG_PERIOD), flight.vehicle.position)
    places = lax.all_gather(place, SWARM)
    others = jnp.arange(len(places)) != lax.axis_index(SWARM)
    gaps = jnp.where(others, jnp.linalg.norm(places - place, axis=-1) - 2.0 * config.radius, jnp.inf)
    nearest = jnp.argmin(gaps)
    touches = gaps[nearest] <= 0.0
    first = touches & (member.touched == NOBODY)
    member = dataclasses.replace(
        member,
        gap=jnp.minimum(member.gap, gaps[nearest]),
        touched=jnp.where(first, nearest, member.touched).astype(jnp.int32),
    )
    # Whoever has arrived and is touched there was in contact.
    status = jnp.where(touches, Status.IN_CONTACT, flight.log.status).astype(jnp.int32)
    log = dataclasses.replace(flight.log, status=status)
    return dataclasses.replace(flight, done=flight.done | touches, log=log).with_part(member)
