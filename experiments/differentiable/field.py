"""What the differentiable experiments share: the log-potential at a few voxels, and how cities are drawn.

    D(s) = −ℓ log φ(s)

tends to the geodesic distance from s to the goal as ℓ falls (Varadhan), and has what a planned length has not: a
derivative by the conductivity of every voxel of the map, for the price of one adjoint solve.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32
from scipy import ndimage

import maxjax
from benchmarks.common import markdown
from maxjax.core.files import atomic_write
from maxjax.sim.worlds.scenes import make_scene, occupancy
from maxjax.solvers.derivative import TIGHT_TOLERANCE
from maxjax.ui.figures import marks, plan_view, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLORS = tuple(color for color, _ in style.PATHS)

FIGURES = Path(__file__).parents[2] / "docs" / "figures"
RESULTS = Path(__file__).parents[1] / "results"


@jax.jit
def log_volume(
    sigma: Float[Array, "nx ny nz"], goal: Int32[Array, " 3"], screening_length: Float[Array, ""]
) -> Float[Array, "nx ny nz"]:
    """Return log φ; differentiable in sigma and screening_length.

    The tolerance is that of a derivative for the value too, so that both speak of the same φ. Called from outside of
    `jit`, it is compiled once for all losses on one shape.
    """
    solver = maxjax.Screened(tolerance=TIGHT_TOLERANCE[sigma.dtype.itemsize])
    return maxjax.solve_potential(sigma, goal, screening_length=screening_length, solver=solver).log_phi


def log_potential(
    sigma: Float[Array, "nx ny nz"],
    goal: Int32[Array, " 3"],
    screening_length: Float[Array, ""],
    voxels: Int32[Array, "n 3"],
) -> Float[Array, " n"]:
    """`log_volume` at some voxels."""
    return jnp.asarray(log_volume(sigma, goal, screening_length))[voxels[:, 0], voxels[:, 1], voxels[:, 2]]


def least_squares(
    look: Callable[[Float[np.ndarray, " p"]], tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n p"]]],
    guess: Float[np.ndarray, " p"],
    reach: Float[np.ndarray, " p"],
    steps: int,
) -> tuple[Float[np.ndarray, " p"], list[tuple[float, Float[np.ndarray, " p"]]]]:
    """Levenberg and Marquardt: (JᵀJ + λ diag JᵀJ) δ = −Jᵀ r, λ by fives, up or down as a step fails or not.

    Args:
        look: parameters ↦ residual and Jacobian.
        guess: where to begin.
        reach: no step goes further than this along any axis.
        steps: looks after the first.

    Returns:
        The best parameters, and cost |r|² and parameters of every step taken.
    """

    def weigh(theta: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        r, jacobian = look(theta)
        return float(r @ r), jacobian.T @ jacobian, jacobian.T @ r

    theta, damping = guess, 1.0
    cost, normal, pull = weigh(theta)
    track = [(cost, theta)]
    for _ in range(steps):
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -pull)
        step *= min(1.0, 1 / np.max(np.abs(step / reach)))
        trial = weigh(theta + step)
        if trial[0] < cost:
            theta, (cost, normal, pull), damping = theta + step, trial, damping / 5
            track.append((cost, theta))
        else:
            damping *= 5
    return theta, track


def free_points(
    rng: np.random.Generator, free: Bool[np.ndarray, "nx ny nz"], where: Bool[np.ndarray, "nx ny nz"], count: int
) -> Int32[np.ndarray, "n 3"]:
    """Different voxels of the largest free component that lie in `where`.

    Raises:
        ValueError: where there are fewer of them.
    """
    labels, found = ndimage.label(free)
    largest = labels == 1 + int(np.argmax(np.bincount(labels.ravel(), minlength=found + 1)[1:]))
    voxels = np.argwhere(largest & where)
    if len(voxels) < count:
        raise ValueError(f"where: expected at least {count} free voxels, given {len(voxels)}")
    return voxels[rng.permutation(len(voxels))[:count]].astype(np.int32)


def city(name: str, seed: int, grid: maxjax.Grid) -> tuple[np.ndarray, np.ndarray]:
    """Exact occupancy of a generated city, and its ground."""
    return occupancy(make_scene(name, seed).geoms, grid)


def heights(grid: maxjax.Grid, low: float, high: float) -> Bool[np.ndarray, "nx ny nz"]:
    """Voxels whose centre lies between two heights [m]."""
    z = grid.origin[2] + grid.spacing * np.arange(grid.shape[2])
    return np.broadcast_to((z >= low) & (z <= high), grid.shape)


def metres(voxels: np.ndarray, grid: maxjax.Grid) -> Float[np.ndarray, "..."]:
    """Index coordinates as world coordinates [m]."""
    return np.asarray(grid.origin) + grid.spacing * np.asarray(voxels, np.float64)


@contextlib.contextmanager
def figure(path: Path, width: float, height: float) -> Iterator[Figure]:
    """A figure in the style of `maxjax.ui.figures`, written as a PNG of 150 dots an inch when its block ends."""
    rc_context, new_figure = style.load_matplotlib()
    with rc_context(style.STYLE):
        drawn = new_figure(figsize=(width, height))
        yield drawn
        buffer = io.BytesIO()
        drawn.savefig(buffer, format="png", dpi=150, bbox_inches="tight", pad_inches=0.05)
    path.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(path, buffer.getvalue())


def draw_city(
    axes: Axes,
    obstacle: Bool[np.ndarray, "nx ny nz"],
    grid: maxjax.Grid,
    altitude: float,
    around: np.ndarray | None = None,
) -> None:
    """The plan view of `maxjax.ui.figures`, of the whole grid or of a square around some points [m]."""
    lower, upper = np.array(grid.lower[:2]), np.array(grid.upper[:2])
    if around is not None:
        low, high = around[:, :2].min(axis=0), around[:, :2].max(axis=0)
        reach = (high - low).max() / 2 + 16
        # A square, moved inwards where it would leave the map.
        middle = np.clip((low + high) / 2, np.minimum(lower + reach, 0), np.maximum(upper - reach, 0))
        lower, upper = np.maximum(lower, middle - reach), np.minimum(upper, middle + reach)
    bar = axes.inset_axes((1.02, 0.0, 0.02, 1.0))
    plan_view.draw_plan(axes, bar, maxjax.VoxelMap.on(grid, obstacle), (lower, upper), altitude)


def draw_mark(axes: Axes, point: np.ndarray, marker: str, color: str, label: str | None, size: float = 8.0) -> None:
    """A mark with a black edge."""
    marks.draw_mark(axes, float(point[0]), float(point[1]), marks.Mark(marker, size, color, label))


def table(columns: Mapping[str, str], rows: Iterable[Mapping[str, object]]) -> str:
    """Rows as a Markdown table: heading by key, in order."""

    def cell(value: object) -> str:
        return "–" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)

    lines = [[cell(row.get(key)) for key in columns] for row in rows]
    return markdown.table(list(columns.values()), lines, left=len(columns)).rstrip()
