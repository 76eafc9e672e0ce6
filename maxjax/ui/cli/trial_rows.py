"""The summary of trials as the rows of a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from maxjax.sim.trials.outcomes import Outcome


def trial_rows(content: dict[str, Any], outcomes: Sequence[Outcome]) -> dict[str, str]:
    """Rows of figures by their names; some are empty.

    Args:
        content: of the summary.
        outcomes: that it is of.
    """

    def spread(name: str, unit: str = "") -> str:
        mean, std = content[name]["mean"], content[name]["std"]
        return "" if mean is None else f"{mean:.1f} ± {std:.1f}{unit}"

    rate, least = content["success_rate"], content["clearance"]["least"]
    rows = {
        "trials": str(content["trials"]),
        "without a pair of ends": str(content["invalid_draws"] or ""),
        "arrived": "" if rate is None else f"{content['successes']} of {content['flown']} ({100 * rate:.2f} %)",
        "collisions": str(content["collisions"]),
        "flown length": spread("flown_length", " m"),
        "planning iterations": spread("planning_iterations"),
        "plans without a path": str(content["failed_plans"]),
        "least clearance": "" if least is None else f"{least:.2f} m",
    }
    if among := content.get("movers"):
        causes = {cause: seconds for cause, seconds in among["flagged_seconds"].items() if seconds}
        told = ", ".join(f"{cause} {seconds:.1f} s" for cause, seconds in causes.items())
        at_once = among.get("contacts_without_a_flag_at_the_moment")
        rows |= {
            "contacts with movers": str(among["contacts"]),
            "without a flag before": str(among["contacts_without_a_flag"]),
            "no flag at the moment": "" if at_once is None else str(at_once),
            "flagged time": "" if among["flagged_share"] is None else f"{100 * among['flagged_share']:.2f} %",
            "flagged, by cause": told,
            "movers without a way": str(among["hidden"] or ""),
        }
    if len(outcomes) == 1:
        (one,) = outcomes
        rows |= {
            "status": one.status,
            "straight line": "" if one.distance is None else f"{one.distance:.1f} m",
            "duration": "" if one.duration is None else f"{one.duration:.1f} s",
        }
    return rows
