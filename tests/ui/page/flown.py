"""A folder of two flights in a town that was flown by nobody: one arrived, one touched a wall."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np

from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.outcomes import Outcome

START, GOAL = (-30.0, -60.0, 12.0), (20.0, -20.0, 12.0)


def line(share: float) -> np.ndarray:
    part = np.linspace(0.0, share, round(81 * share))[:, None]
    return (np.array(START) + part * (np.array(GOAL) - START)).astype(np.float32)


def folder(path: Path) -> Path:
    ledger = Ledger.open(path, {"map": "suburb", "seed": 0, "first": 0, "trials": 3}, range(3))
    for trial, status, share in ((0, "OK", 1.0), (1, "IN_CONTACT", 0.5)):
        ledger.append([outcome(trial, status)])
        ledger.record_positions([trial], line(share)[None])
    missing = dict.fromkeys(("start", "goal", "distance", "flown_length", "duration", "clearance"))
    ledger.append([dataclasses.replace(outcome(2, "INVALID_DRAW"), **missing)])  # type: ignore[arg-type]
    with open(path / "trials.jsonl", "a") as file:
        file.write(json.dumps({"trial": 3})[:-1])  # a line that is being written
    return path


def outcome(trial: int, status: str) -> Outcome:
    return Outcome(
        trial=trial,
        city=0,
        status=status,
        start=list(START),
        goal=list(GOAL),
        distance=64.0,
        excluded=0,
        flown_length=64.0,
        duration=8.0,
        clearance=3.0,
        planning_iterations=8,
        failed_plans=0,
        margins={"8": 8},
        certified=1.0,
        command=f"maxjax fly suburb --seed 0 --trial {trial}",
    )
