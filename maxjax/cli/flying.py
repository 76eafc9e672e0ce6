"""`maxjax fly`: trials of the closed loop in a simulated city, their table, and pictures of them."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool

from maxjax.campaigns.campaign import Campaign
from maxjax.campaigns.execution import draw_trials, fly_trials, world_of
from maxjax.campaigns.ledger import Ledger
from maxjax.campaigns.outcomes import Outcome, on_host, outcome_of, summarise
from maxjax.cli import report
from maxjax.core.grid import Grid
from maxjax.core.provenance import device, versions
from maxjax.core.serialize import atomic_write
from maxjax.sim import rolling_map as mapping
from maxjax.sim.disturbances import Disturbances
from maxjax.sim.flight import Flight, FlightConfig, watch
from maxjax.viz.film import Look
from maxjax.worlds.distance import distance
from maxjax.worlds.geoms import Geoms
from maxjax.worlds.scenes import make_scene, occupancy

# The cities of all maps, by the metre.
_CITY = Grid((300, 300, 134), 1.0, (-149.5, -149.5, 0.5))
_CONFIG = FlightConfig()


def run(
    map: str,
    trials: int | None,
    seed: int,
    method: str,
    batch: int | None,
    disturbances: Disturbances,
    snapshot: bool,
    reactive: float,
    trial: int | None,
    out: Path | None,
    json: bool,
) -> int:
    """Fly, show and write; arguments as on the command line. Returns 0: failed flights are a result.

    Raises:
        ValueError, OSError, ImportError, MemoryError: for arguments that cannot be used.
    """
    if trials is not None and trial is not None:
        raise ValueError("--trials and --trial: expected one of them, given both")
    if trials is not None and trials < 1:
        raise ValueError(f"--trials: expected at least 1, given {trials}")
    if trial is not None and trial < 0:
        raise ValueError(f"--trial: expected an index from 0 on, given {trial}")
    if batch is not None and batch < 1:
        raise ValueError(f"--batch: expected at least 1, given {batch}")
    first, count = (trial, 1) if trial is not None else (0, trials or 1)
    config = dataclasses.replace(_CONFIG, disturbances=disturbances, snapshot=snapshot, reactive=reactive)
    campaign = Campaign(map, seed, range(first, first + count), method, config)
    report.check_output(out)
    ledger = None if out is None else campaign.ledger(out)

    flights: list[Flight] = []
    outcomes: list[Outcome] = []
    with report.tally(len(campaign.trials)) as tell:
        if trial is not None and ledger is not None:
            outcomes, flights = _watch(campaign, ledger)
            tell(1, sum(outcome.arrived for outcome in outcomes), 1)
        else:
            for some in fly_trials(campaign, batch=batch, folder=out, warn=report.complain):
                outcomes += some
                fresh = sum(outcome.flown for outcome in some) if ledger is None or _new(some, ledger) else 0
                tell(len(some), sum(outcome.arrived for outcome in some), fresh)
    origin = {"configuration": campaign.configuration(), "versions": versions(), "device": device()}
    content = report.plain({**summarise(outcomes), **origin})
    files: list[Path] = []
    if out is not None:
        with report.progress("Drawing"):
            files = _draw(campaign, out, outcomes, flights)
        atomic_write(out / "summary.json", report.dumps(content))
        files.append(out / "summary.json")
    if json:
        sys.stdout.write(report.dumps(content))
        return 0
    report.show(report.table(f"{map}, seed {seed}, method {method}", {"": _rows(content, outcomes)}))
    for failure in content["failures"]:
        print(f"trial {failure['index']}: {failure['status']}; again: {failure['command']}")
    if files:
        print(*files, sep="\n")
    return 0


def _new(outcomes: Sequence[Outcome], before: Ledger) -> bool:
    """Whether outcomes are of this run, not read from the folder."""
    return any(outcome.trial not in before.outcomes for outcome in outcomes)


def _rows(content: dict[str, Any], outcomes: Sequence[Outcome]) -> dict[str, str]:
    """The summary as the rows of a table."""

    def spread(name: str, unit: str = "") -> str:
        mean, std = content[name]["mean"], content[name]["std"]
        return "" if mean is None else f"{mean:.1f} ± {std:.1f}{unit}"

    rate, least = content["success_rate"], content["clearance"]["least"]
    rows = {
        "trials": str(content["trials"]),
        "without a pair of ends": str(content["invalid_draws"] or ""),
        "arrived": "" if rate is None else f"{content['successes']} of {content['flown']} ({100 * rate:.2f} %)",
        "collisions": str(content["collisions"]),
        "flown length": spread("flown_length", " m"),
        "planning iterations": spread("planning_iterations"),
        "plans without a path": str(content["failed_plans"]),
        "least clearance": "" if least is None else f"{least:.2f} m",
    }
    if len(outcomes) == 1:
        (one,) = outcomes
        rows |= {
            "status": one.status,
            "straight line": "" if one.distance is None else f"{one.distance:.1f} m",
            "duration": "" if one.duration is None else f"{one.duration:.1f} s",
        }
    return rows


def _watch(campaign: Campaign, ledger: Ledger) -> tuple[list[Outcome], list[Flight]]:
    """Fly the only trial of a campaign step by step; its outcome, and the flight after each planning iteration."""
    drawn = draw_trials(campaign)
    flights: list[Flight] = []
    if drawn["valid"][0]:
        flights = list(watch(world_of(campaign, drawn, 0), campaign.flight))
        logs = {name: values[None] for name, values in on_host(flights[-1].log).items()}
        outcome = outcome_of(campaign, drawn, 0, logs)
        ledger.keep_positions([outcome.trial], logs["position"])
    else:
        outcome = outcome_of(campaign, drawn, 0)
    if outcome.trial not in ledger.outcomes:
        ledger.append([outcome])
    return [outcome], flights


def _draw(campaign: Campaign, out: Path, outcomes: Sequence[Outcome], flights: list[Flight]) -> list[Path]:
    """flights.png: the flights of the first city; flight.gif: the only one. Those of an earlier run are taken away."""
    from maxjax.viz.film import Filmed, film_flight
    from maxjax.viz.flights import Flown, figure_flights
    from maxjax.viz.style import save_figure

    picture, film = out / "flights.png", out / "flight.gif"
    for old in (picture, film):
        old.unlink(missing_ok=True)
    flown = sorted((outcome for outcome in outcomes if outcome.flown), key=lambda outcome: outcome.trial)
    if not flown:
        return []
    here = [outcome for outcome in flown if outcome.city == flown[0].city]
    scene = make_scene(campaign.map, flown[0].city)
    obstacle = _obstacle(scene.geoms)
    positions = campaign.ledger(out).positions()
    shown = [outcome for outcome in here if outcome.trial in positions]
    title = f"{campaign.map}:{flown[0].city}, method {campaign.method}" + _weather(campaign)
    lines = [Flown(one.trial, positions[one.trial], np.asarray(one.goal), one.arrived) for one in shown]
    figure = figure_flights(obstacle, _CITY, lines, title=title, caption=_caption(flown, shown))
    save_figure(figure, picture)
    if not flights or len(positions[flown[0].trial]) < 2:
        return [picture]
    looks = looks_of(flights)
    where = np.concatenate([look.flown for look in looks])
    clearance = np.asarray(jax.jit(jax.vmap(distance, in_axes=(None, 0)))(scene.geoms, where))
    filmed = Filmed(looks, np.asarray(flown[0].goal), clearance, campaign.config.radius)
    content = film_flight(filmed, obstacle, _CITY, title=f"{title}, trial {flown[0].trial}: {flown[0].status}")
    atomic_write(film, content)
    return [picture, film]


def _obstacle(geoms: Geoms) -> Bool[np.ndarray, "nx ny nz"]:
    occupied, ground = occupancy(geoms, _CITY)
    return np.asarray(occupied & ~ground)


def _weather(campaign: Campaign) -> str:
    strengths = [f"{name.replace('_', ' ')} {value:g}" for name, value in campaign.strengths.items() if value]
    return "".join(f", {strength}" for strength in strengths)


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
    """What a flight knew in each planning period, and where it was then, from its states before and after each."""
    looks = []
    before = 0
    for flight in flights[1:]:
        position = np.asarray(flight.log.position)
        there = int(np.isfinite(position).all(axis=1).sum())
        rolling_map = flight.rolling_map
        solid = np.asarray(mapping.occupied(rolling_map) & ~mapping.ground(rolling_map))
        corner = rolling_map.spacing * (np.asarray(rolling_map.corner, np.float64) - 0.5)
        path = np.asarray(flight.path)
        moves = np.nonzero(np.any(np.diff(path, axis=0), axis=1))[0]
        points = np.asarray(flight.scan.points)
        looks.append(
            Look(
                scan=points[np.asarray(flight.scan.hit)],
                known=np.asarray(solid.any(axis=2)),
                lower=(float(corner[0]), float(corner[1])),
                spacing=rolling_map.spacing,
                path=path[: moves[-1] + 2 if len(moves) else 1],
                flown=position[before:there],
            )
        )
        before = there
    return looks
