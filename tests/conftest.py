"""Where compiled programs are kept, which tests are large, which check shapes, and where the real inputs lie."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import sys
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

# Compiling is most of what the tests cost: a program is compiled once a machine, for all workers, child processes,
# clones and later runs.
os.environ.setdefault(
    "JAX_COMPILATION_CACHE_DIR",
    str(
        Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "maxjax-tests", f"jaxlib-{version('jaxlib')}")
    ),
)
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.02")
# Executables that maxjax keeps itself would not be traced again, and tracing is where shapes and dtypes are checked;
# they also know all sources of maxjax, and a line that is changed anywhere would compile everything again.
os.environ.setdefault("MAXJAX_CACHE", "off")
# XLA's older code generator takes a third less time for it, and the kernels do the same; the README's example runs as a
# user runs it. An XLA that does not know a flag ends the process, hence the version.
if version("jaxlib").startswith("0.10."):
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1")
# The runner has a process a core: more threads of XLA and OpenBLAS look for work in vain, on many cores in most of the
# time. With one thread of XLA a program would wait for ever for planners on the host, which call programs.
os.environ.setdefault("NPROC", "2")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Where in the source a value was made is written into programs for profilers alone.
os.environ.setdefault("JAX_TRACEBACK_IN_LOCATIONS_LIMIT", "0")
# What XLA reads back from there it announces at length, on the same machine too.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")

import jax
import jaxtyping
import pytest

# Shapes and dtypes of all signatures are checked in tests, and only there.
jaxtyping.install_import_hook("maxjax", "beartype.beartype")
# A tenth of what a test takes: these test what is made of the rooms, whose own tests check their shapes.
UNCHECKED = ("benchmarks", "sim/trials", "docs", "experiments", "ui", "test_origins")

# Left out by `make check`, with what is marked so by itself: large programs, and the world that moves.
LARGE = (
    "baselines/test_rrt_star",
    "planning/test_astar_compiled",
    *(f"benchmarks/test_{name}" for name in ("benchmarks", "history", "page_benchmark", "potential_benchmark")),
    "benchmarks/test_service",
    "sim/trials/test_fleets",
    "sim/trials/test_trials",
    *(f"experiments/test_{name}" for name in ("ablations", "clearance", "differentiable", "experiments", "fleet")),
    *(f"experiments/test_{name}" for name in ("long", "moving", "network", "offline", "paper", "problem", "real")),
    *(f"experiments/test_{name}" for name in ("tracking_movers", "trajectories", "warframe")),
    "experiments/test_hard_maps.py::test_problems_are_solved",
    "experiments/test_hard_maps.py::test_ten_thousand",
    "io/test_reference.py::test_texts",
    "io/export/test_as_flown",
    *(f"planning/test_{name}" for name in ("corridor", "fleet", "kept_radius", "pipeline", "stored_paths")),
    *(f"planning/test_{name}" for name in ("narrow_streets", "windowed_route")),
    "io/export/test_cut_corners",
    "io/test_load.py::test_delft",
    "planning/test_astar.py::test_finds_the_stated_optimum",
    "planning/test_focus_window.py::test_statuses_and_costs",
    "planning/test_focus_window.py::test_the_public_argument",
    "planning/test_planning_execution.py::test_a_planner_with_the_members",
    "compile/test_lowering",
    *(f"sim/test_{name}" for name in ("controller", "faults", "flight", "trajectory_flight")),
    "sim/swarm/",
    "sim/movers/",
    *(f"solvers/test_{name}" for name in ("newton", "random_walk", "sharding", "v_cycle")),
    "ui/cli/test_cli_interrupted",
    "ui/cli/test_cli_places",
    "sim/trials/test_shards",
    "link/test_link_flights",
    "link/test_recorded_session",
    "energy/test_split_flights",
    "test_airsim",
    "test_origins",
    "test_public_calls.py::test_a_strangers_planner",
    "test_public_calls.py::test_routes_under_vmap",
    "test_public_calls.py::test_the_calls_that_the_design_names",
    *(f"trajectories/test_trajectory.py::test_{name}" for name in ("it_is", "the_hard_radius", "times_are_near")),
    *(f"sim/worlds/test_{name}" for name in ("movers", "populations")),
    # What compiles many small ones: `make check` is to take a minute and a half.
    "baselines/test_apf",
    "nn/",
    *(f"planning/test_{name}" for name in ("line_of_sight", "mission", "planning_exemptions", "problem")),
    "planning/test_string_pulling",
    *(f"sim/test_{name}" for name in ("extensions", "lidar", "rolling_map", "vehicle", "viewpoint", "waiting_flight")),
    "sim/trials/test_execution",
    *(f"sim/worlds/test_{name}" for name in ("distance", "real_city")),
    "solvers/test_potential",
    "test_replanner",
    "trajectories/test_online",
    *(f"ui/cli/test_cli{name}" for name in (".py", "_energy", "_fleet", "_fly", "_frames", "_mission", "_view")),
    *(f"ui/figures/test_{name}" for name in ("figures", "film", "mission_figures", "planned")),
    "ui/page/",
    "verification/test_verifier.py::test_a_thousandth",
    "verification/test_verifier.py::test_touches",
    "verification/test_verifier.py::test_first_hit",
)

# Left out by `make test`: each takes more than a quarter of a minute, and a smaller test keeps its promise by day.
NIGHTLY = {
    "experiments/test_differentiable.py::test_the_gradient_by_the_gate": "that of the bearings is differenced",
    "experiments/test_differentiable.py::test_the_jacobian_of_the_probes": "that of the bearings is differenced",
    "experiments/test_differentiable.py::test_the_sensitivity": "that of the bearings is differenced",
    "experiments/test_fault_matrix.py::test_a_stuck_planner": "sim/test_faults.py flies with planners that fail",
    "nn/test_training.py::test_two_devices": "solvers/test_sharding.py uses several",
    "nn/test_weights.py::test_a_few_sweeps": "nn/test_model.py certifies by sweeps on a small grid",
    "nn/test_weights.py::test_alone": "nn/test_model.py certifies what a smoothed prediction leaves",
    "planning/test_mission.py::test_legs_of_one_goal": "planning/test_fleet.py shares a field",
    "planning/test_narrow_streets": "planning/test_corridor.py compares costs with those of the whole map",
    "planning/test_planning_execution.py::test_a_way": "its tests of with_longer_ascents count the attempts",
    "sim/swarm/test_fleet_flight.py::test_a_fleet_keeps": "sim/movers/test_slow_movers.py passes movers, alone",
    "sim/swarm/test_fleet_flight.py::test_on_the_host": "sim/test_flight.py flies on the host as in a batch, alone",
    "sim/trials/test_execution.py::test_real_flights": "sim/test_flight.py flies, test_execution.py batches",
    "sim/trials/test_shards.py::test_four_processes": "the rest of test_shards.py shares and merges in one process",
    "sim/trials/test_shards.py::test_the_processes_of_a_job": "the rest of test_shards.py shares and merges",
    "sim/trials/test_trial_movers.py::test_outcomes": "test_execution.py keeps books, test_bad_movers.py flies",
    "sim/trials/test_trials.py::test_a_trial_alone": "in test_execution.py a trial depends on no other",
    "solvers/test_newton.py::test_a_batch": "solvers/test_potential.py compares a vmap over scenes with a loop",
    "solvers/test_newton.py::test_a_folded_snake": "its serpentine of five thousand voxels is certified by day",
    "test_public_calls.py::test_a_strangers_planner_is_flown": "sim/test_faults.py flies by A*, on the host",
    "test_public_calls.py::test_routes_under_vmap": "planning/test_windowed_route.py compares such batches",
    "test_replanner.py::test_as_one_program": "planning/test_pipeline.py: one program answers as the stages do",
    "test_typed.py": "`make lint` checks the same types; test_package.py that they are installed",
    "test_x64.py": "solvers/test_potential.py solves in float64",
    "ui/cli/test_cli.py::test_delft": "io/test_load.py reads Delft, ui/cli/test_cli.py plans in other maps",
    "ui/cli/test_cli.py::test_training": "nn/test_training.py trains and goes on",
    "ui/cli/test_cli_fly.py::test_one_trial_is_filmed": "ui/figures/test_film.py draws films",
    "ui/cli/test_cli_interrupted.py::test_during_a_flight": "sim/trials/test_execution.py interrupts a campaign",
    "ui/cli/test_cli_mission.py::test_three_waypoints": "the rest of test_cli_mission.py flies missions around areas",
    "ui/cli/test_cli_places.py::test_the_hague": "the rest of test_cli_places.py plans between latitudes",
    "ui/figures/test_film.py::test_a_film_that_is_too_large": "its film moves at ten frames a second by day",
    "ui/page/test_browser.py::test_flights_play": "test_moving.py holds what the page is sent",
}

COMPILED = Path(os.environ["JAX_COMPILATION_CACHE_DIR"])
KEPT = 14 * 86400.0
"""How long a compiled program is kept that no test asks for [s]."""

# Tracing makes many objects and little garbage: looking for it less often saves a seventh of what the tests take.
gc.set_threshold(200_000, 20, 50)
# Memory of a test process beyond which it forgets the programs that it compiled [bytes].
ENOUGH = 6e9

DATA = Path(os.environ.get("MAXJAX_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")).resolve()


@pytest.fixture(scope="session")
def data() -> Path:
    """Folder of public inputs (MAXJAX_DATA); tests that need it are skipped, with the reason, where it is absent."""
    if not DATA.is_dir():
        pytest.skip(f"no real inputs at {DATA}; set MAXJAX_DATA")
    return DATA


@pytest.fixture(scope="module")
def compiled_astar(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The compiled A*, built apart from the user's; tests that need it are skipped where there is no compiler."""
    from maxjax.planning.search import astar_compiled

    with compiled(astar_compiled.SOURCE, tmp_path_factory):
        yield


@pytest.fixture(scope="module")
def compiled_verifier(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ctypes.CDLL]:
    """The library of the verifier, as `compiled_astar`."""
    from maxjax.compile import native
    from maxjax.verification.compiled import SOURCE

    with compiled(SOURCE, tmp_path_factory):
        yield native.library(SOURCE)


@pytest.fixture(scope="module")
def compiled_boxes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ctypes.CDLL]:
    """The library of `planning.windows.subvolumes`, as `compiled_astar`."""
    from maxjax.compile import native
    from maxjax.planning.windows.subvolumes import SOURCE

    with compiled(SOURCE, tmp_path_factory):
        yield native.library(SOURCE)


@contextlib.contextmanager
def compiled(source: Path, folders: pytest.TempPathFactory) -> Iterator[None]:
    """The library of a source, built once a session."""
    from maxjax.compile import native

    folder = folders.getbasetemp() / "libraries"
    folder.mkdir(exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native, "cache_folder", lambda: folder)
        native._outcome.cache_clear()
        if not native.available(source):
            pytest.skip(str(native._outcome(source)))
        yield
    native._outcome.cache_clear()


def of(item: pytest.Item, places: tuple[str, ...]) -> bool:
    """Whether a test's name within this folder begins like one of these."""
    return item.nodeid.removeprefix("tests/").startswith(places)


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of pages, of large files and of the night."""
    for item in items:
        for mark, places in (("docs", ("docs/",)), ("large", LARGE), ("nightly", tuple(NIGHTLY))):
            if of(item, places):
                item.add_marker(mark)


def pytest_sessionstart(session: pytest.Session) -> None:
    """What no test has asked for in a while is forgotten, that of earlier versions of jaxlib too."""
    if not hasattr(session.config, "workerinput"):
        for path in COMPILED.parent.glob("jaxlib-*/*"):
            with contextlib.suppress(OSError):  # another run may have removed it
                if max(path.stat().st_atime, path.stat().st_mtime) < time.time() - KEPT:
                    path.unlink()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Small grids are compiled without LLVM's optimisations, in a seventh of the time; `full_speed` asks for them."""
    from tests.short_programs import shorten  # here, since maxjax is imported behind its hook

    jaxtyping.config.update("jaxtyping_disable", of(item, UNCHECKED))
    small = item.get_closest_marker("full_speed") is None
    jax.config.update("jax_disable_most_optimizations", small)
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = str(int(small))  # of child processes
    shorten(small)


def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Between two files: each plan of a new shape leaves 100 MB of programs behind, which no other file asks for."""
    if nextitem is not None and nextitem.path != item.path and resident() > ENOUGH:
        forget_programs()


def resident() -> int:
    """Memory that this process has [bytes]; 0 where the system does not say."""
    pages = Path("/proc/self/statm")
    return int(pages.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if pages.is_file() else 0


def forget_programs() -> None:
    """Drop all compiled programs, and give their memory back."""
    from maxjax.compile.executable import Stored

    for program in [one for one in gc.get_objects() if isinstance(one, Stored)]:
        program._ready.clear()
    jax.clear_caches()
    gc.collect()
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)
