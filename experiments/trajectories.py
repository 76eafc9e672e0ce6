"""Trajectories of random plans before judges that share no code with them: limits, radius, and time.

    python -m experiments.trajectories                     # 334 problems a map, about a thousand in all
    python -m experiments.trajectories --strangers 0 --oracles 0 --workers 8 --name trajectories_many

Problems are those of `experiments.problem_sets`, planned by the solver. Each plan is given times twice, within PX4's
limits and within the same with `FREE` for the jerk. Judged is

    limits      the greatest ratio of speed, climb, acceleration, jerk and yaw rate to its limit, every millisecond
    radius      SciPy's exact distances (`benchmarks.common.safety`), ten samples a control interval, outside the balls
    time        over toppra's on the flown curve, under the same limits of speed, climb and acceleration and the same
                speed near walls (`benchmarks.common.time_oracle`); toppra knows no limit of jerk. Between rests, summed

    jerk        with PX4's limit of jerk, for the first `oracles` of a map: over the least time on the same curve under
                all limits, by a nonlinear program (`benchmarks.common.jerk_oracle`)
    flight      with PX4's limit of jerk: in MJX with the map given (`maxjax.fly`), and the first `strangers` of a map
                by crazyflow's vehicle and controller (`benchmarks.common.crazyflow_flight`): error and contacts

Expected: no limit exceeded by more than a millionth; nothing nearer than the radius less what the judge of plans allows
(a thousandth of a voxel); 1.10 of toppra's time at most where both know the same limits, and of the nonlinear
program's; tracking errors of 0.3 m at most in 95 % of the time, and no contact.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
import multiprocessing
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import maxjax
from benchmarks.common import crazyflow_flight, safety
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.jerk_oracle import fastest_time_with_jerk
from benchmarks.common.markdown import Document, device, number, table
from benchmarks.common.time_oracle import fastest_time
from experiments.problem_sets import Instance, problem_set
from maxjax.sim.loop.trajectory_flight import summarize_tracking
from maxjax.sim.worlds.scenes import MAPS

RESULTS = Path(__file__).parent / "results"
FREE = 1000.0  # a jerk that is no limit [m/s³]
_SLACK = 1e-6  # of a limit
_ALLOWED = 4e-3  # below the radius [m]: two thousandths of a voxel, what the judge allows a plan and rounding
_HEADS = (
    "map, jerk [m/s³], trajectories, beyond a limit, below the radius, with rests, "
    "time / toppra: mean, median, 95 %, worst, above 1.10, duration [s], ms"
)
_FLOWN = (
    "map, flights, contacts, off the trajectory, error [m]: 95 % of the time, 95 % of the worst, greatest, "
    "crazyflow: flights, contacts, 95 % of the time, greatest, time / IPOPT: trajectories, mean, worst"
)
_EVERY = 0.01  # between points of the curve that toppra is given [s]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        maps: of `maxjax.sim.worlds.scenes.MAPS`.
        problems: a map.
        half: half extent of a map [m].
        seed: of cities and ends.
        strangers: trajectories of a map that crazyflow flies.
        oracles: trajectories of a map whose least time under a limit of jerk is sought.
        workers: processes that make and judge trajectories; 1: this one.
        name: of the result file.
        out: where the JSON goes.
    """

    maps: tuple[str, ...] = MAPS
    problems: int = 334
    half: float = 100.0
    seed: int = 0
    strangers: int = 30
    oracles: int = 30
    workers: int = 2
    name: str = "trajectories"
    out: Path = RESULTS


TINY = Config(maps=("suburb",), problems=1, half=40.0, strangers=1, oracles=1, workers=1)


class Asked(NamedTuple):
    """What is made and judged."""

    problem: Instance
    plan: maxjax.Plan
    jerk: float  # limit of it [m/s³]
    flown: bool
    oracle: bool  # whether the nonlinear program is solved


class Judged(NamedTuple):
    """Judgement of one trajectory."""

    excess: float  # greatest ratio to a limit
    spare: float  # least distance less the radius [m]
    ratio: float  # duration over toppra's
    duration: float  # [s]
    rests: int
    seconds: float  # that it took to make
    over_oracle: float  # duration over the nonlinear program's; NaN where it was not asked or found nothing
    trajectory: maxjax.Trajectory
    flight: maxjax.Tracking | None


def judge(asked: Asked) -> Judged:
    """Make a trajectory with this limit of jerk, judge it, and fly it if asked."""
    problem, plan, jerk = asked.problem, asked.plan, asked.jerk
    limits = maxjax.FlightLimits(jerk=jerk)
    started = time.perf_counter()
    found = maxjax.trajectory(plan, limits)
    seconds = time.perf_counter() - started
    walls = safety.Walls(problem.occupied, problem.ground, problem.grid.spacing)

    def clearance(points: np.ndarray) -> np.ndarray:
        index = (points - np.array(problem.grid.origin)) / problem.grid.spacing
        return np.asarray(problem.grid.spacing * walls.distance_at(index))

    points = found.sampled(found.step / 10.0).position
    outside = np.ones(len(points), bool)
    for end, ball in zip(plan.path[[0, -1]], plan.exemptions, strict=True):
        outside &= np.linalg.norm(points - end, axis=1) > ball
    spare = float((clearance(points[outside]) - plan.radius).min(initial=math.inf))
    fastest, least = 0.0, 0.0 if asked.oracle else math.nan
    stops = [0.0, *found.rests.tolist(), found.duration]
    for first, last in itertools.pairwise(stops):
        times = np.linspace(first, last, max(math.ceil((last - first) / _EVERY), 4))
        curve = found.at(times).position
        room = np.maximum(clearance(curve) - plan.radius, 0.0)
        caps = np.sqrt(limits.near**2 + 2.0 * limits.acceleration * room)
        fastest += fastest_time(curve, caps, limits)
        if asked.oracle:
            least += fastest_time_with_jerk(times, curve, caps, limits)
    over = found.duration / fastest, found.duration / least
    flight = None
    if asked.flown:
        flight = maxjax.fly(found, problem.map)
    return Judged(_excess(found), spare, over[0], found.duration, len(found.rests), seconds, over[1], found, flight)


def _excess(found: maxjax.Trajectory) -> float:
    """Greatest ratio to a limit, every millisecond."""
    motion, limits = found.sampled(1e-3), found.limits

    def most(values: np.ndarray) -> float:
        return float(np.linalg.norm(values, axis=1).max())

    climb = motion.velocity[:, 2]
    return max(
        most(motion.velocity) / limits.speed,
        float(climb.max()) / limits.ascent,
        -float(climb.min()) / limits.descent,
        most(motion.acceleration) / limits.acceleration,
        most(motion.jerk) / limits.jerk,
        float(np.abs(motion.yaw_rate).max()) / limits.yaw_rate,
    )


def main(config: Config) -> list[Row]:
    """Plan, make trajectories, judge, save; one row a map and limit of jerk."""
    rows: list[Row] = []
    with contextlib.ExitStack() as stack:
        each: Callable[..., Iterable[Judged]] = map
        if config.workers > 1:
            each = stack.enter_context(multiprocessing.get_context("spawn").Pool(config.workers)).imap
        for name in config.maps:
            problems = problem_set(name, config.problems, config.seed, half=config.half)
            plans = [maxjax.plan(p.map, p.start, p.goal) for p in problems]
            good = [(p, q) for p, q in zip(problems, plans, strict=True) if q.status == maxjax.Status.OK]
            for jerk in (maxjax.FlightLimits().jerk, FREE):
                ours = jerk != FREE
                asked = [Asked(p, q, jerk, ours, ours and k < config.oracles) for k, (p, q) in enumerate(good)]
                judged = list(each(judge, asked))
                rows.append({"map": name, "jerk": jerk, "problems": len(problems), **_figures(judged)})
                if ours:
                    flights = [one.flight for one in judged if one.flight is not None]
                    rows[-1] = {**rows[-1], **_flights("flown", flights), **_oracle(judged)}
                    few = [(one.trajectory, q) for one, q in zip(judged, asked, strict=True)][: config.strangers]
                    rows[-1] = {**rows[-1], **_flights("crazyflow", _by_crazyflow(few))}
                print(rows[-1], file=sys.stderr, flush=True)
                keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    return rows


def _figures(judged: Sequence[Judged]) -> Row:
    def column(name: str) -> np.ndarray:
        return np.array([getattr(one, name) for one in judged])

    ratios = column("ratio")
    known = ratios[np.isfinite(ratios)]
    return {
        "trajectories": len(judged),
        "beyond_limits": int((column("excess") > 1.0 + _SLACK).sum()),
        "largest_over_limit": float(column("excess").max()),
        "below_radius": int((column("spare") < -_ALLOWED).sum()),
        "least_over_radius_m": float(column("spare").min()),
        "resting": int((column("rests") > 0).sum()),
        "compared": len(known),
        "over_toppra_mean": float(known.mean()),
        "over_toppra_median": float(np.median(known)),
        "over_toppra_95": float(np.quantile(known, 0.95)),
        "over_toppra_worst": float(known.max()),
        "above_1_10": int((known > 1.10).sum()),
        "duration_s_mean": float(column("duration").mean()),
        "ms_median": 1e3 * float(np.median(column("seconds"))),
    }


def _by_crazyflow(asked: Sequence[tuple[maxjax.Trajectory, Asked]]) -> list[maxjax.Tracking]:
    if not asked:
        return []
    flown = crazyflow_flight.follow_setpoints([trajectory for trajectory, _ in asked])
    return [
        summarize_tracking(trajectory, *how, one.problem.map)
        for (trajectory, one), how in zip(asked, flown, strict=True)
    ]


def _flights(name: str, flights: Sequence[maxjax.Tracking]) -> Row:
    """Tracking errors [m] and contacts."""
    if not flights:
        return {name: 0}
    worst = [float(np.quantile(one.error, 0.95)) for one in flights]
    return {
        name: len(flights),
        f"{name}_contacts": sum(one.status == maxjax.Status.IN_CONTACT for one in flights),
        f"{name}_off": sum(one.status == maxjax.Status.OFF_TRAJECTORY for one in flights),
        f"{name}_lost": sum(one.status == maxjax.Status.NONFINITE_STATE for one in flights),
        f"{name}_error_95": float(np.quantile(np.concatenate([one.error for one in flights]), 0.95)),
        f"{name}_error_95_worst": max(worst),
        f"{name}_error_greatest": max(float(one.error.max()) for one in flights),
        f"{name}_clearance": min(float(one.clearance.min()) for one in flights),
    }


def _oracle(judged: Sequence[Judged]) -> Row:
    over = np.array([one.over_oracle for one in judged])
    over = over[np.isfinite(over)]
    if not len(over):
        return {"oracle": 0}
    return {"oracle": len(over), "over_oracle_mean": float(over.mean()), "over_oracle_worst": float(over.max())}


def section(document: Document) -> str:
    """RESULTS.md: one line a map and limit of jerk."""
    return (
        f"### {sum(row['trajectories'] for row in document['rows']) // 2:,} trajectories ({device(document)})\n\n"
        "PX4's limits (12 m/s, 5 m/s², climb 3 m/s, descent 1.5 m/s, 60 °/s), with its limit of jerk and with one\n"
        "that never binds. Limits every millisecond; the radius by SciPy's distances, ten samples a control interval;\n"
        "times over toppra's on the same curve, which knows no limit of jerk.\n\n"
        + table(_HEADS.split(", "), list(_lines(document["rows"])))
        + _section_of_flights([row for row in document["rows"] if row.get("flown")])
    )


def _section_of_flights(rows: Sequence[Any]) -> str:
    if not rows:
        return ""
    return (
        "\nThe same with PX4's limit of jerk, flown in MJX with the map given, and by crazyflow's vehicle and\n"
        "controller; a contact is anything within 0.5 m of the vehicle's centre, in the balls around ends the centre\n"
        "in a solid. "
        "Last, durations over the least time on the same curve under all limits, jerk included, by IPOPT.\n\n"
        + table(_FLOWN.split(", "), list(_lines_of_flights(rows)))
    )


def _lines_of_flights(rows: Sequence[Any]) -> Iterator[list[str]]:
    for row in rows:
        yield [
            row["map"],
            *(f"{row[f'flown{name}']:,}" for name in ("", "_contacts", "_off")),
            *(f"{row[f'flown_error_{name}']:.2f}" for name in ("95", "95_worst", "greatest")),
            *(f"{row.get(f'crazyflow{name}', '')}" for name in ("", "_contacts")),
            *(f"{row[key]:.2f}" if (key := f"crazyflow_error_{name}") in row else "" for name in ("95", "greatest")),
            f"{row['oracle']}",
            *(f"{row[key]:.3f}" if (key := f"over_oracle_{name}") in row else "" for name in ("mean", "worst")),
        ]


def _lines(rows: Sequence[Any]) -> Iterator[list[str]]:
    for row in rows:
        counts = [row["trajectories"], row["beyond_limits"], row["below_radius"], row["resting"]]
        ratios = [row[f"over_toppra_{name}"] for name in ("mean", "median", "95", "worst")]
        yield [
            row["map"],
            f"{row['jerk']:g}",
            *(f"{count:,}" for count in counts),
            *(f"{ratio:.3f}" for ratio in ratios),
            f"{row['above_1_10']} of {row['compared']}",
            f"{row['duration_s_mean']:.1f}",
            number(row["ms_median"]),
        ]


if __name__ == "__main__":
    main(configured(TINY))
