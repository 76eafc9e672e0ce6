"""The log of a flight over a link: CSV, a row a look, in the map's coordinates.

Rows go to a temporary name while it flies. Whatever ends the flight, the file is renamed then, whole to the last row.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import numpy as np
from jaxtyping import Float64

Point = Float64[np.ndarray, "3"]

COLUMNS = (
    "t_s", "stage", "mode", "armed", "x_m", "y_m", "z_m", "planned_x_m", "planned_y_m", "planned_z_m", "error_m",
    "pace", "clearance_m", "battery_percent", "remark",
)  # fmt: skip


@dataclasses.dataclass(frozen=True, eq=False)
class Look:
    """One look at a vehicle in flight; lengths [m].

    Attributes:
        time: since the link was up [s].
        stage: of the flight.
        mode: of the autopilot, as pilots call it.
        armed: whether its motors are.
        position: where it is in the map; NaN before that is known.
        planned: where it should be; in a mission the nearest point of the path.
        pace: of the clock that waits; NaN in a mission.
        clearance: distance to an occupied voxel.
        battery: what is left [%]; −1 where unknown.
        remark: what happened.
    """

    time: float
    stage: str
    mode: str
    armed: bool
    position: Point
    planned: Point
    pace: float
    clearance: float
    battery: int
    remark: str = ""

    @property
    def error(self) -> float:
        """Distance to where it should be [m]."""
        return float(np.linalg.norm(self.position - self.planned))

    def row(self) -> list[str]:
        """Texts of `COLUMNS`."""
        numbers = [*self.position.tolist(), *self.planned.tolist(), self.error, self.pace, self.clearance]
        shown = [f"{value:.3f}" for value in numbers]
        return [f"{self.time:.3f}", self.stage, self.mode, str(int(self.armed)), *shown, str(self.battery), self.remark]


class FlightLog:
    """Looks at a flight, in order; `open_log` makes one."""

    def __init__(self, file: IO[str]) -> None:
        self._file, self._writer = file, csv.writer(file, lineterminator="\n")
        self._writer.writerow(COLUMNS)
        self.looks: list[Look] = []

    def add(self, look: Look) -> None:
        """Add a look; it is handed to the system at once."""
        self.looks.append(look)
        self._writer.writerow(look.row())
        self._file.flush()


@contextlib.contextmanager
def open_log(path: Path) -> Iterator[FlightLog]:
    """A log that takes its place when the block ends, however it ends.

    Raises:
        OSError: if it cannot be written.
    """
    temporary = path.parent / f".{path.name}.{secrets.token_hex(4)}.tmp"
    with open(temporary, "x", newline="", encoding="utf-8") as file:
        try:
            yield FlightLog(file)
        finally:
            file.flush()
            os.fsync(file.fileno())
            os.replace(temporary, path)
