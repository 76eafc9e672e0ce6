"""How far paths keep from walls, how far they could have kept, and what they pay: every planner on the same problems.

    python -m experiments.clearance                                      # 1,000 problems a map, 200 a surveyed city
    python -m experiments.clearance --variants ablation --problems 100 --street 50 --name clearance_ablation
    python -m experiments.clearance --problems 100 --street 50

Problems are those of `experiments.problem_sets`, paths are judged by `benchmarks.common.safety`, which shares no code
with maxjax. A path is asked to keep 4 m away from the ends (outside balls of 10 m) where a way exists that keeps them
and is at most `DETOUR` times as long as the shortest; likewise 8 m. Costs are those of the variant's own prices, where
it says none those of the planner's default; they are compared with the cheapest 26-neighbour way and with fast
marching.

Plans and judgements are kept by blocks of problems (`experiments.blocks`): the same command goes on where it was ended.

Expected of the solver: all solvable problems OK and certified, none unsafe; where 4 m are possible at most 1 % keep
less and none less than 2 m; at least 7 m in the median where 8 m are; in the mean at most
0.98 of the cheapest way (worst 1.05) and 1.02 of fast marching.
"""

from __future__ import annotations

import dataclasses
import itertools
import multiprocessing
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import maxjax
from benchmarks.common import safety
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, provenance, save
from benchmarks.common.markdown import Document, device, number, table
from experiments.blocks import Blocks
from experiments.problem_sets import DATA, SETS, Instance, problem_set
from maxjax.fields.price import Price
from maxjax.ui.methods import planner_named

RESULTS = Path(__file__).parent / "results"
DETOUR = 1.2
ASKED = (2.0, 4.0, 8.0)  # clearances that ways are looked for with [m]
BLOCK = 50  # problems that are planned and judged before they are kept; whole cities
_SLACK = 1e-3  # rounding of a path's coordinates [m]


@dataclasses.dataclass(frozen=True)
class Variant:
    """A way to call `maxjax.plan`; None: its default.

    Attributes:
        method: by name.
        margin, radius: [m].
        price: shape and height.
    """

    method: str = "solver"
    margin: float = 8.0
    radius: float | None = None
    price: tuple[str, float] | None = None

    @property
    def options(self) -> dict[str, Any]:
        """Arguments of `maxjax.plan`."""
        radius = maxjax.Distances().radius if self.radius is None else self.radius
        price = Price() if self.price is None else Price(*self.price)  # type: ignore[arg-type]
        distances = maxjax.Distances(radius, self.margin, price)
        return {"planner": planner_named(self.method), "distances": distances}

    @property
    def priced(self) -> tuple[str, float, float]:
        """Shape, height and margin of the price that its paths are judged by."""
        shape, height = self.price or (Price().shape, Price().height)
        return shape, height, self.margin


VARIANTS = {name: Variant(name) for name in ("solver", "network", "astar", "rrtstar", "apf")}
ABLATION = {
    **{
        f"{shape} {height:g}": Variant(price=(shape, height))
        for shape, height in itertools.product(("quadratic", "exponential", "speed"), (1.0, 2.0, 4.0, 8.0, 16.0))
    },
    **{f"margin {margin:g}": Variant(margin=margin) for margin in (4.0, 6.0, 12.0, 16.0)},
    **{f"radius {radius:g}": Variant(radius=radius) for radius in (0.0, 2.0)},
}
VARIANTS |= ABLATION


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        sets: of problems.
        problems: a set of random problems.
        street: problems of a surveyed city.
        variants: names of `VARIANTS`, or `ablation` for all of `ABLATION`.
        half: half extent of a map [m].
        seed: of cities and ends.
        workers: processes that judge.
        data: folder of public inputs.
        name: of the result file.
        out: where the JSON goes.
    """

    sets: tuple[str, ...] = SETS
    problems: int = 1000
    street: int = 200
    variants: tuple[str, ...] = ("solver", "astar")
    half: float = 100.0
    seed: int = 0
    workers: int = 2
    data: Path = DATA
    name: str = "clearance"
    out: Path = RESULTS

    @property
    def named(self) -> dict[str, Variant]:
        """The variants."""
        names = [n for given in self.variants for n in (ABLATION if given == "ablation" else (given,))]
        return {name: VARIANTS[name] for name in names}


TINY = Config(sets=("suburb",), problems=2, half=40.0)


class Outcome(NamedTuple):
    """What a planner made of a problem; `path` is (t, 3) in index coordinates, empty if it found none."""

    status: int
    certified: bool
    path: np.ndarray
    radius: float = 0.0
    balls: tuple[float, float] = (0.0, 0.0)
    potential: str = ""
    seconds: float = np.nan


class Case(NamedTuple):
    """Problems of one city, with the outcomes of every variant; what a worker judges."""

    occupied: np.ndarray
    ground: np.ndarray
    spacing: float
    ends: list[tuple[np.ndarray, np.ndarray]]
    outcomes: dict[str, list[Outcome]]
    prices: dict[str, tuple[str, float, float]]


class Judged(NamedTuple):
    """Judgement of one outcome, in metres; NaN without a path. The ways are infinite where there is none."""

    solvable: bool
    ways: tuple[float, ...]  # with the clearances of `ASKED`
    length: float = np.nan
    least: float = np.nan
    cruise: float = np.nan
    unsafe: bool = False
    cost: float = np.nan
    cheapest: float = np.nan
    marched: float = np.nan


def judge(case: Case) -> dict[str, list[Judged]]:
    """Judge all outcomes of one city, by variant."""
    walls = safety.Walls(case.occupied, case.ground, case.spacing)
    prices = {
        priced: safety.price(case.spacing * walls.distance, priced[2], *priced[:2])
        for priced in set(case.prices.values())
    }
    found: dict[str, list[Judged]] = {name: [] for name in case.outcomes}
    for k, (start, goal) in enumerate(case.ends):
        one, other = (walls.labels[tuple(np.floor(end + 0.5).astype(int))] for end in (start, goal))
        solvable = bool(one == other != 0)
        shortest = safety.way(walls, start, goal) if solvable else np.inf
        ways = tuple(
            case.spacing * safety.way(walls, start, goal, c / case.spacing, DETOUR * shortest) if solvable else np.inf
            for c in ASKED
        )
        optima: dict[tuple[str, float, float], tuple[float, float]] = {}
        for name, outcomes in case.outcomes.items():
            priced, outcome = case.prices[name], outcomes[k]
            if not len(outcome.path):
                found[name].append(Judged(solvable, ways))
                continue
            n = prices[priced]
            if priced not in optima:
                cheapest = safety.cheapest(walls, start, goal, n)
                optima[priced] = cheapest, safety.marched(walls, start, goal, n, cheapest)
            found[name].append(_judged(walls, outcome, n, Judged(solvable, ways), optima[priced]))
    return found


def _judged(
    walls: safety.Walls, outcome: Outcome, prices: np.ndarray, problem: Judged, optima: tuple[float, float]
) -> Judged:
    h, path = walls.spacing, outcome.path
    kept = safety.kept(walls, path, (outcome.balls[0] / h, outcome.balls[1] / h))
    below = outcome.radius > 0 and (kept.below or h * kept.outside < outcome.radius - _SLACK)
    return problem._replace(
        length=h * float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
        least=h * kept.least,
        cruise=h * kept.cruise,
        unsafe=kept.occupied or below,
        cost=h * safety.cost(path, prices),
        cheapest=h * optima[0],
        marched=h * optima[1],
    )


class Found(NamedTuple):
    """What planners made of some problems, and how that was judged; by variant."""

    outcomes: dict[str, list[Outcome]]
    judged: dict[str, list[Judged]]


def main(config: Config) -> list[Row]:
    """Plan, judge, save; one row a set and variant."""
    rows: list[Row] = []
    told = {key: getattr(config, key) for key in ("problems", "street", "half", "seed", "variants")}
    blocks = Blocks(config.out / f"{config.name}.partial", {"commit": provenance()["commit"], **told})
    with multiprocessing.get_context("spawn").Pool(config.workers) as pool:
        for name in config.sets:
            count = config.street if name not in SETS[:3] else config.problems
            instances = problem_set(name, count, config.seed, half=config.half, data=config.data)
            found = found_in(name, instances, config, blocks, pool.imap)
            for variant, judged in found.judged.items():
                rows.append({"set": name, "variant": variant, **_figures(found.outcomes[variant], judged)})
                print(rows[-1], file=sys.stderr, flush=True)
            keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    blocks.remove()
    return rows


def found_in(
    name: str,
    instances: Sequence[Instance],
    config: Config,
    blocks: Blocks,
    mapped: Callable[[Callable[[Case], Any], list[Case]], Iterable[dict[str, list[Judged]]]] = map,
) -> Found:
    """What is found in a set: by block kept from an earlier run, or planned and judged; `mapped` as in `judged_by`."""
    variants = config.named
    parts = []
    for first in range(0, len(instances), BLOCK):
        some, at = instances[first : first + BLOCK], f"{name}, {first + 1} to {min(first + BLOCK, len(instances))}"
        block = blocks.kept(at)
        if block is None:
            outcomes = {variant: [outcome_of(one, how) for one in some] for variant, how in variants.items()}
            prices = {variant: how.priced for variant, how in variants.items()}
            parts.append(Found(outcomes, judged_by(some, outcomes, prices, mapped)))
            blocks.keep(at, _listed(parts[-1]))
        else:
            parts.append(_unlisted(block))
        print(at, file=sys.stderr, flush=True)
    outcomes = {key: [one for part in parts for one in part.outcomes[key]] for key in parts[0].outcomes}
    return Found(outcomes, {key: [one for part in parts for one in part.judged[key]] for key in outcomes})


def _listed(found: Found) -> dict[str, Any]:
    """As JSON holds it."""
    return {
        "outcomes": {key: [o._replace(path=o.path.tolist()) for o in some] for key, some in found.outcomes.items()},
        "judged": found.judged,
    }


def _unlisted(block: Mapping[str, Any]) -> Found:
    """What `_listed` gave."""

    def outcome(status: int, certified: bool, path: list[list[float]], *rest: Any) -> Outcome:
        radius, balls, *others = rest
        return Outcome(status, certified, np.array(path, float).reshape(-1, 3), radius, (balls[0], balls[1]), *others)

    def judged(solvable: bool, ways: list[float], *rest: Any) -> Judged:
        return Judged(solvable, tuple(ways), *rest)

    return Found(
        {key: [outcome(*row) for row in rows] for key, rows in block["outcomes"].items()},
        {key: [judged(*row) for row in rows] for key, rows in block["judged"].items()},
    )


def outcome_of(instance: Instance, how: Variant) -> Outcome:
    """Plan a problem."""
    plan = maxjax.plan(instance.map, instance.start, instance.goal, **how.options)
    path = (plan.path - np.array(instance.grid.origin)) / instance.grid.spacing
    claims = plan.radius, plan.exemptions, plan.stats.potential
    return Outcome(int(plan.status), plan.certified, path, *claims, plan.timings["total"])


def judged_by(
    instances: Sequence[Instance],
    outcomes: Mapping[str, list[Outcome]],
    prices: dict[str, tuple[str, float, float]],
    mapped: Callable[[Callable[[Case], Any], list[Case]], Iterable[dict[str, list[Judged]]]] = map,
) -> dict[str, list[Judged]]:
    """Judge outcomes, by variant, in the order of the problems; `mapped` goes through the cities, which share maps."""
    cities: dict[int, list[int]] = {}
    for k, one in enumerate(instances):
        cities.setdefault(id(one.map), []).append(k)
    cases = []
    for members in cities.values():
        first = instances[members[0]]
        origin, h = np.array(first.grid.origin), first.grid.spacing
        ends = [((instances[k].start - origin) / h, (instances[k].goal - origin) / h) for k in members]
        own = {name: [given[k] for k in members] for name, given in outcomes.items()}
        cases.append(Case(first.occupied, first.ground, h, ends, own, prices))
    found: dict[str, dict[int, Judged]] = {name: {} for name in outcomes}
    for members, part in zip(cities.values(), mapped(judge, cases), strict=True):
        for name, judged in part.items():
            found[name] |= dict(zip(members, judged, strict=True))
    return {name: [judged[k] for k in range(len(instances))] for name, judged in found.items()}


def _figures(outcomes: Sequence[Outcome], judged: Sequence[Judged]) -> Row:
    """Figures of one variant on one set."""
    ok = np.array([len(o.path) > 0 for o in outcomes])
    field = {name: np.array([getattr(j, name) for j in judged]) for name in ("length", "least", "cruise", "cost")}
    cruise = np.where(np.isfinite(field["cruise"]), field["cruise"], np.nan)
    ways = np.array([j.ways for j in judged])
    possible = {c: ok & np.isfinite(ways[:, k]) & np.isfinite(cruise) for k, c in enumerate(ASKED)}
    optima = {name: np.array([getattr(j, name) for j in judged]) for name in ("cheapest", "marched")}
    names = Counter(maxjax.Status(o.status).name for o in outcomes if o.status != maxjax.Status.OK)
    figures: dict[str, Any] = {
        "problems": len(outcomes),
        "solvable": sum(j.solvable for j in judged),
        "ok": int(ok.sum()),
        "certified": sum(o.certified for o in outcomes),
        "geodesic": sum(o.potential == "geodesic" for o in outcomes),
        "unsafe": sum(j.unsafe for j in judged),
        "failures": ", ".join(f"{count} {name}" for name, count in names.most_common()) or None,
        "balls": sum(max(o.balls) > 0 for o in outcomes),
        "ball_most_m": round(max(max(o.balls) for o in outcomes), 2),
        "plan_ms_median": _number([1e3 * o.seconds for o in outcomes], 2, np.nanmedian),
        "length_m": _number(field["length"], 2),
        "clearance_m": _number(field["least"], 2),
        "cruise_m": _number(cruise, 2),
        **{f"cruise_p{q}_m": _number(cruise, 2, lambda x, q=q: np.nanpercentile(x, q)) for q in (1, 10, 50, 90)},
        "cruise_least_m": _number(cruise, 3, np.nanmin),
        **{f"possible_{c:g}": int(possible[c].sum()) for c in ASKED},
        "below_4": int((cruise[possible[4.0]] < 4 - _SLACK).sum()),
        "below_2": int((cruise[possible[4.0]] < 2 - _SLACK).sum()),
        "below_2_of_2": int((cruise[possible[2.0]] < 2 - _SLACK).sum()),
        "kept_where_8_m": _number(cruise[possible[8.0]], 2, np.nanmedian),
    }
    for name, optimum in optima.items():
        figures[f"over_{name}_mean"] = _number(field["cost"] / optimum, 4)
        figures[f"over_{name}_worst"] = _number(field["cost"] / optimum, 4, np.nanmax)
    return figures


def _number(values: Any, digits: int, of: Any = np.nanmean) -> float | None:
    """A figure over what is not NaN; None where nothing is."""
    values = np.asarray(values, float)
    return round(float(of(values)), digits) if np.isfinite(values).any() else None


def section(document: Document) -> str:
    """RESULTS.md: clearance where it was possible, and costs."""
    rows = document["rows"]

    def text(value: float | None, form: str) -> str:
        return "–" if value is None else format(value, form)

    def share(row: Mapping[str, Any], key: str) -> str:
        return f"{row[key]} of {row['possible_4']}"

    safe = [
        [
            row["set"],
            row["variant"],
            f"{row['ok']:,} of {row['solvable']:,}",
            f"{row['certified']:,}",
            str(row["unsafe"]),
            text(row["clearance_m"], ".2f"),
            text(row["cruise_m"], ".2f"),
            text(row["cruise_p10_m"], ".2f"),
            text(row["cruise_least_m"], ".2f"),
            share(row, "below_4"),
            share(row, "below_2"),
            text(row["kept_where_8_m"], ".2f"),
        ]
        for row in rows
    ]
    heads = ["problems", "planner", "OK", "certified", "unsafe", "least [m]", "cruise [m]", "10 % below", "worst"]
    heads += ["under 4 m", "under 2 m", "where 8 m"]
    paid = [
        [
            row["set"],
            row["variant"],
            text(row["length_m"], ".1f"),
            f"{text(row['over_cheapest_mean'], '.3f')} ({text(row['over_cheapest_worst'], '.3f')})",
            f"{text(row['over_marched_mean'], '.3f')} ({text(row['over_marched_worst'], '.3f')})",
            f"{row['balls']} ({row['ball_most_m']:g})",
            "–" if row["plan_ms_median"] is None else number(row["plan_ms_median"]),
        ]
        for row in rows
    ]
    costs = ["problems", "planner", "length [m]", "cost / Dijkstra's", "cost / fast marching's"]
    costs += ["balls [m]", "ms"]
    missing = [f"- {row['set']}, {row['variant']}: {row['failures']}\n" for row in rows if row["failures"]]
    title = "Clearance, by price" if document["name"].endswith("ablation") else "Clearance"
    return (
        f"### {title} ({device(document)})\n\n"
        "Judged by SciPy's distance transform, k-d tree, labels and Dijkstra and by scikit-fmm, on paths sampled\n"
        "every 10 cm. `least` and `cruise`: mean of the paths' least distances to the cubes of solid voxels, anywhere\n"
        "and farther than 10 m from both ends; `10 % below` and `worst` are of the latter. `under 4 m` and\n"
        "`under 2 m`: paths that keep less there, of those problems where a way keeps 4 m at no more than\n"
        f"{DETOUR:g} times the length of the shortest; `where 8 m`: median kept where such a way keeps 8 m.\n"
        "\n"
        + table(heads, safe, left=2)
        + "\nWhat paths cost at prices of their own (of the planner's default, where they knew none) over the\n"
        "cheapest 26-neighbour way and over fast marching, mean and, in brackets, worst; ends that needed a ball to\n"
        "leave by, and the largest; median of a whole plan.\n"
        "\n" + table(costs, paid, left=2) + ("\nWithout a path:\n\n" + "".join(missing) if missing else "")
    )


if __name__ == "__main__":
    main(configured(TINY))
