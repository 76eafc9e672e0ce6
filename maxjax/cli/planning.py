"""`maxjax plan`: a path through a city, a scan or a voxel map."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from maxjax import api
from maxjax.cli import report
from maxjax.cli.options import PlanOptions
from maxjax.cli.placed_map import PlacedMap, load_source, place_map
from maxjax.core.grid import Point3
from maxjax.core.status import Status
from maxjax.fields.occupancy import dilate, rungs
from maxjax.methods import METHODS
from maxjax.planning.climb import potential_field
from maxjax.planning.plan import Plan, no_plan
from maxjax.planning.recorder import Recorder, added, recording
from maxjax.solvers.potential import solve_potential
from maxjax.viz.figures import Overlay

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AROUND = 45.0  # [m]; enough of a town to recognise it


def run(options: PlanOptions) -> int:
    """Plan, show and write. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    map, start, goal, out = options.map, options.start, options.goal, options.out
    report.check_output(out)
    with report.progress(f"Reading {map}"), recording() as recorder:
        placed = place_map(load_source(map), start, goal, options.center, options.ground)
    rungs(options.margin, placed.grid)
    with report.progress(f"Planning, method {options.method}; {report.FIRST_RUN}"):
        plan = plan_in(placed, start, goal, options.method, options.margin, recorder)
    message = report.explain(plan, placed, start, goal) if plan.status != Status.OK else plan.status.advice
    configuration = {name: value for name, value in vars(options).items() if name not in ("out", "json")}
    content = report.document(plan, placed, message, configuration)
    plans: dict[str, Plan] = {options.method: plan}
    if out is not None:
        figure = None
        if plan.status == Status.OK:
            with report.progress("Drawing"):
                if METHODS[options.method].climbs:
                    plans["astar"] = plan_in(placed, start, goal, "astar", options.margin, Recorder())
                figure = draw(placed, plans, start, goal, Overlay(title=Path(map).name, around=_AROUND))
        files = report.write_plan(out, content, figure)
    if options.json:
        sys.stdout.write(report.dumps(content))
    else:
        columns = {
            METHODS[name].label: report.describe(found, options.margin, start, goal) for name, found in plans.items()
        }
        report.show(report.table(Path(map).name, columns))
        if out is not None:
            print(*files, sep="\n")
    if plan.status == Status.OK:
        return 0
    report.complain(message)
    return 1


def plan_in(placed: PlacedMap, start: Point3, goal: Point3, method: str, margin: float, before: Recorder) -> Plan:
    """`maxjax.plan` in a placed map, start and goal in the map's coordinates [m]; the path is in its grid's frame.

    Args:
        placed: the map.
        start, goal: [m].
        method, margin: as in `maxjax.plan`.
        before: time already spent on making voxels; added to the plan's.
    """
    if placed.returns and placed.returns["inside"] == 0:
        return dataclasses.replace(no_plan(Status.EMPTY_SCAN, method), timings=before.report())
    found = api.plan(
        placed.occupied,
        placed.localize(start),
        placed.localize(goal),
        placed.grid,
        method=method,
        margin=margin,
        ground=placed.ground,
    )
    return dataclasses.replace(found, timings=added(before.report(), found.timings))


def draw(
    placed: PlacedMap,
    plans: Mapping[str, Plan],
    start: Point3,
    goal: Point3,
    overlay: Overlay,
    city: PlacedMap | None = None,
) -> Figure:
    """The figure of one or more plans, in the map's coordinates; with the potential that the first one climbed.

    Args:
        placed: the map that was planned in.
        plans: by method; those without a path are left out.
        start, goal: [m].
        overlay: title, returns, and width of the map around the paths.
        city: the map to show, if another one, on the same grid; None: `placed`.
    """
    from maxjax.viz.figures import Voxels, figure_plan

    shown = placed if city is None else city
    found = {name: plan for name, plan in plans.items() if plan.status == Status.OK}
    paths = {METHODS[name].label: placed.globalize(plan.path) for name, plan in found.items()}
    first = next(iter(plans.values()))
    if METHODS[first.method].climbs:
        overlay = dataclasses.replace(overlay, log_potential=_log_potential(placed, goal, first.margin))
    voxels = Voxels(shown.occupied, shown.ground, placed.file_grid)
    return figure_plan(voxels, paths, np.asarray(start), np.asarray(goal), overlay)


def _log_potential(placed: PlacedMap, goal: Point3, margin: float) -> Float[np.ndarray, "nx ny nz"]:
    """Logarithm of φ of the plan's own problem; -inf where no current flows."""
    blocked = dilate(jnp.asarray(placed.occupied), margin, placed.grid, jnp.asarray(placed.ground))
    index = placed.grid.index_of(jnp.asarray(placed.localize(goal), jnp.float32))
    field = potential_field(blocked, index, placed.grid, solve_potential)
    phi = np.asarray(field.phi)
    return np.log(np.where(phi > 0, phi, 1.0), where=phi > 0, out=np.full(phi.shape, -np.inf, phi.dtype))
