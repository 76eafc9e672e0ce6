"""Readings, and layers on the best of them, flown on every map: a row each of the first 50 trials and of all."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import re
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from benchmarks.common.harness import Row, keep, save
from experiments.closed_loop import figures_of
from experiments.paper_loop.reading import BEFORE, READINGS, Reading
from experiments.paper_loop.repulsion import GAIN, Repulsion
from experiments.paper_loop.sources import SWEEPS, potential_from
from experiments.paper_loop.stage import Loop, period_of
from maxjax.nn.network import Network
from maxjax.planners import Field
from maxjax.planning.planner import Planner
from maxjax.sim.loop.flight import STAGES, FlightConfig
from maxjax.sim.loop.replan import plan
from maxjax.sim.trials.batches import fly_trials
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.ledger import CONFIG, Ledger
from maxjax.sim.trials.outcomes import INVALID_DRAW, Outcome

RESULTS = Path(__file__).parents[1] / "results"
# Trials of the paper, a map.
FEW = 50
# Trials that are flown at a stretch, and kept in a folder of their own.
BLOCK = 500


@dataclasses.dataclass(frozen=True)
class Whole:
    """A planner of maxjax instead of the loop.

    Attributes:
        planner: of the flight.
        alone: whether it plans in the latest scan alone, before the reactive layer, as the loop does.
    """

    planner: Planner
    alone: bool


def layers(reading: Reading) -> dict[str, Loop | Whole]:
    """A reading, and what maxjax adds: each with `+` to the one before it; then its whole planner."""
    smooth = Loop(dataclasses.replace(reading, sees_walls=True))
    steps = dataclasses.replace(smooth, guarded=True)
    swept, solved = (
        dataclasses.replace(steps, reading=dataclasses.replace(smooth.reading, field=f"paper, {how}"))
        for how in ("swept", "certified")
    )
    verified = dataclasses.replace(solved, verified=True)
    taut = dataclasses.replace(verified, taut=True)
    return {
        str(reading): Loop(reading),
        "+ smoothing that sees walls": smooth,
        "+ steps kept out of walls, discrete step": steps,
        f"+ {SWEEPS} sweeps": swept,
        "+ certificate, solver behind it": solved,
        "+ verification": verified,
        "+ string pulling": taut,
        "+ price in place of dilation": dataclasses.replace(taut, priced=True),
        "maxjax's planner, paper network, the same scan": Whole(Network(model="paper"), alone=True),
        "maxjax's planner, paper network, all scans": Whole(Network(model="paper"), alone=False),
        "maxjax, exact field, all scans": Whole(Field(), alone=False),
    }


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        rows: the grid of "readings", or "layers" on the best of them by the recorded result.
        loops: names, or parts of them: loops that contain one are flown, and none if none is named. All that `keep`
            holds counts, finished or not.
        trials: a map.
        maps: to fly in; nothing was ever tuned or trained on them.
        plans: of a flight, at most; None: as its reading says.
        shard: what to fly of all loops and blocks of 500 trials, (k, n): every n-th of them from the k-th on.
        seed: of the first city.
        batch: flights at a time; None: what suits the device.
        keep: folder for every trial's outcome and positions; None: a run that is stopped is lost.
        out: where the JSON goes.
    """

    rows: Literal["readings", "layers"] = "readings"
    loops: tuple[str, ...] = ("",)
    trials: int = FEW
    maps: tuple[str, ...] = ("downtown", "suburb")
    plans: int | None = None
    shard: tuple[int, int] = (0, 1)
    seed: int = 0
    batch: int | None = None
    keep: Path | None = None
    out: Path = RESULTS

    @property
    def name(self) -> str:
        """Of the result file."""
        return "paper_readings" if self.rows == "readings" else "paper_loop"

    def among(self) -> dict[str, Loop | Whole]:
        """All loops by name, flown or not.

        Raises:
            OSError: if there is no recorded result to choose the best reading by.
        """
        if self.rows == "readings":
            return {name: Loop(reading) for name, reading in READINGS.items()}
        return layers(best_recorded())


TINY = Config(loops=(str(dataclasses.replace(BEFORE, field="exact")),), trials=1, maps=("suburb",), plans=3)


def main(config: Config) -> list[Row]:
    """Fly loops; save and return their rows, and those of all that was kept before.

    Raises:
        ValueError: for a part that no name contains, or a shard that there is not.
    """
    loops, (first, count) = config.among(), config.shard
    named = {part: [part] if part in loops else [name for name in loops if part in name] for part in config.loops}
    if unknown := [part for part, names in named.items() if not names]:
        raise ValueError(f"loops: expected parts of {' | '.join(loops)}; given {', '.join(unknown)}")
    if not 0 <= first < count:
        raise ValueError(f"shard: expected k of n with 0 <= k < n, given {first} of {count}")
    asked = dict.fromkeys(name for names in named.values() for name in names)
    units = [(name, start) for name in asked for start in range(0, config.trials, BLOCK)]
    with contextlib.nullcontext(config.keep) if config.keep else tempfile.TemporaryDirectory() as kept:
        folder = Path(kept) / config.rows  # a reading stands among both
        for name, start in units[first::count]:
            flight = flight_of(loops[name], config.plans)
            for place in config.maps:
                trials = range(start, min(start + BLOCK, config.trials))
                campaign = Campaign(place, config.seed, trials, config=flight)
                _fly(campaign, config.batch, _folder(folder, place, name) / f"{start:05}")
                keep(config.name, config, _rows(folder, loops, config.maps), config.out)
        rows = _rows(folder, loops, config.maps)
    save(config.name, config, rows, config.out)
    return rows


def best_reading(rows: Sequence[Row]) -> Reading:
    """The reading by which the paper's own network arrives most often, of those flown on most maps; the first such."""
    arrived: dict[str, float] = {}
    for row in rows:
        name, share = str(row["loop"]), float(row["arrived"] or 0) / float(row["trials"] or 1)
        if name in READINGS and READINGS[name].field == "paper":
            arrived[name] = arrived.get(name, 0.0) + share
    return READINGS[max(arrived, key=arrived.__getitem__)]


def best_recorded() -> Reading:
    """The best reading by the recorded result.

    Raises:
        OSError: if there is none.
    """
    return best_reading(json.loads((RESULTS / "paper_readings.json").read_text(encoding="utf-8"))["rows"])


def flight_of(loop: Loop | Whole, plans: int | None = None) -> FlightConfig:
    """How a loop is flown, with so many plans at most; None: 100, or as its reading says."""
    if isinstance(loop, Whole):
        reactive = GAIN * loop.alone
        return FlightConfig(planner=loop.planner, plans=plans or 100, snapshot=loop.alone, reactive=reactive)
    reading = loop.reading
    potential_from(reading.field)  # loads the weights, before anything is traced
    flight = FlightConfig(
        planner=Field(),
        plans=plans or reading.plans,
        snapshot=True,
        extensions=(Repulsion(reading.reactive, reading.reach),),
        stages=tuple(loop if stage is plan else stage for stage in STAGES),
    )
    return dataclasses.replace(flight, period=period_of(reading.segment, flight.limits))


def row_of(place: str, name: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The figures of a loop's flights."""
    counted = Counter(o.status for o in outcomes if o.status not in ("OK", INVALID_DRAW))
    statuses = ", ".join(f"{status}: {count}" for status, count in counted.most_common())
    figures = figures_of(list(outcomes))
    del figures["failures"]
    went = [
        o.flown_length / o.distance for o in outcomes if o.flown and not o.arrived and o.flown_length and o.distance
    ]
    lost = round(statistics.median(went), 3) if went else None
    return {"map": place, "loop": name, **figures, "statuses": statuses, "lost_after": lost}


def _fly(campaign: Campaign, batch: int | None, folder: Path) -> None:
    """Fly what a folder lacks of a campaign."""
    started = time.perf_counter()
    arrived = [o.arrived for some in fly_trials(campaign, batch=batch, folder=folder) for o in some]
    told = f"{sum(arrived)} of {len(arrived)} arrived, {time.perf_counter() - started:.0f} s, compilation included"
    print(folder, told, file=sys.stderr, flush=True)


def _rows(folder: Path, loops: Mapping[str, Loop | Whole], maps: Sequence[str]) -> list[Row]:
    """A row of each loop, map and number of trials that was kept."""
    rows: list[Row] = []
    for name in loops:
        for place in maps:
            begun = sorted(_folder(folder, place, name).glob(f"*/{CONFIG}"))
            ledgers = [Ledger.read(path.parent) for path in begun]
            outcomes = [outcome for ledger in ledgers for outcome in ledger.outcomes.values()]
            where = ", ".join(dict.fromkeys(one["device"] for ledger in ledgers for one in ledger.flown_by))
            for some in dict.fromkeys((min(FEW, len(outcomes)), len(outcomes))):
                if some:
                    rows.append({**row_of(place, name, [o for o in outcomes if o.trial < some]), "device": where})
    return rows


def _folder(folder: Path, place: str, name: str) -> Path:
    """Of a loop on a map, below that of all."""
    return folder / place / re.sub(r"\W+", "-", name).strip("-")
