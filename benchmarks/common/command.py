"""The command line of an experiment or a benchmark: its configuration, or with `--tiny` one that ends in minutes.

    python -m experiments.mazes --problems 20            a field of the configuration an option
    python -m experiments.offline_table --tiny           begins with TINY, and writes to build/tiny

A tiny run shows that all of it works here; its figures mean nothing, so they never take the place of recorded ones.
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

FOLDER = Path("build/tiny")
"""Where results of tiny runs go, below the folder that the command is given in."""

_WRITTEN = ("out", "figures", "docs")  # fields that name folders, or a file, to write to
_TOLD = "With --tiny: a small run that shows that it works, written to build/tiny."


def configured(tiny: Config, words: Sequence[str] | None = None) -> Config:
    """The configuration that a command line asks for.

    Args:
        tiny: for `--tiny`; a dataclass whose fields all have defaults.
        words: of the command line; None: this process's.

    Raises:
        SystemExit: for options that it does not have.
    """
    given = list(sys.argv[1:] if words is None else words)
    named: Any = tiny
    begin: Any = type(tiny)()
    if "--tiny" in given:
        paths = {name: getattr(named, name) for name in _WRITTEN if hasattr(named, name)}
        moved = {name: FOLDER / path.name if path.suffix else FOLDER for name, path in paths.items()}
        begin = dataclasses.replace(named, **moved)
    told = f"{(inspect.getdoc(type(tiny)) or '').partition('Attributes:')[0].strip()}\n\n{_TOLD}"
    rest = [word for word in given if word != "--tiny"]
    found: Config = tyro.cli(type(tiny), args=rest, default=begin, description=told)
    return found
