"""A task is what was given, checked once: whatever cannot be used is told with what was expected and what was given."""

from __future__ import annotations

import math
from typing import Any

import jax
import numpy as np
import pytest

from maxjax import Grid, VoxelMap
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from tests.planners import unchecked

GRID = Grid((4, 5, 6), 2.0, (84_888.25, 447_501.5, -3.0))
EMPTY = np.zeros(GRID.shape, bool)
POINTS = np.array([[84_890.0, 447_503.0, 1.0], [84_892.0, 447_505.5, 3.0]])


KEPT = "radius", "margin", "price"


def task(**changes: Any) -> Task:
    given = {"occupied": EMPTY, "starts": POINTS, "goals": POINTS[::-1], "grid": GRID, "ground": None} | changes
    kept = {"radius": 1.0, "margin": 2.0} | {name: given[name] for name in KEPT if name in given}
    distances = unchecked(Distances, **kept)
    where = VoxelMap.on(given["grid"], given["occupied"], given["ground"])
    return Task.of(where, given["starts"], given["goals"], distances)


def test_holds_what_was_given() -> None:
    occupied = np.random.default_rng(0).random((2, *GRID.shape)) < 0.5
    found = task(occupied=occupied, ground=occupied[0], starts=POINTS.tolist(), goals=POINTS[0].astype(np.float32))
    assert len(found) == 2
    np.testing.assert_array_equal(found.barred, occupied | occupied[0])
    np.testing.assert_array_equal(found.kept_off, [occupied[0]] * 2)
    np.testing.assert_array_equal(found.starts, POINTS)
    np.testing.assert_array_equal(found.goals, np.float32([POINTS[0]] * 2))
    assert found.starts.dtype == found.goals.dtype == np.float64
    assert (found.grid, found.distances) == (GRID, Distances(1.0, 2.0))
    assert not task().kept_off.any()
    # Numbers of any real type, arrays of any library.
    assert task(margin=np.float32(1.5)).distances.margin == 1.5
    assert task(margin=np.array(2), radius=1).distances == Distances(1.0, 2.0)
    assert task(occupied=jax.numpy.asarray(EMPTY), radius=0, margin=0).distances.room == 0


def test_ends_are_index_coordinates_rounded_once() -> None:
    np.testing.assert_array_equal(task().ends[:, 0], ((POINTS - np.array(GRID.origin)) / 2.0).astype(np.float32))
    far = task(starts=[[1e300, math.nan, -math.inf]], goals=[math.inf, -1e300, 0.0]).ends[0]
    assert max(GRID.shape) < far[0, 0] < math.inf
    assert np.isnan(far[0, 1])
    assert far[0, 2] == -math.inf
    assert far[1, 0] == math.inf
    assert -math.inf < far[1, 1] < -1


def test_some_of_its_problems_are_views_of_its_maps() -> None:
    maps = np.random.default_rng(0).random((2, *GRID.shape)) < 0.5
    whole = task(occupied=maps)
    second = whole.some(np.array([1]))
    assert np.shares_memory(second.barred, whole.barred)
    np.testing.assert_array_equal(second.each(second.barred), maps[1:])
    assert np.shares_memory(second.each(second.barred), whole.barred)
    np.testing.assert_array_equal(second.starts, POINTS[1:])
    assert np.shares_memory(second.kept_off, whole.kept_off)
    assert second.map_at(0).grid == GRID
    np.testing.assert_array_equal(second.map_at(0).occupied, maps[1])
    twice = whole.some(np.array([1, 1, 0]))
    np.testing.assert_array_equal(twice.each(twice.barred), maps[[1, 1, 0]])
    np.testing.assert_array_equal(twice.one(twice.barred, 2), maps[0])
    np.testing.assert_array_equal(twice.ends, whole.ends[[1, 1, 0]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"occupied": None}, "occupied: expected dtype bool, given object"),
        ({"occupied": [*EMPTY.tolist()[:2], [[True]]]}, "occupied: expected an array, given list"),
        ({"occupied": EMPTY.astype(np.uint8)}, "occupied: expected dtype bool, given uint8"),
        ({"occupied": EMPTY[0]}, r"occupied: expected shape \(nx, ny, nz\) or \(b, nx, ny, nz\), given \(5, 6\)"),
        ({"occupied": np.stack([EMPTY] * 3)}, "map: expected one map, or 2 maps for as many starts, given 3"),
        ({"ground": EMPTY[None]}, r"ground: expected shape \(4, 5, 6\), given \(1, 4, 5, 6\)"),
        ({"ground": "none"}, "ground: expected dtype bool, given <U4"),
        ({"starts": None}, r"starts: expected numbers of shape \(n, 3\) .*given object \(\)"),
        ({"starts": [[1, 2], [3]]}, "starts: expected an array, given list"),
        ({"starts": POINTS[:0]}, r"starts: .*n >= 1 .*given float64 \(0, 3\)"),
        ({"starts": POINTS > 0}, "starts: expected numbers .*given bool"),
        ({"starts": POINTS * 1j}, "starts: expected numbers .*given complex128"),
        ({"starts": POINTS.astype(object)}, "starts: expected numbers .*given object"),
        ({"starts": POINTS.astype("timedelta64[s]")}, "starts: expected numbers .*given timedelta64"),
        ({"goals": POINTS[:1]}, r"goals: expected numbers of shape \(2, 3\) .*given float64 \(1, 3\)"),
        ({"goals": POINTS[0, :2]}, r"goals: expected numbers of shape \(3,\) .*given float64 \(2,\)"),
        ({"margin": "8"}, "margin: expected a finite number of metres, at least 0, given '8'"),
        ({"margin": None}, "margin: expected a finite number of metres, at least 0, given None"),
        ({"margin": True}, "margin: expected a finite number of metres, at least 0, given True"),
        ({"margin": 8j}, "margin: expected a finite number of metres, at least 0, given 8j"),
        ({"margin": [8.0]}, r"margin: expected a finite number of metres, at least 0, given \[8.0\]"),
        ({"margin": math.nan}, "margin: expected a finite number of metres, at least 0, given nan"),
        ({"margin": -1}, "margin: expected a finite .*given -1"),
        ({"margin": math.inf}, "margin: expected a finite .*given inf"),
        ({"margin": 12.5}, "margin: expected at most 12 m, the longest edge of the map, given 12.5"),
        ({"radius": None}, "radius: expected a finite number of metres, at least 0, given None"),
        ({"radius": -0.5}, "radius: expected a finite .*given -0.5"),
        ({"radius": math.nan}, "radius: expected a finite .*given nan"),
        ({"radius": 2.5}, "margin: expected at least the radius, 2.5 m, given 2"),
        ({"radius": 1e9, "margin": 1e9}, "radius: expected at most 12 m, .*given 1000000000.0"),
        ({"price": 4.0}, r"price: expected a maxjax.Price, .*given float float64 \(\)"),
        ({"price": np.ones((4, 5, 5))}, r"price: expected shape \(\.\.\., 4, 5, 6\), given \(4, 5, 5\)"),
        ({"price": np.full((4, 5, 6), 0.5)}, "price: expected finite numbers of at least 1, given some from 0.5 to 1"),
        ({"price": lambda d: 0.9 + 0 * d}, "price: expected a function with finite values of at least 1"),
        ({"price": lambda d, e: d + e}, "price: expected a function of one array"),
    ],
)
def test_what_cannot_be_used_is_told(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        task(**changes)


def test_an_array_in_place_of_a_map_is_told_with_the_call_that_makes_one() -> None:
    with pytest.raises(
        ValueError, match=r"map: expected a maxjax.VoxelMap, given an array of shape \(4, 5, 6\).*VoxelMap.of\("
    ):
        Task.of(EMPTY, POINTS, POINTS[::-1])
