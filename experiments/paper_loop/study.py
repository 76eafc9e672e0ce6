"""Every loop flown on every map, a row each of the first 50 trials and of all."""

from __future__ import annotations

import dataclasses
import statistics
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.common.harness import Row, keep, save
from experiments.closed_loop import figures_of
from experiments.paper_loop.sources import SWEEPS, potential_from
from experiments.paper_loop.stage import Loop
from maxjax.core.provenance import device
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
# Gain of the reactive layer [m/s²].
_GAIN = 1.5
# Distance along each axis that is flown straight to the goal [voxels]: 10 m.
_LAST = 5.0
# Trials of the paper, a map.
FEW = 50


@dataclasses.dataclass(frozen=True)
class Whole:
    """A planner of maxjax instead of the loop.

    Attributes:
        planner: of the flight.
        alone: whether it plans in the latest scan alone, before the reactive layer, as the loop does.
    """

    planner: Planner
    alone: bool


_SOURCES = {
    "paper": "paper network",
    "paper_difference": "paper_difference network",
    "maxjax": "maxjax's network",
    "exact, κ = 0": "exact field, κ = 0",
    "exact": "exact field, screened",
}
_WALLS = Loop(smoothing="walls", near=_LAST)
_STEPS = dataclasses.replace(_WALLS, guarded=True)
BEFORE = "paper network, field"
# Each adds to the one before, the first of them to `BEFORE`.
LAYERS: Mapping[str, Loop] = {
    "+ last 10 m straight": Loop(smoothing="field", near=_LAST),
    "+ smoothing that sees walls": _WALLS,
    "+ steps kept out of walls, discrete step": _STEPS,
    f"+ {SWEEPS} sweeps": dataclasses.replace(_STEPS, source="paper, swept"),
    "+ certificate, solver behind it": dataclasses.replace(_STEPS, source="paper, certified"),
    "+ verification": dataclasses.replace(_STEPS, source="paper, certified", verified=True),
}
LOOPS: Mapping[str, Loop | Whole] = {
    **{
        f"{title}, {smoothing}": Loop(source, smoothing)
        for source, title in _SOURCES.items()
        for smoothing in ("gradients", "field")
    },
    **LAYERS,
    "maxjax's planner, paper network, the same scan": Whole(Network(model="paper"), alone=True),
    "maxjax's planner, paper network, all scans": Whole(Network(model="paper"), alone=False),
    "maxjax, exact field, all scans": Whole(Field(), alone=False),
}


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        trials: a map.
        maps: to fly in; nothing was ever tuned or trained on them.
        loops: parts of names of `LOOPS`: those that contain one of them are flown. Of others, and of all if none is
            named, what `keep` holds counts, finished or not.
        plans: of a flight, at most.
        seed: of the first city.
        batch: flights at a time; None: what suits the device.
        name: of the result file.
        keep: folder for every trial's outcome and positions.
        out: where the JSON goes.
    """

    trials: int = 50
    maps: tuple[str, ...] = ("downtown", "suburb")
    loops: tuple[str, ...] = ("",)
    plans: int = 100
    seed: int = 0
    batch: int | None = None
    name: str = "paper_loop"
    keep: Path | None = None
    out: Path = RESULTS


TINY = Config(trials=1, maps=("suburb",), loops=(BEFORE,), plans=3)


def main(config: Config) -> list[Row]:
    """Fly loops; save and return their rows, and those of all that was kept before."""
    if unknown := [part for part in config.loops if not any(part in name for name in LOOPS)]:
        raise ValueError(f"loops: expected parts of {'; '.join(LOOPS)}; given {', '.join(unknown)}")
    rows: list[Row] = []
    for name in LOOPS:
        for place in config.maps:
            started = time.perf_counter()
            outcomes, where = _flown(config, place, name) if _chosen(config, name) else _kept(config, place, name)
            for some in dict.fromkeys((min(FEW, len(outcomes)), len(outcomes))):
                if some:
                    rows.append({**row_of(place, name, [o for o in outcomes if o.trial < some]), "device": where})
            if _chosen(config, name):
                seconds = time.perf_counter() - started
                print(rows[-1], f"{seconds:.0f} s, compilation included", file=sys.stderr, flush=True)
                keep(config.name, config, rows, config.out)
    save(config.name, config, rows, config.out)
    return rows


def _chosen(config: Config, name: str) -> bool:
    return any(part in name for part in config.loops)


def flight_of(loop: Loop | Whole, plans: int) -> FlightConfig:
    """How a loop is flown with so many plans at most."""
    if isinstance(loop, Whole):
        return FlightConfig(planner=loop.planner, plans=plans, snapshot=loop.alone, reactive=_GAIN * loop.alone)
    potential_from(loop.source)  # loads the weights, before anything is traced
    stages = tuple(loop if stage is plan else stage for stage in STAGES)
    return FlightConfig(planner=Field(), plans=plans, snapshot=True, reactive=_GAIN, stages=stages)


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


def _flown(config: Config, place: str, name: str) -> tuple[list[Outcome], str]:
    """Outcomes, and the device on which they were found."""
    campaign = Campaign(place, config.seed, range(config.trials), config=flight_of(LOOPS[name], config.plans))
    folder = _folder(config, place, name)
    return [o for some in fly_trials(campaign, batch=config.batch, folder=folder) for o in some], device()


def _kept(config: Config, place: str, name: str) -> tuple[list[Outcome], str]:
    """What was flown before, by whatever number of trials."""
    folder = _folder(config, place, name)
    if folder is None or not (folder / CONFIG).is_file():
        return [], ""
    ledger = Ledger.read(folder)
    return list(ledger.outcomes.values()), ", ".join(dict.fromkeys(one["device"] for one in ledger.flown_by))


def _folder(config: Config, place: str, name: str) -> Path | None:
    return None if config.keep is None else config.keep / f"{place}-{list(LOOPS).index(name):02}"
