"""Every loop flown on every map: rows, and the section of RESULTS.md."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.common.harness import Row, keep, save
from benchmarks.common.markdown import Document, device, table
from experiments.closed_loop import PAPER, figures_of
from experiments.paper_loop.sources import SWEEPS
from experiments.paper_loop.stage import Loop
from maxjax.campaigns.campaign import Campaign
from maxjax.campaigns.execution import fly_trials
from maxjax.campaigns.outcomes import INVALID_DRAW, Outcome
from maxjax.nn.planner import Network
from maxjax.planners import Field
from maxjax.planning.planner import Planner
from maxjax.sim.flight import STAGES, FlightConfig
from maxjax.sim.replan import plan

RESULTS = Path(__file__).parents[1] / "results"
# Gain of the reactive layer [m/s²].
_GAIN = 1.5
# Distance along each axis that is flown straight to the goal [voxels]: 10 m.
_LAST = 5.0
# Trials of the paper, a map.
_FEW = 50


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
# Each adds to the one before; the first of them to "paper network, field".
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
        loops: parts of names of `LOOPS`: those that contain one of them are flown; the rest is taken from `keep`.
        seed: of the first city.
        batch: flights at a time; None: what suits the device.
        keep: folder for every trial's outcome and positions.
        out: where the JSON goes.
    """

    trials: int = 50
    maps: tuple[str, ...] = ("downtown", "suburb")
    loops: tuple[str, ...] = ("",)
    seed: int = 0
    batch: int | None = None
    keep: Path | None = None
    out: Path = RESULTS


TINY = Config(trials=1, maps=("suburb",), loops=("paper network, field",))


def main(config: Config) -> list[Row]:
    """Fly every loop; save and return two rows for each, of the paper's number of trials and of all."""
    chosen = {name: loop for name, loop in LOOPS.items() if any(part in name for part in config.loops)}
    if not chosen:
        raise ValueError(f"loops: expected parts of {'; '.join(LOOPS)}; given {', '.join(config.loops)}")
    rows: list[Row] = []
    for number, name in enumerate(chosen):
        for place in config.maps:
            started = time.perf_counter()
            outcomes = _flown(config, place, name)
            for some in dict.fromkeys((min(_FEW, config.trials), config.trials)):
                rows.append(row_of(place, name, [o for o in outcomes if o.trial < some]))
            seconds = time.perf_counter() - started
            print(rows[-1], f"{seconds:.0f} s, compilation included", file=sys.stderr, flush=True)
        keep("paper_loop", config, rows, config.out)
        print(f"{number + 1} of {len(chosen)} loops", file=sys.stderr, flush=True)
    save("paper_loop", config, rows, config.out)
    return rows


def flight_of(loop: Loop | Whole) -> FlightConfig:
    """How a loop is flown."""
    if isinstance(loop, Whole):
        return FlightConfig(planner=loop.planner, snapshot=loop.alone, reactive=_GAIN * loop.alone)
    stages = tuple(loop if stage is plan else stage for stage in STAGES)
    return FlightConfig(planner=Field(), snapshot=True, reactive=_GAIN, stages=stages)


def row_of(place: str, name: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The figures of a loop's flights."""
    counted = Counter(o.status for o in outcomes if o.status not in ("OK", INVALID_DRAW))
    statuses = ", ".join(f"{status}: {count}" for status, count in counted.most_common())
    figures = figures_of(list(outcomes))
    del figures["failures"]
    return {"map": place, "loop": name, **figures, "statuses": statuses}


def _flown(config: Config, place: str, name: str) -> list[Outcome]:
    folder = None if config.keep is None else config.keep / f"{place}-{list(LOOPS).index(name):02}"
    campaign = Campaign(place, config.seed, range(config.trials), config=flight_of(LOOPS[name]))
    return [o for some in fly_trials(campaign, batch=config.batch, folder=folder) for o in some]
