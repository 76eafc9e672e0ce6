"""`maxjax fly`: trials of the closed loop in a simulated city or in a file's, their table, and pictures of them.

With ends given, and no movers, it flies a trajectory in a given map: `ui.cli.track_command`; with the address of an
autopilot, a real vehicle does: `ui.cli.link_command`.
"""

from __future__ import annotations

import dataclasses
import functools
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from maxjax.core.files import atomic_write
from maxjax.core.provenance import device, versions
from maxjax.core.status import Status
from maxjax.sim.loop.flight import Flight, FlightConfig
from maxjax.sim.trials.batches import fly_trials
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.cities import Where
from maxjax.sim.trials.given_city import GivenCity
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import Outcome, summarise
from maxjax.sim.trials.processes import own_shard
from maxjax.sim.trials.replay import replay
from maxjax.sim.trials.shards import Shard, merge
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.layouts import MAPS
from maxjax.sim.worlds.populations import Population
from maxjax.ui.cli import fleet_command as fleets
from maxjax.ui.cli import link_command as linking
from maxjax.ui.cli import report
from maxjax.ui.cli import track_command as tracking
from maxjax.ui.cli.flown_map import check_reach, is_file, where_of, words_of
from maxjax.ui.cli.options import FlyOptions
from maxjax.ui.cli.progress import progress, tally
from maxjax.ui.cli.trial_rows import trial_rows
from maxjax.ui.methods import is_import_path, planner_named


def run_fly(options: FlyOptions) -> int:
    """Fly, show and write. Returns 0, as failed trials are a result; with given ends and no movers, `fly_given`.

    Where shares are merged and trials are missing, or a flight between given ends does not arrive: 1.

    Raises:
        ValueError, OSError, ImportError, MemoryError: for arguments that cannot be used.
    """
    if options.autopilot is not None:
        return linking.fly_over_link(options)
    tracking.refuse(options, linking.ONLY, "needs --autopilot")
    if options.map.lower().endswith(".toml"):
        return tracking.fly_mission(options)
    given = options.start is not None or options.goal is not None
    if given and (options.movers is None or not is_file(options.map)):
        return tracking.fly_given(options)
    if options.fleet is not None:
        if is_file(options.map):
            raise ValueError(f"--fleet: flies in {', '.join(MAPS)}, given the file {options.map}")
        where_of(options)
        return fleets.fly_together(options.fleet, options, *flight_of(options))
    tracking.refuse(options, ("delay",), "needs --fleet")
    whole = _folder_of_shares(options)
    if whole is not None and options.distributed:
        with own_shard() as shard:
            campaign = campaign_of(options)
            _fly_share(campaign, options, shard, whole)
        return 0 if shard.index else _merge(campaign, options, whole)
    campaign = campaign_of(options)
    if whole is None:
        report.check_output(options.out)
        outcomes, flights = _fly(campaign, options, options.out)
        code = _tell(campaign, options, options.out, outcomes, flights)
        return _ended(outcomes[0]) if given else code
    if options.shard is not None:
        share, folder, outcomes = _fly_share(campaign, options, Shard.of(options.shard), whole)
        return _tell(share, options, folder, outcomes) if outcomes else 0
    return _merge(campaign, options, whole)


def _ended(outcome: Outcome) -> int:
    """Exit code of a flight between given ends; what became of one that did not arrive goes to stderr."""
    if not outcome.arrived:
        report.complain(f"{outcome.status}: {Status[outcome.status].advice}")
    return 0 if outcome.arrived else 1


def _folder_of_shares(options: FlyOptions) -> Path | None:
    """The folder of a campaign that is flown in shares; None for one that is not.

    Raises:
        ValueError: for options that do not go together.
    """
    asked = {"--shard": options.shard is not None, "--merge": options.merge, "--distributed": options.distributed}
    given = [name for name, value in asked.items() if value]
    if not given:
        return None
    if len(given) > 1:
        raise ValueError(f"{given[0]} and {given[1]}: expected one of them, given both")
    if options.trial is not None:
        raise ValueError(f"{given[0]}: goes with --trials, not with --trial")
    if options.out is None:
        raise ValueError(f"{given[0]}: expected --out, the folder of the whole campaign, given none")
    return options.out


def _fly_share(
    campaign: Campaign, options: FlyOptions, shard: Shard, whole: Path
) -> tuple[Campaign, Path, list[Outcome]]:
    """Fly a share into its folder: the share, the folder, and its outcomes, none of a share without trials."""
    folder, trials = shard.folder(whole), shard.share(campaign.trials)
    if not trials:
        report.complain(f"Shard {shard.index}/{shard.count} of {len(campaign.trials)} trials has none to fly.")
        return campaign, folder, []
    report.check_output(folder, drawn=False)
    share = dataclasses.replace(campaign, trials=trials)
    return share, folder, _fly(share, options, folder)[0]


def _merge(campaign: Campaign, options: FlyOptions, whole: Path) -> int:
    """Make the folder of a campaign from those of its shares, and tell. Returns 1 where trials are missing, else 0."""
    report.check_output(whole)
    merged = merge(campaign, whole)
    if merged.doubled:
        report.complain(f"Note: {merged.doubled} trials were flown in more than one share, with the same outcome.")
    if merged.missing:
        report.complain(
            f"{len(merged.missing)} of {len(campaign.trials)} trials are missing in {merged.shards} shares: "
            f"{runs(merged.missing)}; fly those shares again, then merge again. Nothing was written."
        )
        return 1
    ledger = campaign.ledger(whole)
    if lost := ledger.lost_positions:
        report.complain(lost)
    outcomes = list(ledger.outcomes.values())
    return _tell(campaign, options, whole, outcomes, ())


def runs(indices: Sequence[int], most: int = 5) -> str:
    """Indices in order as text: runs of them, the first few."""
    found: list[list[int]] = []
    for index in indices:
        if found and found[-1][-1] == index - 1:
            found[-1][1:] = [index]
        else:
            found.append([index])
    shown = [" to ".join(map(str, run)) for run in found[:most]]
    return ", ".join(shown) + (", and others" if len(found) > most else "")


def _tell(
    campaign: Campaign,
    options: FlyOptions,
    out: Path | None,
    outcomes: Sequence[Outcome],
    flights: Sequence[Flight] | None = None,
) -> int:
    """Show and write the summary of a campaign; draw it in its folder, unless `flights` are None. Returns 0."""
    origin: dict[str, Any] = {"versions": versions(), "device": device()}
    files: list[Path] = []
    if out is not None:
        ledger = campaign.ledger(out)
        if makers := ledger.flown_by:  # other processes, maybe elsewhere
            origin["versions"] = makers[-1]["versions"]
            origin["device"] = "; ".join(dict.fromkeys(maker["device"] for maker in makers))
        if flights is not None:
            with progress("Drawing"):
                files = _draw(campaign, ledger, flights)
    content = report.plain({**summarise(outcomes), "configuration": campaign.configuration(), **origin})
    if out is not None:
        atomic_write(out / "summary.json", report.dumps(content))
        files.append(out / "summary.json")
    if options.json:
        sys.stdout.write(report.dumps(content))
        return 0
    title = f"{campaign.name}, seed {campaign.seed}, method {campaign.config.planner.name}"
    report.show(report.table(title, {"": trial_rows(content, outcomes)}))
    for failure in content["failures"]:
        print(f"trial {failure['index']}: {failure['status']}; again: {failure['command']}")
    if files:
        print(*files, sep="\n")
    return 0


def campaign_of(options: FlyOptions, where: Where | None = None) -> Campaign:
    """The campaign that options describe.

    Args:
        options: of `fly`.
        where: it is flown, if that is at hand; None: it is read.

    Raises:
        ValueError, OSError, ImportError: for what cannot be flown.
    """
    trials, trial, batch = options.trials, options.trial, options.batch
    if trials is not None and trial is not None:
        raise ValueError("--trials and --trial: expected one of them, given both")
    if trials is not None and trials < 1:
        raise ValueError(f"--trials: expected at least 1, given {trials}")
    if trial is not None and trial < 0:
        raise ValueError(f"--trial: expected an index from 0 on, given {trial}")
    if batch is not None and batch < 1:
        raise ValueError(f"--batch: expected at least 1, given {batch}")
    first, count = (trial, 1) if trial is not None else (0, trials or 1)
    config, movers = flight_of(options)
    trials_flown = range(first, first + count)
    command = functools.partial(command_of, options=options)
    where = where_of(options) if where is None else where
    check_reach(where, config)
    return Campaign(where, options.seed, trials_flown, config=config, movers=movers, command=command)


def flight_of(options: FlyOptions) -> tuple[FlightConfig, Population | None]:
    """How a vehicle flies, and what moves besides.

    Raises:
        ValueError: for what cannot be flown.
    """
    disturbances = Disturbances(
        wind=options.wind,
        range_noise=options.noise,
        dropout=options.dropout,
        dead_sector=options.dead_sector,
        blackout=options.blackout,
        drift=options.drift,
        latency=float(options.latency),
    )
    planner = planner_named(options.method)
    config = FlightConfig(disturbances, planner=planner, snapshot=options.snapshot, reactive=options.reactive)
    if options.movers is None:
        tracking.refuse(options, ("mover_speed", "mover_kind"), "needs --movers")
        return config, None
    return config, Population(options.movers, options.mover_speed, options.mover_kind)


# Options for disturbances with a strength, in order; latency is a switch.
_OPTIONS = {
    "wind": "--wind",
    "range_noise": "--noise",
    "dropout": "--dropout",
    "dead_sector": "--dead-sector",
    "blackout": "--blackout",
    "drift": "--drift",
}


NO_COMMAND = "# flown from Python: no command line flies it again, which cannot give its"


def command_of(campaign: Campaign, trial: int, options: FlyOptions | None = None) -> str:
    """The command line that flies one trial of a campaign again, by itself; a remark where none does.

    Args:
        campaign: that it is of.
        trial: its index.
        options: that the campaign was asked for with; None: it was made in Python.
    """
    if differing := _beyond_options(campaign, options):
        return f"{NO_COMMAND} {', '.join(differing)}"
    where = campaign.map
    words = ["maxjax", "fly", *([where] if isinstance(where, str) or options is None else words_of(options))]
    words += ["--seed", str(campaign.seed)]
    if isinstance(where, str) or where.ends is None:
        words += ["--trial", str(trial)]
    config, strengths = campaign.config, campaign.strengths
    if config.planner.name != "field":
        words += ["--method", _method_of(campaign, options)]
    for name, option in _OPTIONS.items():
        if strengths[name]:
            words += [option, f"{strengths[name]:.12g}"]
    words += ["--latency"] * bool(strengths["latency"]) + ["--snapshot"] * config.snapshot
    words += ["--reactive", f"{config.reactive:.12g}"] if config.reactive else []
    if (movers := campaign.movers) is not None:
        words += ["--movers", str(movers.count), "--mover-speed", f"{movers.speed:.12g}", "--mover-kind", movers.kind]
    return shlex.join(words)


def _method_of(campaign: Campaign, options: FlyOptions | None) -> str:
    """What --method is for the planner of a campaign: its name, or the import path of one's own."""
    own = options is not None and is_import_path(options.method)
    return options.method if own and options is not None else campaign.config.planner.name


def _beyond_options(campaign: Campaign, options: FlyOptions | None) -> list[str]:
    """Settings of a campaign's flights that no option of the command line gives."""
    config = campaign.config
    if options is None and isinstance(campaign.map, GivenCity):
        return ["map"]
    try:
        planner = planner_named(_method_of(campaign, options))
    except ValueError:
        return ["planner"]
    told = FlightConfig(config.disturbances, planner=planner, snapshot=config.snapshot, reactive=config.reactive)
    names = [field.name for field in dataclasses.fields(config) if field.name != "disturbances"]
    return [name for name in names if getattr(config, name) != getattr(told, name)]


def _fly(campaign: Campaign, options: FlyOptions, out: Path | None) -> tuple[list[Outcome], list[Flight]]:
    """The outcomes of a campaign, and of a single trial with a folder the flight after each planning iteration."""
    ledger = None if out is None else campaign.ledger(out)
    with tally(len(campaign.trials)) as tell:
        if options.trial is not None and ledger is not None:
            outcome, flights = replay(campaign, ledger)
            tell(1, outcome.arrived, 1)
            return [outcome], flights
        outcomes: list[Outcome] = []
        for some in fly_trials(campaign, batch=options.batch, folder=out, warn=report.complain):
            outcomes += some
            fresh = sum(outcome.flown for outcome in some) if ledger is None or _new(some, ledger) else 0
            tell(len(some), sum(outcome.arrived for outcome in some), fresh)
        return outcomes, []


def _new(outcomes: Sequence[Outcome], before: Ledger) -> bool:
    """Whether outcomes are of this run, not read from the folder."""
    return any(outcome.trial not in before.outcomes for outcome in outcomes)


def _draw(campaign: Campaign, ledger: Ledger, flights: Sequence[Flight]) -> list[Path]:
    """flights.png: the flights of the first city; flight.gif: the only one. Those of an earlier run are removed."""
    from maxjax.ui.figures.campaign_figures import figure_campaign, film_trial
    from maxjax.ui.figures.style import save_figure

    picture, film = ledger.folder / "flights.png", ledger.folder / "flight.gif"
    for old in (picture, film):
        old.unlink(missing_ok=True)
    if not any(outcome.flown for outcome in ledger.outcomes.values()):
        return []
    save_figure(figure_campaign(campaign, ledger), picture)
    trial = campaign.trials[0]
    if not flights or len(ledger.positions()[trial]) < 2:
        return [picture]
    atomic_write(film, film_trial(campaign, ledger.outcomes[trial], flights))
    return [picture, film]
