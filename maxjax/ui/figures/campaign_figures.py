"""Pictures (extra `viz`): the flights of a campaign's first city, those of a fleet, the film of a flight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.sim.loop.flight import Flight
from maxjax.sim.loop.flight_state import LOG_PERIOD
from maxjax.sim.mapping import rolling_map
from maxjax.sim.movers.moments import moments_of
from maxjax.sim.swarm.swarm_flight import SwarmLog
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.cities import TrialSite, Where, label_of_city
from maxjax.sim.trials.given_city import GivenCity
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import Outcome
from maxjax.sim.trials.swarm_trials import SwarmTrial
from maxjax.sim.trials.trial_movers import movers_of
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.movers import Movers, solids_at
from maxjax.sim.worlds.scenes import make_scene, occupancy
from maxjax.sim.worlds.solid_distance import distance
from maxjax.ui.figures.drawable import drawable
from maxjax.ui.figures.film import Filmed, Look, film_flight
from maxjax.ui.figures.flights import Flown, figure_flights
from maxjax.ui.figures.movers_from_above import Moving, moving_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# The cities of all maps, by the metre.
_CITY = Grid((300, 300, 134), 1.0, (-149.5, -149.5, 0.5))


def figure_campaign(campaign: Campaign, ledger: Ledger) -> Figure:
    """The flights over the first city of a campaign, seen from above.

    Args:
        campaign: what was flown.
        ledger: its outcomes, at least one of them flown, and positions.
    """
    flown = _flown(ledger)
    city, positions = flown[0].city, ledger.positions()
    shown = [outcome for outcome in flown if outcome.city == city and outcome.trial in positions]
    lines = [Flown(one.trial, positions[one.trial], np.asarray(one.goal), one.arrived) for one in shown]
    return figure_flights(
        *_obstacle_in(campaign.map, city), lines, title=_title(campaign, city), caption=_caption(flown, shown)
    )


def figure_swarm(fleet: SwarmTrial, log: SwarmLog) -> Figure:
    """The ways of all vehicles of a fleet over their city, seen from above.

    Args:
        fleet: what was flown.
        log: of one fleet.
    """
    arrived, position = np.asarray(log.flights.status) == Status.OK, np.asarray(log.flights.position)
    lines = [
        Flown(k, position[k][np.isfinite(position[k]).all(axis=1)], fleet.swaps.goal[k], bool(arrived[k]))
        for k in range(fleet.count)
    ]
    title = f"{fleet.map}:{fleet.seed}, {fleet.count} vehicles, delay {fleet.together.delay:g} s"
    caption = f"{int(arrived.sum())} of {fleet.count} arrived without contact."
    return figure_flights(
        _obstacle(make_scene(fleet.map, fleet.seed).geoms), _CITY, lines, title=title, caption=caption
    )


def film_trial(campaign: Campaign, outcome: Outcome, flights: Sequence[Flight], *, by: str = "") -> bytes:
    """The film of one trial, an animated GIF.

    Args:
        campaign: what was flown.
        outcome: of the trial.
        flights: before its first planning period and after each, two at least.
        by: what flew it, for the title.
    """
    start, goal = (np.asarray(end, np.float32) for end in (outcome.start, outcome.goal))
    geoms = TrialSite(campaign.map, outcome.city, start, goal).solids
    looks = looks_of(flights)
    where = np.concatenate([look.flown for look in looks])
    clearance = np.asarray(jax.jit(jax.vmap(distance, in_axes=(None, 0)))(geoms, where))
    moving: list[Moving] = []
    if (movers := movers_of(campaign.configuration(), outcome, campaign.map)) is not None:
        times = np.minimum(LOG_PERIOD * np.arange(len(where)), outcome.duration or np.inf)
        clearance = np.minimum(clearance, _to_movers(movers, jnp.asarray(times), jnp.asarray(where)))
        moving = moving_of(movers, times, moments_of(flights))
    filmed = Filmed(looks, np.asarray(outcome.goal), clearance, campaign.config.radius, moving)
    title = f"{_title(campaign, outcome.city)}, trial {outcome.trial}{by and f', {by}'}: {outcome.status}"
    return film_flight(filmed, *_obstacle_in(campaign.map, outcome.city), title=title)


def _to_movers(movers: Movers, times: Float[Array, " n"], points: Float[Array, "n 3"]) -> Float[np.ndarray, " n"]:
    """Distances of points to movers at some times [m]."""
    return np.asarray(jax.jit(jax.vmap(lambda t, x: distance(solids_at(movers, t), x)))(times, points))


def _flown(ledger: Ledger) -> list[Outcome]:
    flown = (outcome for outcome in ledger.outcomes.values() if outcome.flown)
    return sorted(flown, key=lambda outcome: outcome.trial)


def _obstacle_in(where: Where, city: int) -> tuple[Bool[np.ndarray, "nx ny nz"], Grid]:
    """What stands in a city, by the metre or, of a given one, by its voxels."""
    if isinstance(where, GivenCity):
        shown = drawable(where.world.above_plane)[0]
        return np.asarray(shown.occupied) & ~np.asarray(shown.ground), shown.grid
    return _obstacle(make_scene(where, city).geoms), _CITY


def _obstacle(geoms: Geoms) -> Bool[np.ndarray, "nx ny nz"]:
    occupied, ground = occupancy(geoms, _CITY)
    return np.asarray(occupied & ~ground)


def _title(campaign: Campaign, city: int) -> str:
    """The city, the method unless it is the field, the disturbances, and what moves."""
    method = campaign.config.planner.name
    methods = [] if method == "field" else [f"method {method}"]
    strengths = [f"{name.replace('_', ' ')} {value:g}" for name, value in campaign.strengths.items() if value]
    if (how := campaign.movers) is not None:
        strengths.append(f"{how.count} {'movers' if how.kind == 'mixed' else how.kind} of {how.speed:g} m/s")
    return ", ".join([label_of_city(campaign.map, city), *methods, *strengths])


def _caption(flown: Sequence[Outcome], shown: Sequence[Outcome]) -> str:
    def counts(some: Sequence[Outcome]) -> str:
        return f"{sum(outcome.arrived for outcome in some)} of {len(some)} arrived"

    caption = f"{counts(shown)} without contact"
    others = [outcome for outcome in flown if outcome.city != flown[0].city]
    if others:
        cities = len({outcome.city for outcome in others})
        caption += f"; not shown: {len(others)} flights in {cities} more cit{'y' if cities == 1 else 'ies'}, "
        caption += counts(others)
    return caption + "."


def looks_of(flights: Sequence[Flight]) -> list[Look]:
    """Map and place of a flight in each planning period, from its states before and after each."""
    looks = []
    before = 0
    for flight in flights[1:]:
        position = np.asarray(flight.log.position)
        after = int(np.isfinite(position).all(axis=1).sum())
        known = flight.rolling_map
        solid = np.asarray(rolling_map.occupied_voxels(known) & ~rolling_map.ground(known))
        corner = known.spacing * (np.asarray(known.corner, np.float64) - 0.5)
        path = np.asarray(flight.path)
        moves = np.nonzero(np.any(np.diff(path, axis=0), axis=1))[0]
        points = np.asarray(flight.scan.points)
        looks.append(
            Look(
                scan=points[np.asarray(flight.scan.hit)],
                known=np.asarray(solid.any(axis=2)),
                lower=(float(corner[0]), float(corner[1])),
                spacing=known.spacing,
                path=path[: moves[-1] + 2 if len(moves) else 1],
                flown=position[before:after],
            )
        )
        before = after
    return looks
