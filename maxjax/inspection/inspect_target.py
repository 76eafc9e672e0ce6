"""From a target to missions that photograph it: surface, viewpoints, rounds, certified legs, a verdict on the whole.

city, target → surface → viewpoints → costs → rounds → a mission each, planned and verified → Inspection
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np

from maxjax.compile.forked import refuse_after_fork
from maxjax.compile.stage_timer import recording, sum_reports, time_stage
from maxjax.core.grid import Point3
from maxjax.core.voxel_map import VoxelMap, check_single_map
from maxjax.inspection.candidates import Aim
from maxjax.inspection.capture import Capture
from maxjax.inspection.free_space import FreeSpace
from maxjax.inspection.inspection import Inspection
from maxjax.inspection.leg_costs import costs_between
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.scenery import Scenery
from maxjax.inspection.sharing import Round, Sharing, share_places
from maxjax.inspection.target_surface import city_faces, surface_of
from maxjax.inspection.targets import Target
from maxjax.inspection.vehicles import Vehicles, check_homes, choose_home
from maxjax.inspection.viewpoints import find_viewpoints
from maxjax.inspection.views import Views
from maxjax.io.kinds.faces import Faces
from maxjax.io.load import LoadedMap
from maxjax.planners import Field
from maxjax.planning.look import Look
from maxjax.planning.mission import Mission, plan_mission
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.waypoint import Waypoint, legs_of

REST = 2.0
"""How long a vehicle rests for a photo [s]: PX4 comes to rest at a waypoint that it holds for so long."""
_POINTS = 8.0  # of the surface, across the smaller side of a photo

CAPTURE, ONE, DISTANCES = Capture(), Vehicles(), Distances()


def inspect(
    city: VoxelMap,
    target: Target,
    camera: Camera | str,
    *,
    capture: Capture = CAPTURE,
    vehicles: Vehicles = ONE,
    distances: Distances = DISTANCES,
) -> Inspection:
    """Photograph façades and roofs: find viewpoints, put them in order, plan and verify the flights.

    Viewpoints keep the radius, lie in air that is joined to the homes, and are as few as show each point as often as
    the overlap asks for. What cannot be seen from anywhere that may be flown to is named with its area.

    Args:
        city: one map. Of a file with faces, the surface is that of its faces; else it is that of the voxels.
        target: a building's name or several; a place (x, y); an outline (n, 2); or a box (2, 3) [m].
        camera: that takes the photos, or its name in the table.
        capture: what the photos are to be like.
        vehicles: who flies.
        distances: radius, margin and price of the legs; the margin is at most half the distance of the photos.

    Returns:
        An `Inspection`. Its status is OK only if each flight was verified as a whole.

    Raises:
        ValueError: if the map is none or a batch, there is no such building, nothing of the target can be seen from
            where may be flown, the distance is not more than the radius, a home is not free, or a viewpoint takes more
            than a flight may cost.
    """
    refuse_after_fork()
    where, camera = check_single_map(city).on_host(), Camera.named(camera) if isinstance(camera, str) else camera
    margin = max(distances.radius, min(distances.margin, 0.5 * capture.distance))
    distances = dataclasses.replace(distances, margin=margin).within(where.grid)
    check_distance(capture, distances.radius)
    with recording() as recorder:
        with time_stage("surface"):
            faces, scenery = scenery_of(where)
            surface = surface_of(where, faces, scenery, target, min(camera.footprint(capture.distance)) / _POINTS)
        with time_stage("viewpoints"):
            free = FreeSpace.of(where, distances.radius, np.array(vehicles.homes[0]) if vehicles.homes else None)
            found = find_viewpoints(Aim(surface, free, camera, capture), scenery)
        homes = vehicles.homes or (choose_home(where, free, surface.points, capture.distance),)
        with time_stage("order"):
            rounds = order_views(found.views, free, homes, vehicles)
        missions = [plan_round(where, found.views, one, homes, distances) for one in rounds]
    return Inspection(
        photos=found.views.some(np.array([k for one in rounds for k in one.places], np.int64)),
        flight=np.repeat(np.arange(len(rounds)), [len(one.places) for one in rounds]),
        coverage=found.coverage,
        missions=tuple(missions),
        vehicles=tuple(one.vehicle for one in rounds),
        camera=camera,
        capture=capture,
        tried=found.tried,
        least=found.least,
        remarks=tuple(str(part) for part in found.coverage.unseen),
        timings=functools.reduce(sum_reports, (mission.timings for mission in missions), recorder.report()),
        scenery=scenery,
    )


def check_distance(capture: Capture, radius: float) -> None:
    """Raises a ValueError for photos that are to be taken from nearer than a vehicle may be [m]."""
    if capture.distance <= radius:
        raise ValueError(
            f"distance: expected more than the radius that a vehicle keeps, {radius:g} m, given {capture.distance:g} m"
        )


def order_views(
    views: Views, free: FreeSpace, homes: Sequence[Point3], vehicles: Vehicles, stay: float = REST
) -> tuple[Round, ...]:
    """Rounds through the places of some views, shared among vehicles.

    Raises:
        ValueError: as `share_places`; for a home that is not free.
    """
    at = check_homes(homes, free)
    costs = costs_between(np.concatenate([at, views.position]), free, vehicles.leg_cost(stay))
    return share_places(Sharing(costs, len(homes), vehicles.home_of, vehicles.most))


def plan_round(where: VoxelMap, views: Views, one: Round, homes: Sequence[Point3], distances: Distances) -> Mission:
    """The mission of a round: from home to each place, where it rests for a photo, and back home."""
    home, places = homes[one.home], list(one.places)
    waypoints = [
        Waypoint(home),
        *(
            Waypoint((x, y, z), hover=REST, heading=(90.0 - math.degrees(yaw)) % 360.0, look=Look(pitch, photo=True))
            for (x, y, z), yaw, pitch in zip(
                views.position[places].tolist(), views.yaw[places].tolist(), views.pitch[places].tolist(), strict=True
            )
        ),
        Waypoint(home),
    ]
    return plan_mission(Task.of(where, *legs_of(waypoints), distances), waypoints, Field())


def scenery_of(where: VoxelMap) -> tuple[Faces, Scenery]:
    """Faces of a city, and what hides: its faces, of a map without any the boxes of its voxels."""
    faces = city_faces(where)
    by_voxels = not (isinstance(where, LoadedMap) and where.file.contents is not None)
    return faces, Scenery.of(where, faces, by_voxels=by_voxels)
