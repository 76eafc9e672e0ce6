"""The data of a flight among movers: what it knows, what it flies, and what it assumed in vain.

No contact with a mover before the motion that is flown has ended, unless a flag is up:

    BOUND     a measurement outside the set of its track: the mover broke its bounds, and what is flown is not verified
              against all that it may do now, at any velocity within the bound
    NEAR      a mover first confirmed nearer than what confirming it and an escape take
    DRIFTED   the vehicle further from its motion than assumed
    TRAPPED   the motion that was verified has ended, or is not any more, and no other one is
    CROWDED   more movers than there are slots for
"""

from __future__ import annotations

import dataclasses
import enum
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from maxjax.sim.loop.flight_state import Flight, FlightConfig, World
from maxjax.sim.movers.choice import Commitment
from maxjax.sim.movers.reachable_sets import Tracks, no_tracks

AHEAD = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Shares of the horizon at which a record says where movers may be."""


class Flag(enum.IntEnum):
    """An assumption about movers that failed."""

    BOUND = 0
    NEAR = 1
    DRIFTED = 2
    TRAPPED = 3
    CROWDED = 4


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Flags:
    """How long each flag was up, and when last; batch axes lead.

    Attributes:
        seconds: that each flag was up [s], by `Flag`.
        any_seconds: that some flag was up [s].
        last: time at which each was up last [s]; minus infinity: never.
    """

    seconds: Float[Array, "*batch f"]
    any_seconds: Float[Array, "*batch"]
    last: Float[Array, "*batch f"]


def no_flags() -> Flags:
    """Flags before take-off: none is up."""
    return Flags(jnp.zeros(len(Flag)), jnp.float32(0.0), jnp.full(len(Flag), -jnp.inf, jnp.float32))


def raise_flags(flags: Flags, up: Bool[Array, " f"], time: Float[Array, ""], lasts: float) -> Flags:
    """The flags after some were up for a while.

    Args:
        flags: before.
        up: which.
        time: since when [s].
        lasts: for so long [s].
    """
    return Flags(
        flags.seconds + lasts * up,
        flags.any_seconds + lasts * jnp.any(up),
        jnp.where(up, time, flags.last),
    )


def flags_of_look(
    seen: Bool[Array, " f"], drifted: Bool[Array, ""], trapped: Bool[Array, ""], appeared: Bool[Array, ""]
) -> Bool[Array, " f"]:
    """The flags that are up from a look on.

    The set of a mover that broke its bounds begins again, with all velocities that the bound on speed allows. Whoever
    is verified against that is promised as much as before, whatever the mover does below that speed.

    Args:
        seen: those of perception.
        drifted: whether the vehicle is off its motion.
        trapped: whether nothing is verified.
        appeared: whether something is met near the vehicle where nothing was.
    """
    up = seen.at[Flag.DRIFTED].set(drifted).at[Flag.TRAPPED].set(trapped).at[Flag.NEAR].max(appeared)
    return up.at[Flag.BOUND].min(trapped)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Sightings:
    """Tracks, returns and flags of a look; batch axes lead.

    Attributes:
        tracks: of the movers.
        returns: rays of the scan that met movers: the static map is not told of them.
        flags: which of the assumptions about movers broke.
        memory: what the next look needs.
    """

    tracks: Tracks
    returns: Bool[Array, "*batch r"]
    flags: Bool[Array, "*batch f"]
    memory: Any


def no_sightings(rays: int) -> Sightings:
    """Sightings where no sensor looks for movers."""
    return Sightings(no_tracks(1), jnp.zeros(rays, bool), jnp.zeros(len(Flag), bool), None)


@runtime_checkable
class Perception(Protocol):
    """A perception of movers; static, hashable."""

    def start(self, world: World, flight: Flight, config: FlightConfig) -> Sightings:
        """Sightings before the first look."""
        ...

    def look(self, world: World, flight: Flight, config: FlightConfig) -> Sightings:
        """Sightings after the scan in `flight.scan`."""
        ...


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class LookRecord:
    """Record of a look, for drawings; batch axes lead, the last of them that of looks.

    Attributes:
        least, greatest: coordinates of the boxes that may hold the movers, at `AHEAD` of the horizon [m]; NaN: nobody.
        flown: the motion, from the look on.
        up: flags that were up with it.
    """

    least: Float[Array, "*batch h s 3"]
    greatest: Float[Array, "*batch h s 3"]
    flown: Commitment
    up: Bool[Array, "*batch f"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Among:
    """The part of a flight among movers; batch axes lead.

    Attributes:
        seen: by the latest look.
        flown: the motion that is flown.
        since: time since its start [s].
        record: of each look of the present planning period.
    """

    seen: Sightings
    flown: Commitment
    since: Float[Array, "*batch"]
    record: LookRecord
