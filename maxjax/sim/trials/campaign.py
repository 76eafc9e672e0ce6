"""Campaigns: what is flown to fill a cell of a table.

    campaign = (map, seed, trials, config)          outcome of trial i = f(map, seed, i, config)

The map is a simulated one by name, or a given city (`sim.trials.cities`).

The key of a trial's flight is folded from map, seed and index, so that its outcome depends on no other trial.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jaxtyping import PRNGKeyArray

from maxjax.core.rng_streams import named_key
from maxjax.core.status import Status
from maxjax.sim.loop.flight import FlightConfig, stages_of
from maxjax.sim.loop.flight_state import LOG_PERIOD
from maxjax.sim.movers.among import Flag
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.movers.lidar_perception import LidarPerception
from maxjax.sim.movers.reachable_sets import Bounds
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.trials.cities import Where, name_of, stream_of
from maxjax.sim.trials.given_city import GivenCity
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import INVALID_DRAW, Outcome, Table
from maxjax.sim.vehicle.disturbances import Disturbances, scan_error
from maxjax.sim.worlds.layouts import MAPS
from maxjax.sim.worlds.mover_ways import ACCELERATION
from maxjax.sim.worlds.populations import Population

# Bounds that movers are assumed to keep, over those that they keep: measured velocities have errors.
_ALLOWANCE = 1.1
# Distances to walls in a contact are compared with so much room [m].
_ROUNDING = 1e-3
# What configurations of earlier versions lack, and what it is where they lack it.
_LATER: dict[str, Any] = {"exact": False, "moving": None, "movers": None, "extensions": []}
_LATER_LIDAR = {"turn": 0.1, "width": 360.0, "reports_misses": False}

# The command line that flies a trial of a campaign again, by itself.
Command = Callable[["Campaign", int], str]


@dataclasses.dataclass(frozen=True)
class Campaign:
    """A campaign: city, trials, and how to fly them.

    Attributes:
        map: one of `MAPS`, or a city of one's own.
        seed: of the first city; in a given one of the draws alone.
        trials: their indices.
        config: how to fly, with the planner; its disturbances are numbers.
        movers: in every city, by a key of their own; None: there are none.
        command: tells the command line of a trial. None: outcomes name none.

    Raises:
        ValueError: for what cannot be flown.
    """

    map: Where
    seed: int = 0
    trials: range = range(1)
    config: FlightConfig = dataclasses.field(kw_only=True)
    movers: Population | None = dataclasses.field(default=None, kw_only=True)
    command: Command | None = dataclasses.field(default=None, kw_only=True, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.map, GivenCity) and self.map not in MAPS:
            raise ValueError(
                f"map: expected one of {', '.join(MAPS)}, given {self.map!r}; a city of your own is given by its file"
            )
        if len(self.trials) < 1 or self.trials.step != 1 or self.trials.start < 0:
            raise ValueError(f"trials: expected at least one, from 0 on, given {self.trials}")
        if not 0 <= self.seed < 2**31:
            raise ValueError(f"seed: expected 0 to 2^31 - 1, given {self.seed}")
        for name, value in self.strengths.items():
            most = {"dropout": 1.0, "dead_sector": 360.0, "latency": 1.0}.get(name, math.inf)
            if not (math.isfinite(value) and 0 <= value <= most):
                raise ValueError(f"{name}: expected a number from 0 to {most:g}, given {value:g}")
        if not (math.isfinite(self.config.reactive) and self.config.reactive >= 0):
            raise ValueError(f"reactive: expected a number of at least 0, given {self.config.reactive:g}")

    @property
    def name(self) -> str:
        """Name of the map, or of the file of a given city."""
        return name_of(self.map)

    @property
    def strengths(self) -> dict[str, float]:
        """The disturbances."""
        return {name: float(value) for name, value in dataclasses.asdict(self.config.disturbances).items()}

    @property
    def flight(self) -> FlightConfig:
        """How to fly, with disturbances as a program takes them; among movers, by its own LiDAR if nothing is said."""
        config = dataclasses.replace(self.config, disturbances=Disturbances(**self.strengths))
        if self.movers is None or config.has(Avoidance):
            return config
        how = self.movers
        bounds = Bounds(_ALLOWANCE * how.fastest, _ALLOWANCE * ACCELERATION, how.body, how.turn)
        sight = TrackingSettings(config.lidar, bounds)
        strengths = self.strengths
        error = scan_error(strengths["drift"], strengths["range_noise"], config.lidar, sight.images * sight.apart)
        perception = LidarPerception(dataclasses.replace(sight, pose_error=error))
        return config.with_extension(Avoidance(perception, bounds))

    @property
    def key(self) -> PRNGKeyArray:
        """Key that the keys of all its flights are folded from."""
        return named_key(jax.random.key(self.seed), f"flights {stream_of(self.map)}")

    def configuration(self) -> dict[str, Any]:
        """All that the outcomes depend on, as JSON holds it.

        What earlier versions did not know is left out where it is as it was then: their campaigns can be resumed.
        """
        own: dict[str, Any] = {"map": self.name}
        own |= {"city": dict(self.map.identity)} if isinstance(self.map, GivenCity) else {}
        own |= {"seed": self.seed, "first": self.trials.start, "trials": len(self.trials)}
        config = self.flight
        # `moving` was a setting of its own, in the place of the extensions.
        names = {"extensions": "moving"}
        settings = {names.get(one.name, one.name): getattr(config, one.name) for one in dataclasses.fields(config)}
        settings["moving"] = config.extension(Avoidance) if config.has(Avoidance) else None
        settings["extensions"] = [type(one).__name__ for one in config.extensions if not isinstance(one, Avoidance)]
        settings |= {"disturbances": self.config.disturbances, "movers": self.movers}
        del settings["planner"]  # told by its name
        settings["stages"] = [getattr(stage, "__name__", str(stage)) for stage in stages_of(self.config)]
        plain: dict[str, Any] = json.loads(
            json.dumps({**own, "method": self.config.planner.name, **settings}, default=_plain)
        )
        plain["lidar"] = _without(plain["lidar"], _LATER_LIDAR)
        return _without(plain, _LATER)

    def ledger(self, folder: Path) -> Ledger:
        """The folder that keeps it, made if missing; raises as `Ledger.open`."""
        return Ledger.open(folder, self.configuration(), self.trials)


def _plain(value: Any) -> Any:
    """Values that JSON does not know: dataclasses by their fields, functions by their names."""
    return value.__name__ if callable(value) and not dataclasses.is_dataclass(value) else dataclasses.asdict(value)


def _without(settings: dict[str, Any], usual: dict[str, Any]) -> dict[str, Any]:
    """Settings but for those that are as usual."""
    return {name: value for name, value in settings.items() if name not in usual or value != usual[name]}


def outcome_of(campaign: Campaign, drawn: Table, row: int, logs: Table | None = None, place: int = 0) -> Outcome:
    """The outcome of one trial of a campaign.

    Args:
        campaign: that it belongs to.
        drawn: all trials of the campaign, in order.
        row: of the trial in `drawn`.
        logs: of the batch that it was flown in; None for a trial that could not be drawn.
        place: of the trial in that batch.
    """
    trial = campaign.trials[row]
    unflown = Outcome(
        trial=trial,
        city=int(drawn["city"][row]),
        status=INVALID_DRAW,
        start=None,
        goal=None,
        distance=None,
        excluded=int(drawn["excluded"][row]),
        flown_length=None,
        duration=None,
        clearance=None,
        planning_iterations=0,
        failed_plans=0,
        margins={},
        certified=None,
        command="" if campaign.command is None else campaign.command(campaign, trial),
    )
    if logs is None:
        return unflown

    def millimetres(value: Any) -> float | None:
        return round(float(value), 3) if math.isfinite(value) else None

    log = {name: values[place] for name, values in logs.items()}
    found = int(log["planning_iterations"]) - int(log["failed_plans"])
    margins = Counter(log["margin"][np.isfinite(log["margin"])].tolist())
    return dataclasses.replace(
        unflown,
        **_flags_of(campaign, log),
        status=Status(int(log["status"])).name,
        start=drawn["start"][row].tolist(),
        goal=drawn["goal"][row].tolist(),
        distance=millimetres(math.dist(drawn["start"][row], drawn["goal"][row])),
        flown_length=millimetres(log["flown_length"]),
        duration=millimetres(log["duration"]),
        clearance=millimetres(log["clearance"]),
        planning_iterations=int(log["planning_iterations"]),
        failed_plans=int(log["failed_plans"]),
        margins={f"{margin:g}": count for margin, count in sorted(margins.items(), reverse=True)},
        certified=round(float(log["certified"]) / found, 4) if found else None,
    )


def _flags_of(campaign: Campaign, log: Table) -> dict[str, Any]:
    """Figures of the flags of one flight; empty where no movers were expected."""
    if "flags.seconds" not in log:
        return {}
    horizon = campaign.flight.extension(Avoidance).choice.horizon
    duration = float(log["duration"])
    share = float(log["flags.any_seconds"]) / duration if duration > 0.0 else 0.0
    touched = int(log["status"]) == Status.IN_CONTACT
    last = float(np.max(log["flags.last"]))
    # Flags stay as they are from one look to the next; times are those of physics steps, which round.
    at_once = last >= duration - LOG_PERIOD - 0.5 * campaign.flight.vehicle.timestep
    # Without movers only walls are there to be touched.
    wall = float(log.get("to_walls", 0.0)) <= campaign.config.radius + _ROUNDING
    return {
        "flagged": {flag.name: round(float(log["flags.seconds"][flag]), 3) for flag in Flag},
        "flagged_share": round(min(share, 1.0), 5),
        "flagged_before": last >= duration - horizon if touched else None,
        "flagged_at_contact": at_once if touched else None,
        "touched": ("wall" if wall else "mover") if touched else None,
        "hidden_movers": int(log["hidden"]) if "hidden" in log else None,
    }
