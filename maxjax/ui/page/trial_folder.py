"""A folder of flights as a page shows it: its trials, their lines, and all that one of them saw and planned.

trials.jsonl, positions/   what every flight left                        (`sim.trials.ledger`)
flown again                scan, map, plan, reference by period (`sim.loop.flight.watch`), up to rounding the same
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.sim.loop.flight import Flight
from maxjax.sim.loop.flight_state import LOG_PERIOD
from maxjax.sim.mapping import rolling_map
from maxjax.sim.movers.among import Among
from maxjax.sim.movers.moments import moments_of
from maxjax.sim.trials.cities import Where
from maxjax.sim.trials.given_city import GivenCity
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import Outcome
from maxjax.sim.worlds.movers import Movers
from maxjax.sim.worlds.scenes import make_scene
from maxjax.trajectories.online import setpoint_at
from maxjax.ui.figures.drawable import drawable
from maxjax.ui.page.camera import hiding, over_way
from maxjax.ui.page.colors import FAILED, FLOWN, KNOWN, PLANNED, REFERENCE, RETURN
from maxjax.ui.page.draw import THROUGH, city_scene, ends_scene, plain_line, together
from maxjax.ui.page.mover_playback import knowledge_cues, moving_cues
from maxjax.ui.page.nodes import Dots, Frame, Node, Scene, point3
from maxjax.ui.page.page_map import City
from maxjax.ui.page.surface import surface
from maxjax.ui.page.timeline import Cue, Film, trail_cues

# The cities of all maps, above their ground.
_GRID = Grid((150, 150, 67), 2.0, (-149.0, -149.0, 1.0))
_POINTS, _LOW = 4000, 0.5  # of a scan that are shown; the ground, whose returns lie thick below it, ends there [m]
_LINE, _PLAN = 5.0, 4.0  # widths [px]
_REFERENCE = np.arange(0.0, 3.0, 0.1)  # times of the reference that are shown [s]


def open_folder(folder: Path) -> tuple[str, Ledger]:
    """The map's name and the ledger of a folder that `maxjax fly --out` has written, or still writes.

    Nothing in it is changed; a last line that is not whole yet is left out.

    Raises:
        ValueError: where it is none, or is damaged.
    """
    ledger = Ledger.read(folder)
    if not ledger.outcomes:
        raise ValueError(f"{folder}: expected at least one trial, given none yet")
    return str(ledger.configuration["map"]), ledger


@functools.lru_cache(maxsize=4)
def city_of(where: Where, seed: int) -> City:
    """The true city of a trial; its ground is the plane z = 0, and what is higher of a given one's."""
    if isinstance(where, GivenCity):
        return City(where.name, drawable(where.world.above_plane)[0])
    return City(f"{where}:{seed}", make_scene(where, seed).voxels(_GRID))


def headline(outcome: Outcome) -> str:
    """A trial in one line of a list."""
    if not outcome.flown:
        return f"{outcome.trial}: not flown"
    return f"{outcome.trial}: {outcome.status}, {outcome.flown_length:.0f} m"


def trial_in_words(outcome: Outcome) -> str:
    """A trial in words, Markdown."""
    if not outcome.flown:
        return f"### Trial {outcome.trial}: not flown\nNo pair of ends was found in city {outcome.city}."
    status = Status[outcome.status]
    head = "arrived" if status == Status.OK else outcome.status
    rows = [f"### Trial {outcome.trial}: {head}"]
    if status != Status.OK:
        rows.append(status.advice)
    rows.append(
        f"**{outcome.flown_length:.1f} m** flown for {outcome.distance:.1f} m in {outcome.duration:.1f} s, "
        f"**{outcome.clearance:.1f} m** clear at the least; {outcome.planning_iterations} plans, "
        f"{outcome.failed_plans} without a path."
    )
    return "\n\n".join(rows)


def film_of(
    outcome: Outcome,
    line: Float[np.ndarray, "t 3"],
    city: City,
    flights: Sequence[Flight] = (),
    movers: Movers | None = None,
) -> Film:
    """A trial as a film.

    Args:
        outcome: of a trial that was flown.
        line: positions every 0.1 s [m].
        city: of the trial.
        flights: from flying it again, before its first period and after each; empty: its line is all there is.
        movers: in the city besides.
    """
    frame = city.frame
    if flights:
        line = _positions(flights[-1])
    arrived = outcome.status == Status.OK.name
    shown: dict[str, Node] = {"/flown/line": plain_line(frame.page(line), FLOWN if arrived else FAILED, _LINE)}
    ends = ends_scene((point3(np.asarray(outcome.start)), point3(np.asarray(outcome.goal))), frame)
    times = np.minimum(LOG_PERIOD * np.arange(len(line)), outcome.duration or np.inf)
    moving = () if movers is None else moving_cues(movers, times, frame)
    known = knowledge_cues(moments, times, frame) if (moments := moments_of(flights)) else ()
    way = frame.page(line)
    between = hiding(city, over_way(city, way)[0], way)
    cues = [*_cues(flights, frame), *moving, *known, *trail_cues(times, way)]
    return Film(
        together(city_scene(city, THROUGH if flights else 1.0, between), ends, shown),
        tuple(sorted(cues, key=lambda cue: cue.time)),
        times,
        way,
    )


def _positions(flight: Flight) -> Float[np.ndarray, "t 3"]:
    position = np.asarray(flight.log.position, np.float64)
    kept: Float[np.ndarray, "t 3"] = position[np.isfinite(position).all(axis=1)]
    return kept


def _cues(flights: Sequence[Flight], frame: Frame) -> tuple[Cue, ...]:
    """Scan, map and plan of the vehicle, from the beginning of each period on."""
    cues, before = [], 0
    for flight in flights[1:]:
        cues.append(Cue(LOG_PERIOD * before, "/period", _period(flight, frame)))
        before = len(_positions(flight)) - 1
    return tuple(cues)


def _period(flight: Flight, frame: Frame) -> Scene:
    scene: dict[str, Node] = {}
    points = np.asarray(flight.scan.points, np.float64)[np.asarray(flight.scan.hit)]
    points = points[points[:, 2] > _LOW]
    if len(points):
        some = points[:: -(-len(points) // _POINTS)]
        scene["/period/scan"] = Dots(frame.page(some), RETURN, 0.35)
    known = flight.rolling_map
    volume = np.asarray(rolling_map.occupied_voxels(known) & ~rolling_map.ground(known))
    if volume.any():
        corner = known.spacing * np.asarray(known.corner, np.float64)
        grid = Grid((volume.shape[0], volume.shape[1], volume.shape[2]), known.spacing, point3(corner))
        scene["/period/known"] = surface(volume, grid, frame, KNOWN, 0.35)
    path = np.asarray(flight.path, np.float64)
    moves = np.flatnonzero(np.any(np.diff(path, axis=0), axis=1))
    if len(moves):
        scene["/period/plan"] = plain_line(frame.page(path[: moves[-1] + 2]), PLANNED, _PLAN)
    if flight.has(Among):  # then the motion is flown, and the reference only says where the way leads
        return scene
    reference = np.stack([np.asarray(setpoint_at(flight.reference, jnp.float32(t)).position) for t in _REFERENCE])
    if np.isfinite(reference).all() and np.ptp(reference, axis=0).max() > 0.1:
        scene["/period/reference"] = plain_line(frame.page(reference), REFERENCE, _PLAN)
    return scene
