"""On a certified field the ascent arrives, through free voxels only, and enters no voxel twice."""

from __future__ import annotations

import dataclasses
import functools
import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Grid, VoxelMap, verify
from maxjax.planning.path.ascent import Ascent, ascend
from maxjax.planning.path.line_of_sight import sight_of
from tests.references import component_of, direct_potential, keeps, random_blocks, random_free, serpentine

SHAPE = (16, 18, 20)
SETTINGS = {
    "momentum": Ascent(steps=1500),
    "smoothed": Ascent(smoothing=5.0, steps=1500),
    "adam": Ascent("adam", steps=1500),
    "fast": Ascent(rate=1.0, steps=1500),
}


@functools.partial(jax.jit, static_argnames=("settings", "room"))
def climb(
    phi: jax.Array, blocked: jax.Array, starts: jax.Array, goal: jax.Array, settings: Ascent, room: float = 0.0
) -> tuple[jax.Array, jax.Array]:
    sight = sight_of(blocked, room)
    return jax.vmap(lambda start: ascend(jnp.log(phi), sight, ~blocked, start, goal, settings))(starts)


def field(blocked: np.ndarray, goal: np.ndarray, length: float = 2.0) -> np.ndarray:
    """By elimination in float64: certified, and no work of the solver that the package has."""
    return direct_potential((~blocked).astype(float), tuple(goal), length**-2).astype(np.float32)


def check(blocked: np.ndarray, path: np.ndarray, start: np.ndarray, goal: np.ndarray) -> None:
    np.testing.assert_array_equal(path[0], start)
    np.testing.assert_array_equal(path[-1], goal)
    verdict = verify(path, VoxelMap.on(Grid(blocked.shape, 1.0, (0.0, 0.0, 0.0)), blocked))  # type: ignore[arg-type]
    assert verdict.ok, verdict
    voxels = np.floor(path + 0.5).astype(int)
    entered = np.concatenate([[True], (np.diff(voxels, axis=0) != 0).any(axis=1)])
    visits = voxels[entered]
    assert len(np.unique(visits, axis=0)) == len(visits)
    assert np.abs(np.diff(path, axis=0)).max() <= 3


@pytest.mark.large
@pytest.mark.parametrize("name", list(SETTINGS))
def test_arrives_on_every_random_scene(name: str) -> None:
    rng = np.random.default_rng(1)
    for count in (0, 15, 40, 80):
        blocked = random_blocks(rng, SHAPE, count, 6)
        goal = random_free(rng, blocked, 1)[0]
        joined = np.argwhere(component_of(~blocked, tuple(goal)))
        starts = joined[rng.integers(len(joined), size=12)].astype(np.float32)
        # Off the centres too, where the neighbours are free.
        starts[::2] += np.float32(rng.uniform(-0.45, 0.45, starts[::2].shape))
        target = np.float32(goal + rng.uniform(-0.45, 0.45, 3))
        paths, arrived = climb(field(blocked, goal), blocked, starts, target, SETTINGS[name])
        assert arrived.all()
        for start, path in zip(starts, np.asarray(paths), strict=True):
            check(blocked, path, start, target)


@pytest.mark.large
def test_with_room_it_arrives_on_every_scene_and_keeps_half_a_voxel() -> None:
    rng = np.random.default_rng(2)
    for count in (15, 40, 80):
        blocked = random_blocks(rng, SHAPE, count, 6)
        goal = random_free(rng, blocked, 1)[0].astype(np.float32)
        joined = np.argwhere(component_of(~blocked, tuple(goal.astype(int))))
        starts = joined[rng.integers(len(joined), size=12)].astype(np.float32)
        # Off the centres, where that keeps the room.
        moved = starts + np.float32(rng.uniform(-0.9, 0.9, starts.shape))
        legal = np.array([keeps(np.stack([x, x]), blocked, 0.5) for x in moved])
        starts = np.where(legal[:, None], moved, starts)
        paths, arrived = climb(field(blocked, goal.astype(int)), blocked, starts, goal, SETTINGS["smoothed"], 0.5)
        assert arrived.all()
        for start, path in zip(starts, np.asarray(paths), strict=True):
            check(blocked, path, start, goal)
            assert keeps(path, blocked, 0.5 - 1e-3)


@pytest.mark.large
@pytest.mark.parametrize(
    "name", ["momentum", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("smoothed", "adam"))]
)
def test_arrives_through_a_corridor_one_voxel_wide(name: str) -> None:
    blocked = np.ones(SHAPE, bool)
    blocked[:, :, 4:7:2] = serpentine(16, 18, 2)
    blocked[14, 9, 5] = False  # up from one floor of the maze to the other
    goal, starts = np.array([0, 0, 4]), np.array([[0, 0, 6], [8, 3, 6], [14, 17, 4]], np.float32)
    phi = field(blocked, goal, 12.0)
    assert phi[0, 0, 6] > 0
    # 14 steps a voxel at most: what the patience allows, and two for the discrete step.
    patient = dataclasses.replace(SETTINGS[name], steps=14 * int((~blocked).sum()))
    for room in (0.0, 0.5) if name == "momentum" else (0.0,):
        paths, arrived = climb(phi, blocked, np.repeat(starts, 4, axis=0), goal.astype(np.float32), patient, room)
        assert arrived.all()
        for start, path in zip(np.repeat(starts, 4, axis=0), np.asarray(paths), strict=True):
            check(blocked, path, start, goal)
            assert keeps(path, blocked, room and room - 1e-3)


def test_straight_through_open_space() -> None:
    start, goal = np.array([[1, 2, 3]] * 12, np.float32), np.array([13, 14, 15], np.float32)
    paths, _ = climb(
        field(np.zeros(SHAPE, bool), goal.astype(int)), np.zeros(SHAPE, bool), start, goal, Ascent(steps=1500)
    )
    length = np.linalg.norm(np.diff(np.asarray(paths[0]), axis=0), axis=1).sum()
    assert length < 1.03 * np.linalg.norm(goal - start[0])


def test_too_few_steps_and_a_field_without_way_do_not_arrive() -> None:
    blocked = np.zeros(SHAPE, bool)
    blocked[8] = True
    goal = np.array([12, 9, 9], np.float32)
    starts = np.array([[2, 2, 2]] * 6 + [[12, 2, 2]] * 6, np.float32)
    paths, arrived = climb(field(blocked, goal.astype(int)), blocked, starts, goal, Ascent(steps=1500))
    assert arrived.tolist() == [False] * 6 + [True] * 6
    assert (np.asarray(paths[0])[:, 0] < 7.5).all()  # it stays on its side
    _, arrived = climb(field(blocked, goal.astype(int)), blocked, starts, goal, Ascent(steps=3))
    assert not arrived.any()


def test_starting_at_the_goal_stays_there() -> None:
    goal = np.array([5, 6, 7], np.float32)
    paths, arrived = climb(
        field(np.zeros(SHAPE, bool), goal.astype(int)),
        np.zeros(SHAPE, bool),
        goal[None].repeat(12, 0),
        goal,
        Ascent(steps=1500),
    )
    assert arrived.all()
    assert (np.asarray(paths) == goal).all()


def test_bad_settings_are_told_with_what_was_given() -> None:
    # As users build them: without the run-time type checks of the tests.
    def build(**changes: object) -> None:
        settings = object.__new__(Ascent)
        for name, value in {**vars(Ascent()), **changes}.items():
            object.__setattr__(settings, name, value)
        inspect.unwrap(Ascent.__post_init__)(settings)

    build()
    with pytest.raises(ValueError, match="expected 'momentum' or 'adam', given 'newton'"):
        build(rule="newton")
    for change in ({"rate": 0.0}, {"rate": 1.1}, {"momentum": 1.0}, {"smoothing": -1.0}, {"steps": 0}):
        with pytest.raises(ValueError, match="Ascent: expected 0 < rate"):
            build(**change)
