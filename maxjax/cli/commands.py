"""From arguments to a command: each is a module of its own, imported when it runs.

So `--help` waits for none of their libraries.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

import tyro

from maxjax.cli.options import (
    CheckOptions,
    DemoOptions,
    FlyOptions,
    MapOptions,
    MissionOptions,
    PlanOptions,
    ScanOptions,
    TrainOptions,
    ViewOptions,
)

_UNUSABLE = 2

# By name: options, and the module whose `run` takes them and returns the exit code.
_COMMANDS: dict[str, tuple[type, str]] = {
    "plan": (PlanOptions, "planning"),
    "mission": (MissionOptions, "mission"),
    "map": (MapOptions, "mapping"),
    "scan": (ScanOptions, "scanning"),
    "fly": (FlyOptions, "flying"),
    "view": (ViewOptions, "viewing"),
    "train": (TrainOptions, "training"),
    "demo": (DemoOptions, "demo"),
    "check": (CheckOptions, "check"),
}


def run(arguments: Sequence[str] | None) -> int:
    """Run a command; arguments and exit code as in `maxjax.cli.main`."""
    options = tyro.extras.subcommand_cli_from_dict(
        {name: kind for name, (kind, _) in _COMMANDS.items()},
        prog="maxjax",
        description="Certified flight paths for UAVs in cities.",
        args=arguments,
    )
    (name,) = (name for kind, name in _COMMANDS.values() if isinstance(options, kind))
    try:
        module = importlib.import_module(f"maxjax.cli.{name}")
        code: int = module.run(options)
        return code
    except (ValueError, OSError, ImportError, MemoryError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and not _of_jax(error):
            raise
        # JAX's own errors, out of memory above all, go on for pages.
        sentence = next(iter(str(error).splitlines()), type(error).__name__)
        print(f"maxjax: error: {sentence}", file=sys.stderr)
        return _UNUSABLE


def _of_jax(error: RuntimeError) -> bool:
    # Imported here, as `--help` needs no JAX.
    from jax.errors import JaxRuntimeError

    return isinstance(error, JaxRuntimeError)
