"""What a command says of places, in the frame that they were given in; and heights that would do."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from maxjax.core.grid import Grid
from maxjax.core.terrain import Terrain
from maxjax.io.geo.earth import TangentPlane
from maxjax.planning.problem.place_format import PlaceFormat
from maxjax.ui.cli import main

HEIGHT = 8.87  # of the ground of the sample, as it is told here [m]
SAMPLE = Path(__file__).parents[3] / "docs" / "samples" / "quarter.geojson"
GOAL = ("--goal", "55", "-20", "8")


def said(capsys: pytest.CaptureFixture[str], *options: object) -> tuple[int, str]:
    """Exit code and last sentence of a plan over the sample, whose ground lies at 8.87 m."""
    plan = ["plan", str(SAMPLE), "--method", "astar", "--ground", str(HEIGHT)]
    code = main([*plan, *map(str, options)])
    return code, capsys.readouterr().err.splitlines()[-1]


def test_a_start_on_the_pavement_takes_off(capsys: pytest.CaptureFixture[str]) -> None:
    for frame, z in (("local-agl", 0.0), ("map", HEIGHT)):
        code, sentence = said(capsys, "--start", "-75", "22", z, *GOAL, "--frame", frame)
        assert code == 1
        assert "START_OCCUPIED" in sentence
        assert "stands on the ground, from which a vehicle takes off" in sentence
        assert "did you mean" not in sentence
        place = "(x -75, y 22, 0 m above ground)" if frame == "local-agl" else "(-75, 22, 8.87)"
        assert f"Given: start {place}" in sentence
    # The height that it names does.
    height = re.search(
        r"from ([0-9.]+) m above ground on", said(capsys, "--start", "-75", "22", "0", *GOAL, "--frame", "local-agl")[1]
    )
    assert height is not None
    assert said(capsys, "--start", "-75", "22", height[1], *GOAL, "--frame", "local-agl")[0] == 0


def test_a_start_below_a_floor_is_told_heights_that_do(capsys: pytest.CaptureFixture[str]) -> None:
    rules = ("--floor", 20, "--ceiling", 40, "--frame", "local-agl")
    for height in (5.0, 90.0):
        code, sentence = said(capsys, "--start", "-75", "22", height, "--goal", "55", "-20", "30", *rules)
        assert code == 1
        assert "START_OUTSIDE_BAND: The start lies below the floor or above a ceiling" in sentence
        assert f"(x -75, y 22, {height:g} m above ground) is" in sentence
        open_ = re.search(r"; there ([0-9.]+) m above ground to ([0-9.]+) m above ground is open", sentence)
        assert open_ is not None
        assert 20.0 <= float(open_[1]) < float(open_[2]) <= 40.0
    for given in open_.groups():
        assert said(capsys, "--start", "-75", "22", given, "--goal", "55", "-20", "30", *rules)[0] == 0


def test_places_are_spoken_as_they_were_given() -> None:
    grid = Grid((20, 20, 20), 2.0, (1.0, 1.0, 1.0))
    earth, terrain = TangentPlane(52.07, 4.3, 10.0), Terrain.flat(3.5, grid)
    point = (10.0, 20.0, 12.5)
    ((north, east, up),) = earth.geodetic(np.array([point])).tolist()
    on_earth = f"latitude {north:.7f}, longitude {east:.7f}"
    assert PlaceFormat("map", earth, terrain).place(point) == "(10, 20, 12.5)"
    assert PlaceFormat("local-agl", None, terrain).place(point) == "(x 10, y 20, 9 m above ground)"
    assert PlaceFormat("agl", earth, terrain).place(point) == f"({on_earth}, 9 m above ground)"
    assert PlaceFormat("amsl", earth, terrain).place(point) == f"({on_earth}, {up:.1f} m above sea level)"
    assert PlaceFormat("map", earth, terrain).height(point) == "z = 12.5"
    assert PlaceFormat("local-agl", None, Terrain.flat(float("nan"), grid)).height(point) == "z = 12.5"


def test_a_leg_that_starts_where_the_last_one_fails_is_told_in_a_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    occupied = np.zeros((24, 16, 12), bool)
    occupied[12] = True
    occupied[12, 1:6, 2:10] = False
    np.savez(tmp_path / "town.npz", occupied=occupied, spacing=2.0, origin=np.zeros(3))
    places = "".join(f"[[waypoint]]\nat = {at}\n" for at in ("[6, 16, 10]", "[24, 1, 1]", "[40, 20, 12]"))
    (tmp_path / "a.toml").write_text(f'map = "town.npz"\nmethod = "astar"\n{places}')
    assert main(["mission", str(tmp_path / "a.toml")]) == 1
    error = capsys.readouterr().err
    assert error.count("(24, 1, 1) lies in an obstacle") == 1
    assert "Leg 2 of 2: START_OCCUPIED: it starts where leg 1 is to end." in error
