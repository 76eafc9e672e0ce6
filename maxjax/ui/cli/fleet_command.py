"""`maxjax fly CITY --fleet N`: many vehicles in one air, the table of what became of them, and a picture.

A folder with a fleet.json is complete: it is written last and removed first.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from maxjax.core.files import atomic_write
from maxjax.core.provenance import device, versions
from maxjax.core.status import Status
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.movers.among import Flag, Flags
from maxjax.sim.swarm.swarm_flight import SwarmLog
from maxjax.sim.swarm.together import Together
from maxjax.sim.trials.swarm_trials import SwarmTrial, fly_swarm_in_stages, stuck
from maxjax.sim.worlds.populations import Population
from maxjax.ui.cli import report
from maxjax.ui.cli import track_command as tracking
from maxjax.ui.cli.options import FlyOptions
from maxjax.ui.cli.progress import progress

_ALONE = ("trials", "trial", "batch", "shard", "merge", "distributed")


def fly_together(count: int, options: FlyOptions, config: FlightConfig, movers: Population | None) -> int:
    """Fly a fleet, show and write. Returns 0, as who does not arrive is a result.

    Args:
        count: of vehicles.
        options: of `fly`.
        config: how each vehicle flies.
        movers: in the city besides.

    Raises:
        ValueError, OSError, ImportError: for arguments that cannot be used.
    """
    tracking.refuse(options, _ALONE, "goes with trials of one vehicle, not with --fleet")
    fleet = SwarmTrial(options.map, options.seed, count, Together(options.delay), config, movers)
    report.check_output(options.out)
    with progress(f"Drawing the swaps of {fleet.count} vehicles"):
        worlds = fleet.worlds()
    with progress(f"Flying {fleet.count} vehicles"):
        log = fly_swarm_in_stages(worlds, fleet.flight, fleet.together)
    content = report.plain({**swarm_figures(fleet, log), "versions": versions(), "device": device()})
    files = _written(options.out, content, fleet, log) if options.out is not None else []
    if options.json:
        sys.stdout.write(report.dumps(content))
        return 0
    title = f"{fleet.map}, seed {fleet.seed}, {fleet.count} vehicles, delay {fleet.together.delay:g} s"
    report.show(report.table(title, {"": _rows(content)}))
    for vehicle in content["vehicles"]:
        if vehicle["status"] != Status.OK.name:
            met = "" if vehicle["touched"] is None else f" with vehicle {vehicle['touched']}"
            print(f"vehicle {vehicle['vehicle']}: {vehicle['status']}{met} after {vehicle['duration']:.1f} s")
    if files:
        print(*files, sep="\n")
    return 0


def swarm_figures(fleet: SwarmTrial, log: SwarmLog) -> dict[str, Any]:
    """Contents of fleet.json; lengths [m], times [s]."""
    flights, touched = log.flights, np.asarray(log.touched)
    status, seconds = np.asarray(flights.status), np.asarray(flights.duration)
    flags = flights.part(Flags)
    flagged = np.asarray(flags.any_seconds)
    vehicles = [
        {
            "vehicle": k,
            "status": Status(int(status[k])).name,
            "start": fleet.swaps.start[k].tolist(),
            "goal": fleet.swaps.goal[k].tolist(),
            "duration": round(float(seconds[k]), 3),
            "flown_length": round(float(flights.flown_length[k]), 3),
            "clearance": round(float(flights.clearance[k]), 3),
            "gap": round(float(log.gap[k]), 3),
            "touched": int(touched[k]) if touched[k] >= 0 else None,
            "swaps": int(log.swaps[k]),
            "dropped": int(log.dropped[k]),
            "flagged": {flag.name: round(float(flags.seconds[k, flag]), 3) for flag in Flag},
        }
        for k in range(fleet.count)
    ]
    proposals = int(np.asarray(log.swaps).sum() + np.asarray(log.dropped).sum())
    return {
        "map": fleet.map,
        "seed": fleet.seed,
        "fleet": fleet.count,
        "delay": fleet.together.delay,
        "arrived": int((status == Status.OK).sum()),
        "contacts": int((touched >= 0).sum()),
        "contacts_with_others": int(((status == Status.IN_CONTACT) & (touched < 0)).sum()),
        "deadlocked": int(stuck(log).sum()),
        "statuses": dict(sorted(Counter(vehicle["status"] for vehicle in vehicles).items())),
        "duration": {"mean": round(float(seconds.mean()), 3), "longest": round(float(seconds.max()), 3)},
        "gap": round(float(np.asarray(log.gap).min()), 3),
        "proposals": proposals,
        "dropped_share": round(float(np.asarray(log.dropped).sum()) / max(proposals, 1), 4),
        "flagged_share": round(float(flagged.sum() / seconds.sum()), 5) if seconds.sum() else 0.0,
        "vehicles": vehicles,
    }


def _rows(content: dict[str, Any]) -> dict[str, str]:
    """The figures as the rows of a table."""
    return {
        "arrived": f"{content['arrived']} of {content['fleet']}",
        "statuses": ", ".join(f"{name} {count}" for name, count in content["statuses"].items()),
        "in contact with each other": str(content["contacts"]),
        "with anything else": str(content["contacts_with_others"]),
        "deadlocked": str(content["deadlocked"]),
        "least gap between two": f"{content['gap']:.2f} m",
        "duration": f"{content['duration']['mean']:.1f} s, longest {content['duration']['longest']:.1f} s",
        "proposals": f"{content['proposals']}, dropped {100 * content['dropped_share']:.1f} %",
        "flagged time": f"{100 * content['flagged_share']:.2f} %",
    }


def _written(out: Path, content: dict[str, Any], fleet: SwarmTrial, log: SwarmLog) -> list[Path]:
    """flights.png and fleet.json, each whole or not at all; those of an earlier one go."""
    from maxjax.ui.figures.campaign_figures import figure_swarm
    from maxjax.ui.figures.style import save_figure

    out.mkdir(parents=True, exist_ok=True)
    picture, summary = out / "flights.png", out / "fleet.json"
    for old in (summary, picture):
        old.unlink(missing_ok=True)
    save_figure(figure_swarm(fleet, log), picture)
    atomic_write(summary, report.dumps(content))
    return [picture, summary]
