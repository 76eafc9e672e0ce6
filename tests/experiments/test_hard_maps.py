"""Hard maps: the judge before brute force, what it finds, and the planner before it."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.common.dilation import closed, joined
from benchmarks.common.safety import Walls, kept
from experiments.hard_maps.judge import Answer, judge
from experiments.hard_maps.maps import CELLS, SIZE, drawn
from experiments.hard_maps.study import TINY, main, section
from tests.references import distances_to_cubes, inflated


@pytest.mark.parametrize("radius", [0.5, 1.0, 1.5, 2.2])
def test_closed_voxels_are_those_of_brute_force(radius: float) -> None:
    occupied = np.random.default_rng(1).random((9, 8, 7)) < 0.05
    centres = np.argwhere(np.ones_like(occupied)).astype(float)
    near = distances_to_cubes(centres, occupied).reshape(occupied.shape) < radius - 1e-9
    np.testing.assert_array_equal(closed(occupied, radius), near | occupied)
    np.testing.assert_array_equal(closed(occupied, radius), inflated(occupied, np.zeros_like(occupied), radius))


def test_distances_of_paths_are_those_of_brute_force() -> None:
    rng = np.random.default_rng(2)
    for _ in range(20):
        occupied = rng.random((9, 8, 7)) < 0.03
        path = rng.uniform(0, 6, (4, 3))
        dense = np.concatenate([np.linspace(a, b, 400) for a, b in itertools.pairwise(path)])
        expected = distances_to_cubes(dense, occupied).min()
        found = kept(Walls(occupied, np.zeros_like(occupied), 1.0), path).least
        if min(expected, found) < 1.5:
            assert found == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(("kind", "radius"), CELLS)
def test_problems_are_drawn_from_their_numbers_and_their_ends_keep_the_radius(kind: str, radius: float) -> None:
    some = drawn(0, kind, radius, range(40))
    np.testing.assert_array_equal(drawn(0, kind, radius, range(30, 40)).occupied, some.occupied[30:])
    for occupied, ends in zip(some.occupied, some.ends, strict=True):
        assert (distances_to_cubes(ends, occupied) >= radius - 1e-9).all()
        assert ((ends >= 0) & (ends <= SIZE - 1)).all()
    assert {np.abs(ends % 1).max() == 0 for ends in some.ends} == {True, False}  # centres, and other points


def test_images_hold_the_same_problem() -> None:
    some = drawn(0, "doors", 1.0, range(6))
    for axis in range(3):
        image = some.mirrored(axis)
        for k in range(6):
            voxels = [np.floor(ends[k] + 0.5).astype(int) for ends in (some.ends, image.ends)]
            assert joined(some.occupied[k], 1.0, voxels[0]) == joined(image.occupied[k], 1.0, voxels[1])
        np.testing.assert_array_equal(
            np.sort(image.occupied.sum(axis=(1, 2, 3))), np.sort(some.occupied.sum((1, 2, 3)))
        )
    moved = some.embedded((1, 2, 1), 3)
    np.testing.assert_array_equal(moved.occupied[:, 1 : SIZE + 1, 2 : SIZE + 2, 1 : SIZE + 1], some.occupied)
    np.testing.assert_array_equal(moved.ends, some.ends + np.array([1, 2, 1]))


def test_the_judge_finds_what_is_wrong() -> None:
    """A wall with a door of one voxel: joined at half a voxel, not at one."""
    occupied = np.zeros((9, 9, 9), bool)
    occupied[4] = True
    occupied[4, 4, 4] = False
    ends = np.array([[1.0, 4, 4], [7, 4, 4]])
    straight, nothing = np.array([[1.0, 4, 4], [7, 4, 4]]), np.zeros((0, 3))
    good = Answer(occupied, ends, 0.5, "OK", 0.5, straight)
    assert dataclasses.astuple(judge(good)) == (True, True, True)
    assert not judge(dataclasses.replace(good, status="NO_SAFE_PATH", path=nothing)).right
    around = np.array([[1.0, 4, 4], [4, 3, 4], [7, 4, 4]])  # through the wall
    assert not judge(dataclasses.replace(good, path=around)).safe
    assert not judge(dataclasses.replace(good, path=straight + 0.01)).safe  # from elsewhere
    wide = Answer(occupied, ends, 1.0, "NO_SAFE_PATH", 0.5, nothing)
    assert dataclasses.astuple(judge(wide)) == (False, True, True)
    assert not judge(dataclasses.replace(wide, named=1.0)).right
    assert not judge(dataclasses.replace(wide, status="NO_VALID_PATH")).right
    assert dataclasses.astuple(judge(dataclasses.replace(wide, status="OK", path=straight))) == (False, False, False)
    occupied[4, 4, 4] = True
    assert judge(Answer(occupied, ends, 1.0, "NO_VALID_PATH", np.nan, nothing)).right


@pytest.mark.nightly
def test_problems_are_solved_exactly_when_they_can_be(tmp_path: Path) -> None:
    config = dataclasses.replace(TINY, keep=tmp_path / "kept", out=tmp_path)
    rows = main(config)
    for row in rows:
        found: Any = row
        assert found["problems"] == TINY.problems / len(CELLS)
        assert found["joined"] == found["solved"] == found["certified"]
        assert found["wrong"] == found["unsafe"] == found["mirrored_otherwise"] == found["moved_otherwise"] == 0
        assert found["worst_mirrored"] < 0.02
        assert found["worst_moved"] < 0.02
    assert sum(int(row["joined"]) for row in rows) > 0  # type: ignore[arg-type]
    assert main(config) == rows  # from the folder
    text = section(json.loads((tmp_path / "hard_maps.json").read_text()))
    assert f"0 of {TINY.problems} wrong or unsafe" in text
    assert "Numbers of failures" not in text


@pytest.mark.nightly
def test_ten_thousand_problems_are_solved_exactly_when_they_can_be(tmp_path: Path) -> None:
    """In a process of its own, with the optimisations that users have."""
    words = ("--problems", "10000", "--slice", "100", "--images", "10", "--workers", "0", "--out", str(tmp_path))
    optimised = os.environ | {"JAX_DISABLE_MOST_OPTIMIZATIONS": "0"}
    command = [sys.executable, "-m", "experiments.hard_maps", *words]
    subprocess.run(command, check=True, env=optimised, cwd=Path(__file__).parents[2], timeout=1200)
    rows = json.loads((tmp_path / "hard_maps.json").read_text())["rows"]
    assert sum(row["problems"] for row in rows) == 10_000
    for row in rows:
        assert row["joined"] == row["solved"] == row["certified"]
        assert row["wrong"] == row["unsafe"] == row["mirrored_otherwise"] == row["moved_otherwise"] == 0
        # What is more than the solver's tolerance is gone with a tighter one.
        assert row["worst_again"] < 0.02
