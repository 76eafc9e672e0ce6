"""The command line: what it prints, writes and returns, for good and for bad input."""

from __future__ import annotations

import builtins
import csv
import dataclasses
import errno
import functools
import importlib.util
import io
import itertools
import json
import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

from maxjax import Grid, Status, VoxelMap, verify
from maxjax.io import PointCloud, read_map
from maxjax.nn.recipes import RECIPES
from maxjax.planning.plan import Plan, PlanStats
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.sim.worlds.scenes import make_scene, occupancy
from maxjax.solvers.screened import Screened
from maxjax.ui.cli import check_command as check
from maxjax.ui.cli import main, report
from maxjax.ui.cli.options import TrainOptions
from maxjax.ui.cli.progress import progress
from maxjax.ui.methods import ALIASES, METHODS
from tests.planners import bare_plan
from tests.scenes import SHAPE, wall_with_gap
from tests.ui.cli.terminal import Terminal

START, GOAL = (6.0, 16.0, 10.0), (40.0, 14.0, 12.0)
# It compiles nothing: for tests of files and messages.
ASTAR = ("--method", "astar")


def town(*, sealed: bool = False) -> np.ndarray:
    """A wall with one gap; on request, the goal in a box."""
    occupied = wall_with_gap()
    if sealed:
        occupied[17:24, 4:11, 3:10] = True
        occupied[18:23, 5:10, 4:9] = False
    return occupied


def voxel_file(folder: Path, occupied: np.ndarray, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> Path:
    np.savez(folder / "town.npz", occupied=occupied, spacing=2.0, origin=np.asarray(origin))
    return folder / "town.npz"


@pytest.fixture
def small(tmp_path: Path) -> str:
    return str(voxel_file(tmp_path, town()))


@pytest.fixture
def terminal(capfd: pytest.CaptureFixture[str]) -> Terminal:
    return Terminal(capfd)


def between(start: Sequence[float] = START, goal: Sequence[float] = GOAL) -> list[object]:
    return ["--start", *start, "--goal", *goal]


def test_json_alone_on_stdout_holds_the_plan(terminal: Terminal, small: str) -> None:
    code, out, err = terminal("plan", small, *between(), "--margin", 2, "--json")
    assert code == 0
    found = json.loads(out)
    assert "Planning" in err
    fields = {*Plan.__dataclass_fields__, *PlanStats.__dataclass_fields__}
    assert set(found) == fields - {"map", "stats"} | {"message", "configuration", "versions", "device"}
    assert (found["status"], found["certified"], found["margin"], found["method"]) == ("OK", True, 2.0, "field")
    path = np.array(found["path"])
    assert tuple(path[0]) == START
    assert tuple(path[-1]) == GOAL
    # An independent look: the path keeps the radius, and its figures are its own.
    judged = verify(
        path, VoxelMap.on(Grid(SHAPE, 2.0, (0.0, 0.0, 0.0)), town()), radius=1.0, exemptions=tuple(found["exemptions"])
    )
    assert judged.ok
    assert found["length"] == pytest.approx(np.linalg.norm(np.diff(path, axis=0), axis=1).sum(), abs=1e-4)
    assert found["clearance"] == pytest.approx(judged.clearance, abs=1e-4)
    assert found["configuration"]["start"] == list(START)
    assert found["configuration"]["grid"] == {"shape": list(SHAPE), "spacing": 2.0, "origin": [0.0, 0.0, 0.0]}
    assert {"compile", "total", "solve", "verify"} < set(found["timings"])


@pytest.mark.parametrize("method", ["solver", "astar"])
def test_out_holds_summary_path_and_figure(terminal: Terminal, tmp_path: Path, small: str, method: str) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "new" / "folder"
    code, text, _ = terminal("plan", small, *between(), "--margin", 2, "--method", method, "--out", out)
    assert code == 0
    assert sorted(os.listdir(out)) == ["path.csv", "plan.json", "plan.png"]
    found = json.loads((out / "plan.json").read_text())
    rows = list(csv.reader(io.StringIO((out / "path.csv").read_text())))
    assert rows[0] == ["x_m", "y_m", "z_m"]
    path = np.array(rows[1:], float)
    np.testing.assert_array_equal(path, np.array(found["path"]))
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).min() > 1e-3
    assert (out / "plan.png").read_bytes().startswith(b"\x89PNG")
    assert f"{found['length']:.2f} m" in text
    assert ("maxjax" in text.splitlines()[2]) == (method == "solver")  # beside it, always A*
    assert "A*" in text.splitlines()[2]
    assert found["certified"] == (method == "solver")
    for name in os.listdir(out):
        assert str(out / name) in text


def test_a_map_far_from_the_origin_gives_the_same_path_there(terminal: Terminal, tmp_path: Path, small: str) -> None:
    _, here, _ = terminal("plan", small, *between(), "--json")
    shift = np.array([84_900.25, 447_500.5, -3.0])
    far = voxel_file(tmp_path, town(), shift)
    code, away, _ = terminal("plan", far, *between(START + shift, GOAL + shift), "--json")
    assert code == 0
    np.testing.assert_allclose(np.array(json.loads(away)["path"]) - shift, json.loads(here)["path"], atol=2e-6)


@pytest.mark.large
def test_national_coordinates_are_kept_to_the_millimetre(terminal: Terminal, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    # The README's tower at half its size: 30 x 30 m wide, 40 m high, across the straight line; the second time in Dutch
    # coordinates.
    tower = np.zeros((51, 51, 26), bool)
    tower[18:33, 18:33, :20] = True
    start, goal = np.array([20.0, 51.0, 10.0]), np.array([80.0, 51.0, 10.0])
    found = []
    for number, corner in enumerate([np.zeros(3), np.array([84_900.125, 447_501.123, 0.0])]):
        out = tmp_path / str(number)
        archive = voxel_file(tmp_path, tower, corner)
        code, _, err = terminal("plan", archive, *between(start + corner, goal + corner), *ASTAR, "--out", out)
        assert code == 0, err
        content = json.loads((out / "plan.json").read_text())
        assert content["configuration"]["grid"]["origin"] == corner.tolist()
        path = np.loadtxt(out / "path.csv", delimiter=",", skiprows=1)
        np.testing.assert_array_equal(path, np.array(content["path"]))
        np.testing.assert_allclose(path[[0, -1]], np.stack([start, goal]) + corner, rtol=0, atol=1e-6)
        assert verify(path, VoxelMap.on(Grid(tower.shape, 2.0, tuple(corner)), tower)).clearance > 4
        found.append((path - corner, content["length"], content["clearance"], content["margin"]))
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=0, atol=2e-6)
    assert found[1][1:] == pytest.approx(found[0][1:], abs=1e-6)


def test_methods_are_those_of_the_registry(terminal: Terminal) -> None:
    for command in ("plan", "fly"):
        _, shown, _ = terminal(command, "--help")
        assert "--method {" + ",".join([*METHODS, *ALIASES]) + "}" in shown


def test_negative_coordinates_are_numbers(terminal: Terminal, tmp_path: Path) -> None:
    origin = (-20.0, -16.0, -8.0)
    start, goal = (np.array(point) + origin for point in (START, GOAL))
    code, out, _ = terminal("plan", voxel_file(tmp_path, town(), origin), *between(start, goal), "--json")
    assert code == 0
    assert json.loads(out)["path"][0] == start.tolist()


def test_flat_ground_is_kept_off(terminal: Terminal, small: str) -> None:
    code, out, err = terminal("plan", small, *between(), "--ground", 11.5, "--json")
    assert code == 1
    assert json.loads(out)["status"] == "START_OCCUPIED"
    assert "START_OCCUPIED" in err
    assert terminal("plan", small, *between(), "--ground", 5)[0] == 0


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("start", "goal", "status", "sentence"),
    [
        ((-30.0, 16.0, 10.0), GOAL, "START_OUTSIDE_MAP", "start (-30, 16, 10)"),
        ((1e300, 16.0, 10.0), GOAL, "START_OUTSIDE_MAP", "grid from (-1, -1, -1) to (47, 31, 23) m"),
        (START, (40.0, 14.0, 500.0), "GOAL_OUTSIDE_MAP", "goal (40, 14, 500)"),
        ((24.0, 20.0, 10.0), GOAL, "START_OCCUPIED", "choose a free start"),
        (START, (24.0, 20.0, 10.0), "GOAL_OCCUPIED", "choose a free goal"),
        ((NAN, 16.0, 10.0), GOAL, "NONFINITE_INPUT", "start (nan, 16, 10)"),
        (START, (40.0, -INF, 12.0), "NONFINITE_INPUT", "goal (40, -inf, 12)"),
        (START, START, "START_EQUALS_GOAL", "same point"),
    ],
)
def test_impossible_problems_have_their_status(
    terminal: Terminal, small: str, start: Sequence[float], goal: Sequence[float], status: str, sentence: str
) -> None:
    for method in ("solver", "astar"):
        code, out, err = terminal("plan", small, *between(start, goal), "--method", method, "--json")
        assert code == 1
        found = json.loads(out)
        assert (found["status"], found["path"], found["certified"]) == (status, [], False)
        assert found["length"] is None
        assert found["clearance"] is None
        assert f"{status}: {Status[status].advice} Given: " in err
        assert sentence in err


def test_a_sealed_goal_leaves_a_summary_but_no_path_to_fly(terminal: Terminal, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "out"
    assert terminal("plan", voxel_file(tmp_path, town()), *between(), "--out", out)[0] == 0
    code, text, err = terminal("plan", voxel_file(tmp_path, town(sealed=True)), *between(), "--out", out)
    assert code == 1
    assert "NO_VALID_PATH" in text
    assert "NO_VALID_PATH" in err
    assert os.listdir(out) == ["plan.json"]
    assert json.loads((out / "plan.json").read_text())["status"] == "NO_VALID_PATH"


def arrays(**named: object) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **named)
    return buffer.getvalue()


def sparse(shape: tuple[int, int, int]) -> bytes:
    """A large map with a wall across, compressed."""
    occupied = np.zeros(shape, bool)
    occupied[30, 10:50, :40] = True
    buffer = io.BytesIO()
    np.savez_compressed(buffer, occupied=occupied)
    return buffer.getvalue()


def huge() -> bytes:
    """An archive that claims 8 TB."""
    array = io.BytesIO()
    np.lib.format.write_array_header_1_0(array, {"descr": "|b1", "fortran_order": False, "shape": (20_000,) * 3})
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("occupied.npy", array.getvalue())
    return buffer.getvalue()


BROKEN = {
    "truncated.npz": (arrays(occupied=np.zeros(SHAPE, bool))[:-200], "damaged"),
    "foreign.npz": (b"no archive at all", "damaged or foreign"),
    "huge.npz": (huge(), "takes 8000000000000 bytes"),
    "many.npz": (sparse((520, 520, 500)), "at most 134217728 voxels, given 135200000"),
    "pickle.npz": (arrays(occupied=np.array([{}])), "pickled"),
    "flat.npz": (arrays(occupied=np.zeros((4, 4), bool)), r"expected shape \(nx, ny, nz\).*found \(4, 4\)"),
    "real.npz": (arrays(occupied=np.zeros(SHAPE)), "expected bool.*found float64"),
    "pairs.npz": (arrays(points=np.zeros((9, 2))), r"expected numbers of shape \(n, 3\), found float64 \(9, 2\)"),
    "words.npz": (arrays(points=np.full((9, 3), "a")), r"expected numbers.*found <U1 \(9, 3\)"),
    "none.npz": (arrays(points=np.zeros((0, 3))), "holds no point"),
    "other.npz": (arrays(sigma=np.ones(3)), "expected an array occupied, occupancy or points, found sigma"),
    "zero.ply": (b"", "empty"),
    "short.ply": (
        b"ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
        "short.ply",
    ),
    "cut.laz": (b"LASF" + bytes(100), "header"),
    "photo.jpg": (b"JFIF", "expected a suffix among .npz, .ply, .pcd"),
}


@pytest.mark.large
@pytest.mark.nightly  # planning/test_focus_window.py plans in windows, ui/figures draws larger voxels
def test_a_large_map_is_planned_in_windows_and_drawn_in_larger_voxels(terminal: Terminal, tmp_path: Path) -> None:
    (tmp_path / "large.npz").write_bytes(sparse((300, 300, 200)))
    out = tmp_path / "out"
    code, *_ = terminal("plan", tmp_path / "large.npz", *between((40, 40, 20), (80, 50, 20)), "--out", out)
    assert code == 0
    assert sorted(os.listdir(out)) == ["path.csv", "plan.json", "plan.png"]


def test_a_map_too_large_for_a_lattice_is_refused(terminal: Terminal, tmp_path: Path) -> None:
    (tmp_path / "large.npz").write_bytes(sparse((300, 300, 200)))
    small = terminal("plan", tmp_path / "large.npz", *between((40, 40, 20), (80, 50, 20)), "--method", "astar")
    assert small[0] == 2
    assert "at most 16777216 voxels" in small[2]


@pytest.mark.parametrize("name", BROKEN)
def test_unusable_files_are_named_and_nothing_is_written(terminal: Terminal, tmp_path: Path, name: str) -> None:
    content, sentence = BROKEN[name]
    (tmp_path / name).write_bytes(content)
    code, out, err = terminal("plan", tmp_path / name, *between(), "--out", tmp_path / "out", "--json")
    assert code == 2
    assert out == ""
    message = err.strip().splitlines()[-1]
    assert message.startswith("maxjax: error: ")
    assert name in message
    assert re.search(sentence, message)
    assert os.listdir(tmp_path) == [name]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["plan", "nowhere.npz", *between()], "No such file"),
        (["plan", ".", *between()], "expected meshes"),
        (["plan", "gotham:3", *between()], "midtown:SEED, downtown:SEED, suburb:SEED"),
        (["plan", "downtown", *between()], "whole number for SEED"),
        (["plan", "downtown:-1", *between()], "whole number for SEED"),
        (["plan", "downtown:99999999999", *between()], "seed: expected 0 to"),
        (["plan", "downtown:0", *between(), "--center", "nan", 0, 0], "--center"),
        (["plan", "downtown:0", *between((1e300, 0, 5))], "middle of the grid"),
        (["plan", "downtown:0", *between(), "--ground", 0], "own ground"),
        (["scan", "gotham:3", "--pose", 0, 0, 5], "midtown:SEED"),
        (["scan", "downtown:0", "--pose", 0, 0, -5], "inside an obstacle"),
        (["scan", "downtown:0", "--pose", 0, "nan", 5], "--pose"),
        (["demo", "--seed", -1], "seed: expected"),
        (["plan", "downtown:0", "--start", 1, 2, "--goal", *GOAL], "start"),
        (["plan", "downtown:0", *between(), "--method", "rrt"], "solver"),
        (["plan", "downtown:0", *between(("a", 0, 0))], "start"),
        ([], "plan"),
    ],
)
def test_unusable_arguments_get_one_sentence(
    terminal: Terminal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[object], sentence: str
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = terminal(*arguments)
    assert code == 2
    assert out == ""
    assert sentence in err
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--margin", -1], "margin"),
        (["--margin", "nan"], "margin"),
        (["--radius", -1], "radius"),
        (["--radius", 9], "margin"),
        (["--ground", "inf"], "--ground"),
        (["--center", 0, 0, 0], "brings its own grid"),
    ],
)
def test_unusable_options_of_a_voxel_map(terminal: Terminal, small: str, options: list[object], sentence: str) -> None:
    code, out, err = terminal("plan", small, *between(), *options)
    assert (code, out) == (2, "")
    assert sentence in err.strip().splitlines()[-1]


@pytest.mark.parametrize("command", ["plan", "scan", "demo"])
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(
    terminal: Terminal, tmp_path: Path, small: str, command: str
) -> None:
    pytest.importorskip("matplotlib")
    rest = {"plan": [small, *between()], "scan": ["downtown:0", "--pose", 0, 0, 5], "demo": []}[command]
    for out in (Path(small), Path(small) / "below", Path("/proc/maxjax/out")):
        code, text, err = terminal(command, *rest, "--out", out)
        assert (code, text) == (2, "")
        assert "cannot be written" in err
        assert "..." not in err  # no progress was shown
    assert os.listdir(tmp_path) == [Path(small).name]


@pytest.mark.parametrize("command", ["plan", "scan", "demo"])
def test_a_missing_extra_is_named_before_the_work(
    terminal: Terminal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: str, command: str
) -> None:
    importer = builtins.__import__

    def without(name: str, *args: object, **kwargs: object) -> object:
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return importer(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    rest = {"plan": [small, *between()], "scan": ["downtown:0", "--pose", 0, 0, 5], "demo": []}[command]
    code, text, err = terminal(command, *rest, "--out", tmp_path / "out")
    assert (code, text) == (2, "")
    assert "pip install 'maxjax[viz]'" in err
    assert "..." not in err
    assert not (tmp_path / "out").exists()


def test_a_full_disk_leaves_no_part_of_a_file(
    terminal: Terminal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: str
) -> None:
    pytest.importorskip("matplotlib")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    code, _, err = terminal("plan", small, *between(), "--out", tmp_path / "out")
    assert code == 2
    assert "No space left on device" in err
    assert os.listdir(tmp_path / "out") == []


@pytest.mark.parametrize(
    "points",
    [np.full((50, 3), np.nan), np.zeros((50, 3)), np.full((50, 3), 5000.0)],
    ids=["of NaN", "of misses", "elsewhere"],
)
def test_a_scan_without_a_return_in_the_grid_is_empty(terminal: Terminal, tmp_path: Path, points: np.ndarray) -> None:
    np.savez(tmp_path / "scan.npz", points=points)
    code, out, err = terminal("plan", tmp_path / "scan.npz", *between(), "--json", "--ground", 0)
    assert code == 1
    found = json.loads(out)
    assert found["status"] == "EMPTY_SCAN"
    assert sum(found["configuration"]["returns"].values()) == 50
    assert "points inside the grid 0" in err


@pytest.mark.large
def test_scan_counts_rays_as_c_mujoco_does_and_plan_reads_it_back(terminal: Terminal, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    pose = (-68.0, 2.0, 6.8)
    code, out, _ = terminal("scan", "downtown:0", "--pose", *pose, "--out", tmp_path, "--json")
    assert code == 0
    counts = json.loads(out)
    assert sorted(os.listdir(tmp_path)) == ["scan.npz", "scan.png"]
    assert counts["rays"] == counts["returns"] + counts["missed"] + counts["dropped"] == 32768
    assert counts["dropped"] == pytest.approx(0.01 * (counts["rays"] - counts["missed"]), rel=0.3)

    cloud = read_map(tmp_path / "scan.npz")
    assert isinstance(cloud, PointCloud)
    assert len(cloud.points) == counts["returns"]
    # Every return lies on a surface: C MuJoCo, cast towards it, meets one there (2 cm of noise).
    scene = make_scene("downtown", 0)
    data = mujoco.MjData(scene.model)
    mujoco.mj_kinematics(scene.model, data)
    for point in cloud.points[::500].astype(float):
        ray = point - pose
        distance = np.linalg.norm(ray)
        geom = np.zeros(1, np.int32)
        met = mujoco.mj_ray(scene.model, data, np.array(pose), ray / distance, None, True, -1, geom)
        assert met == pytest.approx(distance, abs=0.12)

    start, goal = (4.0, 6.0, 6.5), (-60.0, 26.0, 5.8)
    archive = tmp_path / "scan.npz"
    code, out, _ = terminal("plan", archive, *between(start, goal), "--ground", 0, "--json")
    assert code == 0
    found = json.loads(out)
    assert found["certified"]
    assert found["configuration"]["returns"]["inside"] > 10_000
    assert min(z for _, _, z in found["path"]) > 1.0
    # The same problem in national coordinates.
    shift = np.array([84_900.0, 447_500.0, 0.0])
    np.savez(archive, points=cloud.points.astype(np.float64) + shift)
    code, out, _ = terminal("plan", archive, *between(start + shift, goal + shift), "--ground", 0, "--json")
    assert code == 0
    np.testing.assert_allclose(np.array(json.loads(out)["path"]) - shift, found["path"], atol=1e-5)


def test_a_scan_of_nothing_is_empty(terminal: Terminal, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    code, out, err = terminal("scan", "downtown:0", "--pose", 0, 0, 900, "--out", tmp_path / "out", "--json")
    assert code == 1
    assert json.loads(out)["status"] == "EMPTY_SCAN"
    assert "EMPTY_SCAN" in err
    assert os.listdir(tmp_path / "out") == []


def test_plan_in_a_simulated_city(terminal: Terminal) -> None:
    code, out, _ = terminal("plan", "downtown:0", *between((4.0, 6.0, 6.5), (-60.0, 26.0, 5.8)), "--json")
    assert code == 0
    found = json.loads(out)
    assert (found["certified"], found["margin"]) == (True, 8.0)
    # The middle of the grid lies in whole voxels above the ground.
    assert found["configuration"]["grid"]["origin"] == [-128.0, -84.0, -94.0]
    assert found["configuration"]["returns"] == {}


@pytest.mark.large
def test_demo_passes_a_corner_and_draws_it(terminal: Terminal, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    code, text, _ = terminal("demo", "--out", tmp_path)
    assert code == 0
    assert sorted(os.listdir(tmp_path)) == ["path.csv", "plan.json", "plan.png"]
    found = json.loads((tmp_path / "plan.json").read_text())
    assert (found["status"], found["certified"], found["margin"]) == ("OK", True, 8.0)
    for piece in ("maxjax", "A*", "certified", "length", "clearance", "compiled", str(tmp_path / "plan.png")):
        assert piece in text
    scene = make_scene("downtown", 0)
    grid = Grid()
    occupied, ground = occupancy(scene.geoms, grid)
    given = found["configuration"]
    start, goal = np.array(given["start"]), np.array(given["goal"])
    assert 60 <= np.linalg.norm(goal - start) <= 91
    for end in (start, goal):
        assert 3 <= end[2] <= 15
    # The path is the same through its file, without two points in one place.
    path = np.loadtxt(tmp_path / "path.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(path, np.array(found["path"]))
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).min() > 1e-3
    # The true city stands in the straight line, and clear of the path.
    buildings = occupied & ~ground
    assert not verify(np.stack([start, goal]), VoxelMap.on(grid, buildings)).ok
    assert verify(np.array(found["path"]), VoxelMap.on(grid, buildings)).clearance > 4


@pytest.mark.large
def test_check_is_good_here_and_says_what_is_not(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    code, out, _ = terminal("check")
    assert code == 0
    assert out.strip().endswith("all good")
    for piece in ("jax", "mujoco", "devices", "residual", "certificate"):
        assert piece in out
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert "pip install 'maxjax[viz]'" in terminal("check")[1]
    monkeypatch.setattr(check, "versions", lambda: {"jax": "0.10.2", "mujoco": "3.17.0", "mujoco-mjx": "3.16.0"})
    monkeypatch.setattr(check, "Screened", functools.partial(Screened, max_iterations=1, or_geodesic=False))
    code, out, err = terminal("check")
    assert code == 1
    assert "all good" not in out
    for piece in ("miscompiles", "does not match", "residual"):
        assert piece in err


def test_a_way_close_to_walls_and_an_end_in_a_ball_are_warned_of(capfd: pytest.CaptureFixture[str]) -> None:
    grid = Grid((20, 9, 9), 2.0, (0.0, 0.0, 0.0))
    occupied = np.zeros(grid.shape, bool)
    occupied[9, 2, 4] = True
    path = np.array([[2.0, 8.0, 8.0], [36.0, 8.0, 8.0]])
    task = Task.of(VoxelMap.on(grid, occupied), path[:1], path[1], Distances())
    verdict = verify(path, VoxelMap.on(grid, occupied))
    numbers = {
        "clearance_at": verdict.clearance_at,
        "clearance": 3.0,
        "cruise_clearance": 3.0,
        "radius": 1.0,
        "exemptions": (0.0, 2.5),
    }
    plan = bare_plan(task.map, path, method="astar", **numbers)
    assert verdict.cruise_clearance == 3.0
    report.warn(plan, task)
    ball, least = capfd.readouterr().err.splitlines()
    assert "goal (36, 8, 8) stands nearer to an obstacle than the radius of 1 m; within 2.5 m" in ball
    near = r"within 3\.00 m of an obstacle at \(1[79]\.\d, 8\.0, 8\.0\) m, less than half the margin of 8 m"
    assert re.search(near, least)
    report.warn(dataclasses.replace(plan, cruise_clearance=4.0, exemptions=(0.0, 0.0)), task)
    assert not capfd.readouterr().err


def test_text_in_brackets_is_printed_as_it_is(capfd: pytest.CaptureFixture[str]) -> None:
    text = "[viz] :house: [/]"
    report.show(report.table(text, {text: {text: text}}))
    report.complain(text)
    with progress(text):
        pass
    out, err = capfd.readouterr()
    assert out.count(text) == 4
    assert err == f"{text}\n{text} ...\n"


def test_as_a_module_in_a_process_of_its_own(tmp_path: Path) -> None:
    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "maxjax", *arguments]
        return subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=tmp_path, check=False)

    shown = run("plan", "--help")
    assert shown.returncode == 0
    for piece in ("--start X Y Z", "--radius M", "--margin M", "[m]", "default: 8.0"):
        assert piece in shown.stdout
    failed = run("plan", "nowhere.laz", "--start", "0", "0", "5", "--goal", "-9", "0", "5", "--out", "out")
    assert failed.returncode == 2
    assert failed.stdout == ""
    assert "Traceback" not in failed.stderr
    assert "maxjax: error: nowhere.laz: cannot be read: No such file or directory" in failed.stderr
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("command", ["plan", "mission", "map", "scan", "fly", "view", "train", "demo", "check"])
def test_help_says_in_words_what_is_left_out(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([command, "--help"])
    assert "None" not in capsys.readouterr().out


def test_help_waits_for_no_heavy_library(tmp_path: Path) -> None:
    script = "import sys; from maxjax.ui.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
    script += "print('loaded', sorted({'jax', 'mujoco', 'matplotlib', 'scipy', 'laspy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    assert "loaded []" in done.stdout


@pytest.mark.large
def test_delft_over_a_row_of_houses(terminal: Terminal, data: Path, tmp_path: Path) -> None:
    pytest.importorskip("laspy")
    pytest.importorskip("matplotlib")
    start, goal = (84888.0, 447501.0, 6.0), (84968.0, 447512.0, 6.0)
    scan = data / "ahn3_delft" / "ahn3_cropped_1.laz"
    code, text, _ = terminal("plan", scan, *between(start, goal), "--out", tmp_path)
    assert code == 0
    found = json.loads((tmp_path / "plan.json").read_text())
    assert (found["status"], found["certified"]) == ("OK", True)
    assert (found["radius"], found["exemptions"]) == (1.0, [0.0, 0.0])
    assert found["cruise_clearance"] >= 4
    path = np.array(found["path"])
    assert path[0].tolist() == list(start)
    assert path[-1].tolist() == list(goal)
    # Against the returns themselves: none comes nearer to the path than its clearance from their voxels.
    cloud = read_map(scan)
    assert isinstance(cloud, PointCloud)
    points = (cloud.points.astype(np.float64) + cloud.offset)[~cloud.ground]
    points = points[(np.abs(points - path.mean(axis=0)) < 100).all(axis=1)]
    for a, b in itertools.pairwise(path):
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        assert np.linalg.norm(points - (a + t[:, None] * (b - a)), axis=1).min() > found["clearance"] - 1e-3
    straight = a_row_lies_between(points, start, goal)
    assert straight > 8
    assert "A*" in text


def a_row_lies_between(points: np.ndarray, start: Sequence[float], goal: Sequence[float]) -> float:
    """Highest return within 3 m of the straight line, seen from above [m]."""
    a, b = np.array(start[:2]), np.array(goal[:2])
    t = np.clip((points[:, :2] - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    near = np.linalg.norm(points[:, :2] - (a + t[:, None] * (b - a)), axis=1) < 3
    return float(points[near, 2].max())


def test_the_help_of_training_names_every_recipe() -> None:
    named = re.findall(r"\w+", (TrainOptions.__doc__ or "").split("recipes:")[1].split(".")[0])
    assert sorted(named) == sorted(RECIPES.keys() - {"tiny"})


@pytest.mark.large
def test_training_leaves_weights_and_their_record_and_goes_on_from_there(terminal: Terminal, tmp_path: Path) -> None:
    train = ("train", "--tiny", "--epochs", 1, "--out", tmp_path, "--cache", tmp_path / "cache")
    code, out, err = terminal(*train)
    folder = tmp_path / "tiny"
    assert (code, out) == (0, f"{folder / 'tiny.npz'}\n")
    assert "tiny, epoch 1 of 1: loss" in err
    record = json.loads((folder / "training.json").read_text())
    assert record["scenes"] == 8
    assert record["validation_scenes"] == 4
    assert [line["epoch"] for line in record["epochs"]] == [1]
    weights = (folder / "tiny.npz").read_bytes()
    # Nothing is left to train: the checkpoint gives the same weights.
    assert terminal(*train)[0] == 0
    assert arrays_in(weights) == arrays_in((folder / "tiny.npz").read_bytes())


def arrays_in(archive: bytes) -> dict[str, bytes]:
    with np.load(io.BytesIO(archive)) as opened:
        return {name: opened[name].tobytes() for name in opened.files if name != "header"}
