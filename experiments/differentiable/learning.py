"""Learning to plan: recover what a demonstrator pays for, from its paths, by gradients through the solver.

    python -m experiments.differentiable.learning     # 64 x 64 x 24 voxels of 2 m; one minute on two CPU cores

The field's equation with a price n(x) per metre,

    −∇·(σ∇φ) + κ n² σ φ = q,        n = 1 + a exp(−(d − 1) / w) + v z / 10 m,

has −ℓ log φ → min ∫ n ds (Varadhan, with the metric n): n is what a metre costs at the distance d [voxels] from the
nearest wall and at the height z. The price stands in the *leak*. A conductivity that falls towards the walls, with the
leak in proportion, keeps no distance: across a straight street φ is constant then, whatever σ is.

Demonstrations are graph searches (Dijkstra, 26 neighbours, no corner cut) on a hidden (a, w, v): not paths of our
planner. The loss is the mean of 1 − cos between the demonstration's direction and ∇ log φ, which is where the planner
would head there. That is a sum of squares of unit vectors' differences, so Levenberg and Marquardt lower it, with a
Jacobian by (log a, log w, log v) of three derivative solves a goal. Found parameters are
judged on held-out problems in another city, where our planner climbs the learnt field, certified as any other. Paths
are not pulled taut: string pulling knows no price.

Expected: held-out clearance and height within a metre of the demonstrator's, every field certified; a, w and v within
some thirty per cent of the hidden ones.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jax import lax
from jaxtyping import Array, Bool, Float, Int32
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra

import maxjax
from benchmarks.common.harness import Row, save
from experiments.differentiable.field import (
    COLORS,
    FIGURES,
    RESULTS,
    city,
    draw_city,
    draw_mark,
    figure,
    free_points,
    heights,
    least_squares,
    metres,
    table,
)
from maxjax.fields import stencil
from maxjax.fields.certificate import uncertified
from maxjax.fields.connectivity import flood
from maxjax.fields.gradient import gradient
from maxjax.fields.gradient import log_potential as logarithm
from maxjax.planning.ascent import Ascent, ascend
from maxjax.planning.sight import span_codes
from maxjax.solvers.krylov import chebyshev, pcg
from maxjax.solvers.potential import DEGREE, DERIVATIVE_TOLERANCE, TIGHT_TOLERANCE

NAME = "differentiable_learning"
PARAMETERS = ("wall price a", "reach of the walls w", "price of height v")


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        shape: voxels of a window.
        seeds: cities (downtown) to learn from, one goal each.
        held_out: cities to judge in.
        demonstrations: starts a goal.
        hidden: a, w [voxels] and v of the demonstrator.
        guess: where the search begins.
        length: ℓ [voxels].
        steps: of Levenberg and Marquardt.
        out, figures: where JSON and figure go.
    """

    shape: tuple[int, int, int] = (64, 64, 24)
    seeds: tuple[int, ...] = (0, 1, 2)
    held_out: tuple[int, ...] = (7, 8)
    demonstrations: int = 10
    hidden: tuple[float, float, float] = (3.0, 3.0, 0.2)
    guess: tuple[float, float, float] = (1.0, 2.0, 0.1)
    length: float = 5.0
    steps: int = 12
    out: Path = RESULTS
    figures: Path = FIGURES


TINY = Config(shape=(24, 24, 14), seeds=(0,), held_out=(1,), demonstrations=3, steps=3)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Town:
    """What a price is made of.

    Attributes:
        free: voxels outside the margin.
        distance: to the nearest voxel that is not, the ground left out [voxels].
        height: above ground [10 m].
    """

    free: Bool[Array, "nx ny nz"]
    distance: Float[Array, "nx ny nz"]
    height: Float[Array, "nx ny nz"]


def price(town: Town, theta: Float[Array, " 3"]) -> Float[Array, "nx ny nz"]:
    """The price n of the logarithms of a, w and v."""
    a, w, v = jnp.exp(theta)
    n: Array = 1 + a * jnp.exp(-(town.distance - 1) / w) + v * town.height
    return n


def priced_potential(
    town: Town, n: Float[Array, "nx ny nz"], goal: Int32[Array, " 3"], length: Float[Array, ""]
) -> Float[Array, "nx ny nz"]:
    """φ of a price field, 1 at the goal; differentiable in n.

    `solve_potential` has one leak for the whole map; here conjugate gradients solve the same system with a leak a
    voxel, to the same rule, and the derivative is the implicit one: φ + A⁻¹ r(n), where the residual r is zero but its
    derivative, −∂A/∂n φ, is not.
    """
    component = flood(town.free, goal)
    sigma = component.astype(n.dtype)
    held = stencil.cell(sigma.shape, goal).astype(n.dtype)
    still = stencil.assemble(sigma, 0.0)
    leaking = stencil.Operator(still.faces, still.diagonal + sigma * n**2 / length**2)
    operator, source = stencil.hold(leaking, held)
    fixed = jax.tree.map(lax.stop_gradient, operator)
    faces, scale = stencil.normalize(fixed)
    rows = stencil.inflow(fixed.faces, jnp.ones_like(sigma)) / jnp.where(fixed.diagonal > 0, fixed.diagonal, 1)
    smooth = functools.partial(stencil.inflow, faces)
    solve = functools.partial(
        pcg,
        lambda y: y - smooth(y),
        precondition=chebyshev(smooth, jnp.minimum(jnp.max(rows), 1 - 1 / DEGREE**2), DEGREE),
        max_iterations=100,
    )
    tight, tighter = TIGHT_TOLERANCE[n.dtype.itemsize], DERIVATIVE_TOLERANCE[n.dtype.itemsize]
    forward = solve(source * scale, stop=lambda y, r: jnp.all(jnp.abs(r) <= tight * y)).x
    phi = lax.stop_gradient(jnp.where(component, jnp.maximum(scale * forward, 0), 0))
    residual = stencil.residual(operator, phi, source)

    def adjoint(_: Any, b: Array) -> Array:
        return solve(b, stop=lambda _, r: jnp.max(jnp.abs(r)) <= tighter * jnp.max(jnp.abs(b))).x

    change = lax.custom_linear_solve(
        lambda y: y - smooth(y), scale * (residual - lax.stop_gradient(residual)), adjoint, symmetric=True
    )
    return jnp.asarray(phi + scale * change)


def bearings(
    theta: Float[Array, " 3"],
    town: Town,
    goal: Int32[Array, " 3"],
    length: Float[Array, ""],
    voxels: Int32[Array, "n 3"],
) -> Float[Array, "n 3"]:
    """Where the planner would head at voxels: unit vectors along ∇ log φ, less what points into a wall."""
    log_phi = logarithm(priced_potential(town, price(town, theta), goal, length))
    slopes = gradient(log_phi, town.free)
    open_ahead, open_behind = (
        jnp.stack([shift(town.free.astype(log_phi.dtype), axis) for axis in range(3)], axis=-1) > 0
        for shift in (stencil.ahead, stencil.behind)
    )
    slopes = jnp.where(jnp.where(slopes > 0, open_ahead, open_behind), slopes, 0)
    slopes = slopes[voxels[:, 0], voxels[:, 1], voxels[:, 2]]
    square = jnp.sum(slopes**2, axis=1, keepdims=True)
    return slopes * lax.rsqrt(jnp.where(square > 0, square, 1))


@jax.jit
def linearized(
    theta: Float[Array, " 3"],
    town: Town,
    goal: Int32[Array, " 3"],
    length: Float[Array, ""],
    voxels: Int32[Array, "n 3"],
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3 3"]]:
    """`bearings` and their derivative by theta, last axis: one solve, and a derivative solve a parameter."""
    value, push = jax.linearize(lambda theta: bearings(theta, town, goal, length, voxels), theta)
    return value, jax.vmap(push, out_axes=-1)(jnp.eye(3, dtype=theta.dtype))


@jax.jit
def follow(
    theta: Float[Array, " 3"],
    town: Town,
    goal: Int32[Array, " 3"],
    length: Float[Array, ""],
    starts: Int32[Array, "m 3"],
) -> tuple[Float[Array, "m t 3"], Bool[Array, " m"], Int32[Array, ""]]:
    """Paths of our planner in a priced field, which of them arrived, and the voxels without a higher neighbour."""
    phi = priced_potential(town, price(town, theta), goal, length)
    bits = span_codes(~town.free)

    def one(start: Int32[Array, " 3"]) -> tuple[Array, Array]:
        ends = start.astype(phi.dtype), goal.astype(phi.dtype)
        return ascend(phi, bits, town.free, *ends, Ascent(steps=1024))

    paths, arrived = jax.vmap(one)(starts)
    return paths, arrived, uncertified(phi, flood(town.free, goal), goal)


@dataclasses.dataclass(frozen=True)
class Lesson:
    """One goal and the demonstrations to it, in voxels."""

    town: Town
    clear: np.ndarray  # distance to the next building [m]
    goal: np.ndarray
    starts: np.ndarray
    shown: list[np.ndarray]


def window(config: Config) -> maxjax.Grid:
    """The middle of a city, from the ground up."""
    nx, ny, _ = config.shape
    return maxjax.Grid(config.shape, 2.0, (1.0 - nx, 1.0 - ny, -1.0))


def lesson(config: Config, seed: int) -> Lesson:
    """A goal in a city, starts around it, and how the demonstrator flies."""
    grid = window(config)
    occupied, ground = city("downtown", seed, grid)
    earth, all_blocked = (
        np.asarray(maxjax.dilate(jnp.asarray(volume), 2.0, grid, jnp.asarray(ground))) for volume in (ground, occupied)
    )
    free = ~all_blocked
    walls = all_blocked & ~earth
    height = np.broadcast_to((grid.origin[2] + grid.spacing * np.arange(grid.shape[2])) / 10, grid.shape)
    town = Town(
        jnp.asarray(free),
        jnp.asarray(ndimage.distance_transform_edt(~walls), jnp.float32),
        jnp.asarray(height, jnp.float32),
    )
    rng = np.random.default_rng([seed, 6])
    points = free_points(rng, free, heights(grid, 3.0, 15.0), 40 * config.demonstrations)
    goal = points[0]
    apart = np.linalg.norm(points - goal, axis=1)
    low, high = 0.3 * min(grid.shape[:2]), 0.8 * min(grid.shape[:2])
    starts = points[(apart >= low) & (apart <= high)][: config.demonstrations]
    n = np.asarray(price(town, jnp.log(jnp.asarray(config.hidden))))
    clear = grid.spacing * ndimage.distance_transform_edt(~(occupied & ~ground))
    return Lesson(town, clear, goal, starts, demonstrate(free, n, goal, starts))


def demonstrate(free: np.ndarray, n: np.ndarray, goal: np.ndarray, starts: np.ndarray) -> list[np.ndarray]:
    """Cheapest 26-neighbour paths to the goal; a step costs its length times the mean of n at its ends."""
    node = np.arange(free.size).reshape(free.shape)
    entries = []
    for step in itertools.product((-1, 0, 1), repeat=3):
        if step <= (0, 0, 0):
            continue  # each of the 13 axes once
        corners = itertools.product(*((0, s) if s else (0,) for s in step))
        at = [
            tuple(slice(max(-s, 0) + p, m - max(s, 0) + p) for s, p, m in zip(step, corner, free.shape, strict=True))
            for corner in corners
        ]
        passable = np.logical_and.reduce([free[part] for part in at])
        cost = float(np.linalg.norm(step)) * (n[at[0]] + n[at[-1]])[passable] / 2
        entries.append((node[at[0]][passable], node[at[-1]][passable], cost))
    rows, columns, costs = (np.concatenate(part) for part in zip(*entries, strict=True))
    graph = sparse.coo_matrix((costs, (rows, columns)), (free.size, free.size)).tocsr()
    before = dijkstra(graph, directed=False, indices=node[tuple(goal)], return_predecessors=True)[1]
    paths = []
    for start in starts:
        chain = [int(node[tuple(start)])]
        while before[chain[-1]] >= 0:
            chain.append(int(before[chain[-1]]))
        paths.append(np.stack(np.unravel_index(chain, free.shape), axis=-1).astype(np.float64))
    return paths


def tangents_of(path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every other point of a smoothed path with its direction, the ends left out."""
    smoothed = ndimage.gaussian_filter1d(path, 2.0, axis=0, mode="nearest")
    direction = np.gradient(smoothed, axis=0)
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-9)
    chosen = slice(3, -6, 2)
    return path[chosen], direction[chosen]


def padded(one: Lesson, room: int) -> tuple[np.ndarray, np.ndarray]:
    """Voxels and tangents of all demonstrations, filled up to one length so that nothing compiles twice.

    A tangent of zero marks what does not count.
    """
    voxels, tangents = (np.concatenate(part) for part in zip(*(tangents_of(path) for path in one.shown), strict=True))
    fill = room - len(voxels)
    voxels = np.concatenate([voxels, np.repeat(voxels[:1], fill, axis=0)])
    return voxels.astype(np.int32), np.concatenate([tangents, np.zeros((fill, 3))])


def _figures(path: np.ndarray, clear: np.ndarray, grid: maxjax.Grid) -> tuple[float, float, float, float]:
    """Length, mean clearance, least clearance and mean height of a path [m], sampled evenly."""
    moved = np.concatenate([[True], np.any(np.diff(path, axis=0) != 0, axis=1)])
    path = path[moved]
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    s = np.linspace(0, along[-1], 1 + int(4 * along[-1]))
    even = np.stack([np.interp(s, along, x) for x in path.T], axis=-1)
    near = ndimage.map_coordinates(clear, even.T, order=1, mode="nearest")
    height = grid.origin[2] + grid.spacing * even[:, 2].mean()
    return grid.spacing * float(along[-1]), float(near.mean()), float(near.min()), float(height)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What the figure shows."""

    grid: maxjax.Grid
    lesson: Lesson
    paths: dict[str, list[np.ndarray]]
    history: np.ndarray  # (steps, 4): loss, a, w, v


def fly(theta: Float[Array, " 3"], one: Lesson, length: float) -> tuple[Array, Array, Array]:
    """`follow`; where a dear corner of the map takes φ out of float32's range, again with ℓ longer, as the solver."""
    for attempt in range(4):
        stretched = jnp.float32(length * 1.5**attempt)
        found: tuple[Array, Array, Array] = follow(
            theta, one.town, jnp.asarray(one.goal), stretched, jnp.asarray(one.starts)
        )
        if int(found[2]) == 0:
            break
    return found


def run(config: Config) -> tuple[list[Row], Outcome]:
    """Learn, then judge on held-out problems."""
    lessons = [lesson(config, seed) for seed in config.seeds]
    room = max(sum(len(tangents_of(path)[0]) for path in one.shown) for one in lessons)
    arrays = [padded(one, room) for one in lessons]
    counted = sum(int(np.any(tangents != 0, axis=1).sum()) for _, tangents in arrays)
    length = jnp.float32(config.length)

    def look(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        parts = []
        for one, (voxels, tangents) in zip(lessons, arrays, strict=True):
            arguments = jnp.asarray(theta, jnp.float32), one.town, jnp.asarray(one.goal), length, jnp.asarray(voxels)
            value, slope = (np.asarray(x, np.float64) for x in linearized(*arguments))
            counts = np.any(tangents != 0, axis=1)
            # |b − t|² / 2 = 1 − cos for unit vectors.
            parts.append(((value - tangents)[counts].ravel(), slope[counts].reshape(-1, 3)))
        residual, jacobian = (np.concatenate(part) for part in zip(*parts, strict=True))
        return residual / np.sqrt(2 * counted), jacobian / np.sqrt(2 * counted)

    best, track = least_squares(look, np.log(config.guess), np.full(3, 0.7), config.steps)
    trace = np.array([[cost, *np.exp(theta)] for cost, theta in track])
    theta = jnp.asarray(best, jnp.float32)
    rows: list[Row] = [
        {"what": name, "guess": g, "found": round(float(f), 3), "hidden": h}
        for name, g, f, h in zip(PARAMETERS, config.guess, np.exp(theta), config.hidden, strict=True)
    ]
    rows.append(
        {"what": "training loss", "guess": round(float(trace[0, 0]), 4), "found": round(float(trace[-1, 0]), 4)}
    )
    grid = window(config)
    tests = [lesson(config, seed) for seed in config.held_out]
    nothing = jnp.log(jnp.asarray([1e-6, 1.0, 1e-6], jnp.float32))
    flown: dict[str, list[list[np.ndarray]]] = {"demonstrations": [one.shown for one in tests]}
    sure: dict[str, tuple[int, int]] = {}
    for name, parameters in (("before", nothing), ("learnt", theta), ("hidden", jnp.log(jnp.asarray(config.hidden)))):
        found = [fly(parameters, one, config.length) for one in tests]
        flown[name] = [list(np.asarray(paths, np.float64)) for paths, _, _ in found]
        sure[name] = sum(int(there.sum()) for _, there, _ in found), sum(int(stuck) == 0 for *_, stuck in found)
    for name, groups in flown.items():
        numbers = np.array(
            [_figures(path, one.clear, grid) for one, group in zip(tests, groups, strict=True) for path in group]
        )
        mean = numbers.mean(axis=0)
        rows.append(
            {
                "what": name,
                "problems": len(numbers),
                "length_m": round(float(mean[0]), 2),
                "clearance_mean_m": round(float(mean[1]), 2),
                "clearance_least_m": round(float(mean[2]), 2),
                "height_m": round(float(mean[3]), 2),
                "arrived": sure[name][0] if name in sure else None,
                "fields_certified": sure[name][1] if name in sure else None,
            }
        )
    return rows, Outcome(grid, tests[0], {name: groups[0] for name, groups in flown.items()}, trace)


def figures(outcome: Outcome, theta: np.ndarray, config: Config, folder: Path) -> None:
    """Held-out paths on the city, and the price learnt."""
    grid, one = outcome.grid, outcome.lesson
    with figure(folder / f"{NAME}.png", 7.2, 3.6) as drawn:
        plan = drawn.add_axes((0.08, 0.14, 0.44, 0.8))
        draw_city(plan, one.clear == 0, grid, 9.0)
        for name, color, dashes, label in (
            ("demonstrations", "black", "-", "demonstration (held out)"),
            ("before", COLORS[1], "--", "before learning"),
            ("learnt", COLORS[0], "-", "learnt"),
        ):
            for k, path in enumerate(outcome.paths[name]):
                x, y, _ = metres(path, grid).T
                plan.plot(x, y, color=color, linestyle=dashes, linewidth=1.0, zorder=6, label=label if k == 0 else None)
        draw_mark(plan, metres(one.goal, grid), "*", "#F0E442", "goal", 9.0)
        for start in metres(one.starts, grid):
            draw_mark(plan, start, "o", "white", None, 3.5)
        plan.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2, fontsize=6.5)
        side = drawn.add_axes((0.7, 0.62, 0.3, 0.32))
        d = np.linspace(1, 8, 50)
        for (a, w, _), color, dashes, label in (
            (config.hidden, "black", "-", "demonstrator"),
            (config.guess, COLORS[1], "--", "guess"),
            (theta, COLORS[0], "-", "learnt"),
        ):
            side.plot(2 * d, 1 + a * np.exp(-(d - 1) / w), color=color, linestyle=dashes, label=label)
        side.set(xlabel="distance to the wall [m]", ylabel="price n at z = 0")
        side.legend(fontsize=6.5)
        curve = drawn.add_axes((0.7, 0.14, 0.3, 0.3))
        curve.plot(outcome.history[:, 0], "o-", color=COLORS[0], markersize=3.0)
        curve.set(xlabel="step taken", ylabel="1 − cos, mean")


def main(config: Config) -> list[Row]:
    """Run, draw, save; a row for each parameter, then one for each way of flying the held-out problems."""
    rows, outcome = run(config)
    figures(outcome, outcome.history[-1, 1:], config, config.figures)
    save(NAME, config, rows, config.out)
    return rows


def section(document: dict[str, Any]) -> str:
    """What the JSON says, in Markdown."""
    rows = {row["what"]: row for row in document["rows"]}
    found = [rows[name] for name in (*PARAMETERS, "training loss")]
    flown = [rows[name] for name in ("demonstrations", "before", "learnt", "hidden")]
    shown, before, learnt, _ = flown
    goals = len(document["config"]["held_out"])
    head = {
        "what": "held-out paths",
        "problems": "problems",
        "length_m": "length [m]",
        "clearance_mean_m": "clearance, mean [m]",
        "clearance_least_m": "least [m]",
        "height_m": "height [m]",
        "arrived": "arrived",
        "fields_certified": f"fields certified (of {goals})",
    }
    return f"""## Learning to plan from demonstrations

Three numbers of a price field, fitted by gradient through the solver to paths of a graph search that pays for nearness
to walls and for height; judged in cities that it has not seen.

{table({"what": "parameter", "guess": "guess", "found": "found", "hidden": "demonstrator's"}, found)}

{table(head, flown)}

Learning takes the mean clearance from {before["clearance_mean_m"]:g} m to {learnt["clearance_mean_m"]:g} m (the
demonstrator's {shown["clearance_mean_m"]:g} m), the length from {before["length_m"]:g} m to {learnt["length_m"]:g} m
({shown["length_m"]:g} m), the mean height from {before["height_m"]:g} m to {learnt["height_m"]:g} m
({shown["height_m"]:g} m). "hidden" is our planner with the demonstrator's own parameters: what is left to it is the
model's, not the fit's. Paths here are not pulled taut.

![Learning](../docs/figures/{NAME}.png)
"""


if __name__ == "__main__":
    main(tyro.cli(Config))
