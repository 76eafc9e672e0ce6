"""The potential against sparse elimination in float64; its certificate, its statuses and its derivatives."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import itertools
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Grid, Potential, Status, conductivity, solve_potential
from maxjax.fields.certificate import count_uncertified
from maxjax.fields.geodesic import geodesic
from maxjax.fields.gradient import gradient, log_potential
from maxjax.fields.price import SCREENING_LENGTH
from maxjax.solvers.certify import sweep_until_certified
from maxjax.solvers.cg import ConjugateGradients
from maxjax.solvers.geodesic_solver import distance_potential
from maxjax.solvers.medium import Solver, medium_of, no_progress
from maxjax.solvers.paper import PaperSetting
from maxjax.solvers.screened import Screened
from tests.planners import unchecked as by_itself
from tests.references import component_of, direct_potential, random_blocks, random_free, serpentine

GRID = Grid((16, 18, 20))
solve = jax.jit(solve_potential, static_argnames="solver")
Scene = tuple[np.ndarray, np.ndarray]


def paper_sigma(blocked: np.ndarray, goal: np.ndarray) -> np.ndarray:
    grid = Grid(blocked.shape)  # type: ignore[arg-type]
    return np.asarray(conductivity(jnp.asarray(blocked), jnp.asarray(goal, jnp.int32), grid))


def scene(seed: int, shape: tuple[int, int, int] = GRID.shape, count: int = 40) -> Scene:
    """Conductivity and goal among random boxes."""
    rng = np.random.default_rng(seed)
    blocked = random_blocks(rng, shape, count, 6)
    goal = random_free(rng, blocked, 1)[0].astype(np.int32)
    return paper_sigma(blocked, goal), goal


def leak_of(potential: Potential) -> float:
    return float(potential.screening_length) ** -2


def check_certificate(potential: Potential, sigma: np.ndarray, goal: np.ndarray, *, positive: bool = True) -> None:
    """By brute force: every voxel of the goal's component has a higher neighbour, and nothing else has a field."""
    phi = np.exp(np.asarray(potential.log_phi, np.float64))
    joined = component_of(sigma > 0, tuple(goal))
    assert stuck_voxels(np.asarray(potential.log_phi), joined, goal) == potential.uncertified == 0
    assert potential.status == Status.OK
    assert potential.certified
    assert phi[tuple(goal)] == pytest.approx(1, rel=1e-5)
    assert (phi[~joined] == 0).all()
    assert np.isfinite(np.asarray(potential.log_phi)[joined]).all() or not positive


def stuck_voxels(u: np.ndarray, joined: np.ndarray, goal: tuple[int, ...] | np.ndarray) -> int:
    """Voxels of the component, goal aside, without a higher neighbour in it."""
    padded = np.pad(np.where(joined, u, -np.inf), 1, constant_values=-np.inf)
    core = (slice(1, -1),) * 3
    best = np.max([np.roll(padded, s, axis)[core] for axis in range(3) for s in (1, -1)], axis=0)
    stuck = joined & (best <= u)
    stuck[tuple(goal)] = False
    return int(stuck.sum())


@pytest.mark.parametrize("seed", range(6))
def test_random_scenes_are_certified_and_equal_elimination_voxel_by_voxel(seed: int) -> None:
    sigma, goal = scene(seed, count=10 + 12 * seed)
    potential = solve(sigma, goal, solver=Screened(tolerance=1e-5))
    check_certificate(potential, sigma, goal)
    expected = direct_potential(sigma, tuple(goal), leak_of(potential))
    np.testing.assert_allclose(potential.phi, expected, rtol=1e-2)


@pytest.mark.large
@pytest.mark.parametrize("seed", range(6))
def test_directions_are_right_at_the_default_tolerance(seed: int) -> None:
    """95 % of free voxels within 1 degree of elimination, 99.9 % within 5."""
    sigma, goal = scene(seed, (40, 36, 44), count=10 + 30 * seed)
    potential = solve(sigma, goal)
    check_certificate(potential, sigma, goal)
    joined = component_of(sigma > 0, tuple(goal))
    with jax.enable_x64(True):
        exact = jax.jit(solve_potential)(
            jnp.asarray(sigma, jnp.float64), goal, screening_length=jnp.asarray(potential.screening_length, jnp.float64)
        )
        assert exact.status == Status.OK
        ours, best = (
            np.asarray(gradient(log_potential(jnp.asarray(p, jnp.float64)), jnp.asarray(joined)))[joined]
            for p in (potential.phi, exact.phi)
        )
    size = np.linalg.norm(ours, axis=1) * np.linalg.norm(best, axis=1)
    known = size > 1e-12
    cosine = np.sum(ours * best, axis=1)[known] / size[known]
    assert np.mean(cosine >= np.cos(np.radians(1))) >= 0.95
    assert np.mean(cosine >= np.cos(np.radians(5))) >= 0.999


def test_tiny_potentials_are_relatively_accurate_in_float32() -> None:
    sigma, goal = np.ones((25, 24, 23), np.float32), np.array([0, 0, 0], np.int32)
    sigma[8:10, :20] = sigma[15:17, 4:] = 0
    potential = solve(sigma, goal, screening_length=0.9, solver=Screened(tolerance=1e-5))
    expected = direct_potential(sigma, (0, 0, 0), 0.9**-2)
    assert expected[expected > 0].min() < 1e-20
    check_certificate(potential, sigma, goal)
    np.testing.assert_allclose(potential.phi, expected, rtol=1e-2)


def test_paper_setting_equals_elimination_with_grounded_faces() -> None:
    for seed in range(3):
        sigma, goal = scene(seed)
        potential = solve(sigma, goal, solver=PaperSetting())
        expected = direct_potential(sigma, tuple(goal), 0.0, grounded=True)
        np.testing.assert_allclose(potential.phi, expected, rtol=1e-2)


@pytest.mark.parametrize("solver", [Screened(), PaperSetting()], ids=type)
def test_float64_equals_elimination(solver: Solver) -> None:
    sigma, goal = scene(7)
    with jax.enable_x64(True):
        given = jax.jit(lambda s, g: solve_potential(s, g, solver=solver))(jnp.asarray(sigma, jnp.float64), goal)
    assert given.phi.dtype == np.float64
    assert given.status == Status.OK
    leak = leak_of(given) if isinstance(solver, Screened) else 0.0
    expected = direct_potential(sigma, tuple(goal), leak, grounded=isinstance(solver, PaperSetting))
    np.testing.assert_allclose(given.phi, expected, rtol=1e-9)


def test_a_slab_is_a_hyperbolic_cosine() -> None:
    n, length = 40, 3.0
    theta = np.arccosh(1 + length**-2 / 2)
    expected = np.cosh((n - 0.5 - np.arange(n)) * theta) / np.cosh((n - 0.5) * theta)
    # Values, unlike directions, want a tighter tolerance than the default.
    fine = Screened(tolerance=1e-4)
    potential = solve(jnp.ones((n, 1, 1)), jnp.asarray([0, 0, 0], jnp.int32), screening_length=length, solver=fine)
    np.testing.assert_allclose(np.ravel(potential.phi), expected, rtol=1e-3)


@pytest.mark.large
@pytest.mark.full_speed
@pytest.mark.parametrize("name", ["Complex", "Simple"])
def test_real_maps_with_sealed_pockets_are_certified(name: str, data: Path) -> None:
    with np.load(data / "warframe" / f"crop101_{name}.npz") as crop:
        blocked, goals = crop["occupancy"], crop["goal"]
    for goal in goals[:: len(goals) // 3].astype(np.int32):
        sigma = paper_sigma(blocked, goal)
        check_certificate(solve(sigma, goal), sigma, goal)


def test_statuses() -> None:
    sigma, goal = scene(1)
    wall = np.argwhere(sigma == 0)[0].astype(np.int32)

    def outcome(sigma: np.ndarray, goal: np.ndarray, **options: object) -> Status:
        potential = solve(sigma, goal, **options)
        assert bool(potential.certified) is (int(potential.status) == Status.OK)
        return Status(int(potential.status))

    assert outcome(sigma, goal) is Status.OK
    assert outcome(sigma, wall) is Status.GOAL_OCCUPIED
    for outside in ([-1, 3, 3], [3, 18, 3], [99, 3, 3]):
        assert outcome(sigma, np.array(outside, np.int32)) is Status.GOAL_OUTSIDE_MAP
    for bad in (np.nan, np.inf, -1.0):
        broken = sigma.copy()
        broken[3, 4, 5] = bad
        assert outcome(broken, goal) is Status.NONFINITE_INPUT
    for bad in (np.nan, np.inf, 0.0, -2.0):
        assert outcome(sigma, goal, screening_length=bad) is Status.NONFINITE_INPUT
    # A cap ends the search for values; what is certified all the same is a valid field.
    assert (
        outcome(sigma, goal, solver=Screened(max_iterations=0, max_sweeps=0, or_geodesic=False)) is Status.NOT_CONVERGED
    )
    # Nine nats a voxel: φ itself would be beneath float32's range.
    assert outcome(sigma, goal, screening_length=0.01) is Status.OK


@pytest.mark.parametrize("solver", [Screened(), PaperSetting()], ids=type)
@pytest.mark.parametrize("decades", [0, 3, 6, 9, 12])
def test_contrast_of_up_to_twelve_decades_is_solved_or_has_a_status(solver: Solver, decades: int) -> None:
    """Layers, as of walls that leak, and conductivities drawn anew for every voxel."""
    sigma, goal = scene(3)
    rng = np.random.default_rng(decades)
    layers = np.where(np.arange(sigma.shape[0]) // 4 % 2, 10.0**-decades, 1.0)[:, None, None]
    drawn = 10.0 ** -rng.integers(0, decades + 1, sigma.shape)
    for factor in (layers, drawn):
        given = (sigma * factor).astype(np.float32)
        potential = solve(given, goal, solver=solver)
        assert np.isfinite(potential.phi).all()
        assert np.isfinite(potential.residual)
        if potential.status == Status.OK:
            # Conjugate gradients know φ to within a share of the greatest one; what may be zero is set to zero.
            check_certificate(potential, given, goal, positive=isinstance(solver, Screened))
        else:
            assert potential.status == Status.NOT_CERTIFIED
            assert potential.uncertified > 0
            assert decades > 6


def test_a_goal_alone_in_its_voxel_is_certified() -> None:
    sigma = np.zeros(GRID.shape, np.float32)
    sigma[4, 5, 6] = 1e6
    sigma[9:, 9:, 9:] = 1e2  # a pocket that no current reaches
    potential = solve(sigma, np.array([4, 5, 6], np.int32))
    assert potential.status == Status.OK
    assert np.argwhere(potential.phi).tolist() == [[4, 5, 6]]


@pytest.mark.parametrize("turns", [40, 56, 80])
def test_long_detours_need_no_longer_screening(turns: int) -> None:
    """800 to 3,200 voxels of corridor, which φ itself could not span."""
    blocked = serpentine(turns - 1, turns, 1)
    goal = np.array([0, 0, 0], np.int32)
    sigma = (~blocked).astype(np.float32)
    potential = solve(sigma, goal)
    assert not potential.geodesic
    assert potential.screening_length == SCREENING_LENGTH
    check_certificate(potential, sigma, goal)
    # In a corridor φ decays by θ a voxel.
    least = np.asarray(potential.log_phi)[sigma > 0].min()
    assert least == pytest.approx(-2 * np.arcsinh(1 / (2 * SCREENING_LENGTH)) * (sigma.sum() - 1), rel=0.03)


@pytest.mark.large
def test_prices_equal_elimination_and_make_phi_decay_as_they_say() -> None:
    sigma, goal = scene(1)
    price = 1 + 4 * np.random.default_rng(0).random(sigma.shape)
    with jax.enable_x64(True):
        given = jnp.asarray(sigma, jnp.float64), jnp.asarray(goal), jnp.asarray(price)
        found = solve_potential(*given, screening_length=2.0)
        phi = np.asarray(found.phi)
    expected = direct_potential(sigma, tuple(goal), price.ravel() ** 2 / 4)
    np.testing.assert_allclose(phi, expected, rtol=1e-8)
    line = np.ones((40, 1, 1), np.float32)
    steep = solve(line, np.zeros(3, np.int32), np.full(line.shape, 7.0, np.float32), solver=Screened(tolerance=1e-5))
    np.testing.assert_allclose(
        np.diff(np.asarray(steep.log_phi)[:30, 0, 0]), -2 * np.arcsinh(7 / (2 * SCREENING_LENGTH)), rtol=1e-4
    )


def test_prices_below_one_or_not_finite_are_refused() -> None:
    sigma, goal = scene(1)
    for bad in (0.5, np.nan, np.inf, -2.0):
        price = np.ones_like(sigma)
        price[tuple(goal)] = bad
        assert solve(sigma, goal, price).status == Status.NONFINITE_INPUT
    with pytest.raises(ValueError, match="price: expected the shape of sigma"):
        solve_potential(jnp.asarray(sigma), jnp.asarray(goal), jnp.ones((3, 3, 3)))


def test_the_derivative_in_the_price_equals_finite_differences() -> None:
    sigma, goal = scene(4)
    rng = np.random.default_rng(4)
    with jax.enable_x64(True):
        price = jnp.asarray(1.5 + rng.random(sigma.shape))
        toward = jnp.asarray(rng.normal(size=sigma.shape))
        weight = jnp.asarray(rng.normal(size=sigma.shape) * (sigma > 0))

        @jax.jit
        def loss(price: jax.Array) -> jax.Array:
            found = solve_potential(jnp.asarray(sigma, jnp.float64), jnp.asarray(goal), price, screening_length=2.0)
            return jnp.sum(weight * jnp.where(jnp.isfinite(found.log_phi), found.log_phi, 0))

        slope = jnp.sum(jax.grad(loss)(price) * toward)
        step = 1e-5
        expected = (loss(price + step * toward) - loss(price - step * toward)) / (2 * step)
        np.testing.assert_allclose(float(slope), float(expected), rtol=1e-6)


@pytest.mark.large
def test_where_nothing_else_certifies_the_floods_distance_does() -> None:
    sigma, goal = scene(1)
    found = solve(sigma, goal, solver=Screened(max_iterations=0, max_sweeps=0))
    assert found.geodesic
    assert found.status == Status.OK
    check_certificate(found, sigma, goal)
    rng = np.random.default_rng(7)

    @jax.jit
    def flooded(free: jax.Array, goal: jax.Array) -> jax.Array:
        joined, steps = geodesic(free, goal)
        return distance_potential(steps, joined, jnp.asarray(1.5))

    for blocked in (rng.random((12, 13, 14)) < 0.6 for _ in range(20)):
        goal = np.argwhere(~blocked)[0]
        u = flooded(jnp.asarray(~blocked), jnp.asarray(goal, jnp.int32))
        assert stuck_voxels(np.asarray(u), component_of(~blocked, tuple(goal)), goal) == 0


def test_sweeps_certify_what_is_not() -> None:
    """A field with dents, which the flood's distance would replace as well: these sweeps mend it themselves."""
    sigma, goal = scene(3)
    medium = medium_of(jnp.asarray(sigma), jnp.asarray(goal))
    solved = solve(sigma, goal)
    u = np.array(jnp.where(medium.component, solved.log_phi, 0))
    inside = np.argwhere(np.asarray(medium.component) & (u < -1))[::97]
    u[tuple(inside.T)] += 3.0
    dented = dataclasses.replace(no_progress(medium, solved.screening_length), log_phi=jnp.asarray(u))
    assert count_uncertified(dented.log_phi, medium.component, medium.goal) > 0
    mended = sweep_until_certified(medium, dented, most=64, between=8)
    assert mended.uncertified == 0
    assert 0 < mended.sweeps <= 64
    assert count_uncertified(mended.log_phi, medium.component, medium.goal) == 0
    assert sweep_until_certified(medium, mended, most=64, between=8).sweeps == 0


def test_jit_equals_eager() -> None:
    sigma, goal = scene(2)
    eager, jitted = solve_potential(jnp.asarray(sigma), jnp.asarray(goal)), solve(sigma, goal)
    np.testing.assert_allclose(eager.phi, jitted.phi, rtol=1e-4)
    assert eager.status == jitted.status


@pytest.mark.large
def test_vmap_over_goals_and_over_scenes_equals_a_loop() -> None:
    sigma, goal = scene(3)
    goals = random_free(np.random.default_rng(3), sigma == 0, 3).astype(np.int32)
    others = [scene(seed)[0] for seed in (3, 4, 5)]
    sigmas = np.stack([np.where(other > 0, other, 0) for other in others])
    seeds = np.stack([scene(seed)[1] for seed in (3, 4, 5)])
    over_goals = jax.jit(jax.vmap(solve_potential, in_axes=(None, 0)))(sigma, goals)
    over_scenes = jax.jit(jax.vmap(solve_potential))(sigmas, seeds)
    for k in range(3):
        for batch, single in (
            (over_goals, solve(sigma, goals[k])),
            (over_scenes, solve(sigmas[k], seeds[k])),
        ):
            np.testing.assert_allclose(batch.phi[k], single.phi, rtol=1e-4)
            assert batch.status[k] == single.status
            assert batch.screening_length[k] == single.screening_length
    assert goal.shape == (3,)


def test_a_second_problem_of_the_same_shape_does_not_compile_again() -> None:
    traces = []

    @jax.jit
    def traced(sigma: jax.Array, goal: jax.Array, length: jax.Array) -> Potential:
        traces.append(1)
        return solve_potential(sigma, goal, screening_length=length)

    for seed, length in ((1, 2.0), (2, 3.0), (3, 4.5)):
        sigma, goal = scene(seed)
        assert traced(sigma, goal, np.float32(length)).status == Status.OK
    assert len(traces) == 1


# Derivatives: a small scene in float64, against central differences of sparse elimination.

SMALL = (6, 7, 8)
LENGTH = 2.0


def small_scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(11)
    blocked = random_blocks(rng, SMALL, 8, 3)
    goal = random_free(rng, blocked, 1)[0].astype(np.int32)
    sigma = np.where(blocked, 0, 10 ** rng.uniform(0, 2, SMALL))
    return sigma, goal, rng.normal(size=SMALL)


Loss = Callable[[jax.Array], jax.Array]
SIGMA, GOAL, WEIGHTS = small_scene()
JOINED = component_of(SIGMA > 0, tuple(GOAL))
LOSSES: dict[str, Loss] = {
    "weighted sum": lambda phi: (WEIGHTS * phi).sum(),
    "square": lambda phi: (WEIGHTS * phi**2).sum(),
    "logarithm": lambda phi: (WEIGHTS * jnp.log(jnp.where(JOINED, phi, 1.0))).sum(),
}


def reference(sigma: np.ndarray, length: float, loss: Loss, solver: Solver) -> float:
    grounded = isinstance(solver, PaperSetting)
    phi = direct_potential(sigma, tuple(GOAL), 0.0 if grounded else length**-2, grounded)
    return float(loss(jnp.asarray(phi)))


def central(function: Callable[[float], float], step: float) -> float:
    """Fourth order, so that the step may be large beside rounding."""
    near, far = (function(h) - function(-h) for h in (step, 2 * step))
    return (8 * near - far) / (12 * step)


@functools.cache
def slopes_of(solver: Solver) -> tuple[jax.Array, jax.Array]:
    """Of each loss, by σ and by the screening length: one program."""

    def losses(sigma: jax.Array, length: jax.Array) -> jax.Array:
        phi = solve_potential(sigma, jnp.asarray(GOAL), screening_length=length, solver=solver).phi  # type: ignore[arg-type]
        return jnp.stack([loss(phi) for loss in LOSSES.values()])

    slopes: tuple[jax.Array, jax.Array] = jax.jit(jax.jacrev(losses, (0, 1)))(jnp.asarray(SIGMA), jnp.asarray(LENGTH))
    return slopes


@pytest.mark.parametrize("solver", [Screened(), PaperSetting()], ids=type)
@pytest.mark.parametrize("name", list(LOSSES))
def test_gradient_equals_central_differences(name: str, solver: Solver) -> None:
    loss = LOSSES[name]
    with jax.enable_x64(True):
        by_sigma, by_length = (np.asarray(slope)[list(LOSSES).index(name)] for slope in slopes_of(solver))
        rng = np.random.default_rng(12)
        for _ in range(3):
            direction = SIGMA * rng.normal(size=SMALL)
            expected = central(lambda h: reference(SIGMA + h * direction, LENGTH, loss, solver), 1e-3)  # noqa: B023
            assert (by_sigma * direction).sum() == pytest.approx(expected, rel=1e-5)
        if isinstance(solver, Screened):
            expected = central(lambda h: reference(SIGMA, LENGTH + h, loss, solver), 1e-3)
            assert float(by_length) == pytest.approx(expected, rel=1e-5)
        else:
            assert by_length == 0


@pytest.mark.large
def test_forward_reverse_and_second_derivatives_agree() -> None:
    with jax.enable_x64(True):
        rng = np.random.default_rng(13)
        direction, other = (jnp.asarray(SIGMA * rng.normal(size=SMALL)) for _ in range(2))

        @jax.jit
        def slope(sigma: jax.Array) -> jax.Array:
            return jax.grad(
                lambda s: LOSSES["square"](solve_potential(s, jnp.asarray(GOAL), screening_length=LENGTH).phi)
            )(sigma)

        def objective(sigma: jax.Array) -> jax.Array:
            return LOSSES["square"](solve_potential(sigma, jnp.asarray(GOAL), screening_length=LENGTH).phi)

        sigma = jnp.asarray(SIGMA)
        _, forward = jax.jit(lambda s, d: jax.jvp(objective, (s,), (d,)))(sigma, direction)
        assert forward == pytest.approx(float((slope(sigma) * direction).sum()), rel=1e-9)
        curved = jax.jit(lambda s, d: jax.jvp(slope, (s,), (d,)))
        _, curvature = curved(sigma, direction)
        expected = central(lambda h: float((slope(sigma + h * direction) * other).sum()), 1e-3)
        assert float((curvature * other).sum()) == pytest.approx(expected, rel=1e-5)
        # The Hessian is symmetric.
        _, crossed = curved(sigma, other)
        assert float((curvature * other).sum()) == pytest.approx(float((crossed * direction).sum()), rel=1e-8)


@pytest.mark.large
def test_derivatives_are_finite_and_vanish_where_no_current_flows() -> None:
    """At walls, in sealed pockets, and by default of the screening length too."""
    sigma, goal = scene(1)
    slope = np.asarray(
        jax.jit(jax.grad(lambda s: jnp.log(solve_potential(s, jnp.asarray(goal)).phi.sum())))(jnp.asarray(sigma))
    )
    assert np.isfinite(slope).all()
    joined = component_of(sigma > 0, tuple(goal))
    touching = joined.copy()
    for axis in range(3):
        for step in (1, -1):
            touching |= np.roll(joined, step, axis)
    assert (slope[~touching] == 0).all()
    assert np.abs(slope[joined]).max() > 0


def test_wrong_arguments_are_told_with_what_was_given() -> None:
    unchecked = inspect.unwrap(solve_potential)
    sigma, goal = np.ones((4, 5, 6), np.float32), np.array([1, 2, 3], np.int32)
    with pytest.raises(ValueError, match=r"sigma: expected float32 or float64 \(nx, ny, nz\), .* \(5, 6\); use vmap"):
        unchecked(sigma[0], goal)
    for dtype in (bool, np.float16, jnp.bfloat16, np.int32, np.complex64):
        with pytest.raises(ValueError, match=rf"sigma: expected float32 or float64 .*given {np.dtype(dtype).name}"):
            unchecked(sigma.astype(dtype), goal)
    with pytest.raises(ValueError, match=r"goal_index: expected integer \(3,\), given int32 \(2,\)"):
        unchecked(sigma, goal[:2])
    with pytest.raises(ValueError, match=r"goal_index: expected integer \(3,\), given float32 \(3,\)"):
        unchecked(sigma, goal.astype(np.float32))
    with pytest.raises(ValueError, match=r"solver: expected a solver, as maxjax.Screened\(\), given 'open'"):
        unchecked(sigma, goal, solver="open")
    for tolerance in (np.nan, np.inf, 0.0, -1e-3):
        with pytest.raises(ValueError, match=f"tolerance: expected a positive finite number, given {tolerance}"):
            Screened(tolerance=tolerance)
    for name in ("max_iterations", "max_sweeps"):
        for solver, cap in itertools.product((Screened, PaperSetting, ConjugateGradients), (-1, 2.5)):
            with pytest.raises(ValueError, match=f"{name}: expected a whole number, 0 or more, given {cap}"):
                by_itself(solver, **{name: cap})


@pytest.mark.parametrize("solver", [Screened(), PaperSetting(), ConjugateGradients()], ids=type)
@pytest.mark.parametrize("scale", [1e30, 3e-7, 1e-30, 1e-37])
def test_the_scale_of_sigma_is_irrelevant(solver: Solver, scale: float) -> None:
    sigma, goal = (np.asarray(scene(4)[0] > 0, np.float32), scene(4)[1])
    unit, scaled = (solve(factor * sigma, goal, solver=solver) for factor in np.float32([1, scale]))
    assert unit.status == scaled.status == Status.OK
    np.testing.assert_allclose(scaled.phi, unit.phi, rtol=1e-4 if isinstance(solver, PaperSetting) else 1e-5)


def test_the_derivative_scales_with_the_inverse_of_sigma() -> None:
    sigma, goal = scene(4)

    @jax.jit
    def slope(sigma: jax.Array) -> jax.Array:
        return jax.grad(lambda s: jnp.sum(solve_potential(s, jnp.asarray(goal), screening_length=2.0).phi))(sigma)

    # A power of two: the same numbers but for the exponent.
    unit, scaled = slope(jnp.asarray(sigma)), slope(jnp.asarray(sigma * np.float32(2.0**60)))
    assert np.abs(unit).max() > 0
    scaled = np.asarray(scaled, np.float64) * 2.0**60
    np.testing.assert_allclose(scaled, unit, rtol=1e-4, atol=1e-6 * np.abs(unit).max())


def test_a_call_outside_of_jit_compiles_once(caplog: pytest.LogCaptureFixture) -> None:
    given = [tuple(map(jnp.asarray, scene(seed, (9, 11, 13)))) for seed in (1, 2, 3)]

    def compiled() -> list[str]:
        """Programs that these solves compile; at a tolerance of their own, so that no other test has done so."""
        caplog.clear()
        with jax.log_compiles():
            for sigma, goal in given:
                assert solve_potential(sigma, goal, solver=Screened(tolerance=3.21e-3)).status == Status.OK
        return [record.message for record in caplog.records if "Compiling" in record.message]

    assert sum("_potential" in message for message in compiled()) == 1
    assert compiled() == []


@pytest.mark.parametrize("seed", range(3))
def test_conjugate_gradients_alone_find_the_same_field(seed: int) -> None:
    sigma, goal = scene(seed)
    reference, ours = (solve(sigma, goal, solver=kind(tolerance=1e-5)) for kind in (ConjugateGradients, Screened))
    check_certificate(reference, sigma, goal)
    np.testing.assert_allclose(ours.phi, reference.phi, rtol=1e-2)
    expected = direct_potential(sigma, tuple(goal), leak_of(reference))
    np.testing.assert_allclose(reference.phi, expected, rtol=1e-2)


def test_a_solver_keeps_its_caps() -> None:
    sigma, goal = scene(1)
    capped = Screened(max_iterations=0, max_sweeps=0, or_geodesic=False)
    assert solve(sigma, goal, solver=capped).status == Status.NOT_CONVERGED
