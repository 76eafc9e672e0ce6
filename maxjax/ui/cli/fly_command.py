"""`maxjax fly`: trials of the closed loop in a simulated city, their table, and pictures of them.

With ends given it flies a trajectory in a given map: `ui.cli.track_command`.
"""

from __future__ import annotations

import dataclasses
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from maxjax.core.files import atomic_write
from maxjax.core.provenance import device, versions
from maxjax.sim.loop.flight import Flight, FlightConfig
from maxjax.sim.trials.batches import fly_trials
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import Outcome, summarise
from maxjax.sim.trials.processes import own_shard
from maxjax.sim.trials.replay import replay
from maxjax.sim.trials.shards import Shard, merge
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.populations import Population
from maxjax.ui.cli import fleet_command as fleets
from maxjax.ui.cli import report
from maxjax.ui.cli import track_command as tracking
from maxjax.ui.cli.options import FlyOptions
from maxjax.ui.cli.progress import progress, tally
from maxjax.ui.methods import planner_named


def run_fly(options: FlyOptions) -> int:
    """Fly, show and write. Returns 0, as failed trials are a result; with given ends, `track_command.fly_given`.

    Where shares are merged and trials are missing: 1.

    Raises:
        ValueError, OSError, ImportError, MemoryError: for arguments that cannot be used.
    """
    if options.map.lower().endswith(".toml"):
        return tracking.fly_mission(options)
    if options.start is not None or options.goal is not None:
        return tracking.fly_given(options)
    tracking.refuse(options, tracking.GIVEN, "needs --start and --goal, and a map to fly in")
    if options.fleet is not None:
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
        return _tell(campaign, options, options.out, outcomes, flights)
    if options.shard is not None:
        share, folder, outcomes = _fly_share(campaign, options, Shard.of(options.shard), whole)
        return _tell(share, options, folder, outcomes) if outcomes else 0
    return _merge(campaign, options, whole)


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
    title = f"{campaign.map}, seed {campaign.seed}, method {campaign.config.planner.name}"
    report.show(report.table(title, {"": _rows(content, outcomes)}))
    for failure in content["failures"]:
        print(f"trial {failure['index']}: {failure['status']}; again: {failure['command']}")
    if files:
        print(*files, sep="\n")
    return 0


def campaign_of(options: FlyOptions) -> Campaign:
    """The campaign that options describe.

    Raises:
        ValueError: for what cannot be flown.
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
    return Campaign(options.map, options.seed, trials_flown, config=config, movers=movers, command=command_of)


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


def command_of(campaign: Campaign, trial: int) -> str:
    """The command line that flies one trial of a campaign again, by itself; a remark where none does."""
    if differing := _beyond_options(campaign):
        return f"{NO_COMMAND} {', '.join(differing)}"
    words = ["maxjax", "fly", campaign.map, "--seed", str(campaign.seed), "--trial", str(trial)]
    config, strengths = campaign.config, campaign.strengths
    if config.planner.name != "field":
        words += ["--method", config.planner.name]
    for name, option in _OPTIONS.items():
        if strengths[name]:
            words += [option, f"{strengths[name]:.12g}"]
    words += ["--latency"] * bool(strengths["latency"]) + ["--snapshot"] * config.snapshot
    words += ["--reactive", f"{config.reactive:.12g}"] if config.reactive else []
    if (movers := campaign.movers) is not None:
        words += ["--movers", str(movers.count), "--mover-speed", f"{movers.speed:.12g}", "--mover-kind", movers.kind]
    return shlex.join(words)


def _beyond_options(campaign: Campaign) -> list[str]:
    """Settings of a campaign's flights that no option of the command line gives."""
    config = campaign.config
    try:
        planner = planner_named(config.planner.name)
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


def _rows(content: dict[str, Any], outcomes: Sequence[Outcome]) -> dict[str, str]:
    """The summary as the rows of a table."""

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
