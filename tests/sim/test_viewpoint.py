"""Viewpoints: the one chosen can be reached and shows the unseen path, by plain geometry in NumPy."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.sim.mapping.viewpoint import MapView, UnseenPath, next_viewpoint, still_reachable
from maxjax.sim.sensors.lidar import Lidar

SHAPE = (16, 16, 16)
HERE = np.array([8.0, 8.0, 4.0], np.float32)
KEY = jax.random.key(0)


def view_of(seen: np.ndarray, occupied: np.ndarray, blocked: np.ndarray) -> MapView:
    return MapView(*map(jnp.asarray, (seen, occupied, blocked)))


def chosen(
    seen: np.ndarray,
    occupied: np.ndarray,
    blocked: np.ndarray,
    hidden: np.ndarray,
    jitter: float = 0.0,
    here: np.ndarray = HERE,
) -> np.ndarray | None:
    """The viewpoint; None: there is none."""
    unseen = UnseenPath(jnp.asarray(hidden), jnp.asarray(hidden[-1], jnp.float32))
    view = view_of(seen, occupied, blocked)
    found = jax.jit(next_viewpoint)(view, jnp.asarray(here), unseen, Lidar(), jnp.float32(jitter), KEY)
    return np.asarray(found.position) if found.exists else None


def samples(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Voxels along a line."""
    return np.unique(np.round(np.linspace(a, b, 200)).astype(int), axis=0)


def elevation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arctan2(b[2] - a[2], np.hypot(*(b - a)[:2]))))


# Everything up to the height of the vehicle was seen; a wall stands at x = 12; the path goes straight up.
UPWARDS = np.array([[8, 8, z] for z in range(5, 13)], np.int32)


def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    seen, occupied = np.zeros(SHAPE, bool), np.zeros(SHAPE, bool)
    seen[:, :, :5], occupied[12] = True, True
    blocked = occupied.copy()
    blocked[10:] = True
    return seen & ~occupied, occupied, blocked


def test_a_path_straight_up_is_viewed_from_further_back() -> None:
    seen, occupied, blocked = scene()
    end = chosen(seen, occupied, blocked, UPWARDS)
    assert end is not None
    assert abs(elevation(end, UPWARDS[0])) <= 45
    assert abs(elevation(HERE, UPWARDS[0])) > 45  # as it could not be from here
    assert all(seen[tuple(v)] and not blocked[tuple(v)] for v in samples(HERE, end))
    # More of the path lies in the field of view than from a voxel nearer.
    count = [sum(abs(elevation(at, u)) <= 40 for u in UPWARDS) for at in (end, end + np.sign(HERE - end))]
    assert count[0] > count[1]


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_on_a_face_of_its_voxel_a_vehicle_sets_out_though_nobody_saw_beyond(axis: int) -> None:
    """Ends are multiples of 1/64 m: one of 128 stands exactly on a face, which lines from there meet on both sides."""
    seen = np.zeros(SHAPE, bool)
    seen[*[slice(8, None) if k == axis else slice(None) for k in range(3)]] = True
    here = np.full(3, 8.0, np.float32)
    here[axis] = 7.5
    hidden = np.tile([8, 8, 8], (7, 1)).astype(np.int32)
    hidden[:, axis] = np.arange(7, 0, -1)
    nothing = np.zeros(SHAPE, bool)
    end = chosen(seen, nothing, nothing, hidden, here=here)
    assert end is not None
    assert seen[tuple(np.round(end).astype(int))]


def test_a_voxel_behind_a_wall_is_viewed_around_it() -> None:
    seen, occupied, blocked = scene()
    occupied[:8, 10, :] = True
    blocked |= occupied
    hidden = np.array([[6, 12, 4]] * 8, np.int32)
    end = chosen(seen & ~occupied, occupied, blocked, hidden)
    assert end is not None
    assert not any(occupied[tuple(v)] for v in samples(end, hidden[0]))


@pytest.mark.parametrize("jitter", [0.0, 2.0, 8.0])
def test_jitter_keeps_the_requirements(jitter: float) -> None:
    seen, occupied, blocked = scene()
    end = chosen(seen, occupied, blocked, UPWARDS, jitter)
    assert end is not None
    assert abs(elevation(end, UPWARDS[0])) <= 45
    assert seen[tuple(end.astype(int))]


def test_without_a_view_the_path_goes_on_and_a_margin_is_left_by_the_shortest_way() -> None:
    seen, occupied, blocked = scene()
    walled = occupied.copy()
    walled[:, :, 5] = True  # nothing above can be seen from below
    end = chosen(seen, walled, blocked, UPWARDS + np.array([-3, 0, 0], np.int32))
    assert end is not None
    assert end[0] < HERE[0]
    inside = np.array([10.0, 8.0, 4.0], np.float32)
    end = chosen(seen, occupied, blocked, UPWARDS, here=inside)
    assert end is not None
    np.testing.assert_array_equal(end, [9, 8, 4])


def test_unseen_voxels_hold_no_viewpoint_and_end_the_way_to_one() -> None:
    seen, occupied, blocked = scene()
    assert chosen(np.zeros(SHAPE, bool), occupied, blocked, UPWARDS) is None
    end = jnp.array([6.0, 8.0, 4.0])
    assert still_reachable(view_of(seen, occupied, blocked), jnp.asarray(HERE), end)
    seen[7] = False
    assert not still_reachable(view_of(seen, occupied, blocked), jnp.asarray(HERE), end)
