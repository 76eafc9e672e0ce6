"""An end is exempt only where it stands too near, only as far as its own surroundings ask: by labels of SciPy."""

from __future__ import annotations

import functools
import itertools
import math

import jax
import numpy as np
import pytest
from scipy import ndimage

from maxjax import Grid, Price, Status
from maxjax.planning.problem.exemptions import last_level
from maxjax.planning.problem.problem import Problem, formulate, largest_joining_radius
from maxjax.planning.problem.surroundings import halo_of
from maxjax.planning.problem.task import Distances
from tests.references import component_of, distances_to_cubes, inflated, random_blocks, random_free

SHAPE = (12, 10, 8)
GRID, PART = Grid(SHAPE, 1.0, (0.0, 0.0, 0.0)), Grid((8, 8, 6), 1.0, (0.0, 0.0, 0.0))
FACES = ndimage.generate_binary_structure(3, 1)
# What is short of a distance by less keeps it, by more does not; in between samples do not tell [voxels].
KEEPS, SHORT = -2e-5, -3e-4


def distances(radius: float) -> Distances:
    return Distances(radius, radius, Price(height=0.0))


@functools.partial(jax.jit, static_argnums=3)
def formulated(occupied: jax.Array, ground: jax.Array, ends: jax.Array, radius: float) -> Problem:
    return formulate(occupied, ground, ends, distances(radius), GRID)


@functools.partial(jax.jit, static_argnums=3)
def formulated_all(occupied: jax.Array, ground: jax.Array, ends: jax.Array, radius: float) -> Problem:
    return jax.vmap(lambda *one: formulate(*one, distances(radius), GRID))(occupied, ground, ends)


@jax.jit
def formulated_in_part(occupied: jax.Array, ground: jax.Array, ends: jax.Array) -> Problem:
    """Of maps that are seen as far around the part as they count."""
    return formulate(occupied, ground, ends, distances(1.0), PART)


@functools.partial(jax.jit, static_argnums=3)
def largest(occupied: jax.Array, ground: jax.Array, ends: jax.Array, radius: float) -> jax.Array:
    return largest_joining_radius(occupied, ground, ends, distances(radius), GRID)


def scene(rng: np.random.Generator, off: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Occupied voxels, the ground among them, and two ends in others, moved by so much off their centres."""
    occupied = random_blocks(rng, SHAPE, int(rng.integers(3, 9)), 3)
    ground = np.zeros(SHAPE, bool)
    if rng.random() < 0.5:
        ground[:, :, 0] = True
    ends = random_free(rng, occupied | ground, 2) + rng.uniform(-off, off, (2, 3))
    return occupied | ground, ground, ends.astype(np.float32)


Steps = list[tuple[int, ...]]


def first_steps(end: np.ndarray, obstacles: np.ndarray, closed: np.ndarray, kept: float) -> Steps | None:
    """Voxels around an end to whose centres the straight way keeps a distance and touches nothing that is closed."""
    steps = []
    for offset in itertools.product((-1, 0, 1), repeat=3):
        target = np.floor(end + 0.5).astype(int) + offset
        if (target < 0).any() or (target >= SHAPE).any():
            continue
        way = end + np.linspace(0, 1, 400)[:, None] * (target - end)
        least, touch = distances_to_cubes(way, obstacles).min() - kept, distances_to_cubes(way, closed).min()
        if SHORT < least < KEEPS or 0 < touch < -SHORT:
            return None
        if least >= KEEPS and touch > 0:
            steps.append(tuple(target.tolist()))
    return steps


Rule = tuple[bool, int, np.ndarray]


def expected(occupied: np.ndarray, ground: np.ndarray, end: np.ndarray, radius: float) -> Rule | None:
    """Whether an end is exempt, the level (−1: it cannot be left), and the voxels opened; None: samples do not tell."""
    obstacles, end = occupied & ~ground, end.astype(np.float64)
    own = distances_to_cubes(end[None], obstacles)[0]
    beside = ndimage.binary_dilation(ground, FACES) & ~occupied
    at_ground = distances_to_cubes(end[None], beside)[0]
    if SHORT < own - radius < KEEPS or 0 < at_ground < -SHORT:
        return None
    needed, kept = bool(own - radius < KEEPS or at_ground == 0), min(radius, own)
    steps = first_steps(end, obstacles, ground if at_ground == 0 else ground | beside, kept)
    if steps is None:
        return None
    centres = np.moveaxis(np.indices(SHAPE), 0, -1).reshape(-1, 3)
    far = distances_to_cubes(centres, obstacles).reshape(SHAPE)
    if ((far - kept > SHORT) & (far - kept < KEEPS)).any():
        return None
    free = ~inflated(obstacles, ground, radius)
    open_to_end = ~free & ~occupied & (far - kept >= KEEPS) & ((at_ground == 0) | ~beside) & needed
    away = ((centres - np.floor(end + 0.5)) ** 2).sum(axis=1).reshape(SHAPE)
    chosen = sorted(steps, key=lambda v: ((np.array(v) - end) ** 2).sum())
    for level in range(last_level(radius) + 1):
        opened = open_to_end & (away < level**2)
        labels, _ = ndimage.label(opened, FACES)
        for step in chosen:
            if free[step]:
                return needed, level, np.zeros(SHAPE, bool)
            own_part = (labels == labels[step]) & opened[step]
            if (ndimage.binary_dilation(own_part, FACES) & free).any():
                return needed, level, own_part
    return needed, -1, np.zeros(SHAPE, bool)


@pytest.mark.parametrize("radius", [1.0, *(pytest.param(r, marks=pytest.mark.nightly) for r in (0.5, 1.6))])
def test_exemptions_are_those_of_the_rule(radius: float) -> None:
    rng, seen = np.random.default_rng(3), []
    scenes = [scene(rng, 0.45 * (k % 3 > 0)) for k in range(60)]
    for occupied, ground, ends in scenes:
        rules = [expected(occupied, ground, end, radius) for end in ends]
        found = formulated(occupied, ground, ends, radius)
        if None in rules or found.status not in (Status.OK, Status.NO_SAFE_PATH, Status.NO_VALID_PATH):
            continue
        free = ~inflated(occupied & ~ground, ground, radius)
        for end, rule in enumerate(rules):
            assert rule is not None
            needed, level, opened = rule
            free |= opened
            assert int(found.levels[end]) == max(level, 0)
            assert (float(found.exemptions[end]) > 0) <= needed
            seen.append((needed, level))
        np.testing.assert_array_equal(~np.asarray(found.blocked), free)
        leaves = all(rule is not None and rule[1] >= 0 for rule in rules)
        # From where a path has room.
        start, goal = (tuple(np.floor(np.asarray(x) + 0.5).astype(int)) for x in (found.start, found.goal))
        joined, bare = component_of(free, start)[goal], component_of(~occupied, start)[goal]
        status = Status.OK if joined and leaves else Status.NO_SAFE_PATH if bare else Status.NO_VALID_PATH
        assert found.status == status
    assert len(seen) > 100
    assert {(False, 0), (True, 0)} <= set(seen)
    assert any(level > 1 for _, level in seen) or radius < 1


@pytest.mark.parametrize("count", [1000, pytest.param(10_000, marks=pytest.mark.nightly)])
def test_doors_narrower_than_the_radius_join_nothing(count: int) -> None:
    """Walls with a door of 1 to 3 voxels and blocks beside it; a radius of one voxel needs three."""
    rng, radius, part = np.random.default_rng(11), 1.0, count // 4
    occupied = np.zeros((count, *SHAPE), bool)
    for k in range(count):
        at, thick = rng.integers(4, 7), rng.integers(1, 3)
        occupied[k, at : at + thick] = True
        (y, z), (height, width) = rng.integers(0, (8, 6)), rng.integers(1, 4, 2)
        occupied[k, at : at + thick, y : y + width, z : z + height] = False
        x, y, z = rng.integers(0, np.array(SHAPE) - 1)
        occupied[k, x : x + 2, y : y + 2, z : z + 2] |= rng.random() < 0.7
    nothing = np.zeros_like(occupied)
    free = ~inflated(occupied, nothing, radius)
    ends = rng.integers(0, (4, *SHAPE[1:]), (count, 2, 3)) + np.array([[0, 0, 0], [8, 0, 0]])
    row = np.arange(count)
    kept, held = (np.stack([volume[row, *ends[:, end].T] for end in range(2)], axis=1) for volume in (free, occupied))
    parts = [slice(k, k + part) for k in range(0, count, part)]
    found = [formulated_all(occupied[p], nothing[p], ends[p].astype(np.float32), radius) for p in parts]
    status = np.concatenate([np.asarray(one.status) for one in found])
    exemptions = np.concatenate([np.asarray(one.exemptions) for one in found])

    structure = np.zeros((3, *FACES.shape), bool)
    structure[1] = FACES
    (labels, _), (bare, _) = (ndimage.label(volume, structure) for volume in (free, ~occupied))
    (a, b), (c, d) = ([volume[row, *ends[:, end].T] for end in range(2)] for volume in (labels, bare))
    sound = kept.all(axis=1)
    assert sound.sum() > 0.3 * count
    expected = np.where(a == b, Status.OK, np.where(c == d, Status.NO_SAFE_PATH, Status.NO_VALID_PATH))
    np.testing.assert_array_equal(status[sound], expected[sound])
    assert {Status.OK, Status.NO_SAFE_PATH} <= set(status[sound].tolist())
    # Ends whose centres keep the radius have no exemption; the others have one that depends on themselves alone.
    np.testing.assert_array_equal(exemptions[kept], 0.0)
    # Many at a time are each by itself.
    for k in range(0, part, part // 5):
        alone = formulated(occupied[k], nothing[k], ends[k].astype(np.float32), radius)
        for one, many in zip(jax.tree.leaves(alone), jax.tree.leaves(found[0]), strict=True):
            np.testing.assert_array_equal(one, many[k])
    assert (status[held.any(axis=1)] >= Status.START_OCCUPIED).all()


def test_an_exemption_does_not_depend_on_the_other_end() -> None:
    rng = np.random.default_rng(7)
    for _ in range(10):
        occupied, ground, ends = scene(rng, 0.4)
        others = [random_free(rng, occupied, 1).astype(np.float32)[0] for _ in range(4)]
        found = [formulated(occupied, ground, np.stack([ends[0], other]), 1.0) for other in others]
        assert len({int(one.levels[0]) for one in found}) == 1
        swapped = formulated(occupied, ground, np.stack([others[0], ends[0]]), 1.0)
        assert int(swapped.levels[1]) == int(found[0].levels[0])
        np.testing.assert_array_equal(swapped.blocked, found[0].blocked)


def test_at_radius_0_nothing_is_opened() -> None:
    rng = np.random.default_rng(5)
    for _ in range(10):
        occupied, ground, ends = scene(rng, 0.45)
        found = formulated(occupied, ground, ends, 0.0)
        np.testing.assert_array_equal(found.blocked, occupied)
        assert found.levels.tolist() == [0, 0]
        assert found.exemptions.tolist() == [0.0, 0.0]
        a, b = (tuple(v) for v in np.floor(ends + 0.5).astype(int).tolist())
        assert found.status == (Status.OK if component_of(~occupied, a)[b] else Status.NO_VALID_PATH)


def test_a_part_of_a_map_says_what_the_whole_map_does_or_nothing() -> None:
    rng, radius, corner, seen = np.random.default_rng(9), 1.0, np.array([2, 1, 1]), []
    halo = halo_of(distances(radius), PART)
    for _ in range(60):
        occupied, ground, _ = scene(rng)
        inner = tuple(slice(c, c + n) for c, n in zip(corner, PART.shape, strict=True))
        ends = (random_free(rng, occupied[inner], 2) + rng.uniform(-0.4, 0.4, (2, 3))).astype(np.float32)
        around = [
            np.pad(volume, halo)[tuple(slice(c, c + n + 2 * halo) for c, n in zip(corner, PART.shape, strict=True))]
            for volume in (occupied, ground)
        ]
        found, whole = (
            formulated_in_part(*around, ends),
            formulated(occupied, ground, ends + corner.astype(np.float32), radius),
        )
        seen.append(int(found.status))
        if found.status == Status.OK:
            assert whole.status == Status.OK
            np.testing.assert_array_equal(found.levels, whole.levels)
            np.testing.assert_allclose(found.exemptions, whole.exemptions, atol=1e-5)
            np.testing.assert_array_equal(found.blocked, np.asarray(whole.blocked)[inner])
    assert 20 < seen.count(Status.OK) < 60


def test_a_part_that_begins_above_the_ground_knows_how_its_ends_leave_it() -> None:
    """As windows of cities do: what is closed below them makes no exemption smaller."""
    halo = halo_of(distances(1.0), PART)
    ground = np.zeros([n + 2 * halo for n in PART.shape], bool)
    ground[:, :, :halo] = True
    for height in (-0.45, 0.0, 0.4):
        ends = np.array([[3.2, 3.3, height], [5.0, 5.0, 2.0]], np.float32)
        found = formulated_in_part(ground, ground, ends)
        assert found.status == Status.OK
        assert found.exemptions[0] > 0
        assert found.exemptions[1] == 0
        hole = ground.copy()
        hole[halo + 4, halo + 3, :halo] = False
        assert formulated_in_part(hole, hole, ends).status == Status.NO_VALID_PATH


def test_the_largest_radius_is_that_of_the_door() -> None:
    """A door of one voxel, one of 2 x 2, and one of 3 x 3 without and with its corners, in a wall; 1.6 is asked for."""
    ends, frame = np.array([[1, 4, 4], [10, 4, 4]], np.float32), np.ones((3, 3), bool)
    ground = np.zeros(SHAPE, bool)
    cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)
    for door, expected in ((frame[:1, :1], 0.5), (frame[:2, :2], 0.5), (cross, math.sqrt(0.5)), (frame, 1.5)):
        occupied = np.zeros(SHAPE, bool)
        occupied[5:7] = True
        occupied[5:7, 3 : 3 + len(door), 3 : 3 + len(door)] = ~door
        assert formulated(occupied, ground, ends, 1.6).status == Status.NO_SAFE_PATH
        assert float(largest(occupied, ground, ends, 1.6)) == pytest.approx(expected)


def test_the_largest_radius_joins_when_it_is_asked_for() -> None:
    """By planning with it; ends anywhere, off their centres, many of them exempt."""
    rng, found, of_centres = np.random.default_rng(12), [], [math.sqrt(q) / 2 for q in (1, 2, 3, 9, 10, 11)]
    for _ in range(60):
        occupied, ground, ends = scene(rng, 0.4)
        occupied[5, :, :] |= rng.random(SHAPE[1:]) < 0.8
        ends[0, 0], ends[1, 0] = rng.uniform(0, 4), rng.uniform(6, 11)
        if formulated(occupied, ground, ends, 1.6).status != Status.NO_SAFE_PATH:
            continue
        named = float(largest(occupied, ground, ends, 1.6))
        found.append(named)
        if named > 0:
            assert min(abs(named - r) for r in of_centres) < 1e-6
            exact = min(of_centres, key=lambda r: abs(named - r))
            assert formulated(occupied, ground, ends, exact).status == Status.OK
    assert len(found) > 5
    assert max(found) > 0
