"""Flights that plan in windows beside the same flights that plan in whole maps: outcome, length, nearest approach.

    python -m experiments.windowed_flights                        # two CPU cores: 20 minutes a map
    python -m experiments.windowed_flights --keep OUT             # resumes

Trials of the closed loop (`experiments.closed_loop`), each flown twice with the same key. A flight in windows solves in
each iteration the smallest window that proves its cheapest way; the paths are the same to the solver's accuracy, so
that two flights drift apart by millimetres at first, and by more where a detail decides.

Expected: the same outcome for every trial; lengths equal to 0.5 % in the mean.
"""

from __future__ import annotations

import dataclasses
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.markdown import Document, device, table
from maxjax.core.status import Status
from maxjax.planners import Field
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.trials.batches import fly_trials
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.outcomes import Outcome
from maxjax.ui.cli.fly_command import command_of

RESULTS = Path(__file__).parent / "results"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        trials: a map.
        maps: to fly in.
        seed: of the first city.
        keep: folder for every trial's outcome and positions; None: one that is removed again.
        out: where the JSON goes.
    """

    trials: int = 150
    maps: tuple[str, ...] = ("downtown", "suburb")
    seed: int = 0
    keep: Path | None = None
    out: Path = RESULTS


TINY = Config(trials=1, maps=("suburb",))


def main(config: Config, flight: FlightConfig | None = None) -> list[Row]:
    """Fly all trials twice; save and return a row a map.

    Args:
        config: settings.
        flight: how to fly, None: the defaults; `focus` of its planner takes both values.
    """
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        for name in config.maps:
            folder = config.keep or Path(scratch)
            windowed, whole = (_flown(config, flight, name, focus, folder) for focus in (True, False))
            rows.append({"map": name, **compared(windowed, whole)})
            print(rows[-1], file=sys.stderr, flush=True)
            keep("windowed_flights", config, rows, config.out)
    save("windowed_flights", config, rows, config.out)
    return rows


def _flown(config: Config, flight: FlightConfig | None, name: str, focus: bool, folder: Path) -> dict[int, Outcome]:
    how = dataclasses.replace(flight or FlightConfig(planner=Field()), planner=Field(focus=focus))
    campaign = Campaign(name, config.seed, range(config.trials), config=how, command=command_of)
    place = folder / f"{name}-{'windows' if focus else 'whole'}"
    return {o.trial: o for some in fly_trials(campaign, folder=place) for o in some}


def compared(windowed: dict[int, Outcome], whole: dict[int, Outcome]) -> dict[str, Any]:
    """How flights of the same trials differ; lengths of those that arrived both times."""
    trials = [k for k in windowed if windowed[k].flown_length is not None]
    both = [k for k in trials if windowed[k].status == whole[k].status == Status.OK.name]
    ratios = [windowed[k].flown_length / whole[k].flown_length for k in both]  # type: ignore[operator]
    return {
        "trials": len(trials),
        "same_status": sum(windowed[k].status == whole[k].status for k in trials),
        "arrived": len(both),
        "contacts": sum(o.status == Status.IN_CONTACT.name for k in trials for o in (windowed[k], whole[k])),
        "flown_m": round(statistics.mean(windowed[k].flown_length or 0.0 for k in both), 3),
        "flown_whole_m": round(statistics.mean(whole[k].flown_length or 0.0 for k in both), 3),
        "ratio_mean": round(statistics.mean(ratios), 5),
        "ratio_worst": round(max(ratios, key=lambda ratio: abs(ratio - 1)), 4),
        "plans": round(statistics.mean(windowed[k].planning_iterations for k in both), 3),
        "plans_whole": round(statistics.mean(whole[k].planning_iterations for k in both), 3),
        "clearance_least_m": min(windowed[k].clearance or 0.0 for k in trials),
        "clearance_least_whole_m": min(whole[k].clearance or 0.0 for k in trials),
    }


def section(document: Document) -> str:
    """RESULTS.md: outcomes and lengths, in windows and in whole maps."""
    where = device(document)
    lines = [
        [
            str(row["map"]),
            f"{row['same_status']} of {row['trials']}",
            f"{row['arrived']}",
            f"{row['contacts']}",
            f"{row['flown_m']:.2f} ({row['flown_whole_m']:.2f})",
            f"{row['ratio_mean']:.4f}",
            f"{row['ratio_worst']:.3f}",
            f"{row['plans']:.2f} ({row['plans_whole']:.2f})",
            f"{row['clearance_least_m']:.2f} ({row['clearance_least_whole_m']:.2f})",
        ]
        for row in document["rows"]
    ]
    heads = [
        "map",
        "same outcome",
        "arrived",
        "contacts",
        "flown [m]",
        "ratio",
        "farthest from 1",
        "plans",
        "nearest [m]",
    ]
    return (
        f"### Flights in windows\n\nThe same trials planned in windows, in brackets in whole maps; on {where}.\n\n"
        + table(heads, lines)
    )


if __name__ == "__main__":
    main(configured(TINY))
