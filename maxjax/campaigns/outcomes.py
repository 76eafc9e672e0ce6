"""Outcomes of trials, one each, and the statistics of many.

success rate = arrivals / trials flown          detour = flown length / straight distance from start to goal
"""

from __future__ import annotations

import dataclasses
import statistics
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from maxjax.core.status import Status

# Status of a trial without a pair of ends in its city, which is not flown; it is not a member of `Status`.
INVALID_DRAW = "INVALID_DRAW"


# The arrays of a batched dataclass by field name, on the host.
Table = dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Outcome of one trial, a line of `trials.jsonl`. Lengths in metres to the millimetre.

    Attributes:
        trial: its index.
        city: seed of its city.
        status: name of a `Status`, or INVALID_DRAW.
        start, goal: [m]; None where none were found.
        distance: straight from start to goal [m].
        excluded: pairs of ends rejected because no path joins them.
        flown_length: [m].
        duration: [s].
        clearance: least distance from the centre of the vehicle to any solid [m].
        planning_iterations: number of plans.
        failed_plans: number of plans without a path.
        margins: number of plans by margin [m].
        certified: share of the paths found that climb a certified field; None without any path.
        command: command line that flies the trial again.
    """

    trial: int
    city: int
    status: str
    start: list[float] | None
    goal: list[float] | None
    distance: float | None
    excluded: int
    flown_length: float | None
    duration: float | None
    clearance: float | None
    planning_iterations: int
    failed_plans: int
    margins: dict[str, int]
    certified: float | None
    command: str

    @property
    def arrived(self) -> bool:
        """Whether the goal was reached without contact."""
        return self.status == Status.OK.name

    @property
    def flown(self) -> bool:
        """Whether the trial was flown."""
        return self.status != INVALID_DRAW


def on_host(batch: Any) -> Table:
    """The arrays of a registered dataclass by name, fetched from the device."""
    return {field.name: np.asarray(getattr(batch, field.name)) for field in dataclasses.fields(batch)}


def summarise(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The statistics of a campaign.

    Means and standard deviations (of the population, without Bessel's correction) are over arrivals, those of
    `clearance`, the least distance of each flight, over all that were flown.
    `detour` is the flown length over the straight distance, which the shortest way around the buildings exceeds.
    """
    ordered = sorted(outcomes, key=lambda outcome: outcome.trial)
    flown = [outcome for outcome in ordered if outcome.flown]
    arrived = [outcome for outcome in flown if outcome.arrived]
    detour = [float(o.flown_length) / float(o.distance) for o in arrived if o.flown_length and o.distance]
    clearances = [o.clearance for o in flown if o.clearance is not None]
    return {
        "trials": len(ordered),
        "flown": len(flown),
        "invalid_draws": len(ordered) - len(flown),
        "successes": len(arrived),
        "success_rate": len(arrived) / len(flown) if flown else None,
        "collisions": sum(outcome.status == Status.IN_CONTACT.name for outcome in flown),
        "statuses": dict(sorted(Counter(outcome.status for outcome in ordered).items())),
        "flown_length": _mean([float(o.flown_length) for o in arrived if o.flown_length is not None]),
        "planning_iterations": _mean([float(o.planning_iterations) for o in arrived]),
        "failed_plans": sum(outcome.failed_plans for outcome in flown),
        "detour": {**_mean(detour), "p95": round(float(np.percentile(detour, 95)), 4) if detour else None},
        "clearance": {"least": min(clearances, default=None), **_mean(clearances)},
        "failures": [
            {"index": outcome.trial, "status": outcome.status, "command": outcome.command}
            for outcome in flown
            if not outcome.arrived
        ],
    }


def _mean(values: list[float]) -> dict[str, float | None]:
    if not values:
        return {"mean": None, "std": None}
    return {"mean": round(statistics.fmean(values), 4), "std": round(statistics.pstdev(values), 4)}
