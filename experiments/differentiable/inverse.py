"""Inverse: the footprint of a building that nobody has seen, from a few potentials measured around it.

    python -m experiments.differentiable.inverse     # 40 x 40 x 16 voxels of 2 m; 5 minutes on two CPU cores

Current flows around what does not conduct, so log φ in the streets tells of a building that is missing from the map.
One current source; m probes at random free places of a downtown window measure log φ with an error of 0.01. Unknown are
five numbers of an upright box: middle x, y, logarithms of the half widths, and yaw (its height is given):

    θ = argmin Σ_k ( log φ_θ(s_k) − y_k )² / ε²  +  Σ_j ( (θ_j − θ⁰_j) / τ_j )²,

by Gauss-Newton steps (Levenberg-Marquardt), whose Jacobian is five forward derivatives through the solver. The prior τ
around the guess θ⁰ is weak; it decides where probes are fewer than unknowns. The model's box has smooth edges, half a
voxel wide, since a voxel map has no derivative by where a wall is; the measured one is made of whole voxels, by its
exact box, so no model hits the data; hence ε = 0.06, what the model misses by at the true box.

Expected: intersection over union of the footprints 0.4 for the guess, about 0.8 from 24 probes on; with fewer probes
than about ten, hardly better than the guess.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from experiments.differentiable.field import (
    COLORS,
    FIGURES,
    RESULTS,
    draw_city,
    draw_mark,
    figure,
    free_points,
    heights,
    least_squares,
    log_potential,
    metres,
    table,
)
from maxjax.sim.worlds.geoms import BOX, Geoms
from maxjax.sim.worlds.scenes import make_scene, occupancy

NAME = "differentiable_inverse"
# Half the width of the model's edges [voxels], and what its box conducts beside free space.
_EDGE, _LEAST = 0.5, 1e-4


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        seed: of the city (downtown), the probes and their errors.
        shape: voxels of the window around the building.
        probes: how many are used, in turn.
        draws: of the places of the probes, of the errors and of the guess.
        error: of a measured log φ.
        trust: ε, what is allowed for: that error, and the model's.
        length: ℓ [voxels].
        steps: of Gauss-Newton.
        out, figures: where JSON and figure go.
    """

    seed: int = 0
    shape: tuple[int, int, int] = (40, 40, 16)
    probes: tuple[int, ...] = (4, 8, 16, 32)
    draws: int = 4
    error: float = 0.01
    trust: float = 0.06
    length: float = 6.0
    steps: int = 16
    out: Path = RESULTS
    figures: Path = FIGURES


TINY = Config(shape=(24, 24, 14), probes=(12,), draws=1, steps=4, length=4.0)

# Of the guess and of the prior: x, y [voxels], log half widths, yaw [rad].
_SPREAD = np.array([4.0, 4.0, 0.4, 0.4, 0.3])


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Site:
    """What is known before measuring.

    Attributes:
        sigma: conductivity without the building.
        goal: voxel of the current source.
        top: of the building [voxels].
        length: ℓ [voxels].
    """

    sigma: Float[Array, "nx ny nz"]
    goal: Int32[Array, " 3"]
    top: Float[Array, ""]
    length: Float[Array, ""]


def conductivity_with(theta: Float[Array, " 5"], site: Site) -> Float[Array, "nx ny nz"]:
    """σ of the site with a box of smooth edges on it."""
    x, y, z = (jnp.arange(n, dtype=theta.dtype) for n in site.sigma.shape)
    along, across = x[:, None] - theta[0], y[None] - theta[1]
    c, s = jnp.cos(theta[4]), jnp.sin(theta[4])
    half = jnp.exp(theta[2:4])
    outside = jnp.maximum(jnp.abs(c * along + s * across) - half[0], jnp.abs(c * across - s * along) - half[1])
    deep = jnp.maximum(outside[:, :, None], z - site.top)
    return site.sigma * (_LEAST + (1 - _LEAST) * jax.nn.sigmoid(2 * deep / _EDGE))


def predicted(theta: Float[Array, " 5"], site: Site, probes: Int32[Array, "m 3"]) -> Float[Array, " m"]:
    """What the probes measure."""
    return log_potential(conductivity_with(theta, site), site.goal, site.length, probes)


@jax.jit
def linearized(
    theta: Float[Array, " 5"], site: Site, probes: Int32[Array, "m 3"]
) -> tuple[Float[Array, " m"], Float[Array, "m 5"]]:
    """`predicted` and its Jacobian: one solve, and a derivative solve for each unknown."""
    value, push = jax.linearize(lambda theta: predicted(theta, site, probes), theta)
    return value, jax.vmap(push, out_axes=1)(jnp.eye(5, dtype=theta.dtype))


def fit(
    site: Site, probes: np.ndarray, measured: np.ndarray, used: np.ndarray, guess: np.ndarray, config: Config
) -> np.ndarray:
    """Levenberg-Marquardt from the guess; probes that are not `used` have no weight."""
    weight = used / config.trust

    def look(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, slope = linearized(jnp.asarray(theta, jnp.float32), site, jnp.asarray(probes))
        misfit = np.concatenate([weight * (np.asarray(value) - measured), (theta - guess) / _SPREAD])
        return misfit, np.concatenate([weight[:, None] * np.asarray(slope, np.float64), np.diag(1 / _SPREAD)])

    return least_squares(look, guess, _SPREAD, config.steps)[0]


def footprint(theta: np.ndarray, shape: tuple[int, ...], fine: int = 8) -> Bool[np.ndarray, "..."]:
    """The footprint, sampled `fine` times a voxel along each axis."""
    x, y = ((np.arange(n * fine) + 0.5) / fine - 0.5 for n in shape[:2])
    along, across = x[:, None] - theta[0], y[None] - theta[1]
    c, s = np.cos(theta[4]), np.sin(theta[4])
    a, b = np.exp(theta[2:4])
    return np.asarray((np.abs(c * along + s * across) <= a) & (np.abs(c * across - s * along) <= b))


def overlap(theta: np.ndarray, truth: np.ndarray, shape: tuple[int, ...]) -> float:
    """Intersection over union of two footprints."""
    ours, theirs = footprint(theta, shape), footprint(truth, shape)
    return float((ours & theirs).sum() / (ours | theirs).sum())


@dataclasses.dataclass(frozen=True)
class Survey:
    """One building taken off the map, and what can be measured around it."""

    grid: maxjax.Grid
    site: Site
    truth: np.ndarray
    known: np.ndarray
    places: np.ndarray
    log_phi: np.ndarray


def survey(config: Config) -> Survey:
    """The tallest building of medium size near the middle of the city is the one that nobody has seen."""
    geoms = make_scene("downtown", config.seed).geoms
    position, rotation, size = (np.asarray(a, np.float64) for a in (geoms.position, geoms.rotation, geoms.size))
    boxes = (np.array(geoms.type) == BOX) & (size[:, :2].min(axis=1) > 5) & (size[:, :2].max(axis=1) < 16)
    boxes &= (np.abs(position[:, 2] - size[:, 2]) < 0.5) & (np.linalg.norm(position[:, :2], axis=1) < 60)
    hidden = int(np.argmax(np.where(boxes, size[:, 2], -np.inf)))
    nx, ny, nz = config.shape
    corner = np.floor(position[hidden, :2] / 2) * 2 - (nx - 1, ny - 1)
    grid = maxjax.Grid(config.shape, 2.0, (float(corner[0]), float(corner[1]), -1.0))
    others = np.arange(len(geoms.type)) != hidden
    kept = Geoms(
        geoms.position[others],
        geoms.rotation[others],
        geoms.size[others],
        tuple(t for t, k in zip(geoms.type, others, strict=True) if k),
    )
    known, _ = occupancy(kept, grid)
    middle = (position[hidden] - np.asarray(grid.origin)) / grid.spacing
    half = size[hidden, :2] / grid.spacing
    yaw = np.arctan2(rotation[hidden, 1, 0], rotation[hidden, 0, 0])
    truth = np.array([*middle[:2], *np.log(half), yaw])
    top = middle[2] + size[hidden, 2] / grid.spacing
    # By centres of voxels: the exact rasteriser fills every voxel that is touched, half a voxel too many a side.
    column = footprint(truth, grid.shape, fine=1)
    solid = column[:, :, None] & (np.arange(nz) <= top)
    rng = np.random.default_rng([config.seed, 1])
    places = free_points(rng, ~(known | solid), heights(grid, 3.0, 15.0), 2000)
    reach = 2.2 * float(np.exp(truth[2:4]).max())
    apart = np.linalg.norm(places[:, :2] - truth[:2], axis=1)
    goal = places[np.argmin(np.abs(apart - 1.2 * reach))]
    places = places[(apart < reach) & (np.linalg.norm(places - goal, axis=1) > 3)]
    sigma = maxjax.conductivity(jnp.asarray(known), jnp.asarray(goal), grid)
    site = Site(sigma, jnp.asarray(goal), jnp.float32(top), jnp.float32(config.length))
    log_phi = log_potential(jnp.where(jnp.asarray(solid), 0, sigma), site.goal, site.length, jnp.asarray(places))
    return Survey(grid, site, truth, known, places, np.asarray(log_phi, np.float64))


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What the figure shows."""

    survey: Survey
    scores: dict[int, list[float]]
    shown: tuple[np.ndarray, np.ndarray, np.ndarray]  # guess, found, probes used of one draw


def run(config: Config) -> tuple[list[Row], Outcome]:
    """Fit every draw with every number of probes."""
    known = survey(config)
    most = max(config.probes)
    shape, truth, spacing = known.grid.shape, known.truth, known.grid.spacing
    scores: dict[int, list[float]] = {0: [], **{m: [] for m in config.probes}}
    errors: dict[int, list[tuple[float, float]]] = {m: [] for m in scores}
    shown: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    for draw in range(config.draws):
        rng = np.random.default_rng([config.seed, 2, draw])
        chosen = rng.permutation(len(known.places))[:most]
        probes = known.places[chosen]
        measured = known.log_phi[chosen] + config.error * rng.normal(size=most)
        guess = truth + _SPREAD * rng.uniform(-1.0, 1.0, 5)
        found = {0: guess}
        for m in config.probes:
            found[m] = fit(known.site, probes, measured, np.arange(most) < m, guess, config)
            if draw == 0 and m == sorted(config.probes)[len(config.probes) // 2]:
                shown = guess, found[m], probes[:m]
        for m, theta in found.items():
            scores[m].append(overlap(theta, truth, shape))
            middle = spacing * float(np.linalg.norm(theta[:2] - truth[:2]))
            width = 2 * spacing * float(np.abs(np.exp(theta[2:4]) - np.exp(truth[2:4])).mean())
            errors[m].append((middle, width))
    assert shown is not None
    rows: list[Row] = [
        {
            "probes": m,
            "draws": config.draws,
            "iou_mean": round(float(np.mean(scores[m])), 3),
            "iou_least": round(float(np.min(scores[m])), 3),
            "middle_error_m": round(float(np.mean([e[0] for e in errors[m]])), 2),
            "width_error_m": round(float(np.mean([e[1] for e in errors[m]])), 2),
        }
        for m in scores
    ]
    return rows, Outcome(known, scores, shown)


def corners(theta: np.ndarray, grid: maxjax.Grid) -> Float[np.ndarray, "5 2"]:
    """The outline of a footprint [m], closed."""
    c, s = np.cos(theta[4]), np.sin(theta[4])
    a, b = np.exp(theta[2:4])
    local = np.array([[a, b], [-a, b], [-a, -b], [a, -b], [a, b]])
    turned = local @ np.array([[c, s], [-s, c]]) + theta[:2]
    return np.asarray(np.asarray(grid.origin[:2]) + grid.spacing * turned)


def figures(outcome: Outcome, folder: Path) -> None:
    """One survey with its footprints, and overlap against the number of probes."""
    known, grid = outcome.survey, outcome.survey.grid
    guess, found, probes = outcome.shown
    with figure(folder / f"{NAME}.png", 7.2, 3.4) as drawn:
        plan = drawn.add_axes((0.08, 0.14, 0.44, 0.8))
        draw_city(plan, known.known & (np.arange(grid.shape[2]) > 1), grid, 10.0)
        for theta, color, dashes, label in (
            (known.truth, "black", "-", "unseen building"),
            (guess, COLORS[1], "--", "guess"),
            (found, COLORS[0], "-", f"found, {len(probes)} probes"),
        ):
            plan.plot(*corners(theta, grid).T, color=color, linestyle=dashes, linewidth=1.6, zorder=6, label=label)
        plan.plot(
            *metres(probes, grid)[:, :2].T, "o", color=COLORS[5], markeredgecolor="black", markersize=4.5, zorder=7,
            label="probe",
        )  # fmt: skip
        draw_mark(plan, metres(np.asarray(known.site.goal), grid), "*", "#F0E442", "current source", 9.0)
        plan.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3, fontsize=6.5)
        side = drawn.add_axes((0.7, 0.16, 0.3, 0.74))
        counts = list(outcome.scores)
        for k, m in enumerate(counts):
            scores = outcome.scores[m]
            side.plot(np.full(len(scores), k), scores, "o", color=COLORS[1], markersize=3.5, alpha=0.7)
        means = [float(np.mean(outcome.scores[m])) for m in counts]
        side.plot(range(len(counts)), means, "-", color=COLORS[0], label="mean")
        side.set(xlabel="probes", ylabel="intersection over union", ylim=(0, 1))
        side.set_xticks(range(len(counts)), ["guess" if m == 0 else str(m) for m in counts])
        side.legend(loc="lower right")


def main(config: Config) -> list[Row]:
    """Run, draw, save; a row for each number of probes."""
    rows, outcome = run(config)
    figures(outcome, config.figures)
    save(NAME, config, rows, config.out)
    return rows


def section(document: dict[str, Any]) -> str:
    """What the JSON says, in Markdown."""
    rows, config = document["rows"], document["config"]
    guess, most = rows[0], rows[-1]
    head = {
        "probes": "probes (0: the guess)",
        "iou_mean": "intersection over union, mean",
        "iou_least": "least",
        "middle_error_m": "error of the middle [m]",
        "width_error_m": "error of the widths [m]",
    }
    return f"""## Inverse: the footprint of an unseen building

A building is missing from the map; probes in the streets around it measure log φ with an error of
{config["error"]:g}. Gauss-Newton through the solver finds its box, from {most["draws"]} random guesses with as many
draws of probes.

{table(head, rows)}

With {most["probes"]} probes the overlap rises from {guess["iou_mean"]:g} to {most["iou_mean"]:g} on average
({most["iou_least"]:g} at worst); the middle is off by {most["middle_error_m"]:g} m, a voxel being 2 m wide.

![Inverse](../docs/figures/{NAME}.png)
"""


if __name__ == "__main__":
    main(configured(TINY))
