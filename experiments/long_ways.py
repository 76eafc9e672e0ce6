"""Long ways across whole cities: what plans cost over the cheapest lattice path, that of A* at the same price.

    MAXJAX_DATA=... python -m experiments.long_ways                          # two CPU cores: 10 minutes
    MAXJAX_DATA=... python -m experiments.long_ways --problems 4 2           # a quick look

The Hague whole, in voxels of 2 m, and the city of 461 x 461 x 110 voxels of `benchmarks.city_plan`. Both ends stand
5 to 15 m above the ground, 3 m from everything, a third of the map's width apart or farther. Plans are made by default:
in the window that proves them, or in a corridor along the cheapest lattice path. A*'s cost is that of its plan of the
whole map with the same radius and price, so that a ratio below 1 is what the lattice costs.

Expected: all OK and certified; at most 1.00 in the mean and 1.03 at worst.
"""

from __future__ import annotations

import dataclasses
import os
import sys
import time
from pathlib import Path

import numpy as np
from scipy import ndimage

import maxjax
from benchmarks.city_plan import SPACING, city
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.markdown import Document, device, number, table
from maxjax.core.status import Status

RESULTS = Path(__file__).parent / "results"
_LOWEST, _HIGHEST, _CLEAR = 5.0, 15.0, 3.0  # [m], of ends


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        data: folder of public inputs.
        problems: in The Hague, and in the city made.
        shape: voxels of the city made.
        seed: of the ends.
        out: where the JSON goes.
    """

    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    problems: tuple[int, int] = (40, 20)
    shape: tuple[int, int, int] = (461, 461, 110)
    seed: int = 0
    out: Path = RESULTS


TINY = Config(problems=(0, 1), shape=(64, 64, 48))


def main(config: Config) -> list[Row]:
    """Plan, search, compare; save and return the rows."""
    rows: list[Row] = []
    for name, count in zip(("The Hague", "city of tiles"), config.problems, strict=True):
        if not count:
            continue
        where = _hague(config) if name == "The Hague" else _made(config)
        ends = draw_ends(where, count, np.random.default_rng(config.seed))
        rows.append({"map": name, "shape": "x".join(map(str, where.grid.shape)), **_compared(where, ends)})
        print(rows[-1], file=sys.stderr, flush=True)
        keep("long_ways", config, rows, config.out)
    save("long_ways", config, rows, config.out)
    return rows


def _hague(config: Config) -> maxjax.VoxelMap:
    return maxjax.load_map(config.data / "the_hague" / "DenHaag_01.city.json", spacing=2.0)


def _made(config: Config) -> maxjax.VoxelMap:
    occupied, ground = city(config.shape)
    return maxjax.VoxelMap.of(occupied, spacing=SPACING, origin=(0.0, 0.0, 0.0), ground=ground)


def draw_ends(where: maxjax.VoxelMap, count: int, rng: np.random.Generator) -> np.ndarray:
    """Starts and goals, (n, 2, 3) [m], centres of voxels that are high and clear enough, far enough apart."""
    occupied, ground, grid = np.asarray(where.occupied), np.asarray(where.ground), where.grid
    above = np.arange(grid.shape[2]) - (grid.shape[2] - 1 - ground[:, :, ::-1].argmax(axis=2))[:, :, None]
    high = grid.spacing * above
    distance: np.ndarray = np.asarray(ndimage.distance_transform_edt(~occupied))
    room = np.asarray(grid.spacing * distance > _CLEAR + grid.spacing / 2)
    # Over buildings no ground is near: ends stand in streets and yards.
    grounded = np.asarray(ground.any(axis=2))[:, :, None]
    street = (np.cumsum(occupied & ~ground, axis=2) == 0) & grounded
    places = np.argwhere(room & street & (high >= _LOWEST) & (high <= _HIGHEST))
    apart = max(grid.shape[:2]) / 3
    found: list[np.ndarray] = []
    while len(found) < count:
        pair = places[rng.integers(len(places), size=2)]
        if np.linalg.norm(pair[1] - pair[0]) >= apart:
            found.append(np.array(grid.origin) + grid.spacing * pair)
    return np.array(found)


def _compared(where: maxjax.VoxelMap, ends: np.ndarray) -> Row:
    plans: list[maxjax.Plan] = []
    rivals: list[maxjax.Plan] = []
    seconds: list[float] = []
    searched: list[float] = []
    for start, goal in ends.tolist():
        since = time.perf_counter()
        plans.append(maxjax.plan(where, start, goal))
        middle = time.perf_counter()
        rivals.append(maxjax.plan(where, start, goal, planner=maxjax.AStar()))
        seconds.append(middle - since - plans[-1].timings.get("compile", 0.0))
        searched.append(time.perf_counter() - middle - rivals[-1].timings.get("compile", 0.0))
    ratio = np.array([plan.cost / rival.cost for plan, rival in zip(plans, rivals, strict=True)])
    return {
        "problems": len(ends),
        "ok": sum(plan.status == Status.OK for plan in plans),
        "astar_ok": sum(rival.status == Status.OK for rival in rivals),
        "certified": sum(plan.certified for plan in plans),
        "in_corridors": int(np.isfinite([plan.stats.ratio for plan in plans]).sum()),
        "ratio_mean": float(ratio.mean()),
        "ratio_worst": float(ratio.max()),
        "length_over_straight": float(
            np.mean([p.length / np.linalg.norm(e[1] - e[0]) for p, e in zip(plans, ends, strict=True)])
        ),
        "seconds_median": float(np.median(seconds)),
        "astar_seconds_median": float(np.median(searched)),
    }


def section(document: Document) -> str:
    """RESULTS.md: what long ways cost."""
    lines = [
        [
            f"{row['map']}, {row['shape'].replace('x', ' × ')}",
            *(str(row[key]) for key in ("problems", "ok", "certified", "in_corridors")),
            *(f"{row[key]:.4f}" for key in ("ratio_mean", "ratio_worst")),
            f"{row['length_over_straight']:.3f}",
            *(number(row[key]) for key in ("seconds_median", "astar_seconds_median")),
        ]
        for row in document["rows"]
    ]
    heads = ["map", "problems", "OK", "certified", "in corridors", "cost over A*'s", "worst", "over straight line"]
    return (
        f"### Long ways across whole cities ({device(document)})\n\n"
        "What plans cost over A*'s plans of the whole map at the same radius and price, and the median seconds of\n"
        "both.\n\n" + table([*heads, "s", "A*, s"], lines, left=1)
    )


if __name__ == "__main__":
    main(configured(TINY))
