"""The closed loop by the thousand: who arrives, over what way, after how many plans, in what weather.

    python -m experiments.closed_loop --trials 50 --methods solver astar            # one H200: 3 minutes
    python -m experiments.closed_loop --trials 10000 --keep OUT --seed $((16#$(git rev-parse --short=7 HEAD)))
                                                    # fresh trials; one H100: 8 minutes, resumes
    python -m experiments.closed_loop --trials 500 --conditions wind noise dropout dead-sector blackout drift latency

The protocol of the paper's Table I (bottom), on both unseen maps: start and goal 50 to 80 m apart, 3 to 15 m high, 10 m
clear of buildings; 32,768 rays, 100 m range, at most 100 planning iterations. Success is within 2 m of the goal, never
within 0.5 m of any solid or the ground (exact distance at every physics step). `detour` is the flown length over the
straight distance, which is at most the geodesic: it bounds what is flown beyond the shortest way. With `--keep` every
trial is written as it finishes, and a run that was killed goes on.

Expected: every trial of `calm` arrives; no contact in any condition.
"""

from __future__ import annotations

import dataclasses
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.markdown import Document, device, table, trials
from benchmarks.common.paper import FLOWN
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.trials.batches import fly_trials
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.outcomes import Outcome, summarise
from maxjax.sim.vehicle.disturbances import SETS
from maxjax.ui.cli.fly_command import command_of
from maxjax.ui.methods import planner_named

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        trials: a map.
        maps: to fly in; no network was trained on them.
        methods: planners by name.
        conditions: names of `maxjax.sim.vehicle.disturbances.SETS`.
        seed: of the first city; 50 trials share a city.
        batch: flights at a time; None: what suits the device.
        name: of the result file.
        keep: folder for every trial's outcome and positions.
        out: where the JSON goes.
    """

    trials: int = 50
    maps: tuple[str, ...] = ("downtown", "suburb")
    methods: tuple[str, ...] = ("solver",)
    conditions: tuple[str, ...] = ("calm",)
    seed: int = 0
    batch: int | None = None
    name: str = "closed_loop"
    keep: Path | None = None
    out: Path = RESULTS


TINY = Config(trials=1, maps=("suburb",))


def main(config: Config, flight: FlightConfig | None = None) -> list[Row]:
    """Fly every combination; save and return a row for each.

    Args:
        config: settings.
        flight: how to fly, None: the defaults; `conditions` takes the place of its disturbances.
    """
    unknown = [name for name in config.conditions if name not in SETS]
    if unknown:
        raise ValueError(f"conditions: expected some of {', '.join(SETS)}, given {unknown[0]!r}")
    rows: list[Row] = []
    for name in config.maps:
        for method in config.methods:
            for condition in config.conditions:
                planner = planner_named(method)
                calm = FlightConfig(planner=planner) if flight is None else dataclasses.replace(flight, planner=planner)
                disturbed = dataclasses.replace(calm, disturbances=SETS[condition])
                campaign = Campaign(name, config.seed, range(config.trials), config=disturbed, command=command_of)
                folder = None if config.keep is None else config.keep / f"{name}-{method}-{condition}"
                started = time.perf_counter()
                outcomes = [o for some in fly_trials(campaign, batch=config.batch, folder=folder) for o in some]
                seconds = time.perf_counter() - started
                rows.append({"map": name, "method": method, "condition": condition, **figures_of(outcomes)})
                print(rows[-1], f"{seconds:.0f} s, compilation included", file=sys.stderr, flush=True)
                keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    return rows


def figures_of(outcomes: list[Outcome]) -> dict[str, Any]:
    """The figures of a campaign's flights, as a row holds them."""
    found = summarise(outcomes)
    worst = [f"{failure['status']}: {failure['command']}" for failure in found["failures"]]
    return {
        "trials": found["flown"],
        "arrived": found["successes"],
        "success_rate": found["success_rate"],
        "contacts": found["collisions"],
        "flown_m": found["flown_length"]["mean"],
        "flown_std_m": found["flown_length"]["std"],
        "plans": found["planning_iterations"]["mean"],
        "plans_std": found["planning_iterations"]["std"],
        "detour_mean": found["detour"]["mean"],
        "detour_p95": found["detour"]["p95"],
        "clearance_least_m": found["clearance"]["least"],
        "clearance_mean_m": found["clearance"]["mean"],
        "failed_plans": found["failed_plans"],
        "failures": "; ".join(worst) or None,
    }


_TITLES = {
    "closed_loop": "Closed loop, the paper's 50 trials a map",
    "closed_loop_many": "Closed loop, by the thousand",
    "closed_loop_disturbed": "Closed loop in bad weather",
    "closed_loop_disturbed_suburb": "Closed loop in bad weather, in the suburb",
}
_NAMES = {"solver": "field", "network": "network", "astar": "A\\*"}


def section(document: Document) -> str:
    """RESULTS.md: who arrived, how far and after how many plans; every failure."""
    rows = document["rows"]

    def spread(row: Row, name: str, std: str) -> str:
        return "–" if row[name] is None else f"{row[name]:.1f} ± {row[std]:.1f}"

    lines = [
        [
            str(row["map"]),
            f"{_NAMES[str(row['method'])]}, {row['condition']}",
            f"{row['arrived']} of {row['trials']}",
            str(row["contacts"]),
            spread(row, "flown_m", "flown_std_m"),
            spread(row, "plans", "plans_std"),
            "–" if row["detour_p95"] is None else f"{row['detour_mean']:.3f} ({row['detour_p95']:.3f})",
            "–" if row.get("clearance_mean_m") is None else f"{row['clearance_mean_m']:.2f}",
            "–" if row["clearance_least_m"] is None else f"{row['clearance_least_m']:.2f}",
        ]
        for row in rows
    ]
    if document["name"] == "closed_loop":
        lines += [
            [name, f"{method}, the paper", "50 of 50", "0", *figures, "", "", ""]
            for name, methods in FLOWN.items()
            for method, figures in methods.items()
        ]
    heads = [
        "map",
        "method",
        "arrived",
        "contacts",
        "flown [m]",
        "plans",
        "/ straight (95 %)",
        "nearest [m]",
        "nearest of all [m]",
    ]
    flown = {(row["map"], row["method"], row["condition"]): row["flown_m"] for row in rows if row["flown_m"]}
    ratios = [
        f"{name} {flown[name, 'solver', condition] / flown[name, 'astar', condition]:.3f}"
        for name, method, condition in flown
        if method == "solver" and (name, "astar", condition) in flown
    ]
    text = (
        f"### {_TITLES.get(document['name'], 'Closed loop')} ({device(document)})\n\n"
        f"These are {trials(document)}.\n"
        "Arrived: within 2 m of the goal, nothing ever within 0.5 m of the vehicle's centre. Flown length and\n"
        "plans are means ± standard deviations over arrivals; / straight: flown length over the straight line, mean\n"
        "and 95th percentile; nearest: least distance from the centre of the vehicle to anything solid, the mean over\n"
        "flights and of all of them. The paper's cities are others than ours; its figures stand beside for\n"
        "scale.\n\n" + table(heads, lines, left=2)
    )
    if ratios:
        text += f"\nFlown by the field over flown by A\\* on the same trials: {', '.join(ratios)}.\n"
    failures = [
        f"- {status}: `{command}`\n"
        for row in rows
        if row["failures"]
        for status, command in (one.split(": ", 1) for one in str(row["failures"]).split("; "))
    ]
    return text + ("\nDid not arrive, and the command that flies it again:\n\n" + "".join(failures) if failures else "")


if __name__ == "__main__":
    main(configured(TINY))
