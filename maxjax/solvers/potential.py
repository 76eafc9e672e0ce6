"""The conduction potential: solve, sweep until certified, and differentiate implicitly.

    A(σ, κ) φ = 0 on free voxels,   φ = 1 on the goal,   κ = 1/ℓ²

Settings: `screened` (leak κ, insulated outer faces; the default) and `paper` (κ = 0, outer faces grounded). Scaling φ
to 1 at the goal instead of feeding a unit source changes φ by a factor only, and spends float32's range where it is
needed.

Forward, `screened`. A guess that decays with geodesic distance, then Newton cycles on log φ (`solvers.walk`) until one
more sweep would change no voxel by more than a small part of *its own* φ: a norm says nothing about the directions far
from the goal. Where the cycles stall, conjugate gradients with a Chebyshev polynomial as preconditioner, slower but
indifferent to walls, do it instead, to the same rule. Forward, `paper`. Conjugate gradients on the Jacobi-scaled
system, preconditioned by a V-cycle (`solvers.multigrid`), until the norm of the residual is small. Then, in both,
positive sweeps φ_i ← Σ_j w_ij φ_j / d_i run until the field is certified (`fields.certificate`) or a cap is reached.

Derivative. With F(φ, σ, κ) = A φ − q = 0, the implicit function theorem gives  A dφ = −(∂F/∂σ dσ + ∂F/∂κ dκ): one more
solve with the same symmetric A. It is written with `lax.custom_linear_solve`, so JAX transposes it for reverse mode:
the adjoint λ of a loss L solves A λ = ∂L/∂φ, and dL/dσ = −λᵀ ∂F/∂σ. Neither iterations nor sweeps are ever
differentiated.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Literal

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Bool, Float, Int32

from maxjax.core.batching import settle
from maxjax.core.status import Status
from maxjax.fields import stencil
from maxjax.fields.certificate import uncertified
from maxjax.fields.connectivity import geodesic
from maxjax.solvers import walk
from maxjax.solvers.krylov import Linear, Solution, chebyshev, pcg
from maxjax.solvers.multigrid import hierarchy, v_cycle

Setting = Literal["screened", "paper"]

# Degree of the Chebyshev preconditioner. The vector work of a CG iteration costs as much as eight
# applications of the stencil on two CPU cores, and a wait for the device on a GPU, so few iterations are taken.
DEGREE = 32
# When the solve is over, by number of bytes. `screened`: the relative change of any voxel by one more sweep; errors
# that remain are smooth, some ten times as large at the far end, and leave directions alone. `paper`: |q − A φ| / |q|.
TOLERANCE: dict[Setting, dict[int, float]] = {"screened": {4: 1e-2, 8: 1e-12}, "paper": {4: 1e-6, 8: 1e-13}}
# The same where a derivative is asked for, which depends on the values.
TIGHT_TOLERANCE = {4: 1e-5, 8: 1e-12}
# Residual of a derivative solve, largest entry beside the largest of the right-hand side, by number of bytes. An
# adjoint decays over as many decades as φ, and what the derivative needs is the product of both, hence so small.
DERIVATIVE_TOLERANCE = {4: 1e-12, 8: 1e-15}
SWEEPS = 8
# float32 spans 87 nats below 1. What distance does not use up is left to narrow passages, which attenuate φ as well,
# and to the few per cent by which `geodesic` may fall short.
NATS = 68.0
SHORTEST_LENGTH = 1.5
# Where that was not enough, the screening length grows by this factor.
_LENGTHEN = 1.5
_ATTEMPTS = 4
# Up to so many voxels the waits of a solve on an accelerator cost more than to assemble A once more.
_WAITING = 2**24


@dataclasses.dataclass(frozen=True)
class _Caps:
    """What is static in a solve.

    Attributes:
        setting, tolerance, max_iterations, max_sweeps: of `solve_potential`.
        attempts: screening lengths to try.
        ahead: whether an accelerator takes the first cycles ahead of all loops, since at each turn of a loop it waits
            for the host: in the `screened` setting, for a single scene, of a size that leaves it waiting.
    """

    setting: Setting
    tolerance: float
    max_iterations: int
    max_sweeps: int
    attempts: int
    ahead: bool


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Potential:
    """A potential and what is known of it.

    Attributes:
        phi: potential, 1 at the goal, 0 in obstacles and in pockets that no current reaches.
        status: `Status` as int32: OK, NOT_CONVERGED, NOT_CERTIFIED, GOAL_OUTSIDE_MAP, GOAL_OCCUPIED, NONFINITE_INPUT.
        iterations: Newton cycles (`screened`), with those of CG where cycles stalled; CG iterations (`paper`).
        sweeps: positive sweeps after them.
        residual: largest relative change that one more sweep would have made (`screened`); |q − A φ| / |q| of the
            Jacobi-scaled system, recomputed from φ (`paper`).
        certified: every voxel of the goal's component but the goal has a strictly higher face neighbour.
        uncertified: number of voxels that have none.
        screening_length: ℓ that was used [voxels].
    """

    phi: Float[Array, "*batch nx ny nz"]
    status: Int32[Array, "*batch"]
    iterations: Int32[Array, "*batch"]
    sweeps: Int32[Array, "*batch"]
    residual: Float[Array, "*batch"]
    certified: Bool[Array, "*batch"]
    uncertified: Int32[Array, "*batch"]
    screening_length: Float[Array, "*batch"]


def screening_length_for(distance: Int32[Array, "nx ny nz"]) -> Float[Array, ""]:
    """The shortest screening length [voxels] at which float32 spans the goal's component.

    The shorter it is, the closer to shortest paths: −ℓ log φ tends to geodesic distance (Varadhan 1967). Below one and
    a half voxels the lattice itself shows.

    Args:
        distance: to the goal inside its component (`fields.connectivity.geodesic`) [voxels].
    """
    return jnp.maximum(jnp.max(distance) / NATS, SHORTEST_LENGTH)


def solve_potential(
    sigma: Float[Array, "nx ny nz"],
    goal_index: Int32[Array, " 3"],
    *,
    screening_length: Float[Array, ""] | float | None = None,
    setting: Setting = "screened",
    tolerance: float | None = None,
    max_iterations: int = 100,
    max_sweeps: int = 400,
) -> Potential:
    """The certified conduction potential of a conductivity field; composes with `jit`, `vmap` and `grad`.

    Args:
        sigma: conductivity, zero in obstacles; float32, or float64 for references.
        goal_index: voxel of the goal, int32.
        screening_length: ℓ [voxels], an array argument, taken as it is; by default that of
            `screening_length_for`, lengthened where narrow passages take φ out of float32's range all the same.
            Unused in `paper`.
        setting: `screened` or `paper`. Static.
        tolerance: when the solve stops. `screened`: the relative change of any voxel by one more sweep; by default 1e-2
            in float32, where directions are right and values to some ten times that (1e-5 once a derivative is taken,
            1e-12 in float64); values to 1 % need 1e-4. `paper`: the residual's norm over the source's, by default 1e-6
            (1e-13 in float64). Static.
        max_iterations: cap on cycles or CG iterations. Static.
        max_sweeps: cap on positive sweeps. Static.

    Returns:
        A `Potential`; `phi` is differentiable in sigma and screening_length.

    Raises:
        ValueError: for a sigma that is not three-dimensional or not floating, a goal_index that is not (3,), or an
            unknown setting.
    """
    sigma, goal_index = jnp.asarray(sigma), jnp.asarray(goal_index)
    if sigma.ndim != 3 or not jnp.issubdtype(sigma.dtype, jnp.floating):
        raise ValueError(
            f"sigma: expected floating (nx, ny, nz), given {sigma.dtype} {sigma.shape}; use vmap for batches"
        )
    if goal_index.shape != (3,) or not jnp.issubdtype(goal_index.dtype, jnp.integer):
        raise ValueError(f"goal_index: expected integer (3,), given {goal_index.dtype} {goal_index.shape}")
    if setting not in ("screened", "paper"):
        raise ValueError(f"setting: expected 'screened' or 'paper', given {setting!r}")
    attempts = _ATTEMPTS if screening_length is None and setting == "screened" else 1
    goal = goal_index.astype(jnp.int32)
    component, distance = geodesic(lax.stop_gradient(sigma) > 0, goal)
    if screening_length is None:
        screening_length = screening_length_for(distance)
    length = jnp.asarray(screening_length, sigma.dtype)
    if tolerance is None:
        tolerance = TOLERANCE[setting][sigma.dtype.itemsize]
    ahead = setting == "screened" and sigma.size <= _WAITING
    caps = _Caps(setting, tolerance, max_iterations, max_sweeps, attempts, ahead)
    return Potential(**_potential(caps, sigma, length, goal, component, distance))


def _system(
    setting: Setting, sigma: stencil.Volume, length: Float[Array, ""], goal: Int32[Array, " 3"]
) -> tuple[stencil.Operator, stencil.Volume]:
    """A and q with φ = 1 held on the goal; a goal outside the grid holds nothing."""
    held = stencil.cell(sigma.shape, goal) & (sigma > 0)
    return stencil.hold(_operator(setting, sigma, length), held.astype(sigma.dtype))


def _operator(setting: Setting, sigma: stencil.Volume, length: Float[Array, ""]) -> stencil.Operator:
    return stencil.assemble(sigma, 0.0 if setting == "paper" else 1 / length**2, grounded=setting == "paper")


@jax.named_scope("guess")
def _guess(
    distance: Int32[Array, "nx ny nz"], length: Float[Array, ""], component: Bool[Array, "nx ny nz"]
) -> stencil.Volume:
    """φ of a point source where σ ∝ 1/r: decay by θ a voxel, 2 (cosh θ − 1) = 1/ℓ², and by √r; never below float32."""
    decay = jnp.arccosh(1 + 1 / (2 * length**2))
    far = distance.astype(length.dtype)
    return jnp.where(component, jnp.exp(jnp.maximum(-decay * far - jnp.log1p(far) / 2, -85)), 0)


def _preconditioner(
    setting: Setting, operator: stencil.Operator, faces: stencil.Faces, component: Bool[Array, "nx ny nz"]
) -> Linear:
    """Of the scaled system. `paper`: the V-cycle, since no leak bounds the condition of A.

    `screened`: the Chebyshev polynomial, its interval from the largest row sum (Gershgorin). It outdoes the V-cycle,
    which spans no distance faster.
    """
    if setting == "paper":
        return v_cycle(hierarchy(operator, component))
    diagonal = jnp.where(operator.diagonal > 0, operator.diagonal, 1)
    rows = stencil.inflow(operator.faces, jnp.ones_like(diagonal)) / diagonal
    # Below 1 - λ = 1/degree² a polynomial of this degree can do nothing; those few modes are left to CG.
    radius = jnp.minimum(jnp.max(rows), 1 - 1 / DEGREE**2)
    return chebyshev(functools.partial(stencil.inflow, faces), radius, DEGREE)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _potential(
    caps: _Caps,
    sigma: stencil.Volume,
    length: Float[Array, ""],
    goal: Int32[Array, " 3"],
    component: Bool[Array, "nx ny nz"],
    distance: Int32[Array, "nx ny nz"],
) -> dict[str, Array]:
    """The forward solve; in a batch without what only spares a single scene its waits.

    Returns the fields of a `Potential` in a plain dictionary, since their tangents make no `Potential`.
    """
    alone = custom_vmap(functools.partial(_forward, caps))

    @alone.def_vmap
    def together(size: int, in_batch: list[bool], *arrays: Array) -> tuple[dict[str, Array], dict[str, bool]]:
        forward = functools.partial(_forward, dataclasses.replace(caps, ahead=False))
        axes = [0 if batched else None for batched in in_batch]
        many = jax.vmap(forward, axes, axis_size=size)(*arrays)
        return many, dict.fromkeys(many, True)

    found: dict[str, Array] = alone(sigma, length, goal, component, distance)
    return found


def _forward(
    caps: _Caps,
    sigma: stencil.Volume,
    length: Float[Array, ""],
    goal: Int32[Array, " 3"],
    component: Bool[Array, "nx ny nz"],
    distance: Int32[Array, "nx ny nz"],
) -> dict[str, Array]:
    """Attempts with longer and longer screening lengths, while there is one left and a voxel uncertified."""

    def again(state: tuple[Potential, Int32[Array, ""]]) -> tuple[Potential, Int32[Array, ""]]:
        before, attempt = state
        longer = before.screening_length * jnp.where(attempt > 0, _LENGTHEN, 1).astype(length.dtype)
        anew = dataclasses.replace(before, iterations=jnp.where(attempt > 0, 0, before.iterations))
        return _attempt(caps, sigma, longer, goal, component, distance, anew), attempt + 1

    def unfinished(state: tuple[Potential, Int32[Array, ""]]) -> Bool[Array, ""]:
        before, attempt = state
        retry = (before.status == Status.NOT_CERTIFIED) | (before.status == Status.NOT_CONVERGED)
        return retry & (attempt < caps.attempts)

    def nothing(*_: Array) -> Potential:
        none, most = jnp.int32(0), jnp.asarray(jnp.inf, length.dtype)
        status = jnp.int32(Status.NOT_CONVERGED)
        return Potential(jnp.zeros_like(sigma), status, none, none, most, jnp.array(False), none, length)

    begun = nothing()
    if caps.ahead:
        begin = functools.partial(_begun, caps)
        begun = lax.platform_dependent(sigma, length, goal, component, distance, cpu=nothing, default=begin)
    return dict(vars(lax.while_loop(unfinished, again, (begun, jnp.int32(0)))[0]))


def _begun(
    caps: _Caps,
    sigma: stencil.Volume,
    length: Float[Array, ""],
    goal: Int32[Array, " 3"],
    component: Bool[Array, "nx ny nz"],
    distance: Int32[Array, "nx ny nz"],
) -> Potential:
    """The cycles that nearly every scene takes, and its verdict: NOT_CONVERGED where there is more to do.

    On an accelerator the host waits at every loop to be told whether it goes on: with this, at one of five.
    """
    shape = sigma.shape
    sigma, component, distance = (walk.padded(array) for array in (sigma, component, distance))
    newton = walk.begin(
        _operator(caps.setting, sigma, length),
        _guess(distance, length, component),
        component,
        goal,
        tolerance=caps.tolerance,
        max_cycles=caps.max_iterations,
    )
    solution = Solution(newton.phi, newton.cycles, newton.residual, newton.converged)
    stuck = uncertified(newton.phi, component, goal)
    found = _judged(solution, jnp.int32(0), stuck, sigma, length, goal, component, shape)
    return dataclasses.replace(found, status=jnp.where(newton.converged, found.status, Status.NOT_CONVERGED))


def _attempt(
    caps: _Caps,
    sigma: stencil.Volume,
    length: Float[Array, ""],
    goal: Int32[Array, " 3"],
    component: Bool[Array, "nx ny nz"],
    distance: Int32[Array, "nx ny nz"],
    begun: Potential,
) -> Potential:
    """With one screening length; goes on from what has had some iterations with it."""
    shape = sigma.shape
    if caps.setting == "screened":
        sigma, component, distance = (walk.padded(array) for array in (sigma, component, distance))
        solution = _cycled(caps, sigma, length, goal, component, distance, begun)
    else:
        solution = _conjugate_gradients(caps, sigma, length, goal, component)
    lost = solution.converged & jnp.any(component & (solution.x <= 0))
    held = stencil.cell(sigma.shape, goal)

    def sweep(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        phi, sweeps, _ = state
        # Hardly any field needs them: A is assembled anew rather than kept, and the barrier keeps XLA from doing it
        # ahead of the loop.
        operator = _operator(caps.setting, *lax.optimization_barrier((sigma, length, phi))[:2])
        diagonal = jnp.where(operator.diagonal > 0, operator.diagonal, 1)
        phi = lax.fori_loop(
            0, SWEEPS, lambda _, phi: jnp.where(held, phi, stencil.inflow(operator.faces, phi) / diagonal), phi
        )
        return phi, sweeps + SWEEPS, uncertified(phi, component, goal)

    phi, sweeps, stuck = lax.while_loop(
        # A voxel at zero is out of float32's range, and sweeps cannot bring it back.
        lambda state: (state[2] != 0) & (state[1] < caps.max_sweeps) & ~(lost & (state[1] > 0)),
        sweep,
        (solution.x, jnp.int32(0), uncertified(solution.x, component, goal)),
    )
    solution = dataclasses.replace(solution, x=phi)
    return _judged(solution, sweeps, stuck, sigma, length, goal, component, shape)


def _cycled(
    caps: _Caps,
    sigma: stencil.Volume,
    length: Float[Array, ""],
    goal: Int32[Array, " 3"],
    component: Bool[Array, "nx ny nz"],
    distance: Int32[Array, "nx ny nz"],
    begun: Potential,
) -> Solution:
    """φ by Newton cycles on the padded grid; where they stall, by conjugate gradients."""
    operator, guess = _operator(caps.setting, sigma, length), _guess(distance, length, component)

    def from_guess() -> walk.Solution:
        return walk.guessed(guess)

    def from_begun() -> walk.Solution:
        cycled = walk.Solution(walk.padded(begun.phi), begun.iterations, begun.residual, jnp.array(False))
        start: walk.Solution = jax.tree.map(lambda x, y: jnp.where(begun.iterations > 0, x, y), cycled, from_guess())
        return start

    newton = walk.solve(
        operator,
        lax.platform_dependent(cpu=from_guess, default=from_begun) if caps.ahead else from_guess(),
        component,
        goal,
        tolerance=caps.tolerance,
        max_cycles=caps.max_iterations,
        blind=not caps.ahead,
    )
    stalled = ~newton.converged & (newton.cycles < caps.max_iterations)

    def linear(system: tuple[Array, ...], state: tuple[Solution, Array]) -> tuple[Solution, Array]:
        sigma, length, goal, component = system
        # A goal outside the grid leaves nothing to solve. Were this no question of the state, XLA on CPU would solve
        # ahead of the loop, whether there is a turn or not.
        goal = jnp.where(state[1], goal, -1)
        solution = _conjugate_gradients(caps, sigma, length, goal, component)
        iterations = state[0].iterations + solution.iterations
        return dataclasses.replace(solution, iterations=iterations), jnp.zeros_like(stalled)

    cycled = Solution(newton.phi, newton.cycles, newton.residual, newton.converged)
    system = sigma, length, goal, component
    solution: Solution
    solution, _ = settle(lambda _, state: state[1], linear, system, (cycled, stalled), parts=64)
    return solution


def _judged(
    solution: Solution,
    sweeps: Int32[Array, ""],
    stuck: Int32[Array, ""],
    sigma: stencil.Volume,
    length: Float[Array, ""],
    goal: Int32[Array, " 3"],
    component: Bool[Array, "nx ny nz"],
    shape: tuple[int, ...],
) -> Potential:
    """A solution of so many uncertified voxels, with its status, on a grid of this shape."""
    phi = solution.x
    finite = jnp.all(jnp.isfinite(sigma) & (sigma >= 0)) & jnp.isfinite(length) & (length > 0)
    outside = jnp.any((goal < 0) | (goal >= jnp.asarray(shape)))
    blocked = ~jnp.any(component)
    certified = finite & ~outside & ~blocked & (stuck == 0) & jnp.all(jnp.isfinite(phi))
    status = jnp.select(
        [~finite, outside, blocked, certified, ~solution.converged],
        [Status.NONFINITE_INPUT, Status.GOAL_OUTSIDE_MAP, Status.GOAL_OCCUPIED, Status.OK, Status.NOT_CONVERGED],
        Status.NOT_CERTIFIED,
    )
    return Potential(
        phi=lax.slice(phi, (0, 0, 0), shape),
        status=status.astype(jnp.int32),
        iterations=solution.iterations,
        sweeps=sweeps,
        residual=solution.residual,
        certified=certified,
        uncertified=stuck,
        screening_length=length,
    )


@jax.named_scope("conjugate gradients")
def _conjugate_gradients(
    caps: _Caps,
    sigma: stencil.Volume,
    length: Float[Array, ""],
    goal: Int32[Array, " 3"],
    component: Bool[Array, "nx ny nz"],
) -> Solution:
    """φ by conjugate gradients on the scaled system.

    `screened`: until the residual of every voxel is small beside its own φ. `paper`: until the norm is small.
    """
    operator, source = _system(caps.setting, sigma, length, goal)
    faces, scale = stencil.normalize(operator)
    b = source * scale

    def small(y: stencil.Volume, r: stencil.Volume) -> Bool[Array, ""]:
        if caps.setting == "screened":
            return jnp.all(jnp.abs(r) <= caps.tolerance * y)
        return jnp.sum(r * r) <= caps.tolerance**2 * jnp.sum(b * b)

    solution = pcg(
        lambda y: y - stencil.inflow(faces, y),
        b,
        precondition=_preconditioner(caps.setting, operator, faces, component),
        stop=small,
        max_iterations=caps.max_iterations,
    )
    return dataclasses.replace(solution, x=jnp.where(component, jnp.maximum(scale * solution.x, 0), 0))


@_potential.defjvp
def _potential_jvp(caps, primals, tangents):  # type: ignore[no-untyped-def]
    """Solve A φ̇ = −(∂F/∂σ σ̇ + ∂F/∂ℓ ℓ̇); see the head of this module."""
    sigma, length, goal, component, distance = primals
    sigma_dot, length_dot, *_ = tangents
    tight = min(caps.tolerance, TIGHT_TOLERANCE[sigma.dtype.itemsize])
    solved = _potential(dataclasses.replace(caps, tolerance=tight), sigma, length, goal, component, distance)

    def imbalance(sigma: stencil.Volume, length: Float[Array, ""]) -> stencil.Volume:
        operator, source = _system(caps.setting, sigma, length, goal)
        return stencil.residual(operator, solved["phi"], source)

    _, right = jax.jvp(imbalance, (sigma, solved["screening_length"]), (sigma_dot, length_dot))
    operator, _ = _system(caps.setting, sigma, solved["screening_length"], goal)
    faces, scale = stencil.normalize(operator)
    tolerance = DERIVATIVE_TOLERANCE[sigma.dtype.itemsize]
    precondition = _preconditioner(caps.setting, operator, faces, component)

    def solve(matvec, b):  # type: ignore[no-untyped-def]
        return pcg(
            matvec,
            b,
            precondition=precondition,
            stop=lambda _, r: jnp.max(jnp.abs(r)) <= tolerance * jnp.max(jnp.abs(b)),
            max_iterations=caps.max_iterations,
        ).x

    y_dot = lax.custom_linear_solve(lambda y: y - stencil.inflow(faces, y), scale * right, solve, symmetric=True)

    def zero(x: Array) -> Array:
        return jnp.zeros_like(x) if jnp.issubdtype(x.dtype, jnp.floating) else jnp.zeros(x.shape, jax.dtypes.float0)

    return solved, {**jax.tree.map(zero, solved), "phi": scale * y_dot}
