"""`maxjax inspect` and `maxjax survey`: photos of a building or an area, their flights, what they show, and files.

map → what is photographed, with room → viewpoints or lines → flights → table, inspection.json, inspection.png, exports
"""

from __future__ import annotations

import dataclasses
import functools
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from maxjax.core.files import atomic_write
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap
from maxjax.energy.charge_profile import ChargeProfile
from maxjax.energy.split_flights import BatteryFlight, Supply, weigh_flight
from maxjax.inspection.capture import Capture
from maxjax.inspection.departures import Departures, keep_apart
from maxjax.inspection.flown_files import FlownFiles
from maxjax.inspection.inspect_target import inspect
from maxjax.inspection.inspection import Inspection
from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.survey_area import survey
from maxjax.inspection.sweep import Sweep
from maxjax.inspection.targets import Target, choose
from maxjax.inspection.vehicles import Vehicles
from maxjax.io import Window, map_of
from maxjax.io.export.endings import number_file
from maxjax.io.kinds.faces import Faces, faces_of
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.kinds.mesh import Mesh
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.sim.worlds.scenes import Scene
from maxjax.ui.cli import exporting, report
from maxjax.ui.cli.map_task import MapTask, earth_in, load_source
from maxjax.ui.cli.photo_options import InspectOptions, PhotoOptions, SurveyOptions
from maxjax.ui.cli.progress import progress
from maxjax.ui.energy_rows import HEADS, energy_cells, flight_energy
from maxjax.ui.request import Request, reading_of

_ROOM = 15.0  # around what is photographed, beyond the distance of photos [m]
_BELOW = 4.0  # of what is read below the lowest of what stands there [m]
_HIGH = 80.0  # of the middle of a simulated city's voxels [m]


def run_inspect(options: InspectOptions) -> int:
    """Inspect a target, show and write. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    target, reach = _target(options), options.distance + _ROOM
    capture = Capture(options.distance, options.overlap, options.incidence, options.resolution)
    return _run(options, target, reach, functools.partial(inspect, capture=capture))


def run_survey(options: SurveyOptions) -> int:
    """Survey an area, show and write. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    area = _corners("--area", options.area, 2 if options.width is not None else 3)
    sweep = Sweep(**{field.name: getattr(options, field.name) for field in dataclasses.fields(Sweep)})
    reach = options.distance + options.beyond + options.turn + _ROOM
    return _run(options, area, reach, functools.partial(survey, sweep=sweep))


def _run(options: PhotoOptions, target: Target, reach: float, take: Callable[..., Inspection]) -> int:
    """Read the map around a target, take photos of it, show and write."""
    report.check_output(options.out)
    camera = Camera.named(options.camera)
    request = _request(options)
    exporting.check_exports(request)
    limits, supply = request.limits, request.supply
    request.check()
    with progress(f"Reading {options.map}"):
        given = _map_around(request, target, reach)
    exporting.check_place(request, given)
    with progress("Choosing photos and planning their flights"):
        found = take(
            given.task.map,
            target,
            camera,
            vehicles=_vehicles(options, supply),
            distances=Distances(options.radius, options.margin),
        )
    with progress("Timing"):
        flights = [weigh_flight(mission, limits, supply) for mission in found.missions]
        departures = _departures(found, flights, options.separation)
    content = _document(options, found, flights, supply)
    if departures is not None:
        content |= _told_departures(content, departures)
    files: list[object] = []
    if options.out is not None:
        files += _written(options.out, content, found, [ChargeProfile.of(flight, supply) for flight in flights])
    status = Status[content["status"]]
    if status == Status.OK:
        files += _all_files(request, given, flights, found, departures)
    if options.json:
        sys.stdout.write(report.dumps(content))
    else:
        report.show(_table(found, Path(options.map).name, flights, supply, departures))
        print(found, *(() if departures is None else (departures,)), sep="\n")
        if files:
            print(*files, sep="\n")
    for remark in found.remarks:
        report.complain(f"Note: {remark}.")
    if status == Status.OK:
        return 0
    for number, flight in enumerate(flights, 1):
        if flight.status != Status.OK and flight.verdict is not None:
            report.complain(f"Flight {number}: {flight.verdict.describe()}; --longest S makes flights shorter.")
    report.complain(f"{status.name}: {status.advice}")
    return 1


def _vehicles(options: PhotoOptions, supply: Supply | None) -> Vehicles:
    """Who flies, as long as is asked for, else as long as the battery lasts."""
    if supply is not None and options.longest is None:
        return Vehicles.on_battery(supply, options.home, options.vehicles)
    return Vehicles(options.home, options.vehicles, options.longest)


def _target(options: InspectOptions) -> Target:
    """What is to be inspected; raises a ValueError unless one of the options says it."""
    given: dict[str, Any] = {
        "--building": options.building,
        "--at": options.at,
        "--box": None if options.box is None else np.array(options.box).reshape(2, 3),
        "--outline": _corners("--outline", options.outline, 3) if options.outline else None,
    }
    named = [name for name, value in given.items() if value is not None and len(value)]
    if len(named) != 1:
        said = " and ".join(named) if named else "none"
        raise ValueError(f"expected one of {', '.join(given)}, given {said}: say what is to be inspected")
    target: Target = given[named[0]]
    return target


def _corners(name: str, numbers: tuple[float, ...], least: int) -> np.ndarray:
    if len(numbers) % 2 or len(numbers) < 2 * least:
        raise ValueError(f"{name}: expected x and y of {least} corners at least, given {len(numbers)} numbers")
    return np.array(numbers).reshape(-1, 2)


def _request(options: PhotoOptions) -> Request:
    """How a map is read, limits and outputs, as a request has them."""
    names = {field.name for field in dataclasses.fields(Request)}
    own = {field.name: getattr(options, field.name) for field in dataclasses.fields(options) if field.name in names}
    return Request(**own)


def _map_around(request: Request, target: Target, reach: float) -> MapTask:
    """The map around a target, so far beyond it; of a file without faces all of it."""
    source = load_source(request.map, reading_of(request))
    if isinstance(source, Scene):
        if isinstance(target, str) or isinstance(target[0], str):
            raise ValueError(f"--building: {request.map} has no names; give --at, --box or --outline")
        (x, y), _ = _middle(np.asarray(target, np.float64))
        return _task(source.voxels(Grid.centered((x, y, _HIGH))), request)
    bounds = request.bounds
    if bounds is None and request.center is None and isinstance(source, Footprints | Mesh):
        bounds = _bounds(faces_of(source), target, reach)
    window = Window(request.spacing, bounds, request.center, (), request.ground)
    found = map_of(source, window, reading_of(request))
    earth = earth_in(source, request)
    task = dataclasses.replace(_task(found, request), earth=earth, within=found.file.within)
    for remark in found.file.remarks:
        report.complain(f"Note: {Path(request.map).name}: {remark}.")
    return task


def _middle(corners: np.ndarray) -> tuple[tuple[float, float], float]:
    """Middle in plan of a place, an outline or a box, and half of its extent [m]."""
    flat = corners.reshape(-1, corners.shape[-1])[:, :2]
    x, y = (0.5 * (flat.min(axis=0) + flat.max(axis=0))).tolist()
    return (x, y), 0.5 * float(np.ptp(flat, axis=0).max())


def _bounds(faces: Faces, target: Target, reach: float) -> tuple[float, float, float, float, float, float]:
    """Lowest and highest corner of what is read: the target with room, down to the lowest of what stands there [m]."""
    chosen = choose(faces, target)
    corners = faces.triangles[chosen.faces].reshape(-1, 3)
    if chosen.outline is not None or chosen.box is not None:
        limits = np.asarray(chosen.outline if chosen.outline is not None else chosen.box)
        low, high = limits.min(axis=0)[:2], limits.max(axis=0)[:2]
    else:
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    near = (np.abs(corners[:, :2] - 0.5 * (low + high)) <= 0.5 * (high - low) + reach).all(axis=1)
    heights = corners[near, 2] if near.any() else corners[:, 2]
    (x0, y0), (x1, y1) = (low - reach).tolist(), (high + reach).tolist()
    return x0, y0, float(heights.min()) - _BELOW, x1, y1, float(heights.max()) + reach


def _task(where: VoxelMap, request: Request) -> MapTask:
    ends = np.array([where.grid.origin])
    return MapTask(Task.of(where, ends, ends, request.distances), where.terrain, earth=request.earth(None))


def _exported(request: Request, given: MapTask, flight: BatteryFlight, number: int | None) -> list[exporting.Exported]:
    """The files of a flight; of several they are numbered."""
    if not request.export or flight.trajectory is None:
        return []
    files = tuple(file if number is None else number_file(file, number) for file in request.export)
    ends = flight.mission.path[[0, -1]]
    own = dataclasses.replace(given, task=given.task.with_ends(ends[:1], ends[1:]))
    return exporting.write_all(dataclasses.replace(request, export=files), own, flight.trajectory)


def _departures(found: Inspection, flights: Sequence[BatteryFlight], separation: float) -> Departures | None:
    """When the flights of several vehicles depart; None of one vehicle, or where a flight has no trajectory.

    Raises:
        ValueError: as `keep_apart`.
    """
    timed = [flight.trajectory for flight in flights if flight.trajectory is not None]
    if len(set(found.vehicles)) < 2 or len(timed) < len(flights):
        return None
    return keep_apart(timed, found.vehicles, separation)


def _all_files(
    request: Request,
    given: MapTask,
    flights: Sequence[BatteryFlight],
    found: Inspection,
    departures: Departures | None,
) -> list[object]:
    """The files of all flights, and what their photos show."""
    files: list[object] = []
    written = [
        _exported(request, given, flight, number if len(flights) > 1 else None)
        for number, flight in enumerate(flights, 1)
    ]
    for alike in zip(*written, strict=True):
        photos = FlownFiles.of([one.file for one in alike], [one.flown for one in alike], found)
        files += [*alike, photos]
        if departures is not None:
            _tell_times(alike, flights)
        if request.json:
            report.complain(str(photos))
    return files


def _tell_times(files: Sequence[exporting.Exported], flights: Sequence[BatteryFlight]) -> None:
    """Say on stderr where files take other times than the trajectories by which vehicles keep apart."""
    pairs = [
        (one.file.name, max(part.duration for part in one.flown.flights), flight.trajectory.duration)
        for one, flight in zip(files, flights, strict=True)
        if one.flown.flights and flight.trajectory is not None
    ]
    if pairs:
        name, taken, meant = max(pairs, key=lambda pair: abs(pair[1] - pair[2]))
        report.complain(
            f"Note: vehicles keep apart by the times of their trajectories, as set-points have them; {name} takes "
            f"{taken:.0f} s in place of {meant:.0f}: fly such files one after the other, or at heights of their own."
        )


def _told_departures(content: Mapping[str, Any], departures: Departures) -> dict[str, Any]:
    """What inspection.json has of departures: of each flight, and of all."""
    rows = zip(content["flights"], departures.departs.tolist(), departures.waits.tolist(), strict=True)
    flights = [{**flight, "departs": departs, "waits": waits} for flight, departs, waits in rows]
    names = ("apart", "least", "before", "costs")
    return {"flights": flights, "separation": report.plain({name: getattr(departures, name) for name in names})}


def _document(
    options: PhotoOptions, found: Inspection, flights: Sequence[BatteryFlight], supply: Supply | None
) -> dict[str, Any]:
    """The content of inspection.json."""
    status = next((flight.status for flight in flights if flight.status != Status.OK), Status.OK)
    content = {**found.to_dict(), "status": status.name}
    for told, flight in zip(content["flights"], flights, strict=True):
        told["duration"] = None if flight.trajectory is None else flight.trajectory.duration
        told |= flight_energy(flight, supply)
    filled: dict[str, Any] = report.plain({**content, "configuration": dataclasses.asdict(options)})
    return filled


def _table(
    found: Inspection,
    title: str,
    flights: Sequence[BatteryFlight],
    supply: Supply | None,
    departures: Departures | None,
) -> Table:
    """One row a flight; vehicle and departure are left out where there is one vehicle."""
    several = any(found.vehicles)
    heads = ["flight", *(["vehicle"] if several else []), "status", "photos", "length\n[m]", "clearance\n[m]"]
    table = Table(title=title, title_justify="left")
    departs = () if departures is None else ("departs\n[s]",)
    for head in (*heads, "takes\n[s]", *departs, *(() if supply is None else HEADS)):
        table.add_column(head, justify="left" if head == "status" else "right", overflow="fold")
    for k, (flight, vehicle) in enumerate(zip(flights, found.vehicles, strict=True)):
        cells = [str(k + 1), *([str(vehicle + 1)] if several else []), flight.status.name]
        cells += [str(int((found.flight == k).sum()))]
        if flight.trajectory is not None:
            cells += [f"{flight.mission.length:.1f}", f"{flight.mission.clearance:.1f}"]
            cells += [f"{flight.trajectory.duration:.0f}"]
            cells += [] if departures is None else [f"{departures.departs[k]:.1f}"]
        cells += energy_cells(flight, supply)(None) if flight.taken is not None else ()
        table.add_row(*cells)
    return table


def _written(
    out: Path, content: dict[str, Any], found: Inspection, charges: Sequence[ChargeProfile | None]
) -> list[Path]:
    """The files of an inspection in a folder, the picture first."""
    from maxjax.ui.figures.inspections import figure_inspection
    from maxjax.ui.figures.style import save_figure

    out.mkdir(parents=True, exist_ok=True)
    with progress("Drawing"):
        known = [charge for charge in charges if charge is not None]
        save_figure(figure_inspection(found, charges=known), out / "inspection.png")
    atomic_write(out / "inspection.json", report.dumps(content))
    return [out / "inspection.json", out / "inspection.png"]
