"""Judge the completion network where it never was: calibration, and plans from one scan, beside constants.

    python -m experiments.completion.judge --record       two cores: an hour

    reliability   of unseen voxels by predicted P: share that is occupied; Brier score = mean of (P − occupied)²
    plans         from one scan, unseen voxels priced  1 + a P  beside the law of distance; share that crosses buildings

P is 0 (`free`), 1 (`alike`), 1 below what was seen occupied (`extruded`), the network's, or the truth, which no network
can pass. Problems are drawn as those of the offline protocol, in simulated cities and in windows of The Hague and of
Venice (Los Angeles); a path crosses a building if a point of it, taken every quarter of a metre, lies in a voxel that
the city occupies.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
import sys
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy import stats

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from benchmarks.common.problems import draw_ends, voxels_of
from experiments.city_windows import CITIES, slots_of, windows
from experiments.completion.scenes import look
from experiments.completion.train import load
from maxjax import VoxelMap
from maxjax.nn.unseen import predict_unseen, raise_price
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.real_city import TOLERANCE, city
from maxjax.sim.worlds.scenes import make_scene, occupancy

RESULTS = Path(__file__).parents[1] / "results"
_GRID = maxjax.Grid.centered((0.0, 0.0, 0.0), (101, 101, 101), 2.0)
Volume = Bool[np.ndarray, "nx ny nz"]
_EVERY = 0.25  # [m]
_BINS = 10
_EACH, _WINDOWS = 5, 8  # problems a city, and windows of a real one, the most built-up first
_HALF = 100.0  # of a window [m]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        folder: of a training run; None: the weights that come with maxjax.
        data: folder of public inputs.
        maps: to judge on, of the simulator and of `CITIES`.
        problems: a map, five a city.
        height: a, of the price of what is unseen.
        seed: of cities and problems.
        out: where the JSON goes.
    """

    folder: Path | None = None
    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    maps: tuple[str, ...] = ("downtown", "suburb", *CITIES)
    problems: int = 200
    height: float = 4.0
    seed: int = 5000
    out: Path = RESULTS


TINY = Config(maps=("suburb",), problems=1)


class Case(NamedTuple):
    """One scan, and what is there.

    Attributes:
        where: what was seen occupied, and the ground.
        points: returns of the scan from the start [m].
        unseen: voxels that nobody saw, ground left out.
        there: voxels of buildings, seen or not.
        start, goal: [m].
    """

    where: VoxelMap
    points: Float[np.ndarray, "r 3"]
    unseen: Volume
    there: Volume
    start: np.ndarray
    goal: np.ndarray


def main(config: Config) -> list[Row]:
    """Judge; save and return the rows."""
    loaded = None if config.folder is None else load(config.folder)
    rows: list[Row] = []
    for name in config.maps:
        plans: dict[str, list[tuple[bool, float]]] = {}
        guessed: list[np.ndarray] = []
        for k, case in enumerate(cases(name, config)):
            below = np.cumsum((case.where.occupied & ~case.where.ground)[:, :, ::-1], axis=2)[:, :, ::-1] > 0
            shown = {"free": np.zeros_like(case.unseen), "alike": case.unseen, "extruded": below, "truth": case.there}
            chances: dict[str, np.ndarray] = {
                how: (case.unseen & volume).astype(np.float32) for how, volume in shown.items()
            }
            chance = predict_unseen(case.points, case.start, case.where, loaded)
            chances["network"] = chance
            guessed.append(np.stack([chance[chance > 0], case.there[chance > 0]]))
            for how, chance in chances.items():
                plans.setdefault(how, []).append(crossing(case, chance, config.height))
            crossed = ", ".join(f"{how} {sum(crosses for crosses, _ in some)}" for how, some in plans.items())
            print(f"{name}: {k + 1} of {config.problems}, crossed: {crossed}", file=sys.stderr, flush=True)
        rows += [_plan_row(name, how, found) for how, found in plans.items()]
        rows += _calibration(name, np.concatenate(guessed, axis=1))
        save("completion", config, rows, config.out)
    return rows


def cases(name: str, config: Config) -> Iterator[Case]:
    """Scans from starts in the cities of a map."""
    geoms_of = _cities(name, config)
    for k in range(config.problems):
        number, place = divmod(k, _EACH)
        geoms = geoms_of(number)
        occupied, ground = occupancy(geoms, _GRID)
        rng = np.random.default_rng([config.seed, zlib.crc32(name.encode()), number, place])
        start, goal = draw_ends(rng, occupied, _GRID)
        seen, points = look(geoms, jnp.asarray(start), jax.random.key(config.seed + k), _GRID)
        known = np.asarray(seen.occupied) | ground
        where = VoxelMap.on(_GRID, known, ground)
        unseen = ~(known | np.asarray(seen.free))
        yield Case(where, np.asarray(points), unseen, occupied & ~ground, start, goal)


def _cities(name: str, config: Config) -> Callable[[int], Geoms]:
    """The city of a number; of a real one its windows, over and over."""
    if name not in CITIES:
        return lambda number: make_scene(name, config.seed + number).geoms
    found = windows(tuple(config.data / file for file in CITIES[name]), _HALF, TOLERANCE)[:_WINDOWS]
    slots = slots_of(found)
    return lambda number: city(found[number % len(found)].rows, slots)


def crossing(case: Case, chance: Float32[np.ndarray, "nx ny nz"], height: float) -> tuple[bool, float]:
    """Whether a plan crosses a building, and its length over the straight line; (False, NaN) without a plan.

    Args:
        case: the scan.
        chance: P(occupied), 0 where that was seen.
        height: a.
    """
    distances = raise_price(case.where, maxjax.Distances(), chance, height)
    plan = maxjax.plan(case.where, case.start, case.goal, distances=distances)
    if plan.status != maxjax.Status.OK:
        return False, float("nan")
    return _crosses(plan.path, case.there), plan.length / float(np.linalg.norm(case.goal - case.start))


def _crosses(path: np.ndarray, occupied: Bool[np.ndarray, "nx ny nz"]) -> bool:
    for a, b in itertools.pairwise(path):
        count = max(int(np.ceil(np.linalg.norm(b - a) / _EVERY)), 1)
        points = a + (b - a) * np.linspace(0, 1, count + 1)[:, None]
        if occupied[tuple(voxels_of(points, _GRID).T)].any():
            return True
    return False


def _plan_row(name: str, how: str, found: Sequence[tuple[bool, float]]) -> Row:
    lengths = np.array([length for _, length in found])
    planned = int(np.isfinite(lengths).sum())
    crossed = sum(crosses for crosses, _ in found)
    low, high = stats.binomtest(crossed, planned).proportion_ci(0.95, "exact")
    return {
        "what": "plans", "map": name, "unseen": how, "problems": len(found), "planned": planned, "crossed": crossed,
        "low": round(float(low), 4), "high": round(float(high), 4), "length": round(float(np.nanmean(lengths)), 4),
    }  # fmt: skip


def _calibration(name: str, pairs: Float[np.ndarray, "2 n"]) -> list[Row]:
    """Share of occupied voxels by predicted P, and the Brier score beside that of the mean."""
    chance, there = pairs
    place = np.minimum((chance * _BINS).astype(int), _BINS - 1)
    rows: list[Row] = []
    for k in range(_BINS):
        some = place == k
        told: Row = {"what": "reliability", "map": name, "bin": k, "voxels": int(some.sum())}
        means = (("predicted", chance), ("occupied", there)) if some.any() else ()
        rows.append({**told, **{what: round(float(values[some].mean()), 4) for what, values in means}})
    brier, of_mean = float(((chance - there) ** 2).mean()), float(there.mean() * (1 - there.mean()))
    return [*rows, {"what": "brier", "map": name, "network": round(brier, 5), "mean": round(of_mean, 5)}]


if __name__ == "__main__":
    main(configured(TINY))
