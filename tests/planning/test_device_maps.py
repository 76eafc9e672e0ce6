"""What a device chooses and cuts of its maps is what the host chooses and cuts of its own."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import VoxelMap
from maxjax.core.grid import Grid
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.task import Task
from maxjax.planning.run import device_maps
from maxjax.planning.run.device_maps import DeviceMaps, cut_window
from maxjax.planning.windows import focus_window as focus
from maxjax.planning.windows.column_counts import count_columns, lowest_open_layers

SHAPES = ((12, 8, 8), (18, 14, 12))


@pytest.fixture
def task(monkeypatch: pytest.MonkeyPatch) -> Task:
    """Twenty problems in three of five maps that have a ground of different heights."""
    monkeypatch.setattr(focus, "SHAPES", SHAPES)
    rng = np.random.default_rng(8)
    occupied = rng.random((5, 40, 36, 24)) < 0.02
    for k in range(5):
        occupied[k, :, :, : 2 + k] = True
    where = VoxelMap.on(Grid((40, 36, 24), 2.0, (3.0, -7.0, 1.0)), occupied)
    starts = rng.uniform((2, 2, 8), (37, 33, 16), (20, 3))
    goals = np.clip(starts + rng.uniform(-6, 6, (20, 3)), 1, (38, 34, 20))
    to_world = np.array(where.grid.origin)
    found = Task.of(where[0], to_world + 2.0 * starts, to_world + 2.0 * goals, Distances(1.0, 4.0))
    return Task(where, rng.choice([0, 2, 4], 20), found.starts, found.goals, found.distances)


@pytest.mark.parametrize("factor", [1.0, 1.25, 2.0, 4.0])
def test_windows_are_those_that_the_host_chooses(task: Task, factor: float) -> None:
    costs = factor * np.linalg.norm(task.index[:, 1] - task.index[:, 0], axis=1)
    host, device = focus.windows_around(task, costs), DeviceMaps(task).choose(task, costs)
    for name in ("corners", "sizes", "turned"):
        np.testing.assert_array_equal(getattr(host, name), getattr(device, name), err_msg=name)
    np.testing.assert_allclose(device.bounds, host.bounds, rtol=1e-5)
    assert np.isfinite(host.bounds).any() or factor == 4.0


def test_a_part_of_the_problems_is_in_the_same_maps(task: Task) -> None:
    maps, costs = DeviceMaps(task), 1.25 * np.linalg.norm(task.index[:, 1] - task.index[:, 0], axis=1)
    every, rows = maps.choose(task, costs), np.array([17, 3, 4])
    assert maps.hold(task.some(rows))
    for whole, part in zip(every.some(rows), maps.choose(task.some(rows), costs[rows]), strict=True):
        np.testing.assert_array_equal(whole, part)
    assert not maps.hold(Task.of(task.map[0], task.starts, task.goals, task.distances))
    # In a map that was not sent.
    other = task.some(rows)
    other.map_of[:] = 1
    assert not maps.hold(other)


def test_maps_are_sent_up_to_a_number_of_voxels(task: Task, monkeypatch: pytest.MonkeyPatch) -> None:
    used = len(np.unique(task.map_of)) * 40 * 36 * 24
    for limit, fits in ((used, True), (used - 1, False)):
        monkeypatch.setattr(device_maps, "_VOXELS", limit)
        assert DeviceMaps.fit(task) == fits
    shared = Task.of(task.map[0], task.starts, task.goals, task.distances)
    assert DeviceMaps.fit(shared)


def test_open_layers_by_columns_are_those_of_the_boxes() -> None:
    rng = np.random.default_rng(3)
    maps = rng.random((4, 9, 8, 12)) < 0.98
    maps[1:3, :, :, :5] = True
    low = rng.integers(-3, 9, (50, 6, 3))
    high, map_of = low + rng.integers(0, 6, (50, 6, 3)), rng.integers(0, 4, 50)
    found = np.asarray(lowest_open_layers(count_columns(jnp.asarray(maps)), *map(jnp.asarray, (map_of, low, high))))
    for m, lows, highs, layers in zip(map_of, low, high, found, strict=True):
        firsts = np.clip(lows, 0, maps.shape[1:])
        for first, last, z in zip(firsts, np.clip(highs + 1, firsts, maps.shape[1:]), layers, strict=True):
            solid = maps[m, first[0] : last[0], first[1] : last[1], first[2] : last[2]].all(axis=(0, 1))
            assert z == first[2] + np.argmin([*solid, False])


@pytest.mark.parametrize("turned", [False, True])
def test_what_is_cut_is_what_the_host_cuts(turned: bool) -> None:
    cut = jax.jit(cut_window, static_argnames=("shape", "beyond"))
    rng = np.random.default_rng(4)
    maps = rng.random((3, 20, 21, 22)).astype(np.float32)
    size = np.array([[5, 7, 9] if turned else [7, 5, 9]])
    for low in rng.integers(-12, 28, (20, 3)):
        window = focus.Windows(low[None], size, np.ones(1), np.array([turned]))
        for m in range(3):
            host = window.cut(maps, np.array([m]), 2, 1.5)[0]
            at = jnp.int32(m), jnp.asarray(low - 2, jnp.int32), jnp.array(turned)
            np.testing.assert_array_equal(cut(jnp.asarray(maps), *at, shape=host.shape, beyond=1.5), host)
    # Of the only map, whatever its number is.
    alone = cut_window(jnp.asarray(maps[:1]), jnp.int32(2), jnp.zeros(3, jnp.int32), jnp.array(turned), (4, 4, 4), 1.5)
    expected = maps[0, :4, :4, :4]
    np.testing.assert_array_equal(alone, expected.swapaxes(0, 1) if turned else expected)
