"""The command line of an experiment or a benchmark: its configuration, where results go, and `--tiny` and `--record`.

    python -m experiments.hard_maps --problems 20        a field as an option; writes to build/results
    python -m experiments.hard_maps --record             takes the place of the recorded result
    python -m experiments.offline_table --tiny           begins with TINY, and writes to build/tiny

Recorded results are replaced only where that is asked for. A tiny run shows that all of it works here; its figures mean
nothing, so it never replaces any.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import tyro

Config = TypeVar("Config")

TINY_FOLDER, FOLDER = Path("build/tiny"), Path("build/results")
"""Where results of tiny and of other runs go, below the folder that the command is given in."""

_WRITTEN = ("out", "figures", "docs")  # fields that name folders, or a file, to write to
_TOLD = (
    f"Results are written to {FOLDER}; with --record they replace the recorded ones. With --tiny: a small run "
    f"that shows that it works, written to {TINY_FOLDER}."
)


def configured(tiny: Config, words: Sequence[str] | None = None) -> Config:
    """The configuration that a command line asks for.

    Args:
        tiny: for `--tiny`; a dataclass whose fields all have defaults.
        words: of the command line; None: this process's.

    Raises:
        SystemExit: for options that it does not have, or --tiny with --record.
    """
    given = list(sys.argv[1:] if words is None else words)
    if {"--tiny", "--record"} <= {*given}:
        raise SystemExit("--tiny and --record: expected one of them, given both: a tiny run has no figures to record")
    named: Any = tiny
    whole: Any = type(tiny)()
    begin: Any = named if "--tiny" in given else whole
    if "--record" not in given:
        folder = TINY_FOLDER if "--tiny" in given else FOLDER
        paths = {name: getattr(named, name) for name in _WRITTEN if hasattr(named, name)}
        moved = {name: folder / path.name if path.suffix else folder for name, path in paths.items()}
        begin = dataclasses.replace(begin, **moved)
    purpose = inspect.getdoc(sys.modules[type(tiny).__module__]) or ""
    told = f"{purpose}\n\n{_TOLD}"
    rest = [word for word in given if word not in ("--tiny", "--record")]
    found: Config = tyro.cli(type(tiny), args=rest, default=begin, description=told)
    return found
