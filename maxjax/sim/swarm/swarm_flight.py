"""A swarm in closed loop: flights in lockstep, one axis of one program, that gather what they say to each other.

    fly_swarm(worlds, config, together) -> SwarmLog              one program, for batches
    watch_swarm(worlds, config, together) -> flights             on the host, a vehicle's own stages one after the other

Each vehicle senses, maps and plans for itself (`sim.loop.flight`); `sim.swarm.together` takes the place of the stage
that moves. The vehicles are no part of each other's scans, as if returns from where others are told to be were left
out.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.batching import settle
from maxjax.compile.executable import Stored
from maxjax.core.status import Status
from maxjax.sim.loop.flight import program_of, stages_of, take_off
from maxjax.sim.loop.flight_state import Flight, FlightConfig, FlightLog, World
from maxjax.sim.loop.follow import follow, unless
from maxjax.sim.movers.among import Among
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.swarm.member import Member, hovering
from maxjax.sim.swarm.together import SWARM, Together

# Swarms of a batch that take a planning period at a time.
_AT_ONCE = 64


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class SwarmLog:
    """The result of a swarm's flights; batch axes lead, the vehicles come last of them.

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


def fly_swarm(worlds: World, config: FlightConfig, together: Together) -> SwarmLog:
    """Fly a swarm once; pure, for `jit` and `vmap` over batches of swarms.

    Args:
        worlds: one for each vehicle, along a leading axis: the same solids and movers, its own ends and key.
        config: how each flies; its `Avoidance` says by which motions. `Together.motions` are such that a vehicle need
            not brake while its proposal waits.
        together: how they agree.

    Returns:
        The log. START_OCCUPIED: a start lies nearer to another one than motions have to be apart.

    Raises:
        ValueError: for fewer than two vehicles, or a configuration without `Avoidance` or the stage `follow`.
    """
    _check(worlds, config)
    first = swarm_take_off(worlds, config, together)
    flown = settle(_flies, functools.partial(swarm_iteration, config=config, together=together), worlds, first,
                   at_once=_AT_ONCE)  # fmt: skip
    return log_of(flown)


def log_of(flown: Flight) -> SwarmLog:
    """The log of a swarm's flights."""
    member = flown.part(Member)
    return SwarmLog(flown.log, member.gap, member.touched, member.swaps, member.dropped)


def watch_swarm(worlds: World, config: FlightConfig, together: Together) -> Iterator[Flight]:
    """`fly_swarm` with its loop on the host: the flights before their first planning period, and after each.

    The stages in which vehicles know nothing of each other are programs of one flight, as those of
    `sim.loop.flight.watch` are, and are not run for who is done. Up to rounding the flights are the same.
    """
    _check(worlds, config)
    own = [stage for stage in stages_of(config) if stage is not follow]
    flights = _TAKE_OFF(worlds, config, together)
    yield flights
    while np.any(~np.asarray(flights.done)):
        each = []
        for k in range(len(worlds.start)):
            world, flight = jax.tree.map(lambda x, k=k: x[k], (worlds, flights))
            for stage in own if not flight.done else ():
                flight = program_of(stage)(world, flight, config)
            each.append(flight)
        flights = _FOLLOW(worlds, jax.tree.map(lambda *x: jnp.stack(x), *each), config, together)
        yield flights


def _check(worlds: World, config: FlightConfig) -> None:
    if len(worlds.start) < 2:
        raise ValueError(f"swarm: expected 2 vehicles or more, given {len(worlds.start)}")
    if not config.has(Avoidance) or follow not in stages_of(config):
        raise ValueError("swarm: expected the extension Avoidance and the stage `follow`, given a config without")


def swarm_take_off(worlds: World, config: FlightConfig, together: Together) -> Flight:
    """All flights before their first planning period."""
    flights: Flight = jax.vmap(functools.partial(_take_off, config=config, together=together), axis_name=SWARM)(worlds)
    return flights


def swarm_iteration(worlds: World, flights: Flight, config: FlightConfig, together: Together) -> Flight:
    """One planning period of all vehicles."""

    def iterate(world: World, flight: Flight) -> Flight:
        for stage in stages_of(config):
            if stage is follow:
                flight = together(world, flight, config)
            else:
                flight = unless(flight.done, flight, stage(world, flight, config))
        return flight

    flown: Flight = jax.vmap(iterate, axis_name=SWARM)(worlds, flights)
    return flown


def _follow_together(worlds: World, flights: Flight, config: FlightConfig, together: Together) -> Flight:
    """The stage that moves, of all vehicles."""
    stages = dataclasses.replace(config, stages=(follow,))
    return swarm_iteration(worlds, flights, stages, together)


def _flies(_: World, flights: Flight) -> Bool[Array, ""]:
    return jnp.any(~flights.done)


def _take_off(world: World, config: FlightConfig, together: Together) -> Flight:
    """A flight before its first planning period, with its member of the swarm."""
    flight = take_off(world, config)
    member: Member = hovering(flight.part(Among).flown.motion, together.wait)
    places = jax.lax.all_gather(flight.vehicle.position, SWARM)
    others = jnp.arange(len(places)) != jax.lax.axis_index(SWARM)
    apart = jnp.linalg.norm(places - flight.vehicle.position, axis=-1)
    crowded = jnp.any(others & (apart < together.agreement(config.extension(Avoidance)).apart)) & (
        flight.log.status == Status.OK
    )
    status = jnp.where(crowded, Status.START_OCCUPIED, flight.log.status).astype(jnp.int32)
    log = dataclasses.replace(flight.log, status=status)
    return dataclasses.replace(flight, done=flight.done | crowded, log=log).with_part(member)


_TAKE_OFF = Stored("take-off of a swarm", swarm_take_off)
_FOLLOW = Stored("swarm", _follow_together)
