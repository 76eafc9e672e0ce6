"""Batteries: none without a capacity and a reserve."""

from __future__ import annotations

import math

import pytest

from maxjax.energy.battery import Battery


def test_the_reserve_is_not_usable() -> None:
    assert Battery(80.0, 0.25).usable == pytest.approx(60.0)


@pytest.mark.parametrize("capacity", [0.0, -5.0, math.nan, math.inf])
def test_a_capacity_that_is_none_is_refused(capacity: float) -> None:
    with pytest.raises(ValueError, match="battery: expected a capacity above 0 Wh, given"):
        Battery(capacity, 0.2)


def test_a_reserve_of_all_or_of_nothing_is_a_sentence() -> None:
    with pytest.raises(ValueError, match="reserve: expected a share above 0, below 1, given 1: nothing is left to fly"):
        Battery(80.0, 1.0)
    with pytest.raises(ValueError, match="given 0: no flight is called enough without one"):
        Battery(80.0, 0.0)
    for reserve in (-0.1, 1.5, math.nan):
        with pytest.raises(ValueError, match="reserve: expected a share"):
            Battery(80.0, reserve)
