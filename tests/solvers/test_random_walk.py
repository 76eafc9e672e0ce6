"""The linearised equation of log φ against sparse elimination in float64, however far the goal is."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage, sparse
from scipy.sparse.linalg import splu, spsolve

from maxjax import solve_potential
from maxjax.fields.price import SCREENING_LENGTH
from maxjax.solvers import random_walk as module
from maxjax.solvers.medium import medium_of, pad_medium
from maxjax.solvers.random_walk import RandomWalk, random_walk
from tests.references import component_of, conduction_matrix, direct_potential, random_blocks, serpentine

Voxel = tuple[int, int, int]
LEAK = SCREENING_LENGTH**-2


@dataclasses.dataclass(frozen=True)
class Conductor:
    """A conductivity with prices, its goal, and where log φ is read."""

    sigma: np.ndarray
    price: np.ndarray
    goal: Voxel
    start: Voxel


def straight(voxels: int) -> Conductor:
    shape = (voxels + 8, 9, 9)
    return Conductor(np.ones(shape), np.ones(shape), (3, 4, 4), (3 + voxels, 4, 4))


def city() -> Conductor:
    """Towers on a square, a conductivity that varies, and a price beside walls; from corner to corner."""
    rng = np.random.default_rng(8)
    blocked = random_blocks(rng, (72, 72, 1), 60, 12).repeat(20, axis=2)
    blocked &= np.arange(20) < rng.integers(8, 21, (72, 72, 1))
    blocked[:4, :4] = blocked[-4:, -4:] = False
    near = np.clip(1 - ndimage.distance_transform_edt(~blocked) / 4, 0, None)
    sigma = np.where(blocked, 0, 10 ** rng.uniform(0, 1, blocked.shape))
    return Conductor(sigma, 1 + 4 * near**2, (1, 1, 3), (70, 70, 4))


def folded() -> Conductor:
    """A corridor one voxel wide that folds."""
    blocked = serpentine(25, 25, 2)
    return Conductor(1.0 * ~blocked, np.ones(blocked.shape), (0, 0, 0), (24, 20, 1))


SCENES = {"35 voxels": straight(35), "70 voxels": straight(70), "300 voxels": straight(300), "city": city(),
          "corridor": folded()}  # fmt: skip


def slopes_by_elimination(scene: Conductor) -> tuple[float, np.ndarray, np.ndarray]:
    """Log φ at the start, and its derivatives by log price and by log σ, from λ = A⁻¹ e / φ in float64."""
    leak = LEAK * scene.price**2
    phi = direct_potential(scene.sigma, scene.goal, leak.ravel())
    joined = component_of(scene.sigma > 0, scene.goal)
    joined[scene.goal] = False
    unknown, shape = np.flatnonzero(joined), scene.sigma.shape
    matrix = conduction_matrix(scene.sigma, leak.ravel(), False)[unknown][:, unknown].tocsc()
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    unit = np.zeros(shape)
    unit[scene.start] = 1
    adjoint = np.zeros(shape)
    adjoint.flat[unknown] = factors.solve(unit.flat[unknown])
    by_price = -2 * adjoint * leak * scene.sigma * phi / phi[scene.start]
    # A = Σ_faces w (φ_i − φ_j) (λ_i − λ_j) + Σ κ n² σ φ λ, and w = 2 σ_i σ_j / (σ_i + σ_j).
    by_sigma = by_price / 2
    for axis in range(3):
        a, b = (np.moveaxis(x, axis, 0) for x in (scene.sigma, by_sigma))
        field, weight = (np.moveaxis(x, axis, 0) for x in (phi, adjoint))
        total = np.where(a[1:] + a[:-1] > 0, a[1:] + a[:-1], 1)
        bilinear = (field[1:] - field[:-1]) * (weight[1:] - weight[:-1]) / phi[scene.start]
        both = a[1:] * a[:-1] > 0
        b[1:] -= np.where(both, 2 * (a[:-1] / total) ** 2 * a[1:] * bilinear, 0)
        b[:-1] -= np.where(both, 2 * (a[1:] / total) ** 2 * a[:-1] * bilinear, 0)
    return float(np.log(phi[scene.start])), by_price, by_sigma


# One near scene and one long way by day.
BY_NIGHT = [pytest.param(name, marks=pytest.mark.nightly) for name in ("70 voxels", "300 voxels", "city")]


@pytest.mark.parametrize("name", ["35 voxels", "corridor", *BY_NIGHT])
def test_derivatives_of_log_phi_are_those_of_float64_at_any_distance(name: str) -> None:
    scene = SCENES[name]
    expected, *slopes = slopes_by_elimination(scene)

    @jax.jit
    def read(price: jax.Array, sigma: jax.Array) -> jax.Array:
        return solve_potential(sigma, jnp.asarray(scene.goal), price).log_phi[scene.start]

    arrays = jnp.asarray(scene.price, jnp.float32), jnp.asarray(scene.sigma, jnp.float32)
    value, found = jax.value_and_grad(read, argnums=(0, 1))(*arrays)
    assert value == pytest.approx(expected, rel=1e-4)
    for slope, array, reference in zip(found, arrays, slopes, strict=True):
        logarithmic = np.asarray(slope, np.float64) * np.asarray(array, np.float64)
        assert logarithmic.sum() == pytest.approx(reference.sum(), rel=1e-3, abs=1e-3 * np.abs(reference).sum())
        assert np.abs(logarithmic - reference).sum() <= 3e-3 * np.abs(reference).sum()
        np.testing.assert_allclose(logarithmic, reference, atol=3e-3 * np.abs(reference).max())


@pytest.mark.parametrize("conducts", [1e-2, 1e-3, 1e-6])
def test_through_a_wall_that_hardly_conducts_a_derivative_is_right_or_no_number(conducts: float) -> None:
    sigma = np.ones((24, 20, 12))
    sigma[11:13] = conducts
    scene = Conductor(sigma, np.ones(sigma.shape), (18, 10, 6), (3, 10, 6))
    _, _, reference = slopes_by_elimination(scene)
    slope = jax.grad(lambda x: solve_potential(x, jnp.asarray(scene.goal)).log_phi[scene.start])(jnp.float32(sigma))
    logarithmic = np.asarray(slope) * sigma
    if conducts < 1e-3 and np.isnan(logarithmic).all():
        return
    assert np.abs(logarithmic - reference).sum() <= 3e-3 * np.abs(reference).sum()


@pytest.fixture(scope="module")
def small() -> tuple[RandomWalk, sparse.csc_array]:
    """A walk among blocks, and I − P with P's rows of the voxels where it moves."""
    rng = np.random.default_rng(3)
    blocked = random_blocks(rng, (11, 10, 9), 20, 4)
    goal = np.argwhere(~blocked)[7]
    with jax.enable_x64(True):
        sigma = jnp.asarray(np.where(blocked, 0, 10 ** rng.uniform(0, 1, blocked.shape)))
        medium = pad_medium(medium_of(sigma, jnp.asarray(goal, jnp.int32)))
        phi = direct_potential(np.asarray(medium.sigma), tuple(goal), LEAK)
        u = jnp.asarray(np.log(np.where(phi > 0, phi, 1)))
        walk = random_walk(medium, jnp.asarray(SCREENING_LENGTH), u)
    size = phi.size
    matrix = np.asarray(conduction_matrix(np.asarray(medium.sigma), LEAK, False).todense())
    links = np.where(np.eye(size) > 0, 0, -matrix) * phi.ravel()
    moves = np.asarray(walk.moving).ravel()
    rows = links / np.where(moves, links.sum(1), 1)[:, None]
    return walk, sparse.csc_array(np.eye(size) - np.where(moves[:, None] & moves, rows, 0))


def test_it_is_a_walk_and_both_of_its_systems_are_solved(small: tuple[RandomWalk, sparse.csc_array]) -> None:
    walk, matrix = small
    moves = np.asarray(walk.moving)
    right = np.where(moves, np.random.default_rng(5).normal(size=moves.shape), 0)
    with jax.enable_x64(True):
        total = sum(np.asarray(part) for pair in walk.steps for part in pair)
        np.testing.assert_allclose(total[moves], 1, rtol=1e-12)
        np.testing.assert_allclose(
            np.asarray(walk.solve(jnp.asarray(right))).ravel(), spsolve(matrix, right.ravel()), rtol=1e-9, atol=1e-9
        )
        transposed = spsolve(matrix.T.tocsc(), right.ravel())
        found = np.asarray(walk.solve_transposed(jnp.asarray(right))).ravel()
        np.testing.assert_allclose(found, transposed, rtol=1e-9, atol=1e-9)


def test_sweeps_alone_converge_and_a_cap_yields_no_number(
    small: tuple[RandomWalk, sparse.csc_array], monkeypatch: pytest.MonkeyPatch
) -> None:
    walk, matrix = small
    right = np.where(np.asarray(walk.moving), 1.0, 0.0)
    with jax.enable_x64(True):
        # Corrections that overshoot: they are left out once they make no progress.
        monkeypatch.setattr(module, "answer_on_aggregates", lambda *_: 1e3)
        monkeypatch.setattr(module, "spread", lambda delta, _: delta * walk.log_phi)
        found = np.asarray(walk.solve(jnp.asarray(right))).ravel()
        np.testing.assert_allclose(found, spsolve(matrix, right.ravel()), rtol=1e-9, atol=1e-9)
        monkeypatch.setattr(module, "_MOST", 3)
        assert np.isnan(np.asarray(walk.solve(jnp.asarray(right)))[np.asarray(walk.moving)]).all()
