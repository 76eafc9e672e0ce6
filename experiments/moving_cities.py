"""Closed loop among movers in the synthetic cities, and what they cost: time, and time in which nothing is promised.

    python -m experiments.moving_cities --trials 8                            # two cores: 20 minutes
    python -m experiments.moving_cities --trials 1000 --batch 250 --keep OUT  # one GPU; resumes

Cities, ends and movers are those of `maxjax fly MAP --movers N --mover-speed V --mover-kind K`; every trial is the same
without movers, and among any. Pilots:

    ours      motions that are verified against what the vehicle's own LiDAR shows
    true      the same, told the place, velocity and shape of every mover within reach
    oracle    the same, told their ways for as long as a motion lasts: what is left is what the choice of motions costs
    orca      `experiments.orca`, by its own LiDAR as ours
    unaware   the planner of static worlds, for which movers are nothing but returns

Time: mean over trials that arrive both ways, over that without movers. Flagged: share of the time in which an
assumption was known not to hold. Contacts by exact distance at every physics step, within 0.5 m. Bounds are those of
Clopper and Pearson, 95 %.

Expected: nearly every trial arrives, with no contact that was not flagged before.
"""

from __future__ import annotations

import dataclasses
import itertools
import statistics
import sys
from pathlib import Path
from typing import Any, Literal

from scipy.stats import beta

from benchmarks.common.command import configured
from benchmarks.common.harness import Row, keep, save
from benchmarks.common.markdown import Document, device, table, trials
from experiments.orca import orca
from maxjax.planners import Field
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.movers.true_tracks import TrueTracks
from maxjax.sim.trials.batches import fly_trials
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.outcomes import Outcome, summarise
from maxjax.sim.worlds.populations import Population
from maxjax.ui.cli.fly_command import command_of

RESULTS = Path(__file__).parent / "results"
Pilot = Literal["ours", "true", "oracle", "orca", "unaware"]
# Acceleration that sets of known ways grow by [m/s²].
_NONE = 1e-3


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        trials: of each row.
        pilots: who flies.
        maps: to fly in.
        counts: of movers.
        speeds: greatest ones [m/s].
        kinds: of movers; encounters pass the vehicle's way when it is there.
        seed: of the first city.
        batch: flights at a time; None: what suits the device.
        name: of the result file.
        keep: folder for every trial's outcome and positions.
        out: where the JSON goes.
    """

    trials: int = 8
    pilots: tuple[Pilot, ...] = ("ours", "unaware")
    maps: tuple[str, ...] = ("downtown",)
    counts: tuple[int, ...] = (10, 30)
    speeds: tuple[float, ...] = (2.0, 5.0, 8.0)
    kinds: tuple[str, ...] = ("drones", "encounters")
    seed: int = 0
    batch: int | None = None
    name: str = "moving_cities"
    keep: Path | None = None
    out: Path = RESULTS


TINY = Config(trials=1, pilots=("ours",), maps=("suburb",), counts=(3,), speeds=(2.0,), kinds=("drones",))


@dataclasses.dataclass(frozen=True)
class Piloted(Campaign):
    """A campaign that some pilot flies."""

    pilot: Pilot = dataclasses.field(default="ours", kw_only=True)

    @property
    def flight(self) -> FlightConfig:
        """How to fly."""
        return by_pilot(super().flight, self.pilot)


def by_pilot(flight: FlightConfig, pilot: Pilot) -> FlightConfig:
    """The same flight by a pilot."""
    if pilot == "unaware":
        return dataclasses.replace(flight, extensions=())
    moving = flight.extension(Avoidance)
    told = TrueTracks(future=moving.choice.horizon if pilot == "oracle" else 0.0)
    changes: dict[Pilot, dict[str, Any]] = {
        "orca": {"chooser": orca},
        "true": {"perception": told},
        # Sets of movers whose ways are known grow by nothing else.
        "oracle": {"perception": told, "bounds": dataclasses.replace(moving.bounds, acceleration=_NONE)},
    }
    return flight.with_extension(dataclasses.replace(moving, **changes.get(pilot, {})))


def main(config: Config, flight: FlightConfig | None = None) -> list[Row]:
    """Fly every row; save and return them.

    Args:
        config: settings.
        flight: how to fly; None: the defaults.
    """
    how = FlightConfig(planner=Field()) if flight is None else flight
    rows: list[Row] = []
    every = range(config.trials)
    for name in config.maps:
        alone = _flown(Campaign(name, config.seed, every, config=how, command=command_of), f"{name}-alone", config)
        rows.append({"map": name, "movers": 0, "kind": None, "speed": None, "pilot": "ours", **_figures(alone, alone)})
        for pilot, movers in itertools.product(config.pilots, _among(config)):
            campaign = Piloted(name, config.seed, every, config=how, movers=movers, command=command_of, pilot=pilot)
            row: Row = {"map": name, "movers": movers.count, "kind": movers.kind, "speed": movers.speed, "pilot": pilot}
            folder = "-".join(str(value) for value in row.values())
            rows.append({**row, **_figures(_flown(campaign, folder, config), alone)})
            print(rows[-1], file=sys.stderr, flush=True)
            keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    return rows


def _among(config: Config) -> list[Population]:
    cells = itertools.product(config.kinds, config.counts, config.speeds)
    return [Population(count, speed, kind) for kind, count, speed in cells]


def _flown(campaign: Campaign, name: str, config: Config) -> list[Outcome]:
    folder = None if config.keep is None else config.keep / name
    flown = [outcome for some in fly_trials(campaign, batch=config.batch, folder=folder) for outcome in some]
    return sorted(flown, key=lambda outcome: outcome.trial)


def _figures(outcomes: list[Outcome], alone: list[Outcome]) -> Row:
    found = summarise(outcomes)
    flown, arrived = int(found["flown"]), int(found["successes"])
    both = [
        (float(one.duration), float(other.duration))
        for one, other in zip(outcomes, alone, strict=True)
        if one.arrived and other.arrived and one.duration and other.duration
    ]
    among = found.get("movers", {})
    return {
        "flights": flown,
        "arrived": arrived,
        "at_least": round(float(100.0 * beta.ppf(0.025, arrived, flown - arrived + 1)), 1) if arrived else 0.0,
        "contacts": found["collisions"],
        "unflagged": among.get("contacts_without_a_flag"),
        "unflagged_at_contact": among.get("contacts_without_a_flag_at_the_moment"),
        "seconds": round(statistics.fmean(ours for ours, _ in both), 2) if both else None,
        "ratio": round(sum(ours for ours, _ in both) / sum(other for _, other in both), 3) if both else None,
        "flagged": among.get("flagged_share"),
        "least_m": found["clearance"]["least"],
        "again": "; ".join(failure["command"] for failure in found["failures"][:20]) or None,
    }


_PILOTS = {"ours": "ours", "true": "told", "oracle": "oracle", "orca": "ORCA", "unaware": "unaware"}
_TITLES = {"moving_encounters": "Encounters on the way of the vehicle", "moving_suburb": "Movers in the suburb"}


def section(document: Document) -> str:
    """RESULTS.md: who arrives among whom, how much later, and what was flagged."""
    lines = []
    for row in document["rows"]:
        lines.append([
            str(row["map"]), f"{row['movers']} {row['kind']}" if row["movers"] else "none",
            "–" if row["speed"] is None else f"{row['speed']:g}",
            _PILOTS[row["pilot"]] if row["movers"] else "alone", f"{row['arrived']} of {row['flights']}",
            f"{row['at_least']:.1f}", str(row["contacts"]), counted(row, "unflagged"),
            counted(row, "unflagged_at_contact"),
            "–" if row["ratio"] is None else f"{row['ratio']:.2f}",
            "–" if row["flagged"] is None else f"{100 * row['flagged']:.1f}",
        ])  # fmt: skip
    heads = ["map", "movers", "speed [m/s]", "pilot", "arrived", "at least [%]", "contacts", "unflagged",
             "no flag then", "time / alone", "flagged [%]"]  # fmt: skip
    failures = [
        f"- `{one}`\n" for row in document["rows"] if row["pilot"] == "ours" and row["again"] for one in _some(row)
    ]
    return (
        f"### {_TITLES.get(document['name'], 'Cities with movers')} ({device(document)})\n\n"
        f"These are {trials(document)}.\n"
        "Ours: motions verified against what the vehicle's own LiDAR shows. Told: the same by places and velocities\n"
        "of all movers. Oracle: the same by their ways for the time that a motion lasts. ORCA: on the tracks of ours.\n"
        "Unaware: the planner of static worlds, for which movers are nothing but returns.\n"
        "At least: lower bound of Clopper and Pearson, 95 %. Unflagged: contacts with movers before which, within the\n"
        "horizon of a motion, no assumption was known to be broken; no flag then: those at whose moment none was.\n"
        "Time: of trials that arrive both ways, over that without movers.\n\n"
        + table(heads, lines, left=4)
        + ("\nThose that did not arrive, among movers, and the command that flies them again:\n\n" if failures else "")
        + "".join(failures)
    )


def counted(row: Row, name: str) -> str:
    """A count of a row; a dash where it was not made."""
    return "–" if row.get(name) is None else str(row[name])


def _some(row: Row) -> list[str]:
    return str(row["again"]).split("; ")[:3]


if __name__ == "__main__":
    main(configured(TINY))
