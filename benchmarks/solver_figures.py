"""The two plots of docs/solver.md: convergence of the cycles, and cost against size.

    python -m benchmarks.solver_figures                                     # two CPU cores: 3 minutes

Convergence: problem 0 of each map and a window of a Warframe maze, as in `benchmarks.potential`. One cycle at a time
from the guess, at the screening length that `solve_potential` starts with; after each the largest relative change that
one more sweep makes, and the share of voxels whose gradient of log φ is off by more than 1° from a float64 solution by
SciPy. Row 0 is the guess, which no sweep has judged yet. Cost: the same downtown, 200 m wide, on ever finer voxels;
the whole of `solve_potential`, certificate included, after warm-up.

Results stand in results/solver_figures.json; the plots are drawn from the same rows.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int32

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, measure, save
from benchmarks.common.scenes import Instance, Selection, city_at, scenes_of
from benchmarks.common.screened_system import angles_of, blas_threads, reference_of, system, unit_diagonal
from maxjax.sim.worlds.scenes import MAPS
from maxjax.solvers.cg import screening_length_for
from maxjax.solvers.medium import Medium, Progress, medium_of, no_progress
from maxjax.solvers.newton import newton_cycles
from maxjax.solvers.screened import TOLERANCES, Screened, guess
from maxjax.ui.figures.style import PATHS, STYLE, load_matplotlib, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DOCS = Path(__file__).parents[1] / "docs"
_MARKERS = "os^Dv<"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        shape: of the grid of the convergence rows, voxels of 2 m around the origin.
        maps: maps to take problems from.
        crop: Warframe window, where the data folder exists; empty for none.
        data: folder of public inputs.
        cycles: cycles to follow.
        sizes: edges of the cubes of the cost rows.
        repeats: timed solves a size.
        margin: [m]; the Warframe window has none.
        seed: of the cities and problems.
        out: where the JSON goes.
        docs: where the plots go.
    """

    shape: tuple[int, int, int] = (101, 101, 101)
    maps: tuple[str, ...] = MAPS
    crop: str = "Complex"
    data: Path = Path(os.environ.get("MAXJAX_DATA", "../shared/data"))
    cycles: int = 16
    sizes: tuple[int, ...] = (33, 49, 65, 81, 101, 129)
    repeats: int = 9
    margin: float = 8.0
    seed: int = 0
    out: Path = RESULTS
    docs: Path = DOCS


TINY = Config(shape=(33, 33, 33), maps=("suburb",), crop="", cycles=4, sizes=(17, 25, 33), repeats=1)


def main(config: Config) -> list[Row]:
    """Measure, save the rows, draw the plots; return the rows."""
    # The scenes and cities of `benchmarks.potential`.
    same = Selection(config.shape, config.maps, config.crop, config.data, 1, config.margin, config.seed)
    # Timings first: they suffer from whatever else the process has left behind.
    cost = [_cost(edge, config) for edge in config.sizes]
    convergence = [row for scene in scenes_of(same) for row in _convergence(scene, config)]
    rows = [*convergence, *cost]
    config.docs.mkdir(parents=True, exist_ok=True)
    save("solver_figures", config, rows, config.out)
    save_figure(draw_convergence(convergence), config.docs / "solver_convergence.png")
    save_figure(draw_scaling(cost), config.docs / "solver_scaling.png")
    return rows


@jax.jit
def _start(sigma: Float[Array, "nx ny nz"], goal: Int32[Array, " 3"]) -> tuple[Medium, Progress]:
    """The padded medium and the guess, as `solve_potential` begins."""
    medium = medium_of(sigma, goal)
    length = screening_length_for(medium.distance)
    medium = Screened().prepared(medium)
    return medium, guess(medium, no_progress(medium, length))


@jax.jit
def _cycle(medium: Medium, progress: Progress) -> Progress:
    """One cycle; nothing but φ passes from one to the next, so k of them are a solve of k cycles."""
    first = dataclasses.replace(progress, iterations=jnp.int32(0), residual=jnp.full_like(progress.residual, jnp.inf))
    return newton_cycles(medium, first, tolerance=0.0, most=1)


def _convergence(scene: Instance, config: Config) -> list[Row]:
    print(f"convergence, {scene.name}", file=sys.stderr, flush=True)
    sigma, goal = scene.sigma, scene.problems[0].goal_index
    medium, progress = _start(sigma, goal)
    length = progress.length
    matrix, source, joined = system(np.asarray(sigma), np.asarray(goal), float(length))
    scale, scaled, right = unit_diagonal(matrix, source)
    exact = np.zeros(joined.shape)
    with blas_threads(1):
        exact[joined] = scale @ reference_of(scaled, right)
    exact[tuple(np.asarray(goal))] = 1.0
    angles = angles_of(exact, joined)
    inside = tuple(slice(n) for n in sigma.shape)
    rows: list[Row] = []
    residual = None
    for cycles in range(config.cycles + 1):
        if cycles:
            progress = _cycle(medium, progress)
            residual = float(progress.residual)
        values = np.where(joined, np.exp(np.asarray(progress.log_phi, np.float64)[inside]), 0)
        one, five = angles(values)
        error = np.max(np.abs(values[joined] / exact[joined] - 1))
        rows.append({
            "what": f"convergence: {scene.name}", "cycles": cycles, "residual": residual,
            "over_1deg": round(1 - one, 6), "over_5deg": round(1 - five, 6), "largest_error": float(f"{error:.4g}"),
            "screening_length": round(float(length), 3),
        })  # fmt: skip
    return rows


def _cost(edge: int, config: Config) -> Row:
    print(f"size {edge}", file=sys.stderr, flush=True)
    sigma, goal = city_at(edge, config.margin, config.seed)
    solve = functools.partial(jax.jit(maxjax.solve_potential), sigma, goal)
    timing = measure(solve, config.repeats)
    found = solve()
    return {
        "what": f"size: downtown, {edge}³", "voxels": edge**3, "unit": "ms",
        "median": round(1e3 * timing.median_s, 3), "min": round(1e3 * timing.min_s, 3),
        "max": round(1e3 * timing.max_s, 3), "n": timing.n, "compile_s": round(timing.compile_s, 2),
        "cycles": int(found.iterations), "certified": bool(found.certified),
        "screening_length": round(float(found.screening_length), 3),
    }  # fmt: skip


def draw_convergence(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Residual and share of wrong directions against cycles, a line a scene.

    Args:
        rows: of `main`, those of the convergence.

    Raises:
        ImportError: if matplotlib is missing; names the extra.
    """
    rc_context, new_figure = load_matplotlib()
    names = list(dict.fromkeys(str(row["what"]).removeprefix("convergence: ") for row in rows))
    with rc_context(STYLE):
        figure = new_figure(figsize=(7.0, 3.2), layout="constrained")
        left, right = figure.subplots(1, 2)
        for number, name in enumerate(names):
            mine = [row for row in rows if row["what"] == f"convergence: {name}"]
            color, dashes = PATHS[number % len(PATHS)]
            style: dict[str, Any] = {
                "color": color, "linestyle": dashes, "linewidth": 1.2, "marker": _MARKERS[number % len(_MARKERS)],
                "markersize": 3.0,
            }  # fmt: skip
            for axes, key, factor in ((left, "residual", 1.0), (right, "over_1deg", 100.0)):
                # No line to where there is no number or, on a logarithmic axis, none but zero.
                shown = [(row["cycles"], factor * row[key]) for row in mine if row[key]]
                axes.plot(*zip(*shown, strict=True) if shown else ([], []), label=name, **style)
        tolerance = TOLERANCES[4]
        left.axhline(tolerance, color="black", linewidth=0.7, linestyle=":")
        left.annotate(
            "default tolerance", (1.0, tolerance), (-2, 2), xycoords=("axes fraction", "data"),
            textcoords="offset points", ha="right", va="bottom",
        )  # fmt: skip
        right.axhline(5.0, color="black", linewidth=0.7, linestyle=":")
        right.annotate(
            "5 %", (1.0, 5.0), (-2, 2), xycoords=("axes fraction", "data"), textcoords="offset points", ha="right",
            va="bottom",
        )  # fmt: skip
        left.set(xlabel="Cycles", ylabel="Largest relative change by one sweep", yscale="log")
        right.set(xlabel="Cycles", ylabel="Voxels more than 1° off [%]", yscale="log")
        for axes in (left, right):
            axes.xaxis.get_major_locator().set_params(integer=True)
            axes.grid(color="#DDDDDD", linewidth=0.4)
        left.legend()
    return figure


def draw_scaling(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Run time against voxels, with cycles at each point and a line of slope 1.

    Args:
        rows: of `main`, those of the cost.

    Raises:
        ImportError: if matplotlib is missing; names the extra.
    """
    rc_context, new_figure = load_matplotlib()
    voxels, median, low, high = (np.array([row[key] for row in rows]) for key in ("voxels", "median", "min", "max"))
    with rc_context(STYLE):
        figure = new_figure(figsize=(4.8, 3.4), layout="constrained")
        axes = figure.subplots()
        color, _ = PATHS[1]
        axes.errorbar(
            voxels, median, yerr=(median - low, high - median), color=color, marker="o", markersize=4.0, linewidth=1.2,
            capsize=2.5, label="solve and certificate: median, least, largest",
        )  # fmt: skip
        # Through the largest, so that what smaller grids pay beyond their share lies above it.
        slope = median[-1] * voxels / voxels[-1]
        axes.plot(voxels, slope, color="black", linewidth=0.8, linestyle=":", label="slope 1")
        for row in rows:
            edge = str(row["what"]).split()[-1]
            axes.annotate(
                f"{edge}\n{row['cycles']} cycles", (row["voxels"], row["median"]), (5, -4), textcoords="offset points",
                ha="left", va="top", fontsize=7,
            )  # fmt: skip
        axes.set_xlim(0.7 * voxels[0], 2.2 * voxels[-1])
        axes.margins(y=0.12)
        axes.set(xlabel="Voxels", ylabel="Time a solve [ms]", xscale="log", yscale="log")
        axes.grid(color="#DDDDDD", linewidth=0.4)
        axes.legend(loc="upper left")
    return figure


if __name__ == "__main__":
    main(configured(TINY))
