"""Outcomes of trials, one each, and the statistics of many.

success rate = arrivals / trials flown          detour = flown length / straight distance from start to goal
"""

from __future__ import annotations

import dataclasses
import statistics
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from maxjax.core.status import Status

# Status of a trial without a pair of ends in its city, which is not flown; it is not a member of `Status`.
INVALID_DRAW = "INVALID_DRAW"


# Fields of an outcome that flights without movers lack.
AMONG_MOVERS = ("flagged", "flagged_share", "flagged_before", "flagged_at_contact", "touched", "hidden_movers")


def _whole(value: Any) -> bool:
    return type(value) is int and abs(value) < 2**53


def _number(value: Any) -> bool:
    return _whole(value) or (type(value) is float and abs(value) < 1e12)  # NaN is not


def _table(value: Any, holds: Callable[[Any], bool]) -> bool:
    return isinstance(value, dict) and all(map(holds, value.values()))


# Whether a value that JSON held is of the kind that a field of an outcome is written as.
_KINDS: dict[str, Callable[[Any], bool]] = {
    "None": lambda value: value is None,
    "bool": lambda value: isinstance(value, bool),
    "int": _whole,
    "float": _number,
    "str": lambda value: isinstance(value, str),
    "list[float]": lambda value: isinstance(value, list) and len(value) == 3 and all(map(_number, value)),
    "dict[str, int]": lambda value: _table(value, _whole),
    "dict[str, float]": lambda value: _table(value, _number),
}


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
        flagged: among movers, the seconds that each assumption did not hold, by its name; None without movers.
        flagged_share: of the duration, that some assumption did not hold.
        flagged_before: of a contact, whether one did not within the horizon of motions before it.
        flagged_at_contact: of a contact, whether one did not at the look before it; None: not recorded.
        touched: of a contact, "wall" or "mover".
        hidden_movers: those without a way in the city.
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
    flagged: dict[str, float] | None = None
    flagged_share: float | None = None
    flagged_before: bool | None = None
    touched: str | None = None
    hidden_movers: int | None = None
    flagged_at_contact: bool | None = None

    @classmethod
    def of(cls, line: Mapping[str, Any]) -> Outcome:
        """The outcome of a line, as JSON holds it.

        Raises:
            TypeError, ValueError: for a field that is unknown, is missing, or holds another kind of value.
        """
        outcome = cls(**line)
        for field in dataclasses.fields(cls):
            kinds, value = str(field.type).split(" | "), getattr(outcome, field.name)
            if not any(_KINDS[kind](value) for kind in kinds):
                raise ValueError(f"{field.name}: expected {field.type}, given {value!r}")
        return outcome

    @property
    def arrived(self) -> bool:
        """Whether the goal was reached without contact."""
        return self.status == Status.OK.name

    @property
    def flown(self) -> bool:
        """Whether the trial was flown."""
        return self.status != INVALID_DRAW

    @property
    def line(self) -> dict[str, Any]:
        """As JSON holds it: without what only flights among movers have, where there were none."""
        told = dataclasses.asdict(self)
        return {name: value for name, value in told.items() if name not in AMONG_MOVERS or value is not None}


def on_host(batch: Any) -> Table:
    """The arrays of a registered dataclass by name, fetched from the device.

    Those of a dataclass in it are named after both, those of a tuple after their class, as in `flags.seconds`;
    what is None is left out.
    """
    found: Table = {}
    for field in dataclasses.fields(batch):
        value = getattr(batch, field.name)
        if dataclasses.is_dataclass(value):
            found |= {f"{field.name}.{name}": array for name, array in on_host(value).items()}
        elif isinstance(value, tuple):
            for part in value:
                found |= {f"{type(part).__name__.lower()}.{name}": array for name, array in on_host(part).items()}
        elif value is not None:
            found[field.name] = np.asarray(value)
    return found


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
    among = [outcome for outcome in flown if outcome.flagged is not None]
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
        **({"movers": _among_movers(among)} if among else {}),
    }


def _among_movers(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Figures of flags among movers; contacts are those with movers, times are summed over all flights."""
    seconds: Counter[str] = Counter()
    for outcome in outcomes:
        seconds.update(outcome.flagged or {})
    contacts = [outcome for outcome in outcomes if outcome.touched == "mover"]
    duration = sum(outcome.duration or 0.0 for outcome in outcomes)
    told = all(one.flagged_at_contact is not None for one in contacts)
    flagged = sum((outcome.flagged_share or 0.0) * (outcome.duration or 0.0) for outcome in outcomes)
    return {
        "contacts": len(contacts),
        "contacts_with_walls": sum(outcome.touched == "wall" for outcome in outcomes),
        "contacts_without_a_flag": sum(not outcome.flagged_before for outcome in contacts),
        "contacts_without_a_flag_at_the_moment": sum(not one.flagged_at_contact for one in contacts) if told else None,
        "flagged_seconds": {cause: round(total, 3) for cause, total in seconds.items()},
        "flagged_share": round(flagged / duration, 5) if duration else None,
        "hidden": sum(outcome.hidden_movers or 0 for outcome in outcomes),
    }


def _mean(values: list[float]) -> dict[str, float | None]:
    if not values:
        return {"mean": None, "std": None}
    return {"mean": round(statistics.fmean(values), 4), "std": round(statistics.pstdev(values), 4)}
