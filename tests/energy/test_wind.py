"""Wind: by weather reports, over time, and what is none."""

from __future__ import annotations

import numpy as np
import pytest

from maxjax.energy.wind import Wind
from tests.planners import unchecked


def test_a_report_says_where_it_comes_from() -> None:
    west = Wind.blowing(8.0, 270.0).at(np.array([0.0, 99.0]))
    np.testing.assert_allclose(west, [[8.0, 0.0, 0.0]] * 2, atol=1e-12)
    np.testing.assert_allclose(Wind.blowing(5.0, 0.0).velocities, [[0.0, -5.0, 0.0]], atol=1e-12)
    assert Wind.calm().strongest == 0.0


def test_samples_are_joined_by_lines_and_held_at_both_ends() -> None:
    wind = Wind(np.array([10.0, 20.0]), np.array([[2.0, 0.0, 0.0], [4.0, -6.0, 1.0]]))
    np.testing.assert_allclose(wind.at(np.array([0.0, 15.0, 30.0])), [[2, 0, 0], [3, -3, 0.5], [4, -6, 1]])
    assert wind.strongest == pytest.approx(np.sqrt(53.0))


@pytest.mark.parametrize(
    ("times", "velocities", "sentence"),
    [
        ([0.0, 1.0], [[0.0, 0.0, 0.0]], "expected times"),
        ([], np.zeros((0, 3)), "expected times"),
        ([1.0, 1.0], np.zeros((2, 3)), "expected times that rise"),
        ([0.0], [[np.nan, 0.0, 0.0]], "expected finite numbers"),
    ],
)
def test_what_is_no_wind_is_refused(times: list[float], velocities: list[list[float]], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        unchecked(Wind, times=np.array(times, np.float64), velocities=np.array(velocities, np.float64))


def test_speeds_and_directions_that_are_none_are_refused() -> None:
    with pytest.raises(ValueError, match="wind: expected a speed from 0 m/s on, given -1"):
        Wind.blowing(-1.0, 0.0)
    with pytest.raises(ValueError, match="wind: expected the degrees"):
        Wind.blowing(1.0, float("inf"))
