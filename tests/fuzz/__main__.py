"""Mutate small valid inputs of every format, and count how they end.

    python -m tests.fuzz --inputs 1050000      # one CPU core: 6 minutes; goes on where it was interrupted

    python -m tests.fuzz --inputs 3700000 --formats ed318.json fence.plan      # some alone, each as often as then

Expected: every input is refused in a sentence of maxjax, or taken as something finite. The first of each format that
ends otherwise is kept in OUT/otherwise, and the command fails.
"""

from __future__ import annotations

import contextlib
import dataclasses
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import tyro

from benchmarks.common.harness import RESULTS, Row, begun, keep, show
from tests.fuzz.formats import FORMATS, share


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        inputs: of all formats together.
        seed: of the mutations.
        formats: those alone; none given: all.
        out: where the JSON goes.
    """

    inputs: int = 100_000
    seed: int = 0
    formats: tuple[str, ...] = ()
    out: Path = RESULTS


def main(config: Config) -> list[Row]:
    """Try all formats.

    Raises:
        SystemExit: if an input ends otherwise than it should.
    """
    rows = begun("fuzz", config, config.out)
    done = {str(row["format"]) for row in rows}
    for name in (name for name in config.formats or FORMATS if name not in done):
        rows.append(_row(name, config))
        keep("fuzz", config, rows, config.out)
    show("fuzz", rows)
    if wrong := [str(row["format"]) for row in rows if row["otherwise"]]:
        raise SystemExit(f"neither refused nor finite: {', '.join(wrong)}; the first of each is in {config.out}")
    return rows


def _row(name: str, config: Config) -> Row:
    tried, rng = FORMATS[name], np.random.default_rng(config.seed)
    whole, found = tried.valid(), Counter[str]()
    count, start = share(name, config.inputs), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(count):
            content = tried.damage(whole, rng)
            try:
                found[tried.outcome(content, Path(folder))] += 1
            except Exception as error:
                found["otherwise"] += 1
                if found["otherwise"] == 1:
                    _keep(config.out / "otherwise", name, content, error)
    counts = {end: found[end] for end in ("refused", "taken", "otherwise")}
    return {"format": name, "inputs": count, **counts, "seconds": round(time.process_time() - start, 1)}


def _keep(folder: Path, name: str, content: bytes, error: Exception) -> None:
    """The input, and how it ended."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"first-{name.replace(' ', '-')}").write_bytes(content)
    with contextlib.suppress(UnicodeError):
        print(f"{name}: {type(error).__name__}: {str(error)[:500]}")


if __name__ == "__main__":
    main(tyro.cli(Config))
