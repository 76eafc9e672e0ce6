"""The commands, their options and their help.

Each command is a module of its own that is imported when it runs, so that `--help` waits for none of their libraries.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

Point3 = tuple[float, float, float]

_Map = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MAP")]
_Xyz = Annotated[Point3, tyro.conf.arg(metavar="X Y Z")]
_OptionalXyz = Annotated[Point3 | None, tyro.conf.arg(metavar="X Y Z")]
_Metres = Annotated[float, tyro.conf.arg(metavar="M")]
_OptionalMetres = Annotated[float | None, tyro.conf.arg(metavar="Z")]
_Folder = Annotated[Path, tyro.conf.arg(metavar="DIR")]
_OptionalFolder = Annotated[Path | None, tyro.conf.arg(metavar="DIR")]
_Count = Annotated[int | None, tyro.conf.arg(metavar="N")]
_Seed = Annotated[int, tyro.conf.arg(metavar="S")]
_Flag = tyro.conf.FlagCreatePairsOff[bool]

_UNUSABLE = 2


def _plan(
    map: _Map,
    /,
    start: _Xyz,
    goal: _Xyz,
    center: _OptionalXyz = None,
    method: Literal["solver", "network", "astar", "rrtstar", "apf"] = "solver",
    margin: _Metres = 8.0,
    ground: _OptionalMetres = None,
    out: _OptionalFolder = None,
    json: _Flag = False,
) -> int:
    """Plan a path through a map and verify it.

    Coordinates are those of the map: metres, z up. The grid has 101 x 101 x 101 voxels of 2 m; a voxel map brings its
    own.

    Args:
        map: A file (.npz, .ply, .las, .laz), or a simulated city: midtown:SEED, downtown:SEED, suburb:SEED.
        start: Start of the path [m].
        goal: End of the path [m].
        center: Middle of the grid [m]; by default half-way between start and goal.
        method: solver: climb the conduction potential, with a certificate. network: one that a network predicts,
            improved until it is certified. Rivals: astar, rrtstar (OMPL's), apf (an artificial potential field).
        margin: Distance to keep from obstacles [m]; lowered by one voxel at a time where it seals start or goal in.
        ground: Height of flat ground [m], for maps that do not tell ground apart.
        out: Folder for plan.json, path.csv and plan.png.
        json: Print the content of plan.json, and nothing else, on stdout.
    """
    from maxjax.cli import planning

    return planning.run(map, start, goal, center, method, margin, ground, out, json)


def _scan(map: _Map, /, pose: _Xyz, out: _OptionalFolder = None, json: _Flag = False) -> int:
    """Simulate one LiDAR scan in a city: 32,768 rays, 100 m range, level attitude.

    Args:
        map: A simulated city: midtown:SEED, downtown:SEED, suburb:SEED; its ground is z = 0.
        pose: Position of the sensor [m].
        out: Folder for scan.npz (its points, which `maxjax plan` reads) and scan.png.
        json: Print the counts as JSON, and nothing else, on stdout.
    """
    from maxjax.cli import scanning

    return scanning.run(map, pose, out, json)


def _fly(
    map: _Map,
    /,
    trials: _Count = None,
    seed: _Seed = 0,
    method: Literal["solver", "network", "astar"] = "solver",
    batch: _Count = None,
    wind: Annotated[float, tyro.conf.arg(metavar="W")] = 0.0,
    noise: _Metres = 0.0,
    dropout: Annotated[float, tyro.conf.arg(metavar="P")] = 0.0,
    dead_sector: Annotated[float, tyro.conf.arg(metavar="DEG")] = 0.0,
    blackout: Annotated[float, tyro.conf.arg(metavar="SEC")] = 0.0,
    drift: _Metres = 0.0,
    latency: _Flag = False,
    snapshot: _Flag = False,
    reactive: Annotated[float, tyro.conf.arg(metavar="G")] = 0.0,
    trial: Annotated[int | None, tyro.conf.arg(metavar="K")] = None,
    out: _OptionalFolder = None,
    json: _Flag = False,
) -> int:
    """Fly trials in closed loop: sense, map, plan, follow, until the goal, contact, or no plan is left.

    Start and goal are 50 to 80 m apart, 3 to 15 m high; 50 trials share a city. Killed and started again with the same
    --out, a campaign goes on where it was.

    Args:
        map: A simulated map: midtown, downtown, suburb.
        trials: Number of trials, from trial 0 on; 1 by default.
        seed: Seed of the first city.
        method: solver: climb the conduction potential. network: one that a network predicts. astar: search the grid.
        batch: Flights at a time; by default what suits the device.
        wind: Mean speed of the wind [m/s], with gusts in proportion.
        noise: Standard deviation of measured distances [m].
        dropout: Share of returns lost, 0 to 1.
        dead_sector: Width of a sector without any returns [deg].
        blackout: How long no scan holds any return, some seconds after take-off [s].
        drift: Greatest error of the believed position [m].
        latency: Fly each plan one planning period late.
        snapshot: Plan from the latest scan alone.
        reactive: Gain of the reactive layer [m/s^2]; 0 leaves it out.
        trial: Fly this trial only; with --out, film it.
        out: Folder for trials.jsonl, summary.json, flights.png and, of one trial, flight.gif.
        json: Print the content of summary.json, and nothing else, on stdout.
    """
    # MJX tells on stdout which optional packages it lacks.
    with contextlib.redirect_stdout(sys.stderr):
        from maxjax.cli import flying
        from maxjax.sim.disturbances import Disturbances
    disturbances = Disturbances(wind, noise, dropout, dead_sector, blackout, drift, float(latency))
    return flying.run(map, trials, seed, method, batch, disturbances, snapshot, reactive, trial, out, json)


def _train(
    config: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ("maxjax",),
    out: _Folder = Path("maxjax-train"),
    tiny: _Flag = False,
    epochs: _Count = None,
    scenes: Annotated[int, tyro.conf.arg(metavar="N")] = 749,
    cache: _OptionalFolder = None,
    seed: _Seed = 0,
) -> int:
    """Train networks that predict the potential, on simulated scans of midtown.

    A run that was killed goes on from its last checkpoint, bit for bit.

    Args:
        config: Networks and their recipes: paper, paper_difference, paper_large, maxjax, maxjax_slim, maxjax_half,
            maxjax_no_flood.
        out: Folder; each network has its own in it, with weights, log and checkpoint.
        tiny: A small network on a few scenes of 33 x 33 x 33 voxels, to see that all works.
        epochs: By default those of the recipe, 200.
        scenes: Number of training scenes.
        cache: Folder to keep the scenes in.
        seed: Seed of scenes and weights.
    """
    with contextlib.redirect_stdout(sys.stderr):
        from maxjax.cli import training
    return training.run(config, out, tiny, epochs, scenes, cache, seed)


def _demo(out: _Folder = Path("maxjax-demo"), seed: _Seed = 0) -> int:
    """Plan around a street corner from one simulated LiDAR scan, by the field and by A*.

    Args:
        out: Folder for plan.json, path.csv and plan.png.
        seed: Seed of the city, of the scan's noise and of the choice of the corner.
    """
    from maxjax.cli import demo

    return demo.run(out, seed)


def _check() -> int:
    """Show versions and devices, and solve and certify a small potential."""
    from maxjax.cli import check

    return check.run()


def run(arguments: Sequence[str] | None) -> int:
    """Run a command; arguments and exit code as in `maxjax.cli.main`."""
    commands: dict[str, Callable[..., Any]] = {
        "plan": _plan,
        "scan": _scan,
        "fly": _fly,
        "train": _train,
        "demo": _demo,
        "check": _check,
    }
    description = "Certified flight paths for UAVs in cities."
    try:
        code: int = tyro.extras.subcommand_cli_from_dict(
            commands, prog="maxjax", description=description, args=arguments
        )
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
