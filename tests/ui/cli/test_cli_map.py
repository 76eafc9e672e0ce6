"""`maxjax map`: what a file holds, in numbers of its own and from above."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from maxjax.ui.cli import main


@pytest.fixture
def boxes(tmp_path: Path) -> Path:
    path = tmp_path / "town.csv"
    path.write_text("x_min,y_min,z_min,x_max,y_max,z_max\n0,0,0,10,20,30\n40,0,0,50,20,12\n")
    return path


def test_numbers_are_the_files(boxes: Path, capfd: pytest.CaptureFixture[str]) -> None:
    options = ["--spacing", "1", "--ground", "0", "--crs", "EPSG:28992", "--bounds", "0", "0", "-2", "50", "20", "40"]
    assert main(["map", str(boxes), *options, "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["extent"] == [[0, 0, 0], [50, 20, 30]]
    assert (found["crs"], found["read"], found["grid"]["spacing"]) == ("EPSG:28992", {"boxes": 2}, 1.0)
    nx, ny, nz = found["grid"]["shape"]
    assert found["ground"] % (nx * ny) == 0
    assert main(["map", str(boxes), *options]) == 0
    shown = capfd.readouterr().out
    assert "EPSG:28992" in shown
    assert "0.00 to 50.00 m" in shown
    assert f"{nx} x {ny} x {nz} of 1 m" in shown


def test_it_is_drawn_from_above(boxes: Path, capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    out = boxes.parent / "out"
    assert main(["map", str(boxes), "--out", str(out)]) == 0
    assert (out / "map.png").read_bytes().startswith(b"\x89PNG")
    assert str(out / "map.png") in capfd.readouterr().out


def test_an_unusable_file_ends_in_one_sentence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\n")
    assert main(["map", str(tmp_path / "a.obj"), "--out", str(tmp_path / "out")]) == 2
    shown, told = capfd.readouterr()
    assert shown == ""
    assert "a.obj: expected a mesh, found no face" in told
    assert not (tmp_path / "out").exists()


def test_what_stands_at_a_place_is_said(boxes: Path, capfd: pytest.CaptureFixture[str]) -> None:
    options = ["--spacing", "1", "--ground", "0", "--at"]
    assert main(["map", str(boxes), *options, "5", "10", "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    (lowest, level, ground), (base, roof, obstacle) = found["at"]["occupied"]
    assert (ground, obstacle, base, roof) == ("ground", "obstacle", level, 30.5)
    assert lowest < level <= 0.5
    assert main(["map", str(boxes), *options, "5", "10"]) == 0
    assert "30.5 m (obstacle)" in capfd.readouterr().out
    assert main(["map", str(boxes), *options, "500", "10"]) == 2
    assert "--at: expected a place in" in capfd.readouterr().err


def test_an_end_far_above_everything_is_asked_about(boxes: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(boxes), "--ground", "0", "--start", "-5", "0", "9", "--goal", "60", "0", "5000"]) == 2
    assert "an end at z = 5000 lies 4970 m above all that the map holds" in capfd.readouterr().err
