"""What a scan shows: beams pass what lies before their returns, and a wall hides what is behind it."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from maxjax.core.grid import Grid
from maxjax.fields.sighting import sight
from maxjax.sim.sensors.lidar import Lidar, scan
from maxjax.sim.worlds.solids import upright_boxes


def test_beams_pass_what_lies_before_their_returns() -> None:
    grid = Grid((20, 20, 20), 1.0, (0.0, 0.0, 0.0))
    sensor = jnp.array([2.2, 3.2, 4.0])
    returns = jnp.array([[15.3, 3.2, 4.0], [2.2, 12.6, 4.0], [jnp.nan, 0.0, 0.0]])
    seen = sight(sensor, returns, grid)
    occupied, free = np.zeros(grid.shape, bool), np.zeros(grid.shape, bool)
    occupied[15, 3, 4], occupied[2, 13, 4] = True, True
    # The last points, a multiple of half a voxel from the sensor, lie at 14.7 and 11.7.
    free[2:15, 3, 4], free[2, 3:13, 4] = True, True
    np.testing.assert_array_equal(seen.occupied, occupied)
    np.testing.assert_array_equal(seen.free, free)
    near = np.asarray(sight(sensor, returns, grid, 5.0).free)
    assert not near[8:].any()
    assert near[2:7, 3, 4].all()


def test_a_wall_is_seen_on_its_near_side_and_hides_what_is_behind() -> None:
    grid = Grid((40, 40, 10), 2.0, (-40.0, -40.0, 0.0))
    wall = upright_boxes(jnp.array([[10.0, 0.0, 2.0, 30.0, 0.0, 20.0, 0.0]]))
    sensor = jnp.array([-10.0, 0.0, 6.0])
    seen = sight(sensor, scan(wall, Lidar(), sensor, jnp.eye(3), jax.random.key(0)).points, grid)
    x = grid.origin[0] + grid.spacing * np.arange(40)
    occupied, free = np.asarray(seen.occupied), np.asarray(seen.free)
    assert occupied[np.abs(x - 8.0) <= 1.0].any()
    assert not (occupied | free)[x > 10.0, 15:25].any()
    assert free[(x > -8.0) & (x < 6.0), 19:21, 2:4].all()
    assert not (occupied & free).any()
