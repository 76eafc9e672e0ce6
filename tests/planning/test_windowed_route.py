"""Routes in windows, alone and in a batch, are those of whole maps."""

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
from maxjax.planning.run.plan_route import find_route
from maxjax.planning.windows import windowed_route as windowed
from maxjax.verification.verifier import verify

GRID = Grid((34, 30, 20), 2.0, (0.0, 0.0, 0.0))
DISTANCES = Distances(1.0, 4.0)
NEAR_SIZES = ((16, 16, 14), (24, 22, 14))
PLANNER = maxjax.Field()
COUNT = 15  # pairs of ends in a batch


def blocks(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A ground two layers thick with towers on it."""
    occupied = np.zeros(GRID.shape, bool)
    for _ in range(14):
        x, y = rng.integers(0, (32, 28))
        occupied[x : x + 3, y : y + 3, : rng.integers(4, 16)] = True
    ground = np.zeros(GRID.shape, bool)
    ground[:, :, :2] = True
    return occupied | ground, ground


@pytest.fixture(params=[NEAR_SIZES[1:], pytest.param(NEAR_SIZES, marks=pytest.mark.nightly)], ids=["one", "two"])
def small_windows(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    """How many sizes there are: each of them is half a minute to compile."""
    monkeypatch.setattr(windowed, "_SIZES", request.param)
    monkeypatch.setattr(windowed, "_AT_ONCE", (3, 2, 2)[-1 - len(request.param) :])
    return len(request.param)


def sought(volumes: tuple[jax.Array, jax.Array], ends: jax.Array, wanted: jax.Array) -> windowed.WindowedRoute:
    asked = windowed.MapAndEnds.of(volumes, ends, jnp.zeros(3))
    return windowed.route_in_windows(asked, wanted, DISTANCES, GRID, PLANNER)


@functools.partial(jax.jit, static_argnums=3)
def alone_in_windows(
    volumes: tuple[jax.Array, jax.Array], ends: jax.Array, wanted: jax.Array, sizes: int
) -> windowed.WindowedRoute:
    """Traced anew for each number of sizes."""
    return sought(volumes, ends, wanted)


@functools.partial(jax.jit, static_argnums=3)
def together_in_windows(
    volumes: tuple[jax.Array, jax.Array], ends: jax.Array, wanted: jax.Array, sizes: int
) -> windowed.WindowedRoute:
    return jax.vmap(sought, (None, 0, 0))(volumes, ends, wanted)


in_the_whole = jax.jit(functools.partial(find_route, distances=DISTANCES, planner=PLANNER))


def test_routes_in_windows_are_those_of_whole_maps(small_windows: int) -> None:
    """By night alone as well; by day flights with fields plan so (sim/test_flight.py)."""
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
    assert len(both) == COUNT
    volumes = jnp.asarray(occupied), jnp.asarray(ground)
    wanted = jnp.ones(len(both), bool).at[0].set(False)
    together = together_in_windows(volumes, both, wanted, small_windows)
    where = VoxelMap.on(GRID, occupied, ground)
    numbers = []
    for k, pair in enumerate(both):
        if not wanted[k]:
            continue
        _, expected = in_the_whole(where, pair)
        found_at_k = [jax.tree.map(lambda x, k=k: x[k], together)]
        if small_windows > 1:
            found_at_k.append(alone_in_windows(volumes, pair, jnp.array(True), small_windows))
        for found in found_at_k:
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


def test_what_lies_around_the_start_is_what_the_whole_map_blocks(small_windows: int) -> None:
    rng = np.random.default_rng(5)
    occupied, ground = blocks(rng)
    ends = jnp.array([[4.0, 4.0, 4.0], [14.0, 9.0, 6.0]])
    occupied[2:7, 2:7, 3:6] = False
    several = jnp.stack([ends] * COUNT), jnp.ones(COUNT, bool)
    volumes = jnp.asarray(occupied), jnp.asarray(ground)
    found = jax.tree.map(lambda x: x[0], together_in_windows(volumes, *several, small_windows))
    problem, _ = in_the_whole(VoxelMap.on(GRID, occupied, ground), ends)
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
