"""Plans across whole cities, in the memory of a few windows: corner to corner, and between ends 300 voxels apart.

    python -m benchmarks.city_plan                          # two CPU cores: 10 minutes
    python -m benchmarks.city_plan --cities 160x160x48 --no-compare    # a quick look

A city is a square of tiles of 128 x 128 voxels, `midtown` and `downtown` in turns, each with a seed of its own, voxels
of 2 m. The first city is crossed from corner to corner; in the others ends are 300 voxels apart, about the middle. Both
ends stand in the nearest street, 5 m above the ground. Each city is planned in a process of its own: twice, so that
compilation is known, and its peak memory is that beyond the process that holds the map. `compare` solves the first city
as a whole as well: the length is compared with that of its path.

Expected: OK and certified; corner to corner within 1.01 of the length by the field of the whole map.
"""

from __future__ import annotations

import dataclasses
import math
import multiprocessing
import resource
import time
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, save
from maxjax.sim.worlds.scenes import make_scene, occupancy

SPACING = 2.0
_TILE = 128
_MAPS = ("midtown", "downtown")
# Height of both ends [m], and how far apart they are where they do not stand in corners [voxels].
_HEIGHT, _APART = 5.0, 300
_CORNER = 12  # voxels from the sides of the map

Volume = Bool[np.ndarray, "nx ny nz"]
Point = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        cities: voxels of each, NXxNYxNZ.
        compare: whether the first city is solved as a whole, too.
        out: where the JSON goes.
    """

    cities: tuple[str, ...] = ("461x461x110", "1024x800x110")
    compare: bool = True
    out: Path = RESULTS


TINY = Config(cities=("64x48x20", "64x48x20"), compare=False)


def city(shape: tuple[int, int, int]) -> tuple[Volume, Volume]:
    """Occupied voxels and ground of a city of tiles; its lowest layer is ground."""
    half = _TILE // 2 * SPACING
    grid = maxjax.Grid((_TILE, _TILE, shape[2]), SPACING, (-half, -half, -SPACING / 2))
    occupied, ground = np.zeros(shape, bool), np.zeros(shape, bool)
    for i in range(-(-shape[0] // _TILE)):
        for j in range(-(-shape[1] // _TILE)):
            at = slice(i * _TILE, (i + 1) * _TILE), slice(j * _TILE, (j + 1) * _TILE)
            tile = occupancy(make_scene(_MAPS[(i + j) % 2], 1000 * i + j).geoms, grid)
            for volume, part in zip((occupied, ground), tile, strict=True):
                held = volume[at]
                held[:] = np.asarray(part)[: held.shape[0], : held.shape[1]]
    return occupied, ground


def street(occupied: Volume, x: float, y: float) -> Point:
    """The open place [m] nearest to a column of voxels."""
    level = math.floor(_HEIGHT / SPACING + 0.5)
    free = np.argwhere(~occupied[:, :, level] & ~occupied[:, :, level + 1])
    i, j = free[np.argmin(np.abs(free - [x, y]).sum(axis=1))].tolist()
    return SPACING * i, SPACING * j, _HEIGHT


def ends(occupied: Volume, corners: bool) -> tuple[Point, Point]:
    """Both ends of a flight."""
    nx, ny, _ = occupied.shape
    if corners:
        return street(occupied, _CORNER, _CORNER), street(occupied, nx - _CORNER, ny - _CORNER)
    side = min(_APART / math.sqrt(2), nx - 2 * _CORNER, ny - 2 * _CORNER) / 2
    return street(occupied, nx / 2 - side, ny / 2 - side), street(occupied, nx / 2 + side, ny / 2 + side)


def crossed(shape: tuple[int, int, int], corners: bool, focus: bool) -> dict[str, Any]:
    """Plan through a city, twice; run in a process of its own."""
    occupied, ground = city(shape)
    start, goal = ends(occupied, corners)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    walls = []
    for _ in range(2):
        since = time.perf_counter()
        plan = maxjax.plan(
            maxjax.VoxelMap.on(maxjax.Grid(shape, SPACING, (0.0,) * 3), occupied, ground),
            start,
            goal,
            planner=maxjax.Field(focus=focus),
        )
        walls.append(time.perf_counter() - since)
    return {
        "voxels_M": round(occupied.size / 1e6, 1),
        "straight_m": round(math.dist(start, goal), 1),
        "status": plan.status.name,
        "certified": plan.certified,
        "length_m": round(plan.length, 2),
        "cost_m": round(plan.cost, 2),
        "cruise_clearance_m": round(plan.cruise_clearance, 2),
        "seconds": round(walls[1], 2),
        "first_seconds": round(walls[0], 2),
        "map_MB": round((occupied.nbytes + ground.nbytes) / 1e6, 1),
        "memory_beyond_MB": round((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024, 1),
    }


def main(config: Config) -> list[Row]:
    """Plan through every city; save and return the rows."""
    rows: list[Row] = []
    context = multiprocessing.get_context("spawn")
    for k, text in enumerate(config.cities):
        shape = shape_of(text)
        for focus in (True, False) if k == 0 and config.compare else (True,):
            with context.Pool(1) as pool:
                row = pool.apply(crossed, (shape, k == 0, focus))
            where = "corner to corner" if k == 0 else f"{_APART} voxels"
            rows.append({"what": f"city of {' × '.join(map(str, shape))}, {where}", "focus": focus} | row)
    save("city_plan", config, rows, config.out)
    return rows


def shape_of(text: str) -> tuple[int, int, int]:
    """Voxels of a city that is given as NXxNYxNZ.

    Raises:
        ValueError: if it is not, or too small for both ends.
    """
    numbers = [int(part) for part in text.split("x") if part.isdecimal()]
    if len(numbers) != 3 or min(numbers[:2]) < 3 * _CORNER:
        raise ValueError(f"--cities: expected NXxNYxNZ, {3 * _CORNER} or more voxels wide, given {text!r}")
    return numbers[0], numbers[1], numbers[2]


if __name__ == "__main__":
    main(configured(TINY))
