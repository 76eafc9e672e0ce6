"""A fleet in closed loop: flights in lockstep, one axis of one program, that gather what they say to each other.

    fly_fleet(worlds, config, together) -> FleetLog

Each vehicle senses, maps and plans for itself (`sim.flight`); `sim.fleet.together` takes the place of the stage that
moves. The vehicles are no part of each other's scans, as if returns from where others are told to be were left out.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.status import Status
from maxjax.programs.batching import settle
from maxjax.sim.fleet.member import Member, hovering
from maxjax.sim.fleet.together import FLEET, Together
from maxjax.sim.flight import stages_of, take_off
from maxjax.sim.flight_state import Flight, FlightConfig, FlightLog, World
from maxjax.sim.follow import follow, unless

# Fleets of a batch that take a planning period at a time.
_AT_ONCE = 64


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class FleetLog:
    """The result of a fleet's flights; batch axes lead, the vehicles come last of them.

    Attributes:
        flights: of each vehicle; OK where it reached its goal and was in contact with nothing, then or later.
        gap: least distance from its body to another one [m].
        touched: number of the first vehicle that it was in contact with; -1: none.
        swaps: proposals that it swapped to.
        dropped: proposals that it dropped.
    """

    flights: FlightLog
    gap: Float[Array, "*batch"]
    touched: Int32[Array, "*batch"]
    swaps: Int32[Array, "*batch"]
    dropped: Int32[Array, "*batch"]


def fly_fleet(worlds: World, config: FlightConfig, together: Together) -> FleetLog:
    """Fly a fleet once; pure, for `jit` and `vmap` over batches of fleets.

    Args:
        worlds: one for each vehicle, along a leading axis: the same solids and movers, its own ends and key.
        config: how each flies; `config.moving` says by which motions. `Together.motions` are such that a vehicle need
            not brake while its proposal waits.
        together: how they agree.

    Returns:
        The log. START_OCCUPIED: a start lies nearer to another one than motions have to be apart.

    Raises:
        ValueError: for fewer than two vehicles, or a `config.moving` of None.
    """
    if config.moving is None or len(worlds.start) < 2:
        raise ValueError(f"fly_fleet: expected two vehicles or more and config.moving, given {len(worlds.start)}")
    first = jax.vmap(functools.partial(_take_off, config=config, together=together), axis_name=FLEET)(worlds)
    flown = settle(_flies, functools.partial(fleet_iteration, config=config, together=together), worlds, first,
                   at_once=_AT_ONCE)  # fmt: skip
    return log_of(flown)


def log_of(flown: Flight) -> FleetLog:
    """The log of a fleet's flights."""
    member = flown.member
    assert member is not None
    return FleetLog(flown.log, member.gap, member.touched, member.swaps, member.dropped)


def fleet_iteration(worlds: World, flights: Flight, config: FlightConfig, together: Together) -> Flight:
    """One planning period of all vehicles."""

    def iterate(world: World, flight: Flight) -> Flight:
        for stage in stages_of(config):
            if stage is follow:
                flight = together(world, flight, config)
            else:
                flight = unless(flight.done, flight, stage(world, flight, config))
        return flight

    return jax.vmap(iterate, axis_name=FLEET)(worlds, flights)


def _flies(_: World, flights: Flight) -> Bool[Array, ""]:
    return jnp.any(~flights.done)


def _take_off(world: World, config: FlightConfig, together: Together) -> Flight:
    """A flight before its first planning period, with its member of the fleet."""
    flight = take_off(world, config)
    assert config.moving is not None
    assert flight.among is not None
    member: Member = hovering(flight.among.flown.motion, together.wait)
    places = jax.lax.all_gather(flight.vehicle.position, FLEET)
    others = jnp.arange(len(places)) != jax.lax.axis_index(FLEET)
    apart = jnp.linalg.norm(places - flight.vehicle.position, axis=-1)
    crowded = jnp.any(others & (apart < together.agreement(config.moving).apart)) & (flight.log.status == Status.OK)
    status = jnp.where(crowded, Status.START_OCCUPIED, flight.log.status).astype(jnp.int32)
    log = dataclasses.replace(flight.log, status=status)
    return dataclasses.replace(flight, member=member, done=flight.done | crowded, log=log)
