"""The folder of a campaign, from which it is resumed.

    config.json     the configuration          trials.jsonl    one outcome a line, appended a batch at a time
    positions/      every 0.1 s, by batch      times.json      run time of each batch

Lines are synchronised to the disk before their outcomes count; other files are replaced atomically. Only `times.json`
depends on the clock, so a resumed campaign leaves the same files as an uninterrupted one.
"""

from __future__ import annotations

import dataclasses
import io
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from maxjax.campaigns.outcomes import Outcome
from maxjax.core.files import atomic_write
from maxjax.core.interruption import finishing
from maxjax.core.serialization import read_npz

CONFIG, ROWS, POSITIONS, TIMES = "config.json", "trials.jsonl", "positions", "times.json"


class Ledger:
    """The folder of a campaign: its configuration, outcomes so far, positions, run times.

    Attributes:
        folder: the folder.
        outcomes: by trial.
        batch: flights at a time when it was last flown; None for a new folder.
    """

    def __init__(
        self, folder: Path, configuration: dict[str, Any], outcomes: dict[int, Outcome], batch: int | None
    ) -> None:
        self.folder, self._configuration, self.outcomes, self.batch = folder, configuration, outcomes, batch

    @classmethod
    def open(cls, folder: Path, configuration: dict[str, Any], trials: range) -> Ledger:
        """Make the folder, or check that it holds this campaign and read its outcomes.

        Args:
            folder: made if missing.
            configuration: all that the outcomes depend on, as JSON holds it.
            trials: indices of the campaign.

        Raises:
            ValueError: if it holds another campaign, or damaged files.
            OSError: if it cannot be written.
        """
        (folder / POSITIONS).mkdir(parents=True, exist_ok=True)
        config, rows = folder / CONFIG, folder / ROWS
        if not config.exists():
            if rows.exists():
                raise ValueError(f"{folder}: holds {ROWS} but no {CONFIG}; choose another folder")
            ledger = cls(folder, configuration, {}, None)
            ledger._write_config()
            return ledger
        try:
            written = json.loads(config.read_text())
            before, batch = dict(written["campaign"]), written["batch"]
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{config}: expected the configuration of a campaign; choose another folder") from error
        differing = [name for name in {**before, **configuration} if before.get(name) != configuration.get(name)]
        if differing:
            name = differing[0]
            raise ValueError(
                f"{folder}: holds another campaign: {name} was {before.get(name)} there, is {configuration.get(name)} "
                "here; choose another folder"
            )
        return cls(folder, configuration, _read(rows, trials), batch)

    def append(self, outcomes: Sequence[Outcome]) -> None:
        """Append one line an outcome; they are on the disk when this returns."""
        if not outcomes:
            return
        lines = "".join(json.dumps(dataclasses.asdict(o), allow_nan=False) + "\n" for o in outcomes)
        # One call of the system's `write`: KeyboardInterrupt comes before or after it, not between two lines.
        with finishing(), open(self.folder / ROWS, "ab", buffering=0) as file:
            file.write(lines.encode())
            os.fsync(file.fileno())
        self.outcomes.update({outcome.trial: outcome for outcome in outcomes})

    def record_positions(self, trials: Sequence[int], position: Float[np.ndarray, "b t 3"]) -> None:
        """Write the positions of a batch to a file of its own; NaN after the end of a flight."""
        longest = int(np.isfinite(position).all(axis=-1).sum(axis=1).max())
        content = io.BytesIO()
        np.savez_compressed(content, trial=np.asarray(trials), position=position[:, :longest])
        atomic_write(self.folder / POSITIONS / f"{trials[0]:06d}.npz", content.getvalue())

    def positions(self) -> dict[int, Float[np.ndarray, "t 3"]]:
        """Positions every 0.1 s [m] of the trials that have an outcome."""
        found = {}
        for file in sorted((self.folder / POSITIONS).glob("*.npz")):
            arrays = read_npz(file)
            for trial, position in zip(arrays["trial"].tolist(), arrays["position"], strict=True):
                if trial in self.outcomes:
                    found[trial] = position[np.isfinite(position).all(axis=-1)]
        return found

    def record_batch_size(self, size: int) -> None:
        """Record the size of the batches, with which the campaign is resumed."""
        if size != self.batch:
            self.batch = size
            self._write_config()

    def record_time(self, trials: Sequence[int], seconds: float) -> None:
        """Append the run time of a batch; that of the first one of a process includes compilation."""
        path = self.folder / TIMES
        try:
            times = json.loads(path.read_text())["batches"]
        except (OSError, ValueError, KeyError):
            times = []
        times.append({"first": trials[0], "trials": len(trials), "seconds": round(seconds, 3)})
        atomic_write(path, json.dumps({"batches": times}) + "\n")

    def _write_config(self) -> None:
        content = {"campaign": self._configuration, "batch": self.batch}
        atomic_write(self.folder / CONFIG, json.dumps(content, indent=2) + "\n")


def _read(path: Path, trials: range) -> dict[int, Outcome]:
    """Outcomes of a file of lines; an incomplete last line is removed."""
    if not path.exists():
        return {}
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        os.truncate(path, whole)
    outcomes = {}
    for number, line in enumerate(content[:whole].splitlines(), 1):
        try:
            outcome = Outcome(**json.loads(line))
        except (ValueError, TypeError) as error:
            raise ValueError(
                f"{path}: line {number} is no outcome; remove the file or choose another folder"
            ) from error
        if outcome.trial not in trials:
            raise ValueError(f"{path}: line {number} is about trial {outcome.trial}, which is not of this campaign")
        outcomes[outcome.trial] = outcome
    return outcomes
