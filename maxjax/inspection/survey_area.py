"""From an area to missions that photograph it from above: lines, heights, runs, certified legs, a verdict on the whole.

    area → lines (lawn-mower) → heights → free runs → flights → a mission each, planned and verified → photos, coverage

Photos are triggered by the distance flown; what they show is counted where the missions lead.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64

from maxjax.compile.forked import refuse_after_fork
from maxjax.compile.stage_timer import recording, sum_reports, time_stage
from maxjax.core.grid import Point3
from maxjax.core.voxel_map import VoxelMap, check_single_map
from maxjax.inspection.free_space import FreeSpace
from maxjax.inspection.height_profile import Below
from maxjax.inspection.inspect_target import DISTANCES, ONE, check_distance, scenery_of
from maxjax.inspection.inspection import Inspection
from maxjax.inspection.leg_costs import TimeCost, costs_between
from maxjax.inspection.mission_photos import photos_of
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.scenery import Scenery
from maxjax.inspection.seen_area import Coverage, unseen_parts
from maxjax.inspection.sharing import Round, Sharing, cut_order
from maxjax.inspection.survey_runs import Lost, Run, runs_of
from maxjax.inspection.sweep import Sweep
from maxjax.inspection.sweep_lines import Line, Rows, beside, lawn_mower
from maxjax.inspection.target_surface import Surface, area_surface
from maxjax.inspection.targets import check_line, check_outline
from maxjax.inspection.vehicles import Vehicles, check_homes, choose_home
from maxjax.inspection.views import Views
from maxjax.inspection.visibility import find_sights
from maxjax.planners import Field
from maxjax.planning.mission import Mission, plan_mission
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.waypoint import Waypoint, legs_of
from maxjax.trajectories.limits import FlightLimits

_POINTS = 24.0  # of the surface, across the smaller side of a photo
_BESIDE = 3.0  # times their distance, up to which points that no photo shows are one part

SWEEP = Sweep()


def survey(
    city: VoxelMap,
    area: Any,
    camera: Camera | str,
    *,
    sweep: Sweep = SWEEP,
    vehicles: Vehicles = ONE,
    distances: Distances = DISTANCES,
) -> Inspection:
    """Photograph an area from above, line by line, at a distance above its ground or its roofs.

    Lines are as far apart as the overlap sideways asks for, photos on them as the overlap forward does, and no faster
    than the shutter. What stands in the way is flown around by certified legs; photos lost there are named.

    Args:
        city: one map that tells its ground.
        area: corners of an outline (n, 2); with `Sweep.width` those of the line that a corridor follows [m].
        camera: that takes the photos, or its name in the table.
        sweep: how far above what, with how much overlap, which way.
        vehicles: who flies.
        distances: radius, margin and price; legs of the lines have no price.

    Returns:
        An `Inspection` of the roofs and the ground of the area.

    Raises:
        ValueError: if the map is none or a batch, or tells no ground; if the outline crosses itself or is none; if
            nothing above it may be flown to; if a home is not free, or a line takes more than a flight may cost.
    """
    refuse_after_fork()
    where, camera = check_single_map(city).on_host(), Camera.named(camera) if isinstance(camera, str) else camera
    distances = distances.within(where.grid)
    check_distance(sweep, distances.radius)
    with recording() as recorder:
        with time_stage("surface"):
            outline, lines = _lines(area, camera, sweep)
            faces, scenery = scenery_of(where)
            surface = area_surface(where, faces, scenery, outline, min(camera.footprint(sweep.distance)) / _POINTS)
        with time_stage("lines"):
            free = FreeSpace.of(where, distances.radius, np.array(vehicles.homes[0]) if vehicles.homes else None)
            runs, lost = _runs(where, lines, free, sweep, camera)
        homes = vehicles.homes or (choose_home(where, free, np.concatenate([run.points for run in runs]), 0.0),)
        with time_stage("order"):
            rounds = _rounds(runs, free, homes, vehicles, _speed(sweep, camera))
        missions = [_mission(where, runs, one, homes, (sweep, camera, distances)) for one in rounds]
        with time_stage("coverage"):
            taken, flight = _photos(missions)
            coverage = _shown(taken, surface, scenery, camera, sweep)
    return Inspection(
        photos=taken,
        flight=flight,
        coverage=coverage,
        missions=tuple(missions),
        vehicles=tuple(one.vehicle for one in rounds),
        camera=camera,
        capture=sweep,
        tried=len(taken),
        remarks=(*map(str, lost), *map(str, coverage.unseen)),
        timings=functools.reduce(sum_reports, (mission.timings for mission in missions), recorder.report()),
        scenery=scenery,
    )


def _photos(missions: list[Mission]) -> tuple[Views, Int64[np.ndarray, " n"]]:
    """The photos of some missions, and of each the number of its mission."""
    photos = [photos_of(mission) for mission in missions]
    return functools.reduce(Views.joined, photos), np.repeat(np.arange(len(photos)), [len(some) for some in photos])


def _shown(taken: Views, surface: Surface, scenery: Scenery, camera: Camera, sweep: Sweep) -> Coverage:
    """What some photos show, and the parts of the surface that none of them does."""
    limits = sweep.limits(camera)
    sights = find_sights(taken, surface, scenery, camera, limits)
    unseen = np.flatnonzero(np.bincount(sights.point, minlength=len(surface)) == 0)
    apart = _BESIDE * min(camera.footprint(sweep.distance)) / _POINTS
    parts = unseen_parts(surface, unseen, ["missed"] * len(unseen), apart)
    return Coverage.of(surface, sights, sweep.views, limits.resolution, parts)


def _speed(sweep: Sweep, camera: Camera) -> float:
    """On lines: no faster than the shutter [m/s]."""
    return min(sweep.speed, camera.fastest(sweep.every(camera)))


def _lines(area: Any, camera: Camera, sweep: Sweep) -> tuple[Float64[np.ndarray, "k 2"], list[Line]]:
    """The outline of an area, and the lines of its survey."""
    step = sweep.apart(camera)
    if sweep.width is not None:
        line = check_line("area", area)
        left, right = beside(line, 2.0 * sweep.width, sweep.width)
        return np.concatenate([left, right]), beside(line, sweep.width, step)
    outline = check_outline("area", area)
    rows = Rows(step, sweep.beyond)
    lines = lawn_mower(outline, rows, sweep.heading, outline[0])
    if sweep.cross:
        first = lines[0][1] - lines[0][0]
        across = math.degrees(math.atan2(first[0], first[1])) + 90.0
        lines += lawn_mower(outline, rows, across, lines[-1][-1])
    return outline, lines


def _runs(
    where: VoxelMap, lines: list[Line], free: FreeSpace, sweep: Sweep, camera: Camera
) -> tuple[list[Run], list[Lost]]:
    """What is flown of some lines, and the photos that are lost; raises a ValueError where nothing is."""
    runs, lost = runs_of(lines, Below.of(where, sweep.above, free.radius), free, sweep, sweep.every(camera))
    if not runs:
        raise ValueError(f"area: expected air to fly in above it, found none: {lost[0]}")
    return runs, lost


def _rounds(
    runs: list[Run], free: FreeSpace, homes: tuple[Point3, ...], vehicles: Vehicles, speed: float
) -> tuple[Round, ...]:
    """Flights that fly the runs in their order."""
    at, count = check_homes(homes, free), len(runs)
    cost = TimeCost(FlightLimits(speed=speed)) if vehicles.cost is None else vehicles.cost
    ends = np.concatenate([at, *(run.points[[0, -1]] for run in runs)])
    between = costs_between(ends, free, vehicles.leg_cost(0.0))
    begin, end = len(at) + 2 * np.arange(count), len(at) + 2 * np.arange(count) + 1
    own = np.array([float(cost(run.points[:-1], run.points[1:]).sum()) for run in runs])
    # What a run takes belongs to the way to it.
    table = np.zeros((len(at) + count,) * 2)
    table[len(at) :, len(at) :] = between[np.ix_(end, begin)] + own
    table[: len(at), len(at) :] = between[np.ix_(np.arange(len(at)), begin)] + own
    table[len(at) :, : len(at)] = between[np.ix_(end, np.arange(len(at)))]
    return cut_order(Sharing(table, len(at), vehicles.home_of, vehicles.most), range(count))


def _mission(
    where: VoxelMap, runs: list[Run], one: Round, homes: tuple[Point3, ...], how: tuple[Sweep, Camera, Distances]
) -> Mission:
    """The mission of a flight: from home along each of its runs, and back home."""
    home, (sweep, camera, distances) = homes[one.home], how
    every, speed = sweep.every(camera), _speed(sweep, camera)
    along = [waypoint for k in one.places for waypoint in runs[k].waypoints(sweep, every, speed, distances.radius)]
    waypoints = [Waypoint(home), *along, Waypoint(home)]
    return plan_mission(Task.of(where, *legs_of(waypoints), distances), waypoints, Field())
