"""Learning to plan: recover what a demonstrator pays for, from its paths, by gradients through the solver.

    python -m experiments.differentiable.learning     # 64 x 64 x 24 voxels of 2 m; one minute on two CPU cores

The field's equation with a price n(x) per metre,

    −∇·(σ∇φ) + κ n² σ φ = q,        n = 1 + a exp(−(d − 1) / w) + v z / 10 m,

has −ℓ log φ → min ∫ n ds (Varadhan, with the metric n): n is what a metre costs at the distance d [voxels] from the
nearest wall and at the height z. The price stands in the *leak*. A conductivity that falls towards the walls, with the
leak in proportion, keeps no distance: across a straight street φ is constant then, whatever σ is.

Demonstrations are graph searches (Dijkstra, 26 neighbours, no corner cut) on a hidden (a, w, v): not paths of our
planner. The loss is the mean of 1 − cos between the demonstration's direction and ∇ log φ, which is where the planner
would head from that point. That is a sum of squares of unit vectors' differences, so Levenberg and Marquardt lower it,
with a Jacobian by (log a, log w, log v) of three derivative solves a goal. Found parameters are judged on held-out
problems in another city, where our planner climbs the learnt field, certified as any other. Paths are not pulled taut:
string pulling knows no price.

Expected: held-out clearance and height within a metre of the demonstrator's, every field certified; a, w and v within
some thirty per cent of the hidden ones.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import ndimage

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from experiments.differentiable.demonstrations import Demonstrator, Lesson, lesson, padded, tangents_of, window
from experiments.differentiable.field import (
    COLORS,
    FIGURES,
    RESULTS,
    draw_city,
    draw_mark,
    figure,
    least_squares,
    metres,
    table,
)
from experiments.differentiable.priced import follow, linearized

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


def run(config: Config) -> tuple[list[Row], Outcome]:
    """Learn, then judge on held-out problems."""
    best, trace = learn(config)
    theta = jnp.asarray(best, jnp.float32)
    rows: list[Row] = [
        {"what": name, "guess": g, "found": round(float(f), 3), "hidden": h}
        for name, g, f, h in zip(PARAMETERS, config.guess, np.exp(theta), config.hidden, strict=True)
    ]
    rows.append(
        {"what": "training loss", "guess": round(float(trace[0, 0]), 4), "found": round(float(trace[-1, 0]), 4)}
    )
    grid = window(config.shape)
    tests = [lesson(Demonstrator(config.hidden, config.demonstrations), grid, seed) for seed in config.held_out]
    nothing = jnp.log(jnp.asarray([1e-6, 1.0, 1e-6], jnp.float32))
    flown: dict[str, list[list[np.ndarray]]] = {"demonstrations": [one.shown for one in tests]}
    counts: dict[str, tuple[int, int]] = {}
    for name, parameters in (("before", nothing), ("learnt", theta), ("hidden", jnp.log(jnp.asarray(config.hidden)))):
        length = jnp.float32(config.length)
        found = [follow(parameters, one.town, jnp.asarray(one.goal), length, jnp.asarray(one.starts)) for one in tests]
        flown[name] = [list(np.asarray(paths, np.float64)) for paths, _, _ in found]
        counts[name] = sum(int(arrived.sum()) for _, arrived, _ in found), sum(int(stuck) == 0 for *_, stuck in found)
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
                "arrived": counts[name][0] if name in counts else None,
                "fields_certified": counts[name][1] if name in counts else None,
            }
        )
    return rows, Outcome(grid, tests[0], {name: groups[0] for name, groups in flown.items()}, trace)


def learn(config: Config) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "steps 4"]]:
    """The best logarithms of a, w and v, and loss, a, w, v of every step taken."""
    grid = window(config.shape)
    lessons = [lesson(Demonstrator(config.hidden, config.demonstrations), grid, seed) for seed in config.seeds]
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
    return best, np.array([[cost, *np.exp(theta)] for cost, theta in track])


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
    main(configured(TINY))
