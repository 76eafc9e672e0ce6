"""Routes in windows, alone and in a batch, are those of whole maps."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import maxjax
from maxjax import VoxelMap
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.problem.distances import Distances
from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.planning.run.plan_route import find_route
from maxjax.planning.windows import windowed_route as windowed
from maxjax.ui.methods import planner_named
from maxjax.verification.verifier import verify

GRID = Grid((34, 30, 20), 2.0, (0.0, 0.0, 0.0))
DISTANCES = Distances(1.0, 4.0)
NEAR_SIZES = ((16, 16, 14), (24, 22, 14))


def blocks(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A ground two layers thick with towers on it."""
    occupied = np.zeros(GRID.shape, bool)
    for _ in range(14):
        x, y = rng.integers(0, (32, 28))
        occupied[x : x + 3, y : y + 3, : rng.integers(4, 16)] = True
    ground = np.zeros(GRID.shape, bool)
    ground[:, :, :2] = True
    return occupied | ground, ground


@pytest.fixture
def small_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windowed, "_SIZES", NEAR_SIZES)
    monkeypatch.setattr(windowed, "_AT_ONCE", (3, 2, 2))


def test_routes_in_windows_are_those_of_whole_maps(small_windows: None) -> None:
    rng = np.random.default_rng(3)
    occupied, ground = blocks(rng)
    occupied[20:27, 5:12, 2:19] = True
    occupied[21:26, 6:11, 2:18] = False  # a sealed room, seen to be sealed by the whole map alone
    free = np.argwhere(~occupied[:, :, :14])
    ends = [rng.permutation(free)[:2] + rng.uniform(-0.2, 0.2, (2, 3)) for _ in range(10)]
    ends = [pair for pair in ends if np.linalg.norm(pair[0] - pair[1]) > 3]
    ends += [
        np.array([[2.0, 2.0, 4.0], [5.0, 4.0, 5.0]]),
        np.array([[2.0, 2.0, 4.0], [23.0, 8.0, 5.0]]),  # into the room
        np.array([[2.0, 2.0, 4.0], [2.0, 2.0, 1.0]]),  # into the ground
        np.array([[2.0, 2.0, 4.0], [2.0, 2.0, 40.0]]),  # out of the map
        np.array([[2.0, 2.0, 4.0], [np.nan, 2.0, 4.0]]),
    ]
    both = jnp.asarray(np.stack(ends), jnp.float32)
    planner = planner_named("field")
    assert isinstance(planner, FieldPlanner)
    origin = jnp.zeros(3)
    volumes = jnp.asarray(occupied), jnp.asarray(ground)

    def sought(ends: jax.Array, wanted: jax.Array) -> windowed.WindowedRoute:
        asked = windowed.MapAndEnds.of(volumes, ends, origin)
        return windowed.route_in_windows(asked, wanted, DISTANCES, GRID, planner)

    wanted = jnp.ones(len(both), bool).at[0].set(False)
    together = jax.jit(jax.vmap(sought))(both, wanted)
    where = VoxelMap.on(GRID, occupied, ground)
    whole = jax.jit(functools.partial(find_route, where, distances=DISTANCES, planner=planner))
    one = jax.jit(sought)
    numbers = []
    for k, pair in enumerate(both):
        if not wanted[k]:
            continue
        _, expected = whole(ends=pair)
        alone = one(pair, jnp.array(True))
        for found in (jax.tree.map(lambda x, k=k: x[k], together), alone):
            assert int(found.route.status) == int(expected.status)
            numbers.append(int(found.least))
            if expected.status == Status.OK:
                assert found.route.cost <= 1.02 * expected.cost
                assert found.route.certified
                judged = verify(
                    2.0 * np.asarray(found.route.path, np.float64),
                    where,
                    radius=DISTANCES.radius,
                    exemptions=tuple(np.asarray(found.route.exemptions, np.float64)),
                )
                assert judged.ok
    statuses = [Status(int(x)) for x in together.route.status]
    assert statuses[-4:] == [
        Status.NO_VALID_PATH,
        Status.GOAL_OCCUPIED,
        Status.GOAL_OUTSIDE_MAP,
        Status.NONFINITE_INPUT,
    ]
    assert statuses.count(Status.OK) >= 6


def test_what_lies_around_the_start_is_what_the_whole_map_blocks(small_windows: None) -> None:
    rng = np.random.default_rng(5)
    occupied, ground = blocks(rng)
    planner = planner_named("field")
    ends = jnp.array([[4.0, 4.0, 4.0], [14.0, 9.0, 6.0]])
    occupied[2:7, 2:7, 3:6] = False
    asked = windowed.MapAndEnds.of((jnp.asarray(occupied), jnp.asarray(ground)), ends, jnp.zeros(3))
    found = jax.jit(lambda: windowed.route_in_windows(asked, jnp.array(True), DISTANCES, GRID, planner))()
    problem, _ = find_route(
        VoxelMap.on(GRID, occupied, ground), ends, DISTANCES, dataclasses.replace(planner, focus=False)
    )
    blocked = np.pad(np.asarray(problem.blocked), windowed.NEAR, constant_values=True)
    size = 2 * windowed.NEAR + 1
    expected = blocked[4 : 4 + size, 4 : 4 + size, 4 : 4 + size]
    np.testing.assert_array_equal(found.near, expected)
    assert maxjax.Status(int(found.route.status)) is Status.OK


@pytest.mark.parametrize("corner", [(-3, 0, 2), (0, 0, 0), (5, 4, 3)])
def test_a_box_of_a_volume_is_that_of_a_padded_one(corner: tuple[int, int, int]) -> None:
    volume = np.random.default_rng(0).integers(0, 9, (7, 6, 5)).astype(np.float32)
    padded = np.pad(volume, 9, constant_values=-1)
    x, y, z = (9 + c for c in corner)
    found = windowed.cut_box(jnp.asarray(volume), jnp.array(corner), (6, 5, 4), beyond=-1.0)
    np.testing.assert_array_equal(found, padded[x : x + 6, y : y + 5, z : z + 4])
