"""`maxjax map`: what a map file holds, and what becomes of it as voxels."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from maxjax.cli import report
from maxjax.cli.options import MapOptions
from maxjax.cli.progress import progress
from maxjax.cli.task import MOST_VOXELS
from maxjax.maps import Map, Window, map_of, read_map
from maxjax.maps.contents import facts


def run(options: MapOptions) -> int:
    """Read, show and draw. Returns 0.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    report.check_output(options.out)
    window = Window(options.spacing, options.bounds, options.center, (), options.ground)
    with progress(f"Reading {options.map}"):
        contents = read_map(options.map)
        found = map_of(contents, window, options.below, options.unknown, options.crs)
        extent = facts(contents).extent
    content = report.plain(_document(found, extent))
    picture = None if options.out is None else _draw(found, options.out)
    if options.json:
        sys.stdout.write(report.dumps(content))
    else:
        report.show(report.table(found.source, {"": _rows(found, extent)}))
        if picture is not None:
            print(picture)
    for remark in found.remarks:
        report.complain(f"Note: {found.source}: {remark}.")
    return 0


def _document(found: Map, extent: np.ndarray) -> dict[str, Any]:
    grid = found.grid
    return {
        "source": found.source,
        "crs": found.crs,
        "origin": found.origin,
        "extent": extent.tolist(),
        "read": found.read,
        "dropped": found.dropped,
        "grid": {"shape": grid.shape, "spacing": grid.spacing, "origin": grid.origin},
        "occupied": int(found.occupied.sum()),
        "ground": int(found.ground.sum()),
        "remarks": list(found.remarks),
    }


def _rows(found: Map, extent: np.ndarray) -> dict[str, str]:
    grid = found.grid
    rows = {"reference system": found.crs or "not named; give --crs"}
    if found.origin is not None:
        rows["(0, 0) is at"] = f"longitude {found.origin[0]:.6f}, latitude {found.origin[1]:.6f}"
    for axis, low, high in zip("xyz", *extent.tolist(), strict=True):
        rows[axis] = f"{low:.2f} to {high:.2f} m"
    rows |= {name: f"{count:,}" for name, count in found.read.items()}
    rows |= {f"dropped: {name}": f"{count:,}" for name, count in found.dropped.items()}
    rows["voxels"] = f"{' x '.join(map(str, grid.shape))} of {grid.spacing:g} m"
    rows["occupied"] = f"{int((found.occupied & ~found.ground).sum()):,}"
    rows["ground"] = f"{int(found.ground.sum()):,}"
    return rows


def _draw(found: Map, out: Path) -> Path | None:
    """map.png: the map from above; None, and a sentence, where it is too large to draw."""
    from maxjax.viz.figures import figure_map
    from maxjax.viz.style import save_figure

    picture = out / "map.png"
    picture.unlink(missing_ok=True)
    if found.occupied.size > MOST_VOXELS:
        report.complain_of_size()
        return None
    out.mkdir(parents=True, exist_ok=True)
    with progress("Drawing"):
        obstacle = found.occupied & ~found.ground
        save_figure(figure_map(obstacle, found.grid, title=found.source, within=found.within), picture)
    return picture
