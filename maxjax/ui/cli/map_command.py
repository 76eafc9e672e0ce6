"""`maxjax map`: what a map file holds, and what becomes of it as voxels."""

from __future__ import annotations

import itertools
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from maxjax.core.voxel_map import VoxelMap
from maxjax.io import LoadedMap, Window, map_of, read_map
from maxjax.io.geo.accuracy import accuracy_of
from maxjax.io.kinds.contents import facts
from maxjax.ui.cli import report
from maxjax.ui.cli.options import MapOptions
from maxjax.ui.cli.progress import progress
from maxjax.ui.request import reading_of


def run_map(options: MapOptions) -> int:
    """Read, show and draw. Returns 0.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    report.check_output(options.out)
    window = Window(options.spacing, options.bounds, options.center, (), options.ground)
    with progress(f"Reading {options.map}"):
        reading = reading_of(options)
        contents = read_map(options.map, reading)
        found = map_of(contents, window, reading)
        extent = facts(contents).extent
    content = _document(found, extent)
    if options.at is not None:
        content["at"] = {"place": list(options.at), "occupied": column(found, options.at)}
    content = report.plain(content)
    picture = None if options.out is None else _draw(found, options.out)
    if options.json:
        sys.stdout.write(report.dumps(content))
    else:
        rows = _rows(found, extent) | ({} if options.at is None else _at(found, options.at))
        report.show(report.table(found.file.source, {"": rows}))
        if picture is not None:
            print(picture)
    for remark in found.file.remarks:
        report.complain(f"Note: {found.file.source}: {remark}.")
    return 0


def _document(found: LoadedMap, extent: np.ndarray) -> dict[str, Any]:
    grid, file = found.grid, found.file
    return {
        "source": file.source,
        "crs": file.crs,
        "origin": file.origin,
        **_on_earth(found),
        "extent": extent.tolist(),
        "read": file.read,
        "dropped": file.dropped,
        "grid": {"shape": grid.shape, "spacing": grid.spacing, "origin": grid.origin},
        "occupied": int(found.occupied.sum()),
        "ground": int(found.ground.sum()),
        "remarks": list(file.remarks),
    }


def _on_earth(found: LoadedMap) -> dict[str, Any]:
    """What a map's heights count from, and how true its places are; nothing where it lies nowhere."""
    earth = found.earth
    if earth is None:
        return {}
    middle = 0.5 * (np.array(found.grid.lower) + np.array(found.grid.upper))
    true = accuracy_of(earth, middle)
    return {"height_of_zero": earth.zero.above_sea, "heights": str(earth.zero), "accuracy": true.clause[2:]}


def _rows(found: LoadedMap, extent: np.ndarray) -> dict[str, str]:
    grid, file = found.grid, found.file
    rows = {"reference system": file.crs or "not named; give --crs"}
    if file.earth is not None:
        place = _on_earth(found)
        rows["heights"] = place["heights"]
        if place["height_of_zero"]:
            rows["z = 0"] = f"{place['height_of_zero']:.2f} m above sea level"
        rows |= {"on Earth": place["accuracy"]} if place["accuracy"] else {}
    if file.origin is not None:
        rows["(0, 0) is at"] = f"longitude {file.origin[0]:.6f}, latitude {file.origin[1]:.6f}"
    for axis, low, high in zip("xyz", *extent.tolist(), strict=True):
        rows[axis] = f"{low:.2f} to {high:.2f} m"
    rows |= {name: f"{count:,}" for name, count in file.read.items()}
    rows |= {f"dropped: {name}": f"{count:,}" for name, count in file.dropped.items()}
    rows["voxels"] = f"{' x '.join(map(str, grid.shape))} of {grid.spacing:g} m"
    rows["occupied"] = f"{int((found.occupied & ~found.ground).sum()):,}"
    rows["ground"] = f"{int(found.ground.sum()):,}"
    return rows


def _at(found: LoadedMap, place: tuple[float, float]) -> dict[str, str]:
    """The column of the map at a place."""
    spans = [f"{low:.1f} to {high:.1f} m ({what})" for low, high, what in column(found, place)]
    x, y = place
    return {f"at ({x:.10g}, {y:.10g})": ", ".join(spans) or "nothing"}


def column(found: VoxelMap, place: tuple[float, float]) -> list[tuple[float, float, str]]:
    """Occupied spans of the column of voxels at a place, lowest first: from, to [m], ground or obstacle.

    Raises:
        ValueError: if the place lies outside of the map.
    """
    grid = found.grid
    i, j = (math.floor((a - b) / grid.spacing) for a, b in zip(place, grid.lower[:2], strict=True))
    if not (0 <= i < grid.shape[0] and 0 <= j < grid.shape[1]):
        (x0, y0, _), (x1, y1, _) = grid.lower, grid.upper
        raise ValueError(f"--at: expected a place in x {x0:g} to {x1:g}, y {y0:g} to {y1:g}, given {place}")
    kind = np.asarray(found.occupied[i, j]).astype(int) + np.asarray(found.ground[i, j])
    edges = np.flatnonzero(np.diff(kind, prepend=-1, append=-1))
    level = grid.lower[2] + grid.spacing * np.arange(len(kind) + 1)
    names = {1: "obstacle", 2: "ground"}
    return [
        (float(level[a]), float(level[b]), names[int(kind[a])])
        for a, b in itertools.pairwise(edges.tolist())
        if kind[a]
    ]


def _draw(found: LoadedMap, out: Path) -> Path:
    """map.png: the map from above."""
    from maxjax.ui.figures.drawable import drawable, title_with_remark
    from maxjax.ui.figures.figures import figure_map
    from maxjax.ui.figures.style import save_figure

    picture = out / "map.png"
    picture.unlink(missing_ok=True)
    out.mkdir(parents=True, exist_ok=True)
    with progress("Drawing"):
        where, within, remark = drawable(found, found.file.within)
        save_figure(figure_map(where, title=title_with_remark(found.file.source, remark), within=within), picture)
    return picture
