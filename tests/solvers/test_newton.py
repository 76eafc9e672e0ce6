"""Newton cycles on log φ against SciPy's elimination in float64; their count, positivity, and mazes."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Grid, Potential, Status, conductivity, solve_potential
from maxjax.compile.lowering import lowering_for
from maxjax.solvers.aggregation import pad_to_aggregates
from maxjax.solvers.cg import screening_length_for
from maxjax.solvers.medium import Progress, medium_of, no_progress
from maxjax.solvers.newton import newton_cycles
from maxjax.solvers.screened import TOLERANCES, Screened, guess
from tests.references import component_of, direct_potential, random_blocks, random_free, serpentine

Scene = tuple[np.ndarray, np.ndarray]


def conducting(blocked: np.ndarray, goal: np.ndarray) -> np.ndarray:
    grid = Grid(blocked.shape)  # type: ignore[arg-type]
    return np.asarray(conductivity(jnp.asarray(blocked), jnp.asarray(goal, jnp.int32), grid))


def scene(seed: int, shape: tuple[int, int, int], doors: bool = True) -> Scene:
    """Conductivity and goal: random boxes and a pocket; plates one voxel thick, each with one door of one voxel."""
    rng = np.random.default_rng(seed)
    blocked = random_blocks(rng, shape, int(np.prod(shape)) // 300, max(2, min(shape) // 3))
    for axis in range(3):
        if shape[axis] < 6 or not doors:
            continue
        hole = rng.integers(0, shape)
        hole[axis] = rng.integers(2, shape[axis] - 2)
        plate: list[int | slice] = [slice(None)] * 3
        plate[axis] = int(hole[axis])
        blocked[tuple(plate)] = True
        blocked[tuple(hole)] = False
    if min(shape) >= 6:
        blocked[:3, :3, :3] = True
        blocked[1, 1, 1] = False
    # In the largest component, so that there is something to solve.
    free = random_free(rng, blocked, 20)
    goal = max(free, key=lambda voxel: component_of(~blocked, tuple(voxel)).sum()).astype(np.int32)
    return conducting(blocked, goal), goal


@jax.jit
def start(sigma: jax.Array, goal: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Screening length and guess, as `solve_potential` begins."""
    medium = medium_of(sigma, goal)
    length = screening_length_for(medium.distance).astype(sigma.dtype)
    return length, guess(medium, no_progress(medium, length)).log_phi


@functools.partial(jax.jit, static_argnames=("tolerance", "most"))
def solve(
    sigma: jax.Array,
    goal: jax.Array,
    length: jax.Array,
    log_phi: jax.Array,
    *,
    tolerance: float = TOLERANCES[4],
    most: int = 60,
) -> Progress:
    medium = Screened().prepared(medium_of(sigma, goal))
    progress = dataclasses.replace(no_progress(medium, length), log_phi=pad_to_aggregates(log_phi))
    return newton_cycles(medium, progress, tolerance=tolerance, most=most)


def cut(log_phi: jax.Array, sigma: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """φ without the padding, where nothing may be."""
    inside = tuple(slice(n) for n in sigma.shape)
    rest = np.array(log_phi)
    rest[inside] = 0
    assert not rest.any()
    return np.where(component_of(sigma > 0, tuple(goal)), np.exp(np.asarray(log_phi)[inside]), 0)


@pytest.mark.parametrize("seed", range(4))
def test_cycles_equal_elimination_in_float64(seed: int) -> None:
    sigma, goal = scene(seed, (17, 18, 20))
    with jax.enable_x64(True):
        given = jnp.asarray(sigma, jnp.float64), jnp.asarray(goal)
        length, guess = start(*given)
        found = solve(*given, length, guess, tolerance=1e-10)
        phi = cut(found.log_phi, sigma, goal)
    assert found.converged
    assert float(found.residual) <= 1e-10
    expected = direct_potential(sigma, tuple(goal), float(length) ** -2)
    np.testing.assert_allclose(phi, expected, rtol=1e-8)


@pytest.mark.parametrize("seed", range(2))
def test_the_solution_is_a_fixed_point(seed: int) -> None:
    sigma, goal = scene(seed, (17, 18, 20))
    exact = direct_potential(sigma, tuple(goal), 2.0**-2)
    with jax.enable_x64(True):
        given = jnp.asarray(sigma, jnp.float64), jnp.asarray(goal)
        log_phi = jnp.log(jnp.where(exact > 0, exact, 1))
        found = solve(*given, jnp.asarray(2.0), log_phi, tolerance=1e-10)
        phi = cut(found.log_phi, sigma, goal)
    assert found.iterations == 1
    assert float(found.residual) < 1e-12
    np.testing.assert_allclose(phi, exact, rtol=1e-10)


def refined(seed: int, edge: int) -> Scene:
    """The same random boxes in the unit cube, on voxels of 1/edge."""
    rng = np.random.default_rng(seed)
    blocked = np.zeros((edge,) * 3, bool)
    for _ in range(60):
        corner, size = rng.uniform(0, 1, 3), rng.uniform(0.03, 0.25, 3)
        low, high = np.round(edge * corner).astype(int), np.round(edge * (corner + size)).astype(int)
        blocked[tuple(map(slice, low, high))] = True
    goal = np.argwhere(~blocked)
    goal = goal[np.argmin(np.linalg.norm(goal / edge - 0.3, axis=1))].astype(np.int32)
    return conducting(blocked, goal), goal


@pytest.mark.parametrize(("seed", "edge"), [pytest.param(0, 101, marks=pytest.mark.nightly), (1, 65)])
def test_cycles_do_not_grow_with_size(seed: int, edge: int) -> None:
    cycles = []
    for n in (33, edge):
        sigma, goal = refined(seed, n)
        found = solve(sigma, goal, *start(sigma, goal))
        assert found.converged
        cycles.append(int(found.iterations))
    assert cycles[1] <= cycles[0] + 2


@pytest.mark.parametrize("shape", [(7, 60, 9), (40, 1, 1), (33, 65, 20)])
def test_anisotropic_and_odd_shapes_converge(shape: tuple[int, int, int]) -> None:
    flat = np.ones(shape, np.float32), np.zeros(3, np.int32)
    sigma, goal = scene(5, shape, doors=False) if min(shape) > 1 else flat
    with jax.enable_x64(True):
        given = jnp.asarray(sigma, jnp.float64), jnp.asarray(goal)
        length, guess = start(*given)
        found = solve(*given, length, guess, tolerance=1e-9)
        phi = cut(found.log_phi, sigma, goal)
    assert found.converged
    if sigma.size < 20_000:  # elimination fills in
        expected = direct_potential(sigma, tuple(goal), float(length) ** -2)
        np.testing.assert_allclose(phi, expected, rtol=1e-7)


@pytest.mark.parametrize("seed", [1, 11])
def test_doors_of_one_voxel_are_passed(seed: int) -> None:
    sigma, goal = scene(seed, (33, 33, 33))
    potential = jax.jit(lambda s, g: solve_potential(s, g, solver=Screened(tolerance=1e-4)))(sigma, goal)
    assert potential.status == Status.OK
    expected = direct_potential(sigma, tuple(goal), float(potential.screening_length) ** -2)
    np.testing.assert_allclose(potential.phi, expected, rtol=1e-2)


@pytest.mark.parametrize("shape", [(1, 1, 1), (6, 5, 4)])
def test_a_grid_too_small_to_be_halved_is_solved(shape: tuple[int, int, int]) -> None:
    sigma, goal = np.ones(shape, np.float32), np.zeros(3, np.int32)
    found = solve(sigma, goal, *start(sigma, goal))
    assert found.converged


@pytest.mark.parametrize("seed", range(3))
def test_phi_is_positive_on_the_component_and_zero_elsewhere_after_every_cycle(seed: int) -> None:
    sigma, goal = scene(seed, (17, 18, 20))
    joined = component_of(sigma > 0, tuple(goal))
    length, log_phi = start(sigma, goal)
    for _ in range(8):
        found = solve(sigma, goal, length, log_phi, tolerance=0.0, most=1)
        assert found.iterations == 1
        assert not found.converged
        log_phi, phi = found.log_phi[tuple(map(slice, sigma.shape))], cut(found.log_phi, sigma, goal)
        assert np.isfinite(log_phi).all()
        assert (phi[joined] > 0).all()
        assert (phi[~joined] == 0).all()
        assert phi[tuple(goal)] == pytest.approx(1, rel=1e-5)


# Mazes


def check_certified(potential: Potential, sigma: np.ndarray, goal: np.ndarray) -> None:
    """By brute force: every voxel of the goal's component but the goal has a higher neighbour."""
    assert potential.status == Status.OK, Status(int(potential.status))
    phi = np.asarray(potential.log_phi)
    joined = component_of(sigma > 0, tuple(goal))
    around = np.pad(phi, 1, constant_values=-np.inf)
    core = (slice(1, -1),) * 3
    best = np.max([np.roll(around, s, axis)[core] for axis in range(3) for s in (1, -1)], axis=0)
    stuck = joined & (best <= phi)
    stuck[tuple(goal)] = False
    assert not stuck.any()
    assert np.isfinite(phi[joined]).all()


@pytest.mark.parametrize("height", [3])
def test_a_serpentine_of_five_thousand_voxels_is_certified(height: int) -> None:
    blocked = serpentine(101, 101, height)
    goal = np.zeros(3, np.int32)
    sigma = conducting(blocked, goal)
    assert (~blocked).sum() // height >= 5000
    potential = jax.jit(solve_potential)(sigma, goal)
    check_certified(potential, sigma, goal)


def snake(edge: int, pitch: int) -> tuple[np.ndarray, int]:
    """A corridor one voxel wide that folds along y, and its layers along z: (blocked, voxels from end to end)."""
    corners = [np.zeros(3, int)]
    rows = list(range(0, edge, pitch))
    far = 0
    for layer, z in enumerate(rows):
        for y in rows if layer % 2 == 0 else rows[::-1]:
            corners += [np.array([far, y, z])]
            far = edge - 1 - far
            corners += [np.array([far, y, z])]
    blocked = np.ones((edge,) * 3, bool)
    for a, b in itertools.pairwise(corners):
        low, high = np.minimum(a, b), np.maximum(a, b) + 1
        blocked[tuple(map(slice, low, high))] = False
    return blocked, int((~blocked).sum())


@pytest.mark.full_speed
@pytest.mark.parametrize("pitch", [25])
def test_a_folded_snake_through_the_whole_grid_is_certified(pitch: int) -> None:
    """Three thousand voxels from end to end."""
    blocked, voxels = snake(101, pitch)
    assert voxels >= 3000
    goal = np.zeros(3, np.int32)
    sigma = conducting(blocked, goal)
    potential = jax.jit(solve_potential)(sigma, goal)
    check_certified(potential, sigma, goal)


@pytest.mark.parametrize("shape", [(7, 6, 5), pytest.param((24, 17, 20), marks=pytest.mark.nightly)])
def test_accelerators_find_the_same_field(shape: tuple[int, int, int]) -> None:
    sigma, goal = (jnp.asarray(given) for given in scene(3, shape, doors=False))
    here = solve_potential(sigma, goal)
    with lowering_for("gpu"):
        there = solve_potential(sigma, goal)
    assert int(there.iterations) == int(here.iterations)
    assert here.certified
    assert there.certified
    np.testing.assert_array_equal(there.phi > 0, here.phi > 0)
    np.testing.assert_allclose(there.phi, here.phi, rtol=1e-4)


@pytest.mark.parametrize("edge", [17, pytest.param(33, marks=pytest.mark.nightly)])
def test_a_batch_answers_each_scene_as_it_is_answered_alone(edge: int) -> None:
    """Cycles that stall, a corridor, and a goal in a wall; alone, and all of them at once."""
    easy, goal = scene(3, (edge,) * 3, doors=False)
    doors, beyond = scene(1, (edge,) * 3)
    corridor, corner = np.zeros((edge,) * 3, np.float32), np.zeros(3, np.int32)
    corridor[: edge - 2, : edge - 1, :1] = conducting(serpentine(edge - 2, edge - 1, 1), corner)
    walled = easy.copy()
    walled[0, 0, 0] = 0
    sigma = jnp.asarray(np.stack([easy, doors, corridor, walled]))
    goals = jnp.asarray(np.array([goal, beyond, corner, corner], np.int32))
    # A tolerance that no other test uses: programs traced with other constants are kept.
    solve = functools.partial(solve_potential, solver=Screened(tolerance=1.01e-4))

    here = [solve(*given) for given in zip(sigma, goals, strict=True)]
    assert [int(one.status) for one in here] == [Status.OK, Status.OK, Status.OK, Status.GOAL_OCCUPIED]
    with lowering_for("gpu"):
        together = jax.jit(jax.vmap(solve))(sigma, goals)
        alone = [solve(*given) for given in zip(sigma, goals, strict=True)]
    for k, one in enumerate(here):
        for other in (alone[k], jax.tree.map(lambda x, k=k: x[k], together)):
            assert other.status == one.status
            assert other.screening_length == one.screening_length
            np.testing.assert_allclose(other.phi, one.phi, rtol=1e-2, atol=1e-37)
