"""Random streams: all draws of a flight have keys of their own, the keys that recorded results were drawn from."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.core.rng_streams import ITERATIONS, Stream, named_key, stream
from maxjax.sim.loop.flight import FlightConfig, fly_closed_loop
from maxjax.sim.worlds.geoms import ground_plane
from maxjax.ui.methods import planner_named

KEY = jax.random.key(7)
PER_ITERATION = (Stream.SCAN, Stream.VIEWPOINT, Stream.GUSTS, Stream.FAULTS)


def test_streams_are_pairwise_distinct_in_every_iteration() -> None:
    """As intervals of the indices that are folded in, and as keys."""
    length = {which: ITERATIONS if which in PER_ITERATION else 1 for which in Stream}
    for a, b in itertools.combinations(Stream, 2):
        assert a + length[a] <= b or b + length[b] <= a
    keys = [stream(KEY, which) for which in Stream if which not in PER_ITERATION]
    keys += [stream(KEY, which, jnp.int32(i)) for which in PER_ITERATION for i in (*range(40), ITERATIONS - 1)]
    words = np.array([jax.random.key_data(key) for key in keys])
    assert len(np.unique(words, axis=0)) == len(keys)


def test_the_keys_are_those_of_recorded_results() -> None:
    expected = {
        Stream.WIND_DIRECTION: 1,
        Stream.DRIFT_DIRECTION: 2,
        Stream.SENSOR_OUTAGE: 3,
        Stream.FIRST_GUST: 4,
        Stream.SCAN: 1_000,
        Stream.VIEWPOINT: 10_000,
        Stream.GUSTS: 100_000,
        Stream.FAULTS: 200_000,
    }
    assert set(expected) == set(Stream)
    for which, number in expected.items():
        assert stream(KEY, which) == jax.random.fold_in(KEY, number)
        assert stream(KEY, which, jnp.int32(12)) == jax.random.fold_in(KEY, number + 12)
    # 907060870 is the CRC-32 of the ASCII text "hello".
    assert named_key(KEY, "hello") == jax.random.fold_in(KEY, 907060870)


def test_a_flight_longer_than_its_streams_is_refused() -> None:
    ends = jnp.array([0.0, 0.0, 5.0]), jnp.array([20.0, 0.0, 5.0])
    with pytest.raises(ValueError, match=f"plans: expected 1 to {ITERATIONS}, given {ITERATIONS + 1}"):
        fly_closed_loop(ground_plane(), *ends, KEY, FlightConfig(planner=planner_named("field"), plans=ITERATIONS + 1))
