"""Steps aside: what is chosen can be reached and shows what it should, by plain geometry in NumPy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.sim.lidar import Lidar
from maxjax.sim.lookout import step_to, still_open

SHAPE = (16, 16, 16)
HERE = np.array([8.0, 8.0, 4.0], np.float32)
KEY = jax.random.key(0)


def step(
    seen: np.ndarray,
    occupied: np.ndarray,
    blocked: np.ndarray,
    hidden: np.ndarray,
    restless: float = 0.0,
    here: np.ndarray = HERE,
) -> np.ndarray | None:
    """The voxel stepped to; None: there is none."""
    arrays = (jnp.asarray(array) for array in (seen, occupied, blocked, here, hidden, hidden[-1].astype(np.float32)))
    end, exists = jax.jit(step_to, static_argnums=6)(*arrays, Lidar(), jnp.float32(restless), KEY)
    return np.asarray(end) if exists else None


def samples(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Voxels along a line."""
    return np.unique(np.round(np.linspace(a, b, 200)).astype(int), axis=0)


def elevation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(b[2] - a[2], np.hypot(*(b - a)[:2]))))


# Everything up to the height of the vehicle was seen; a wall stands at x = 12; the path goes straight up.
UPWARDS = np.array([[8, 8, z] for z in range(5, 13)], np.int32)


def world() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    seen, occupied = np.zeros(SHAPE, bool), np.zeros(SHAPE, bool)
    seen[:, :, :5], occupied[12] = True, True
    blocked = occupied.copy()
    blocked[10:] = True
    return seen & ~occupied, occupied, blocked


def test_a_way_straight_up_is_looked_at_from_a_step_back() -> None:
    seen, occupied, blocked = world()
    end = step(seen, occupied, blocked, UPWARDS)
    assert end is not None
    assert abs(elevation(end, UPWARDS[0])) <= 45
    assert abs(elevation(HERE, UPWARDS[0])) > 45  # as it could not be from here
    assert all(seen[tuple(v)] and not blocked[tuple(v)] for v in samples(HERE, end))
    # More of the way lies in the field of view than a voxel nearer.
    count = [sum(abs(elevation(at, u)) <= 40 for u in UPWARDS) for at in (end, end + np.sign(HERE - end))]
    assert count[0] > count[1]


def test_what_hides_behind_a_wall_is_looked_at_around_it() -> None:
    seen, occupied, blocked = world()
    occupied[:8, 10, :] = True
    blocked |= occupied
    hidden = np.array([[6, 12, 4]] * 8, np.int32)
    end = step(seen & ~occupied, occupied, blocked, hidden)
    assert end is not None
    assert not any(occupied[tuple(v)] for v in samples(end, hidden[0]))


@pytest.mark.parametrize("restless", [0.0, 2.0, 8.0])
def test_chance_leaves_what_is_demanded_alone(restless: float) -> None:
    seen, occupied, blocked = world()
    end = step(seen, occupied, blocked, UPWARDS, restless)
    assert end is not None
    assert abs(elevation(end, UPWARDS[0])) <= 45
    assert seen[tuple(end.astype(int))]


def test_without_a_view_it_goes_on_and_out_of_a_margin_it_takes_the_shortest_way() -> None:
    seen, occupied, blocked = world()
    walled = occupied.copy()
    walled[:, :, 5] = True  # nothing above can be seen from below
    end = step(seen, walled, blocked, UPWARDS + np.array([-3, 0, 0], np.int32))
    assert end is not None
    assert end[0] < HERE[0]
    inside = np.array([10.0, 8.0, 4.0], np.float32)
    end = step(seen, occupied, blocked, UPWARDS, here=inside)
    assert end is not None
    np.testing.assert_array_equal(end, [9, 8, 4])


def test_there_is_no_step_where_nothing_was_seen_and_one_under_way_ends_there() -> None:
    seen, occupied, blocked = world()
    assert step(np.zeros(SHAPE, bool), occupied, blocked, UPWARDS) is None
    end = jnp.array([6.0, 8.0, 4.0])
    assert still_open(jnp.asarray(seen), jnp.asarray(blocked), jnp.asarray(HERE), end)
    seen[7] = False
    assert not still_open(jnp.asarray(seen), jnp.asarray(blocked), jnp.asarray(HERE), end)
