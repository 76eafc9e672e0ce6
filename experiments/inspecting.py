"""Photographs of buildings and areas beside the patterns of QGroundControl and a greedy choice, judged alike.

    MAXJAX_DATA=... python -m experiments.inspecting --seed N --record

On two cores, ten buildings a city take half an hour; a run that was ended goes on with the same command.

Buildings drawn at random of five cities (those of `experiments.covering`) are photographed from 8 m with 0.7 and 0.6 of
overlap, six photos of each point, by

    maxjax             `maxjax.inspect`
    greedy             the same candidates, legs and rounds; of the candidates always the one that shows most
    structure scan     QGroundControl's (`experiments.qgc_patterns`), around the outline of the building in plan

and the surroundings of one building of each city from 50 m above the ground, by `maxjax.survey` and by QGroundControl's
survey. All begin and end at the home that maxjax chooses.

Judged alike: the share of the surface that some photo shows, and six do, as maxjax counts it and by C MuJoCo's rays
and a projection of its own (`experiments.photo_judge`); mean angle between lines of sight and normals; flown length;
time from rest to rest at each corner, with two seconds at a photo that is taken at rest; least true distance to the
faces of the city, ground left out; straight legs that pass through a face; whether `maxjax.verify` passes the flight
with the radius. Photos count as if nothing had been hit on the way to them. Simulated cities are known by their voxels,
whose sides are their faces; the true solids lie within these.

Expected: maxjax keeps the radius everywhere and sees all that can be seen; a structure scan sees no roof, and passes
through what stands beside the building.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, begun, keep, package, save
from benchmarks.common.mesh_rays import MeshRays
from experiments import covering
from experiments.inspecting_table import section
from experiments.photo_judge import count_hits, count_photos, find_clearance
from experiments.qgc_patterns import Pattern, scan_structure, survey_polygon
from maxjax.core.grid import Point3
from maxjax.inspection.candidates import Aim
from maxjax.inspection.capture import Capture
from maxjax.inspection.free_space import FreeSpace
from maxjax.inspection.inspect_target import REST, order_views, plan_round
from maxjax.inspection.leg_costs import TimeCost
from maxjax.inspection.mission_photos import photos_of
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.scenery import Scenery
from maxjax.inspection.seen_area import Coverage
from maxjax.inspection.set_cover import choose_photos
from maxjax.inspection.sweep import Sweep
from maxjax.inspection.target_surface import Surface, city_faces
from maxjax.inspection.targets import Target, choose
from maxjax.inspection.vehicles import Vehicles
from maxjax.inspection.viewpoints import find_candidates
from maxjax.inspection.views import Views
from maxjax.inspection.visibility import find_sights
from maxjax.io.kinds.faces import Faces
from maxjax.sim.worlds.scenes import make_scene, occupancy
from maxjax.trajectories.limits import PX4_MISSION
from maxjax.verification.verifier import verify

__all__ = ["TINY", "Config", "main", "section"]

RESULTS = Path(__file__).parent / "results"
_AROUND = 60.0  # of a map, within which faces hide and are kept clear of [m]
_EARTH = maxjax.TangentPlane(47.0, 8.0, 400.0)  # of maps that lie nowhere
_TAKE_PHOTO = 2000  # MAV_CMD_IMAGE_START_CAPTURE
# Formats that hold photos.
_FILES = {
    ".plan": maxjax.Autopilot.px4(),
    ".waypoints": maxjax.Autopilot.arducopter(),
    ".kmz": None,
    "_litchi.csv": None,
}
_STEP = 32.0  # of the extents of maps [m]
_SIMPLE = 1.0  # by which an outline that a user draws may leave the footprint [m]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        cities: as those of `experiments.covering`.
        targets: buildings of each.
        files: of so many of them each format is written and read back.
        distance: of photos from the surface [m].
        overlap: of photos, forward and sideways.
        above: of a survey, above the ground [m].
        side: of its area [m]; 0: no survey.
        radius: to keep [m].
        camera: by its name.
        seed: of the buildings, and of simulated cities.
        data: folder of public cities.
        out: where the JSON goes.
    """

    cities: tuple[str, ...] = ("downtown", "suburb", "sample", "The Hague", "Venice")
    targets: int = 10
    files: int = 1
    distance: float = 8.0
    overlap: tuple[float, float] = (0.7, 0.6)
    above: float = 50.0
    side: float = 80.0
    radius: float = 1.5
    camera: str = "DJI M3E"
    seed: int = 0
    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    out: Path = RESULTS

    @property
    def capture(self) -> Capture:
        """Of buildings."""
        return Capture(self.distance, self.overlap)

    @property
    def buildings(self) -> covering.Config:
        """How they are drawn."""
        return covering.Config(self.cities, self.targets, step=_STEP, seed=self.seed, data=self.data)

    @property
    def distances(self) -> maxjax.Distances:
        """Of flights around buildings."""
        return maxjax.Distances(self.radius, 0.5 * self.distance)


TINY = Config(cities=("sample",), targets=1, overlap=(0.3, 0.3), side=30.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Subject:
    """What is photographed, and what stands around it."""

    where: maxjax.VoxelMap
    surface: Surface
    scenery: Scenery
    home: Point3
    camera: Camera
    capture: Capture
    radius: float

    @functools.cached_property
    def faces(self) -> Faces:
        """Of the city."""
        return city_faces(self.where)

    @functools.cached_property
    def near(self) -> Float64[np.ndarray, "n 3 3"]:
        """Triangles of what stands in the map, or not far from it [m]."""
        return _near(self.faces.triangles, self.where)

    @functools.cached_property
    def rays(self) -> MeshRays:
        """Of what stands and of the ground."""
        return MeshRays(np.concatenate([self.near, _near(self.faces.terrain, self.where)]))

    @classmethod
    def of(cls, found: maxjax.Inspection, radius: float) -> Subject:
        """That of an inspection or a survey."""
        mission = found.missions[0]
        home, surface = mission.waypoints[0].position, found.coverage.surface
        return cls(mission.map, surface, found.scenery, home, found.camera, found.capture, radius)


def _near(triangles: Float64[np.ndarray, "n 3 3"], where: maxjax.VoxelMap) -> Float64[np.ndarray, "k 3 3"]:
    low, high = np.array(where.grid.lower) - _AROUND, np.array(where.grid.upper) + _AROUND
    found: Float64[np.ndarray, "k 3 3"] = triangles[
        ((triangles.max(axis=1) >= low) & (triangles.min(axis=1) <= high)).all(axis=1)
    ]
    return found


def judge(subject: Subject, path: Float64[np.ndarray, "t 3"], photos: Views, seconds: float) -> dict[str, Any]:
    """What a flight comes to.

    Args:
        subject: that is photographed.
        path: as flown [m].
        photos: that are taken.
        seconds: that it takes.
    """
    surface, camera, capture = subject.surface, subject.camera, subject.capture
    limits = capture.limits(camera)
    sights = find_sights(photos, surface, subject.scenery, camera, limits)
    coverage = Coverage.of(surface, sights, capture.views, limits.resolution)
    counts = count_photos(photos, surface, subject.rays, camera, capture)
    other = dataclasses.replace(coverage, counts=counts)
    walls, areas = ~surface.roof, surface.areas
    weight = areas[sights.point]
    return {
        "photos": len(photos),
        "length_m": round(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()), 1),
        "seconds": round(seconds, 1),
        "area_m2": round(surface.area, 1),
        "share": round(coverage.share(), 4),
        "share_wanted": round(coverage.share(capture.views), 4),
        "share_walls": round(float(areas[walls & (coverage.counts > 0)].sum() / max(areas[walls].sum(), 1e-9)), 4),
        "share_rays": round(other.share(), 4),
        "share_wanted_rays": round(other.share(capture.views), 4),
        "incidence_deg": round(float(weight @ sights.incidence / max(weight.sum(), 1e-9)), 2),
        "clearance_m": round(find_clearance(path, subject.near), 3),
        "legs_hit": count_hits(path, subject.rays),
        "verified": bool(verify(path, subject.where, radius=subject.radius).ok),
    }


def flight_time(path: Float64[np.ndarray, "t 3"], speed: float, photos_at_rest: int = 0) -> float:
    """Seconds along a path from rest to rest at each corner, and at photos."""
    cost = TimeCost(dataclasses.replace(PX4_MISSION, speed=speed))
    return float(cost(path[:-1], path[1:]).sum()) + REST * photos_at_rest


def building(number: int, where: maxjax.VoxelMap, target: Target, config: Config) -> Iterator[dict[str, Any]]:
    """A row for each way to photograph a building, by its number in the city."""
    capture = config.capture
    begin = time.perf_counter()
    found = maxjax.inspect(where, target, config.camera, capture=capture, distances=config.distances)
    took = time.perf_counter() - begin
    subject = Subject.of(found, config.radius)
    files = _of_files(found) if number < config.files else {}
    yield {"way": "maxjax", "least": found.least, **_of_mission(subject, found.mission, took), **files}
    begin = time.perf_counter()
    free = FreeSpace.of(where, config.radius)
    aim = Aim(subject.surface, free, subject.camera, capture)
    views, sights = find_candidates(aim, subject.scenery)
    chosen = choose_photos(sights.matrix, subject.surface.points, subject.surface.areas, capture.views, seconds=0.0)
    views = views.some(chosen.photos)
    (one,) = order_views(views, free, (subject.home,), Vehicles())
    mission = plan_round(subject.where, views, one, (subject.home,), config.distances)
    yield {"way": "greedy", **_of_mission(subject, mission, time.perf_counter() - begin)}
    outline, heights = _structure(subject, target)
    pattern = scan_structure(outline, heights, subject.home, subject.camera, capture)
    yield {"way": "structure scan", **_of_pattern(subject, pattern)}


def area(where: maxjax.VoxelMap, middle: tuple[float, float], config: Config) -> Iterator[dict[str, Any]]:
    """A row for each way to photograph an area from above."""
    outline, sweep = _square(middle, 0.5 * config.side), Sweep(config.above, beyond=0.25 * config.side)
    begin = time.perf_counter()
    distances = maxjax.Distances(config.radius)
    found = maxjax.survey(where, outline, config.camera, sweep=sweep, distances=distances)
    subject = Subject.of(found, config.radius)
    took = time.perf_counter() - begin
    yield {"way": "maxjax", **_of_mission(subject, found.mission, took), **_of_files(found)}
    ground = where.terrain.at(*subject.home[:2])
    wide = _square(middle, 0.5 * config.side + sweep.beyond)
    yield {"way": "survey", **_of_pattern(subject, survey_polygon(wide, ground, subject.home, subject.camera, sweep))}


def _square(middle: tuple[float, float], half: float) -> Float64[np.ndarray, "4 2"]:
    return np.array(middle) + half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def _of_mission(subject: Subject, mission: maxjax.Mission, took: float) -> dict[str, Any]:
    """A row of a mission that was planned in so many seconds."""
    if mission.status != maxjax.Status.OK:
        return {"status": mission.status.name, "plan_s": round(took, 2)}
    looks = [waypoint.look for waypoint in mission.waypoints if waypoint.look is not None]
    speeds = [waypoint.speed for waypoint in mission.waypoints if waypoint.speed is not None]
    seconds = flight_time(mission.path, min([PX4_MISSION.speed, *speeds]), sum(look.photo for look in looks))
    return {"status": "OK", "plan_s": round(took, 2), **judge(subject, mission.path, photos_of(mission), seconds)}


def _of_pattern(subject: Subject, pattern: Pattern) -> dict[str, Any]:
    """A row of a pattern."""
    seconds = flight_time(pattern.path, min(PX4_MISSION.speed, pattern.speed))
    return {"status": "OK", "plan_s": None, **judge(subject, pattern.path, pattern.photos, seconds)}


def _of_files(found: maxjax.Inspection) -> dict[str, Any]:
    """Photos and share of the surface of what the files of each format make a vehicle fly, or why there is none."""
    row = dict[str, Any]()
    where = found.mission.map
    # Simulated cities stand on level ground; voxels tell it to a voxel.
    earth, ground = (where.earth or _EARTH, None) if isinstance(where, maxjax.LoadedMap) else (_EARTH, 0.0)
    with tempfile.TemporaryDirectory() as folder:
        for ending, autopilot in _FILES.items() if found.status == maxjax.Status.OK else ():
            file = Path(folder) / f"flight{ending}"
            try:
                flown = maxjax.export_inspection(file, found, earth=earth, ground=ground, autopilot=autopilot)
            except ValueError as error:
                row |= {f"refused{ending}": str(error).removeprefix(f"{file}: ")[:120]}
                continue
            share = None if flown.coverage is None else round(flown.coverage.share(), 4)
            row |= {f"photos{ending}": len(flown.photos), f"share{ending}": share}
            if ending == ".waypoints":
                row |= {"photos_by_pymavlink": _read_back(file)}
    return row


def _read_back(file: Path) -> int | None:
    """Photos at waypoints that pymavlink finds in a file; None where it is not installed."""
    mavwp: Any = package("pymavlink.mavwp")
    if mavwp is None:
        return None
    loader = mavwp.MAVWPLoader()
    loader.load(str(file))
    return sum(bool(loader.wp(k).command == _TAKE_PHOTO) for k in range(loader.count()))


def _structure(subject: Subject, target: Target) -> tuple[Float64[np.ndarray, "k 2"], Point3]:
    """What a user draws around a building; heights of the ground, and of what of it is to be seen [m]."""
    import shapely

    chosen, surface = choose(subject.faces, target), subject.surface.points
    plan = shapely.union_all(shapely.buffer(shapely.polygons(subject.faces.triangles[chosen.faces][:, :, :2]), 0.0))
    low, high = surface.min(axis=0), surface.max(axis=0)
    plan = plan.intersection(shapely.box(*(low[:2] - _SIMPLE), *(high[:2] + _SIMPLE)))
    plan = plan.buffer(_SIMPLE, join_style="mitre").buffer(-_SIMPLE, join_style="mitre").simplify(_SIMPLE)
    whole = plan if plan.geom_type == "Polygon" else plan.convex_hull
    ground = subject.where.terrain.at(*subject.home[:2])
    return np.asarray(whole.exterior.coords)[:-1], (ground, float(low[2]), float(high[2]))


def area_map(name: str, config: Config) -> tuple[maxjax.VoxelMap, tuple[float, float]] | None:
    """A map with room for a survey, and the middle of its area: that of the first building; None without its data."""
    if name in ("downtown", "suburb"):
        scene = make_scene(name, config.seed)
        grid = maxjax.Grid.centered((0.0, 0.0, 40.0), (91, 91, 61), 2.0)
        return maxjax.VoxelMap.on(grid, *map(np.asarray, occupancy(scene.geoms, grid))), (0.0, 0.0)
    first = next(covering.maps(name, config.buildings), None)
    if first is None:
        return None
    (path,), (where, target) = covering.city_files(name, config.data), first
    faces = city_faces(where)
    x, y, _ = faces.triangles[choose(faces, target).faces].reshape(-1, 3).mean(axis=0).tolist()
    reach, low = 0.5 * config.side + _AROUND, where.grid.lower[2]
    bounds = (x - reach, y - reach, low, x + reach, y + reach, low + config.above + 20.0)
    reading = maxjax.Reading(crs=covering.SYSTEMS.get(name))
    return maxjax.load_map(path, spacing=2.0, bounds=bounds, reading=reading), (x, y)


def main(config: Config) -> list[Row]:
    """Photograph, judge, save, and return the rows; a run that was ended goes on."""
    rows = begun("inspecting", config, config.out)
    done = {(row["city"], row["target"]) for row in rows}

    def add(city: str, target: int | None, name: str, ways: Callable[[], Iterator[dict[str, Any]]]) -> None:
        if (city, target) in done:
            return
        own = {"city": city, "target": target, "building": name[:60]}
        try:
            rows.extend({**own, **row} for row in ways())
        except ValueError as error:
            rows.append({**own, "way": "maxjax", "status": str(error)[:200]})
        print(*rows[-3:], sep="\n", file=sys.stderr, flush=True)
        keep("inspecting", config, rows, config.out)

    for city in config.cities:
        if not {(city, number) for number in range(config.targets)} <= done:
            for number, (where, target) in enumerate(covering.maps(city, config.buildings)):
                add(city, number, str(target), functools.partial(building, number, where, target, config))
        if config.side and (city, None) not in done and (found := area_map(city, config)) is not None:
            add(city, None, "area", functools.partial(area, *found, config))
    save("inspecting", config, rows, config.out)
    return rows


if __name__ == "__main__":
    main(configured(TINY))
