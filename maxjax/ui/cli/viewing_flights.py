"""`maxjax view FOLDER`: flights that `maxjax fly --out` has written, on a page or in one file."""

from __future__ import annotations

import functools
import shlex
from collections.abc import Sequence
from pathlib import Path

import tyro

from maxjax.core.files import FileError
from maxjax.sim.loop.flight import Flight, watch
from maxjax.sim.trials.batches import draw_trials, world_of
from maxjax.sim.trials.cities import Where, label_of_city
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import Outcome
from maxjax.sim.trials.trial_movers import movers_of
from maxjax.ui.cli.flown_map import check_same, where_of
from maxjax.ui.cli.fly_command import NO_COMMAND, campaign_of
from maxjax.ui.cli.options import FlyOptions, ViewOptions
from maxjax.ui.cli.page import wait, write_page
from maxjax.ui.cli.progress import progress
from maxjax.ui.page.flight_page import FlightPage
from maxjax.ui.page.server import serve
from maxjax.ui.page.share import playing_page
from maxjax.ui.page.trial_folder import city_of, film_of, open_folder


def view_flights(options: ViewOptions) -> int:
    """Show the page until Ctrl-C, or write it. Returns 0.

    Raises:
        ValueError, OSError: for a folder or a trial that cannot be shown.
    """
    name, ledger = open_folder(Path(options.map))
    where = where_flown(name, ledger)
    flown = [trial for trial in sorted(ledger.outcomes) if ledger.outcomes[trial].flown]
    trial = options.trial if options.trial is not None else next(iter(flown), min(ledger.outcomes))
    if trial not in ledger.outcomes:
        raise ValueError(f"--trial: expected one of the folder's {len(ledger.outcomes)} trials, given {trial}")
    outcome = ledger.outcomes[trial]
    if options.share is None:
        server = serve(city_of(where, outcome.city), host=options.host, port=options.port, dark=options.dark)
        page = FlightPage(server, where, ledger, functools.partial(again, where=where), trial, dark=options.dark)
        wait(server)
        page.close()
        return 0
    if trial not in flown:
        raise ValueError(f"--trial {trial}: it was not flown, so there is nothing to share")
    with progress(f"Flying trial {trial} again"):
        flights = again(outcome, where)
    with progress("Writing the page"):
        city = city_of(name, outcome.city)
        movers = movers_of(ledger.configuration, outcome, where)
        film = film_of(outcome, ledger.positions()[trial], city, flights, movers)
        page_text = playing_page(city, film, caption(name, outcome), dark=options.dark)
    write_page(options.share, page_text)
    return 0


def where_flown(name: str, ledger: Ledger) -> Where:
    """Where the trials of a folder were flown; a file is read again as the command line of one of them says.

    Raises:
        ValueError, OSError: if it is not there any more, or is another one.
    """
    if "city" not in ledger.configuration:
        return name
    first = ledger.outcomes[min(ledger.outcomes)]
    try:
        where = where_of(_options_of(first))
    except FileError as error:
        raise FileError(f"{error}; the path is the one that maxjax fly was given, from where that ran") from error
    check_same(where, ledger.configuration, ledger.folder)
    return where


def caption(where: Where, outcome: Outcome) -> str:
    """The caption of a flight on a shared page."""
    head = f"{label_of_city(where, outcome.city)}, trial {outcome.trial}: {outcome.status}"
    figures = f"{outcome.flown_length:.1f} m in {outcome.duration:.1f} s, {outcome.clearance:.1f} m clear at the least"
    legend = (
        "Blue line: flown; green: plan; pink: reference, or committed motion; blue boxes: the map so far; dots: scan; "
        "violet: movers; frames: where they may be now; veils: where they may be within the horizon"
    )
    return f"{head}\n{figures}\n{legend}"


def again(outcome: Outcome, where: Where | None = None) -> Sequence[Flight]:
    """Fly a trial again, by the command line that its outcome names.

    Args:
        outcome: of the trial.
        where: it was flown, if that is at hand; None: as the command says.

    Raises:
        ValueError: where that is no flight's.
    """
    campaign = campaign_of(_options_of(outcome), where)
    drawn = draw_trials(campaign)
    return list(watch(world_of(campaign, drawn, 0), campaign.flight)) if drawn["valid"][0] else []


def _options_of(outcome: Outcome) -> FlyOptions:
    """The options of the command line that an outcome names."""
    if outcome.command.startswith(NO_COMMAND):
        raise ValueError(f"trial {outcome.trial}: it was {outcome.command.removeprefix('# ')}")
    words = shlex.split(outcome.command)
    if words[:2] != ["maxjax", "fly"]:
        raise ValueError(f"trial {outcome.trial}: expected a command of maxjax fly, given {outcome.command!r}")
    try:
        return tyro.cli(FlyOptions, args=words[2:])
    except SystemExit as error:
        raise ValueError(f"trial {outcome.trial}: its command cannot be read: {outcome.command!r}") from error
