"""The folder of a campaign, from which it is resumed.

    config.json     the configuration          trials.jsonl    one outcome a line, appended a batch at a time
    positions/      every 0.1 s, by batch      times.json      run time of each batch
    shards/K-of-N/  such folders, of shares    lock            held by the process that flies

Lines are synchronised to the disk before their outcomes count; other files are replaced atomically. Only `times.json`
depends on the clock, so a resumed campaign leaves the same files as an uninterrupted one. Beside the configuration
stands what the lines were flown by: the sources of maxjax, versions, devices.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from maxjax.core.files import FileError, atomic_write, brief, open_to_append, read_bytes, read_text
from maxjax.core.interruption import finishing
from maxjax.core.provenance import device, sources, versions
from maxjax.core.serialization import read_npz
from maxjax.sim.trials.outcomes import Outcome

CONFIG, ROWS, POSITIONS, TIMES = "config.json", "trials.jsonl", "positions", "times.json"
_LOCK = "lock"


class Ledger:
    """The folder of a campaign: its configuration, outcomes so far, positions, run times.

    Attributes:
        folder: the folder.
        configuration: all that the outcomes depend on, as JSON holds it.
        outcomes: by trial.
        batch: flights at a time when it was last flown; None for a new folder.
        flown_by: what its lines were flown by, each once: digest of the sources, versions, device.
    """

    def __init__(self, folder: Path, configuration: dict[str, Any], outcomes: dict[int, Outcome] | None = None) -> None:
        self.folder, self.configuration, self.outcomes = folder, configuration, outcomes or {}
        self.batch: int | None = None
        self.flown_by: list[dict[str, Any]] = []

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
        if not (folder / CONFIG).exists():
            if (folder / ROWS).exists():
                raise ValueError(f"{folder}: holds {ROWS} but no {CONFIG}; choose another folder")
            ledger = cls(folder, configuration)
            ledger._write_config()
            return ledger
        ledger = cls.read(folder)
        before = ledger.configuration
        differing = [name for name in {**before, **configuration} if before.get(name) != configuration.get(name)]
        if differing:
            name = differing[0]
            raise ValueError(
                f"{folder}: holds another campaign: {name} was {brief(before.get(name))} there, is "
                f"{brief(configuration.get(name))} here; choose another folder"
            )
        if foreign := sorted(set(ledger.outcomes) - set(trials)):
            raise ValueError(f"{folder / ROWS}: holds trial {foreign[0]}, which is not of this campaign")
        return ledger

    @classmethod
    def read(cls, folder: Path) -> Ledger:
        """The ledger of a folder, so far; nothing in it is changed, and a last line in writing is left out.

        Raises:
            ValueError: if it holds no campaign, or damaged files.
        """
        try:
            written = json.loads(read_text(folder / CONFIG))
            ledger = cls(folder, dict(written["campaign"]), _read(folder / ROWS))
            ledger.batch, ledger.flown_by = _batch(written), [dict(one) for one in written.get("flown_by", [])]
        except (KeyError, TypeError, RecursionError, ValueError) as error:
            # What is there and cannot be used has its own sentence.
            if isinstance(error, FileError) and not isinstance(error.__cause__, OSError):
                raise
            raise ValueError(
                f"{folder}: expected a folder that maxjax fly --out has written, with its {CONFIG}; "
                "choose another folder"
            ) from error
        return ledger

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Keep other processes from flying into the folder: two that append to one file may lose lines.

        A process that is killed lets go of it, and the line that it was writing is removed. On a file system without
        locks nobody is kept from anything.

        Raises:
            ValueError: if another process flies into it, or its files are none.
        """
        with open_to_append(self.folder / _LOCK) as file:
            try:
                import fcntl

                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise ValueError(
                    f"{self.folder}: another process flies into it; wait for that one, or choose another folder"
                ) from error
            except (ImportError, OSError):
                pass
            if (rows := self.folder / ROWS).exists():
                os.truncate(rows, len(_whole(rows)))
            self.outcomes = _read(rows)  # another process may just have ended
            yield

    def append(self, outcomes: Sequence[Outcome]) -> None:
        """Append one line an outcome, flown by this process; they are on the disk when this returns."""
        if not outcomes:
            return
        self.record_makers([{"sources": sources(), "versions": versions(), "device": device()}])
        # One call of the system's `write`: KeyboardInterrupt comes before or after it, not between two lines.
        with finishing(), open_to_append(self.folder / ROWS) as file:
            file.write(_lines(outcomes))
            os.fsync(file.fileno())
        self.outcomes.update({outcome.trial: outcome for outcome in outcomes})

    def rewrite(self, outcomes: Sequence[Outcome]) -> None:
        """Put these lines, in this order, in place of those that are there."""
        atomic_write(self.folder / ROWS, _lines(outcomes))
        self.outcomes = {outcome.trial: outcome for outcome in outcomes}

    def record_positions(self, trials: Sequence[int], position: Float[np.ndarray, "b t 3"]) -> None:
        """Write the positions of a batch to a file of its own; NaN after the end of a flight."""
        longest = int(np.isfinite(position).all(axis=-1).sum(axis=1).max())
        content = io.BytesIO()
        np.savez_compressed(content, trial=np.asarray(trials), position=position[:, :longest])
        atomic_write(self.folder / POSITIONS / f"{trials[0]:06d}.npz", content.getvalue())

    def positions(self) -> dict[int, Float[np.ndarray, "t 3"]]:
        """Positions every 0.1 s [m] of the trials that have an outcome."""
        return {
            trial: position[np.isfinite(position).all(axis=-1)]
            for trials, batch in self.batches()
            for trial, position in zip(trials, batch, strict=True)
        }

    def batches(self) -> Iterator[tuple[list[int], Float[np.ndarray, "b t 3"]]]:
        """Trials that have an outcome and their positions [m], file by file, as `record_positions` takes them."""
        for file in sorted((self.folder / POSITIONS).glob("*.npz")):
            trials, position = _positions(file)
            rows = [row for row, trial in enumerate(trials) if trial in self.outcomes]
            if rows:
                yield [trials[row] for row in rows], position[rows]

    def without_positions(self) -> list[int]:
        """Trials that flew, and whose positions are no longer there, in order."""
        kept = {trial for trials, _ in self.batches() for trial in trials}
        return sorted(trial for trial, outcome in self.outcomes.items() if outcome.flown and trial not in kept)

    @property
    def lost_positions(self) -> str:
        """A remark on flights whose positions are no longer there; empty if nothing is lost."""
        lost = self.without_positions()
        if not lost:
            return ""
        return (
            f"{self.folder / POSITIONS}: lacks the positions of {len(lost)} trials that flew, the first of them "
            f"{lost[0]}; they cannot be shown; remove their lines from {ROWS} and they are flown again"
        )

    @property
    def other_makers(self) -> str:
        """A remark on lines that other sources or versions flew; empty if there are none."""
        own = {"sources": sources(), "versions": versions()}
        others = [one for one in self.flown_by if {name: one.get(name) for name in own} != own]
        if not others or not self.outcomes:
            return ""
        return (
            f"{self.folder}: of its {len(self.outcomes)} outcomes some were flown by other sources or versions "
            f"({len(others)} others); they stay, and {CONFIG} names all of them. For outcomes of one kind, choose "
            "another folder"
        )

    def record_batch_size(self, size: int | None) -> None:
        """Record the size of the batches, with which the campaign is resumed."""
        if size != self.batch:
            self.batch = size
            self._write_config()

    def record_makers(self, makers: Iterable[dict[str, Any]]) -> None:
        """Record what lines were flown by."""
        before = len(self.flown_by)
        for maker in makers:
            if maker not in self.flown_by:
                self.flown_by.append(maker)
        if len(self.flown_by) > before:
            self._write_config()

    def record_time(self, trials: Sequence[int], seconds: float) -> None:
        """Append the run time of a batch; that of the first one of a process includes compilation."""
        self.record_times([{"first": trials[0], "trials": len(trials), "seconds": round(seconds, 3)}])

    def record_times(self, times: Sequence[dict[str, Any]]) -> None:
        """Append run times, as `times` tells them."""
        atomic_write(self.folder / TIMES, json.dumps({"batches": [*self.times(), *times]}) + "\n")

    def times(self) -> list[dict[str, Any]]:
        """First trial, number of trials and run time [s] of each batch; empty where they cannot be read."""
        try:
            return list(json.loads(read_text(self.folder / TIMES))["batches"])
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return []

    def _write_config(self) -> None:
        content = {"campaign": self.configuration, "batch": self.batch, "flown_by": self.flown_by}
        atomic_write(self.folder / CONFIG, json.dumps(content, indent=2) + "\n")


def _batch(written: dict[str, Any]) -> int | None:
    batch = written.get("batch")
    if batch is not None and (type(batch) is not int or batch < 1):
        raise ValueError(f"batch: expected a positive whole number, given {brief(batch)}")
    return batch


def _positions(path: Path) -> tuple[list[int], Float[np.ndarray, "b t 3"]]:
    """Trials and positions [m] of a file of `record_positions`."""
    arrays = read_npz(path)
    trial, position = arrays.get("trial"), arrays.get("position")
    if trial is None or position is None or trial.dtype.kind != "i" or position.dtype.kind != "f":
        raise FileError(f"{path}: expected trials and their positions, given something else; remove it")
    if trial.ndim != 1 or position.ndim != 3 or (len(position), position.shape[2]) != (len(trial), 3):
        raise FileError(f"{path}: expected positions (b, t, 3) of trials (b), given {position.shape} of {trial.shape}")
    return trial.tolist(), position


def _lines(outcomes: Iterable[Outcome]) -> bytes:
    """An outcome a line."""
    return "".join(json.dumps(one.line, allow_nan=False) + "\n" for one in outcomes).encode()


def _whole(path: Path) -> bytes:
    """A file up to the end of its last whole line."""
    content = read_bytes(path)
    return content[: content.rfind(b"\n") + 1]


def _read(path: Path) -> dict[int, Outcome]:
    """Outcomes of a file of lines, none where there is no file; an incomplete last line is left out."""
    if not path.exists():
        return {}
    outcomes = {}
    for number, line in enumerate(_whole(path).splitlines(), 1):
        try:
            outcome = Outcome.of(json.loads(line))
        except (ValueError, TypeError, RecursionError) as error:
            raise FileError(f"{path}: line {number} is no outcome; remove the file or choose another folder") from error
        outcomes[outcome.trial] = outcome
    return outcomes
