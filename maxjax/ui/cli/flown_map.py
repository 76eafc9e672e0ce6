"""Where `maxjax fly` flies in closed loop: a simulated map by name or the city of a file, and how to name it again."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from maxjax.core.files import FileError
from maxjax.io import Window
from maxjax.io.reader import READERS
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.trials.cities import Where
from maxjax.sim.trials.given_city import Ends, GivenCity
from maxjax.sim.worlds.layouts import MAPS
from maxjax.ui.cli import track_command as tracking
from maxjax.ui.cli.options import FlyOptions
from maxjax.ui.cli.progress import progress
from maxjax.ui.cli.report import complain
from maxjax.ui.option_groups import ReadOptions
from maxjax.ui.request import reading_of

_FOLLOWED = "needs --start and --goal, a map to fly in and no --movers; a closed loop has distances of its own"


def where_of(options: FlyOptions) -> Where:
    """Where options say to fly; what a user should know of a file goes to stderr.

    Raises:
        ValueError, OSError, ImportError: for a map that cannot be flown in, or options that do nothing there.
    """
    if not is_file(options.map):
        tracking.refuse(options, tracking.READ, "reads a file, and a simulated city is none")
        tracking.refuse(options, ("start", "goal"), "goes with a file, and trials of a simulated city draw their ends")
    tracking.refuse(options, tracking.FOLLOWED, _FOLLOWED)
    if not is_file(options.map):
        return options.map
    ends = ends_of(options)
    with progress(f"Reading {options.map}"):
        window = Window(options.spacing, options.bounds, options.center, (), options.ground)
        city = GivenCity.load(options.map, window, reading_of(options), ends)
    for remark in (*city.remarks, *city.beyond):
        complain(f"Note: {city.name}: {remark}.")
    return city


def is_file(text: str) -> bool:
    """Whether MAP is meant as a file: it is no simulated map, and is there or has the suffix of a format."""
    return text not in MAPS and (Path(text).exists() or Path(text.removesuffix(".gz")).suffix.lower() in READERS)


def ends_of(options: FlyOptions) -> Ends | None:
    """Start and goal; None if they are to be drawn.

    Raises:
        ValueError: for one without the other, or with a number of trials.
    """
    if (options.start is None) != (options.goal is None):
        raise ValueError("--start and --goal: expected both or none, given one")
    if options.start is None or options.goal is None:
        return None
    tracking.refuse(
        options,
        ("trials", "trial", "shard", "merge", "distributed"),
        "goes with ends that are drawn, not with --start and --goal, where another --seed makes another flight",
    )
    return options.start, options.goal


def check_reach(where: Where, config: FlightConfig) -> None:
    """Refuse given ends that lie further apart than the map of a flight reaches.

    Raises:
        ValueError: if they do.
    """
    if not isinstance(where, GivenCity) or where.ends is None:
        return
    start, goal = where.ends
    reach = config.spacing * (min(config.shape) // 2)
    apart = max(abs(a - b) for a, b in zip(start, goal, strict=True))
    if apart > reach:
        raise ValueError(
            f"--goal: expected one within {reach:g} m of the start along each axis, as far as the map of a flight "
            f"reaches, given {apart:g} m; fly there in several flights"
        )


def words_of(options: FlyOptions) -> list[str]:
    """The words of a command line that name the map, how to read it, and given ends."""
    words = [options.map]
    defaults = {field.name: field.default for field in dataclasses.fields(FlyOptions)}
    for name in (*(field.name for field in dataclasses.fields(ReadOptions)), "start", "goal"):
        if (value := getattr(options, name)) != defaults[name]:
            option = f"--{name.replace('_', '-')}"
            each = value if name in ("drop_class", "only") else [value]
            for one in each:
                words += [option, *map(_word, one if isinstance(one, tuple) else [one])]
    return words


def _word(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def check_same(where: Where, configuration: dict[str, Any], folder: Path) -> None:
    """Refuse a city that is not the one of a campaign.

    Raises:
        FileError: if its file or what is made of it has changed.
    """
    if isinstance(where, GivenCity) and dict(where.identity) != configuration.get("city"):
        raise FileError(
            f"{folder}: was flown in another {where.name} than the one that is there now, or it is read in another "
            "way; put back the file that it was flown in"
        )
