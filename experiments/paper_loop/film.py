"""A film: one trial by the reading of the paper's loop that arrives most often, and by maxjax beside it.

    python -m experiments.paper_loop.film --record       two CPU cores: 8 minutes

Left: the paper's network, smoothed gradients and reactive layer. Right: the exact field, certified, in all scans.
Both as `maxjax fly --trial` films a flight; the shorter one waits at its end.
"""

from __future__ import annotations

import dataclasses
import io
import itertools
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.common.command import configured
from experiments.paper_loop.stage import Loop
from experiments.paper_loop.study import Whole, best_recorded, flight_of
from maxjax.core.files import atomic_write
from maxjax.planners import Field
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.outcomes import Outcome
from maxjax.sim.trials.replay import replay
from maxjax.ui.figures.campaign_figures import film_trial
from maxjax.ui.figures.gif import animation
from maxjax.ui.figures.style import ARRIVED, FAILED, FLAGGED, PLANNED


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        map: of the trial.
        trial: its number.
        seed: of the first city.
        plans: at most; None: as each loop has it.
        out: file of the film.
    """

    map: str = "downtown"
    trial: int = 0
    seed: int = 0
    plans: int | None = None
    out: Path = Path("docs/paper_loop.gif")


TINY = Config(plans=2)


def main(config: Config) -> list[Outcome]:
    """Fly both, and film them; their outcomes."""
    outcomes, films = [], []
    flown: dict[str, Loop | Whole] = {"the paper's loop": Loop(best_recorded()), "maxjax": Whole(Field(), alone=False)}
    for name, loop in flown.items():
        trials = range(config.trial, config.trial + 1)
        campaign = Campaign(config.map, config.seed, trials, config=flight_of(loop, config.plans))
        with tempfile.TemporaryDirectory() as folder:
            outcome, flights = replay(campaign, campaign.ledger(Path(folder)))
        outcomes.append(outcome)
        films.append(_frames(film_trial(campaign, outcome, flights, by=name)))
    config.out.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(config.out, animation(_beside(*films), (ARRIVED, FAILED, PLANNED, FLAGGED)))
    return outcomes


def _frames(film: bytes) -> list[np.ndarray]:
    from PIL import Image, ImageSequence

    return [np.asarray(frame.convert("RGB")) for frame in ImageSequence.Iterator(Image.open(io.BytesIO(film)))]


def _beside(left: list[np.ndarray], right: list[np.ndarray]) -> list[object]:
    """Images of both, as long as the longer one."""
    from PIL import Image

    pairs = itertools.zip_longest(left, right)
    return [
        Image.fromarray(np.hstack([left[-1] if one is None else one, right[-1] if other is None else other]))
        for one, other in pairs
    ]


if __name__ == "__main__":
    main(configured(TINY))
