"""Movers as they are: sets of those whose ways are known hold them for as long, without any acceleration."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.sim.movers.reachable_sets import Bounds, reachable
from maxjax.sim.movers.true_tracks import TrueTracks, tracks_of
from maxjax.sim.worlds.movers import places, through
from tests.sim.movers.scenes import spheres

BOUNDS = Bounds(speed=20.0, acceleration=1e-3)


@pytest.mark.parametrize("start", [0.0, 0.7, 2.9])
def test_known_ways_lie_in_sets_that_do_not_accelerate(start: float) -> None:
    """Circles of 3 m at 2 rad/s, whose acceleration is 12 m/s²."""
    angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    circle = 3.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], -1)[None]
    velocity = 6.0 * np.stack([-np.sin(angle), np.cos(angle), 0.0 * angle], -1)[None]
    solids = spheres(circle[:, 0], velocity[:, 0]).solids
    movers = through(solids, jnp.asarray(circle), jnp.asarray(velocity), jnp.array([np.pi / 16]), loops=True)
    tracks = tracks_of(movers, jnp.float32(start), jnp.zeros(3), BOUNDS, TrueTracks(slots=1, future=2.0))
    after = jnp.linspace(0.0, 2.0, 21)
    least, greatest = reachable(tracks, after, BOUNDS)
    place = jax.vmap(lambda t: places(movers, start + t)[0])(after)
    half = np.asarray(tracks.half)
    assert (place - half >= least - 1e-3).all()
    assert (place + half <= greatest + 1e-3).all()
    unknown = tracks_of(movers, jnp.float32(start), jnp.zeros(3), BOUNDS, TrueTracks(slots=1))
    least, greatest = reachable(unknown, after, BOUNDS)
    assert not ((place - half >= least) & (place + half <= greatest)).all()


def test_sets_of_straight_ways_stay_as_small_as_they_are() -> None:
    movers = spheres(np.zeros((1, 3)), np.array([[5.0, -2.0, 0.0]]))
    how = TrueTracks(slots=1, velocity=0.0, future=2.0)
    tracks = tracks_of(movers, jnp.float32(0.0), jnp.zeros(3), BOUNDS, how)
    np.testing.assert_allclose(tracks.slowest, tracks.fastest, atol=1e-4)
    np.testing.assert_allclose(tracks.slowest[0], [5.0, -2.0, 0.0], atol=1e-4)
