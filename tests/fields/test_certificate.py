"""A certified field leads every voxel to the goal; each local maximum is counted, none is missed."""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from scipy.sparse.csgraph import dijkstra

from maxjax.fields.certificate import best_neighbour, count_uncertified
from tests.references import component_of, conduction_matrix, random_blocks, random_free

SHAPE = (9, 8, 10)
FACES = np.array([s for s in itertools.product((-1, 0, 1), repeat=3) if np.abs(s).sum() == 1])

count = jax.jit(count_uncertified)
best_of = jax.jit(best_neighbour)


def faces(voxel: np.ndarray, free: np.ndarray) -> list[tuple[int, ...]]:
    around = [tuple(v) for v in voxel + FACES if (v >= 0).all() and (v < free.shape).all()]
    return [v for v in around if free[v]]


def scene(seed: int) -> tuple[np.ndarray, np.ndarray, tuple[int, ...], np.ndarray]:
    """Free voxels, the goal's component, the goal, and a field that falls with the number of steps from the goal."""
    rng = np.random.default_rng(seed)
    blocked = random_blocks(rng, SHAPE, 25, 4)
    goal = tuple(random_free(rng, blocked, 1)[0])
    graph = abs(conduction_matrix((~blocked).astype(float), 0.0, False))
    steps = dijkstra(graph, indices=np.ravel_multi_index(goal, SHAPE), unweighted=True)
    phi = (1 / (1 + steps)).reshape(SHAPE).astype(np.float32)
    return ~blocked, component_of(~blocked, goal), goal, np.where(blocked, 0, phi)


def stuck(phi: np.ndarray, component: np.ndarray, goal: tuple[int, ...]) -> int:
    voxels = (v for v in np.argwhere(component) if tuple(v) != goal)
    return sum(not any(phi[n] > phi[tuple(v)] for n in faces(v, component)) for v in voxels)


def test_equals_brute_force_on_noise() -> None:
    for seed in range(5):
        free, component, goal, _ = scene(seed)
        # Few distinct values, so that ties, which certify nothing, are everywhere.
        phi = (np.random.default_rng(seed).integers(0, 12, SHAPE) / 12).astype(np.float32)
        assert count(phi, component, jnp.asarray(goal, jnp.int32)) == stuck(phi, component, goal) > 0
        expected = [[max((phi[n] for n in faces(v, free)), default=-np.inf)] for v in np.argwhere(np.ones(SHAPE))]
        np.testing.assert_array_equal(best_of(phi, free).ravel(), np.ravel(expected))


def test_certifies_a_field_of_distances_and_every_walk_arrives() -> None:
    for seed in range(5):
        _, component, goal, phi = scene(seed)
        assert count(phi, component, jnp.asarray(goal, jnp.int32)) == 0
        for start in np.argwhere(component)[::7]:
            here, visited = tuple(start), set()
            while here != goal:
                assert here not in visited
                visited.add(here)
                here = max(faces(np.array(here), component), key=phi.__getitem__)


def test_counts_each_planted_maximum() -> None:
    _, component, goal, phi = scene(1)
    candidates = [tuple(v) for v in np.argwhere(component) if np.abs(v - goal).sum() > 2]
    planted: list[tuple[int, ...]] = []
    for voxel in candidates:
        if all(np.abs(np.subtract(voxel, other)).sum() > 3 for other in planted):
            planted.append(voxel)
    assert len(planted) > 5
    for number, voxel in enumerate(planted, 1):
        phi[voxel] = 2.0
        assert count(phi, component, jnp.asarray(goal, jnp.int32)) == number == stuck(phi, component, goal)


def test_plateaus_and_nan_are_not_certified() -> None:
    _, component, goal, _ = scene(2)
    flat = np.where(component, np.float32(0.5), 0)
    assert count(flat, component, jnp.asarray(goal, jnp.int32)) == component.sum() - 1
    broken = np.where(component, np.float32(np.nan), 0)
    assert count(broken, component, jnp.asarray(goal, jnp.int32)) == component.sum() - 1


def test_sealed_pockets_and_walls_do_not_count() -> None:
    component = np.ones(SHAPE, bool)
    component[3:6, 3:6, 3:6] = False  # a wall, and the pocket in its middle
    goal = (0, 0, 0)
    phi = (1 / (1 + np.indices(SHAPE).sum(axis=0))).astype(np.float32)
    phi[3:6, 3:6, 3:6] = 0
    assert count(phi, component, jnp.asarray(goal, jnp.int32)) == 0
    # The pocket's field, high or flat, is nobody's neighbour.
    phi[4, 4, 4] = 7
    phi[3, 4, 4] = 7
    assert count(phi, component, jnp.asarray(goal, jnp.int32)) == 0
