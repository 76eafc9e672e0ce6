"""How fast maxjax was at commits of its history, beside a peer that never changes.

    python -m benchmarks.history     # two CPU cores: 15 minutes; goes on where it was interrupted

Every so many commits of the branch, counted from its first, and the one that is checked out: the package of each is
unpacked in a temporary folder and measured there by today's `common.history_probe`, with the packages of today. Rows
that are in the result file stay as they are, so that a run adds what is new; delete the file to measure all anew.
"""

from __future__ import annotations

import dataclasses
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

from benchmarks.common import history_probe
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, keep, show
from maxjax.compile.cache import VARIABLE

ROOT = Path(__file__).parents[1]
_QUARTER = ROOT / "docs" / "samples" / "quarter.geojson"
_NOT_PASSED = ("JAX_COMPILATION_CACHE_DIR", "XDG_CACHE_HOME", "PYTHONPATH", VARIABLE)


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        every: so many commits one is measured; 0: only the one that is checked out.
        repeats: of each figure.
        out: where the JSON goes.
    """

    every: int = 60
    repeats: int = 5
    out: Path = RESULTS


TINY = Config(every=0, repeats=1)


def main(config: Config) -> list[Row]:
    """Measure what is not measured yet; save and return all rows, in the order of their commits.

    Raises:
        OSError: outside a clone of the repository.
    """
    path = config.out / "history.json"
    rows: list[Row] = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []
    line = _git("log", "--first-parent", "--reverse", "--format=%h %cs").decode().splitlines()
    numbers = range(config.every, len(line), config.every) if config.every else ()
    for number in (len(line), *reversed(numbers)):  # the newest first
        commit, date = line[number - 1].split()
        if all(row["commit"] != commit for row in rows):
            print(f"{number} of {len(line)}: {commit}, {date}", flush=True)
            told = {key: _short(value) for key, value in _measured(commit, config.repeats).items()}
            rows = sorted([*rows, {"number": number, "commit": commit, "date": date, **told}], key=_number)
            keep("history", config, rows, config.out)
    show("history", rows)
    return rows


def _number(row: Row) -> int:
    return int(row["number"] or 0)


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.3g}")


def _git(*words: str) -> bytes:
    done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True)
    if done.returncode:
        raise OSError(f"git {words[0]}: {done.stderr.decode(errors='replace').strip()}; run this in a clone")
    return done.stdout


def _measured(commit: str, repeats: int) -> dict[str, float | None]:
    """The figures of a commit, from a process of its own whose caches are empty."""
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(_git("archive", commit, "maxjax"))) as archive:
            archive.extractall(folder, filter="data")
        here = {name: value for name, value in os.environ.items() if name not in _NOT_PASSED}
        here |= {VARIABLE: f"{folder}/kept", "XDG_CACHE_HOME": f"{folder}/home", "PYTHONPATH": folder}
        here |= {"JAX_PLATFORMS": "cpu"}
        command = [sys.executable, history_probe.__file__, str(_QUARTER), str(repeats)]
        done = subprocess.run(command, cwd=folder, env=here, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, float | None] = json.loads(done.stdout)
    return found


if __name__ == "__main__":
    main(configured(TINY))
