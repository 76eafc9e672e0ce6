"""From arguments to a command: each is a module of its own, imported when it runs.

So `--help` waits for none of their libraries.
"""

from __future__ import annotations

import dataclasses
import importlib
import sys
from collections.abc import Sequence

import tyro

from maxjax.ui.cli.options import (
    CheckOptions,
    DemoOptions,
    FlyOptions,
    MapOptions,
    MissionOptions,
    PlanOptions,
    RosOptions,
    ScanOptions,
    TrainOptions,
    ViewOptions,
)
from maxjax.ui.cli.photo_options import InspectOptions, SurveyOptions

_UNUSABLE = 2

# By name: options, and the module and its function that takes them and returns the exit code.
_COMMANDS: dict[str, tuple[type, str, str]] = {
    "plan": (PlanOptions, "plan_command", "run_plan"),
    "mission": (MissionOptions, "mission_command", "run_mission"),
    "inspect": (InspectOptions, "inspect_command", "run_inspect"),
    "survey": (SurveyOptions, "inspect_command", "run_survey"),
    "map": (MapOptions, "map_command", "run_map"),
    "scan": (ScanOptions, "scan_command", "run_scan"),
    "fly": (FlyOptions, "fly_command", "run_fly"),
    "view": (ViewOptions, "view_command", "run_view"),
    "ros": (RosOptions, "ros_command", "run_ros"),
    "train": (TrainOptions, "train_command", "run_train"),
    "demo": (DemoOptions, "demo_command", "run_demo"),
    "check": (CheckOptions, "check_command", "run_check"),
}


def run(arguments: Sequence[str] | None) -> int:
    """Run a command; arguments and exit code as in `maxjax.ui.cli.main`."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    # What ROS is told is no option of ours.
    cut = given.index("--ros-args") if given[:1] == ["ros"] and "--ros-args" in given else len(given)
    options = tyro.extras.subcommand_cli_from_dict(
        {name: kind for name, (kind, *_) in _COMMANDS.items()},
        prog="maxjax",
        description="Certified flight paths for UAVs in cities.",
        args=given[:cut],
    )
    if isinstance(options, RosOptions):
        options = dataclasses.replace(options, ros_arguments=tuple(given[cut:]))
    ((module, function),) = ((m, f) for kind, m, f in _COMMANDS.values() if isinstance(options, kind))
    try:
        code: int = getattr(importlib.import_module(f"maxjax.ui.cli.{module}"), function)(options)
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
