"""Problems that no planner had a say in: random ones on our three maps, and between points of surveyed streets.

    problem = (occupied, ground, start, goal)      its key: set and number

Random problems are those of `benchmarks.common.problems`. In The Hague and Venice both ends lie 20 to 50 voxels apart,
3 to 15 m high, in free voxels and `_CLEAR` or more from every solid as surveyed, exactly; the windows are those of
`experiments.city_windows`, and take turns.
"""

from __future__ import annotations

import dataclasses
import os
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64

import maxjax
from benchmarks.common.problems import draw_ends, problems
from experiments.city_windows import CITIES, windows
from maxjax.sim.worlds.real_city import TOLERANCE, city
from maxjax.sim.worlds.scenes import MAPS, occupancy

SETS = (*MAPS, *CITIES)
DATA = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))

_CLEAR = 1.5  # least distance of an end from a solid [m]


@dataclasses.dataclass(frozen=True)
class Instance:
    """A map and two ends.

    Attributes:
        map: problems of one city share it.
        start, goal: [m], in its world frame.
    """

    map: maxjax.VoxelMap
    start: Float64[np.ndarray, " 3"]
    goal: Float64[np.ndarray, " 3"]

    @property
    def grid(self) -> maxjax.Grid:
        """Of the map."""
        return self.map.grid

    @property
    def occupied(self) -> Bool[np.ndarray, "nx ny nz"]:
        """Occupied voxels, ground included."""
        return np.asarray(self.map.occupied)

    @property
    def ground(self) -> Bool[np.ndarray, "nx ny nz"]:
        """Those that are ground."""
        return np.asarray(self.map.ground)


def problem_set(
    name: str, count: int, seed: int = 0, *, half: float = 100.0, places: int = 4, data: Path = DATA
) -> list[Instance]:
    """The first `count` problems of a set; the same for the same seed, whatever the count.

    Args:
        name: one of `SETS`.
        count: problems.
        seed: of cities and ends.
        half: half extent of the map [m]; voxels of 2 m, the ground in the middle layer.
        places: windows of a surveyed city, the most built-up ones.
        data: folder of the surveys.
    """
    n = 2 * round(half / 2) + 1
    grid = maxjax.Grid.centered((0.0, 0.0, 0.0), (n, n, n), 2.0)
    if name in MAPS:
        tasks = problems(name, count, seed, grid)
        return [Instance(t.map, t.starts[0], t.goals[0]) for t in tasks]
    surveyed = windows(tuple(data / file for file in CITIES[name]), half, TOLERANCE)[:places]
    drawn = [_in_window(one.rows, [seed, zlib.crc32(name.encode()), k], grid) for k, one in enumerate(surveyed)]
    return [next(drawn[k % len(drawn)]) for k in range(count)]


def _in_window(rows: Float64[np.ndarray, "n 7"], seed: list[int], grid: maxjax.Grid) -> Iterator[Instance]:
    """The problems of a window, without end."""
    rng = np.random.default_rng(seed)
    solid, ground = occupancy(city(rows, len(rows)), grid)
    where = maxjax.VoxelMap.on(grid, solid | ground, ground)
    while True:
        ends = np.array(draw_ends(rng, np.asarray(where.occupied), grid), np.float64)
        if _distance(rows, ends).min() >= _CLEAR:
            yield Instance(where, ends[0], ends[1])


def _distance(rows: Float64[np.ndarray, "n 7"], points: Float64[np.ndarray, "p 3"]) -> Float64[np.ndarray, "p n"]:
    """Distance [m] from points to upright boxes, rows of `maxjax.sim.worlds.solids.upright_boxes`."""
    x, y, length, width, bottom, top, yaw = rows.T
    east, north, up = (points[:, None, k] for k in range(3))
    along = np.cos(yaw) * (east - x) + np.sin(yaw) * (north - y)
    across = np.cos(yaw) * (north - y) - np.sin(yaw) * (east - x)
    gaps = np.abs(along) - length, np.abs(across) - width, np.maximum(bottom - up, up - top)
    distance: Float64[np.ndarray, "p n"] = np.sqrt(sum(np.maximum(gap, 0.0) ** 2 for gap in gaps))
    return distance
