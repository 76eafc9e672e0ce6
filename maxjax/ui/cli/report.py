"""Output of the commands: tables and sentences; the files plan.json, path.csv and plan.png.

A folder with a plan.json is complete: it is written last and removed first.
"""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64
from rich.console import Console
from rich.table import Table

from maxjax.core.files import atomic_write
from maxjax.core.grid import Point3
from maxjax.core.provenance import device, versions
from maxjax.core.status import Status
from maxjax.io.geo.earth import Earth
from maxjax.planning.mission import Mission, NearWaypoint
from maxjax.planning.plan import Plan
from maxjax.planning.problem.occupied_end import find_occupied_end, open_sentence
from maxjax.planning.problem.place_format import PlaceFormat
from maxjax.planning.problem.task import Task
from maxjax.planning.windows.corridor import NEARLY
from maxjax.ui.cli.map_task import MapTask
from maxjax.ui.figures.style import load_matplotlib
from maxjax.ui.methods import climbs
from maxjax.verification.verifier import verify

# Decimals of latitude and longitude [degrees], to a tenth of a millimetre, and height [m]; and their columns.
_DIGITS = 9
_PLACES = ("latitude_deg", "longitude_deg", "height_m")

# Statuses of a start and of a goal where the airspace is closed.
_CLOSED = (
    (Status.START_IN_CLOSED_AREA, Status.START_OUTSIDE_BAND),
    (Status.GOAL_IN_CLOSED_AREA, Status.GOAL_OUTSIDE_BAND),
)

# Names of timings in the order in which they run, so that plans by different methods share the rows of a table.
_TIMED = (
    "voxelise", "transfer", "device", "formulate", "solve", "ascend", "tighten", "search", "distance", "descend",
    "price", "verify", "total",
)  # fmt: skip


def console(*, stderr: bool = False) -> Console:
    """A console that shows text as it is: no `[tags]`, no `:names:` of emoji."""
    return Console(stderr=stderr, markup=False, emoji=False)


def check_output(out: Path | None, *, drawn: bool = True) -> None:
    """Find out before the work whether its results can be drawn, if they are to be, and written.

    Raises:
        ImportError: if matplotlib is missing; names the extra.
        ValueError: if `out` is no folder, or cannot be made or written to.
    """
    if out is None:
        return
    try:
        if drawn:
            load_matplotlib()
    except ImportError as error:
        raise ImportError("--out draws a figure, which needs the extra viz: pip install 'maxjax[viz]'") from error
    try:
        standing = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
        # Asks the file system itself: permission bits do not tell of read-only disks.
        with tempfile.TemporaryFile(dir=standing):
            pass
    except OSError as error:
        raise ValueError(f"--out {out}: cannot be written: {error.strerror or error}; choose another folder") from error


def explain(plan: Plan, given: MapTask) -> str:
    """The status and what to do about it; of a plan without a path, the given values that it is about as well."""
    if plan.status == Status.OK:
        return plan.status.advice
    (start, goal), grid, occupied, places = given.ends, given.task.grid, given.task.barred, given.places
    sentence = (
        f"{plan.status.name}: {plan.status.advice} Given: start {places.place(start)}, goal {places.place(goal)}, "
        f"grid from {_xyz(grid.lower)} to {_xyz(grid.upper)} m"
    )
    if plan.status == Status.NO_SAFE_PATH:
        sentence += f"; radius {given.task.distances.radius:g} m, and {plan.radius:g} m at most joins the ends"
    if plan.status == Status.NO_VALID_PATH:
        sentence += f", {int(occupied.sum())} of {occupied.size} voxels occupied"
    if plan.status in (Status.NO_SAFE_PATH, Status.NO_VALID_PATH) and given.task.map.closed is not None:
        count = np.count_nonzero(given.task.map.closed)
        sentence += f"; the rules of the air close {count} of {occupied.size} voxels, and paths keep a voxel off those"
    for end, (point, status) in enumerate(zip((start, goal), _CLOSED, strict=True)):
        if plan.status in status and given.airspace is not None:
            index = np.floor(given.task.ends[0, end] + 0.5).astype(int).tolist()
            reasons = given.airspace.reasons_at(tuple(index), given.terrain)
            sentence += f"; the voxel of {places.place(point)} is {' and '.join(reasons)}"
            sentence += f"; {open_sentence(given.task.map_at(0), point, places)}"
    for point, taken in zip((start, goal), (Status.START_OCCUPIED, Status.GOAL_OCCUPIED), strict=True):
        if plan.status == taken:
            stands = find_occupied_end(given.task.map_at(0), point, given.task.distances.radius)
            sentence += "" if stands is None else f"; {stands.describe(places)}"
            if stands is not None and _unknown(given, np.array([point]))[0]:
                sentence += ", where nothing of the map's data is: unknown, and closed; --unknown free opens it"
    if given.returns:
        counts = given.returns
        sentence += (
            f"; points inside the grid {counts['inside']}, outside {counts['outside']}, "
            f"without a return {counts['missing']}"
        )
    return sentence + "."


def _unknown(given: MapTask, points: Float64[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Which points of the map lie in columns that its data do not cover."""
    if given.within is None:
        return np.zeros(len(points), bool)
    grid = given.task.grid
    column = np.floor((points[:, :2] - np.array(grid.lower[:2])) / grid.spacing).astype(int)
    return np.asarray(~given.within[tuple(column.T)])


def _xyz(point: Point3) -> str:
    return "(" + ", ".join(f"{x:.10g}" for x in point) + ")"


def document(plan: Plan, given: MapTask, message: str, configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Content of plan.json: the fields of `Plan`, and what is needed to run it again; lengths to the micrometre."""
    grid = given.task.grid
    where = {"shape": grid.shape, "spacing": grid.spacing, "origin": grid.origin}
    told = plan.to_dict()
    content = {
        "status": told.pop("status"),
        "message": message,
        "path": told.pop("path"),
        **places_of(plan, given.earth),
        **told,
        "configuration": {**configuration, "grid": where, "returns": given.returns},
        "versions": versions(),
        "device": device(),
    }
    filled: dict[str, Any] = plain(content)
    return filled


def places_of(plan: Plan | Mission, earth: Earth | None) -> dict[str, Any]:
    """Latitude, longitude [degrees] and height above sea level [m] of each point of a path, where known.

    Where the map lies is `path_geodetic`, its heights NaN where they are not known; what they are is `heights`.
    """
    if earth is None:
        return {}
    places = np.round(earth.geodetic(np.asarray(plan.path, np.float64)), _DIGITS).tolist()
    return {"path_geodetic": places, "heights": str(earth.zero)}


def plain(value: Any) -> Any:
    """Data that JSON can hold: numbers that are not finite become null."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def dumps(content: Mapping[str, Any]) -> str:
    """The text of a JSON document, ending in a newline."""
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def table(title: str, columns: Mapping[str, Mapping[str, str]]) -> Table:
    """A table with one column an entry; its rows are the entries' keys, those that are empty left out."""
    grid = Table(title=title, title_justify="left")
    grid.add_column("")
    for name in columns:
        grid.add_column(name, justify="right")
    for row in dict.fromkeys(key for column in columns.values() for key in column):
        cells = [column.get(row, "") for column in columns.values()]
        if any(cells):
            grid.add_row(row, *cells)
    return grid


def describe(plan: Plan, task: Task) -> dict[str, str]:
    """A plan as the rows of a table."""
    asked = task.distances.radius
    rows = {
        "status": plan.status.name,
        "certified": "yes" if plan.certified else "no" if climbs(plan.method) else "-",
        "radius": f"{plan.radius:g} m" + (f" (asked {asked:g} m)" if plan.radius != asked else ""),
        "margin": f"{plan.margin:g} m",
    }
    if plan.status == Status.OK:
        rows |= {
            "length": f"{plan.length:.2f} m",
            "straight line": f"{math.dist(task.starts[0], task.goals[0]):.2f} m",
            "price paid": f"{plan.cost:.2f} m",
            "price over the lattice guide's": "" if math.isnan(plan.stats.ratio) else f"{plan.stats.ratio:.3f}",
            "clearance": f"{plan.clearance:.2f} m",
            "clearance away from the ends": f"{plan.cruise_clearance:.2f} m",
            "waypoints": str(len(plan.path)),
        }
    for name in _TIMED:
        rows[f"time: {name}"] = f"{1e3 * plan.timings[name]:.0f} ms" if name in plan.timings else ""
    rows["compiled before, once"] = f"{plan.timings['compile']:.1f} s"
    return rows


def warn(plan: Plan, task: Task, places: PlaceFormat = PlaceFormat()) -> None:  # noqa: B008 (frozen)
    """Say on stderr where a plan of the task's only problem comes nearer to obstacles than it was asked to."""
    if plan.status != Status.OK:
        return
    what = "an obstacle" if task.map.closed is None else "an obstacle or to closed airspace"
    for end, exempt, point in zip(("start", "goal"), plan.exemptions, (task.starts[0], task.goals[0]), strict=True):
        if exempt:
            complain(
                f"Warning: the {end} {places.place(tuple(point.tolist()))} stands nearer to {what} than the radius of "
                f"{plan.radius:g} m; within {exempt:g} m of it the path keeps no more than that."
            )
    if plan.stats.ratio > NEARLY:
        complain(
            f"Warning: the path costs {plan.stats.ratio:.2f} times what guided it across this large map; another may "
            "be shorter. A window (--bounds) around a shorter way, or a larger --spacing, may show it."
        )
    if plan.cruise_clearance < 0.5 * task.distances.margin:
        found = verify(plan.path, plan.map, exemptions=plan.exemptions)
        place = "" if found.cruise_nearest is None else f" at {_place(found.cruise_nearest)}"
        complain(
            f"Warning: away from the ends the path comes within {plan.cruise_clearance:.2f} m of an obstacle{place}, "
            f"less than half the margin of {task.distances.margin:g} m."
        )


def refuse_near(near: Sequence[NearWaypoint], places: PlaceFormat, out: Path | None, name: str) -> int:
    """Say on stderr why a radius that is to be kept is not, and remove an earlier plan; returns the exit code."""
    if out is not None:
        remove_plans(out, name)
    for one in near:
        complain(
            f"Refused: {one.describe(places)}; move it, give a smaller --radius, or leave out --keep-radius. "
            "Nothing was written."
        )
    return 1


def warn_near(mission: Mission, places: PlaceFormat) -> None:
    """Say on stderr at which waypoints of a mission its radius is not kept."""
    for one in mission.near:
        complain(f"Warning: {one.describe(places)}; --keep-radius refuses that.")


def warn_outside(path: Float64[np.ndarray, "n 3"], given: MapTask) -> None:
    """Say on stderr how much of a path lies where the map's data say nothing of obstacles."""
    metres = outside_data(path, given)
    if metres > 0.0:
        complain(
            f"Warning: {metres:.1f} m of the path lie outside of what the map's file covers: obstacles there are not "
            "known. A file that covers the way shows them."
        )


def outside_data(path: Float64[np.ndarray, "n 3"], given: MapTask) -> float:
    """How much of a path lies above columns that the map's data do not cover [m]."""
    total = 0.0
    for a, b in itertools.pairwise(path):
        length = float(np.linalg.norm(b - a))
        pieces = max(1, math.ceil(4.0 * length / given.task.grid.spacing))
        middles = a + (b - a) * ((np.arange(pieces) + 0.5) / pieces)[:, None]
        total += length / pieces * np.count_nonzero(_unknown(given, middles))
    return total


def _place(point: Point3) -> str:
    return "(" + ", ".join(f"{x:.1f}" for x in point) + ") m"


def show(*tables: Table) -> None:
    """Print tables on stdout."""
    where = console()
    for one in tables:
        where.print(one)


def complain(message: str) -> None:
    """Print a sentence on stderr."""
    console(stderr=True).print(message, highlight=False, soft_wrap=True)


def remove_plans(out: Path, name: str) -> None:
    """Remove the files of an earlier `plan` or `mission` from a folder, and no others, if it is there."""
    for file in (f"{name}.json", "path.csv", f"{name}.png"):
        (out / file).unlink(missing_ok=True)


def write_plan(out: Path, content: Mapping[str, Any], figure: Any, name: str = "plan") -> list[Path]:
    """Write plan.json and, for a plan that is OK, path.csv and the figure plan.png; each whole or not at all.

    Args:
        out: folder; made if missing.
        content: from `document`.
        figure: matplotlib figure, or None where none is drawn.
        name: of the JSON and the figure, `plan` or `mission`.

    Returns:
        The files written. Those of an earlier one of this name are gone: after a failure, no path is left to fly.

    Raises:
        OSError: if they cannot be written.
    """
    from maxjax.ui.figures.style import save_figure

    out.mkdir(parents=True, exist_ok=True)
    summary, path, picture = out / f"{name}.json", out / "path.csv", out / f"{name}.png"
    remove_plans(out, name)
    written = []
    if figure is not None:
        save_figure(figure, picture)
        written.append(picture)
    if content["path"]:
        atomic_write(path, _csv(content["path"], content.get("path_geodetic")))
        written.append(path)
    atomic_write(summary, dumps(content))
    return [*written, summary]


def _csv(path: list[list[float]], places: list[list[float]] | None) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["x_m", "y_m", "z_m", *([] if places is None else _PLACES)])
    writer.writerows(path if places is None else [[*point, *place] for point, place in zip(path, places, strict=True)])
    return text.getvalue()
