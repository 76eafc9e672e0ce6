"""Settings, and which figure is drawn from what."""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path
from typing import Literal

from experiments.differentiable.field import FIGURES
from experiments.paper_figures.architecture import draw_architecture
from experiments.paper_figures.flights import draw_flights
from experiments.paper_figures.path import draw_path
from experiments.paper_figures.planned import Choice, Planned, planned
from experiments.paper_figures.slices import draw_fields, draw_training

Name = Literal["path", "training", "architecture", "fields", "flights"]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        only: which figures; `flights` is left out where no folder is given.
        flights: folders of campaigns (`maxjax fly --trials`, `experiments.closed_loop --keep`), one row each.
        worst: flights of a folder.
        candidates: problems of a map that the longest detour is chosen from.
        shape: of the grid, voxels of 2 m around the origin.
        margin: [m].
        seed: of the cities.
        out: where the figures go.
    """

    only: tuple[Name, ...] = ("path", "training", "architecture", "fields", "flights")
    flights: tuple[Path, ...] = ()
    worst: int = 3
    candidates: int = 10
    shape: tuple[int, int, int] = (101, 101, 101)
    margin: float = 8.0
    seed: int = 0
    out: Path = FIGURES


TINY = Config(candidates=1, shape=(51, 51, 21), worst=2)


def main(config: Config) -> list[Path]:
    """Draw the figures; returns their files."""
    names = [name for name in config.only if name != "flights" or config.flights]
    if len(names) < len(config.only):
        print("flights: left out, no --flights given", file=sys.stderr)
    return [_draw(name, config) for name in names]


def _draw(name: Name, config: Config) -> Path:
    choice = Choice(config.candidates, config.shape, config.margin, config.seed)

    def of(city: str) -> Planned:
        return planned(city, choice)

    match name:
        case "path":
            return draw_path(of("downtown"), config.out / "paper_path.png")
        case "training":
            return draw_training(of("midtown"), config.out / "paper_training_map.png")
        case "architecture":
            return draw_architecture(config.out / "paper_architecture.png")
        case "fields":
            unseen = {city: of(city) for city in ("downtown", "suburb")}
            return draw_fields(unseen, config.out / "paper_fields.png")
        case "flights":
            return draw_flights(config.flights, config.worst, config.out / "paper_flights.png")
