"""Sensitivity: where would an obstacle change this path most?

    python -m experiments.differentiable.sensitivity     # 101³ voxels of 2 m; 4 minutes on two CPU cores

The planner sees the map dilated by its margin, B(v) being the ball of voxels that an obstacle at v blocks. To first
order an obstacle there lengthens the path D = −ℓ log φ(start) by

    S(v) = − Σ_{u ∈ B(v)} g_u,        g = ∂D / ∂ log σ,

so one adjoint solve and one convolution give the whole map: a million obstacles at the price of two solves. (Σ g = 0
over the map: only the shape of σ counts, hence S has both signs; what is far from the path counts little.) First order
is too small where an obstacle closes a passage, but it ranks.

Checked by doing it: obstacles are put at the strongest places, far enough from each other, and at places drawn at
random over the ranks; each time the path is planned anew and measured. Ends keep a clear distance, since what encloses
an end says nothing of the way.

Expected: the strongest places lengthen the path by metres, places drawn at random from free space by nearly nothing;
a rank correlation of 0.8 or more between S and the change of D.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32
from scipy import signal, stats

import maxjax
from benchmarks.common.command import configured
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
    log_potential,
    metres,
    table,
)

NAME = "differentiable_sensitivity"


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        map, seed: the city.
        shape: voxels of 2 m.
        margin: [m].
        apart: least and largest distance between start and goal [voxels].
        length: ℓ [voxels].
        strongest, others: places at which an obstacle is tried.
        out, figures: where JSON and figure go.
    """

    map: str = "downtown"
    seed: int = 0
    shape: tuple[int, int, int] = (101, 101, 101)
    margin: float = 4.0
    apart: tuple[float, float] = (45.0, 60.0)
    length: float = 2.0
    strongest: int = 10
    others: int = 30
    out: Path = RESULTS
    figures: Path = FIGURES


TINY = Config(shape=(24, 24, 14), margin=2.0, apart=(8.0, 16.0), strongest=2, others=4)


def lengthening(
    sigma: Float[Array, "nx ny nz"],
    goal: Int32[Array, " 3"],
    start: Int32[Array, " 3"],
    length: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, "nx ny nz"]]:
    """D [voxels] and g = ∂D/∂ log σ [voxels], 0 in walls."""

    def distance(sigma: Float[Array, "nx ny nz"]) -> Float[Array, ""]:
        return -length * log_potential(sigma, goal, length, start[None])[0]

    value, slope = jax.value_and_grad(distance)(sigma)
    return value, slope * sigma


def ball(radius: float) -> Float[np.ndarray, "k k k"]:
    """Voxels within a radius [voxels]."""
    reach = int(radius)
    offset = np.arange(-reach, reach + 1)
    squared = offset[:, None, None] ** 2 + offset[None, :, None] ** 2 + offset[None, None, :] ** 2
    return (squared <= radius**2 + 1e-4).astype(np.float64)


@dataclasses.dataclass(frozen=True)
class Crossing:
    """A start and a goal in a city.

    Attributes:
        config: settings.
        grid: of the volumes.
        occupied, ground: voxels.
        start, goal: voxels.
    """

    config: Config
    grid: maxjax.Grid
    occupied: Bool[np.ndarray, "nx ny nz"]
    ground: Bool[np.ndarray, "nx ny nz"]
    start: Int32[np.ndarray, " 3"]
    goal: Int32[np.ndarray, " 3"]

    def planned(self, occupied: Bool[np.ndarray, "nx ny nz"]) -> maxjax.Plan:
        """The plan where these voxels are occupied."""
        points = metres(self.start, self.grid)[None], metres(self.goal, self.grid)
        where = maxjax.VoxelMap.on(self.grid, np.asarray(self.blocked(occupied)))
        return maxjax.plan_to_goal(where, *points, distances=maxjax.Distances(0.0, 0.0))[0]

    def blocked(self, occupied: Bool[np.ndarray, "nx ny nz"]) -> Bool[Array, "nx ny nz"]:
        """These voxels, dilated."""
        return maxjax.dilate(jnp.asarray(occupied), self.config.margin, self.grid, jnp.asarray(self.ground))

    def sigma(self, occupied: Bool[np.ndarray, "nx ny nz"]) -> Float[Array, "nx ny nz"]:
        """The conductivity where these voxels are occupied."""
        return maxjax.conductivity(self.blocked(occupied), jnp.asarray(self.goal), self.grid)

    def distance(self, occupied: Bool[np.ndarray, "nx ny nz"]) -> float:
        """D where these voxels are occupied [voxels]."""
        length = jnp.float32(self.config.length)
        at = jnp.asarray(self.start)[None]
        return float(-length * log_potential(self.sigma(occupied), jnp.asarray(self.goal), length, at)[0])


def drawn(config: Config, rng: np.random.Generator) -> Crossing:
    """Of a hundred pairs of points in a city, the one with most walls between them: a path that has to turn."""
    nx, ny, nz = config.shape
    grid = maxjax.Grid(config.shape, 2.0, (1.0 - nx, 1.0 - ny, -1.0 if nz < 101 else -99.0))
    occupied, ground = city(config.map, config.seed, grid)
    free = ~np.asarray(maxjax.dilate(jnp.asarray(occupied), config.margin, grid, jnp.asarray(ground)))
    ends = free_points(rng, free, heights(grid, 3.0, 15.0), 200)
    gap = np.linalg.norm(ends[:, None] - ends[None], axis=-1)
    pairs = np.argwhere((gap >= config.apart[0]) & (gap <= config.apart[1]))[:100]
    lines = np.round(np.linspace(ends[pairs[:, 0]], ends[pairs[:, 1]], 200)).astype(int)
    start, goal = ends[pairs[np.argmax((~free)[tuple(np.moveaxis(lines, -1, 0))].sum(axis=0))]]
    return Crossing(config, grid, occupied, ground, start, goal)


def run(config: Config) -> tuple[list[Row], Outcome]:
    """One map of the sensitivity, and what obstacles really do."""
    rng = np.random.default_rng([config.seed, 4])
    flight = drawn(config, rng)
    grid, occupied, length = flight.grid, flight.occupied, jnp.float32(config.length)
    before, slope = lengthening(flight.sigma(occupied), jnp.asarray(flight.goal), jnp.asarray(flight.start), length)
    radius = config.margin / grid.spacing
    strength = -signal.fftconvolve(np.asarray(slope, np.float64), ball(radius), mode="same")
    # An obstacle may stand in any voxel that is free itself and far enough from both ends.
    voxels = np.moveaxis(np.indices(grid.shape), 0, -1)
    off = np.minimum(*(np.linalg.norm(voxels - end, axis=-1) for end in (flight.start, flight.goal)))
    candidates = ~occupied & (off > 2 * radius + 2)
    places = _places(rng, np.where(candidates, strength, -np.inf), config, radius)
    reference = flight.planned(occupied)
    assert reference.status == maxjax.Status.OK, reference.status
    plans, changes = [], []
    for place in places:
        changed = occupied.copy()
        changed[tuple(place)] = True
        plans.append(flight.planned(changed))
        changes.append(grid.spacing * (flight.distance(changed) - float(before)))
    predicted = grid.spacing * strength[tuple(places.T)]
    measured = np.stack([changes, [plan.length - reference.length for plan in plans]])
    kept = np.array([plan.status == maxjax.Status.OK for plan in plans])
    rows = _rows(predicted, measured, kept, config)
    rows[-1] = {**rows[-1], "path_m": round(float(reference.length), 2), **_correlations(predicted, measured, kept)}
    worst = plans[int(np.argmax(np.where(kept, measured[1], -np.inf)))]
    strength = np.where(candidates, strength, np.nan)
    return rows, Outcome(flight, strength, places, predicted, measured, reference.path, worst.path)


def _rows(
    predicted: Float[np.ndarray, " n"], measured: Float[np.ndarray, "2 n"], kept: Bool[np.ndarray, " n"], config: Config
) -> list[Row]:
    """A row for each way of choosing places, and one for all of them; means over those that kept the margin."""
    kind = np.repeat(["strongest", "drawn over the ranks", "drawn from free space"], _counts(config))
    field, longer = measured
    rows: list[Row] = []
    for name in dict.fromkeys(kind.tolist()):
        chosen = (kind == name) & kept
        rows.append(
            {
                "places": str(name),
                "count": int((kind == name).sum()),
                "same_margin": int(chosen.sum()),
                "predicted_m": round(float(predicted[chosen].mean()), 3),
                "field_change_m": round(float(field[chosen].mean()), 3),
                "path_change_mean_m": round(float(longer[chosen].mean()), 3),
                "path_change_most_m": round(float(longer[chosen].max()), 3),
            }
        )
    return [*rows, {"places": "all", "count": len(kept), "same_margin": int(kept.sum())}]


def _correlations(predicted: np.ndarray, measured: np.ndarray, kept: np.ndarray) -> dict[str, float]:
    """Rank correlation of the prediction with the change of the field and of the path."""
    field, path = (round(float(stats.spearmanr(predicted[kept], change[kept])[0]), 3) for change in measured)
    return {"rank_correlation_field": field, "rank_correlation_path": path}


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What the figure shows: places in voxels, paths in metres."""

    flight: Crossing
    strength: np.ndarray
    places: np.ndarray
    predicted: np.ndarray
    measured: np.ndarray
    path: np.ndarray
    detour: np.ndarray


def _counts(config: Config) -> tuple[int, int, int]:
    return config.strongest, config.others - config.others // 3, config.others // 3


def _places(rng: np.random.Generator, strength: np.ndarray, config: Config, radius: float) -> np.ndarray:
    """The strongest places, two margins apart; places from each part of the ranks; places drawn from all."""
    best, ranked, drawn = _counts(config)
    order = np.argsort(strength, axis=None)[::-1]
    order = order[np.isfinite(strength.ravel()[order])]
    chosen: list[np.ndarray] = []
    for flat in order:
        place = np.array(np.unravel_index(flat, strength.shape))
        if all(np.linalg.norm(place - other) > 2 * radius for other in chosen):
            chosen.append(place)
        if len(chosen) == best:
            break
    # Ranks on a logarithmic scale: most of the map is far from the path.
    ranks = np.exp(rng.uniform(0, np.log(len(order)), ranked)).astype(int) - 1
    flat = np.concatenate([order[ranks], rng.choice(order, drawn)])
    return np.concatenate([np.array(chosen), np.stack(np.unravel_index(flat, strength.shape), axis=-1)])


def figures(outcome: Outcome, folder: Path) -> None:
    """The map of the sensitivity on the city, and prediction against what happened."""
    from matplotlib.colors import LinearSegmentedColormap

    flight, grid, path = outcome.flight, outcome.flight.grid, outcome.path
    with figure(folder / f"{NAME}.png", 7.2, 3.6) as drawn:
        plan = drawn.add_axes((0.08, 0.14, 0.42, 0.76))
        draw_city(plan, flight.occupied & ~flight.ground, grid, float(np.median(path[:, 2])), path)
        best = np.nanmax(np.where(np.isnan(outcome.strength), -np.inf, outcome.strength), axis=2)
        seen = np.where(best > 0.01 * best.max(), grid.spacing * best, np.nan)
        (x0, y0, _), (x1, y1, _) = grid.lower, grid.upper
        hot = LinearSegmentedColormap.from_list("hot", ("#F0E44200", "#E69F00", "#D55E00"))
        image = plan.imshow(seen.T, origin="lower", extent=(x0, x1, y0, y1), cmap=hot, alpha=0.85, zorder=3)
        drawn.colorbar(image, ax=plan, orientation="horizontal", pad=0.17, label="lengthening by an obstacle, S [m]")
        plan.plot(*path[:, :2].T, color=COLORS[1], linewidth=1.6, zorder=6, label="path")
        plan.plot(
            *outcome.detour[:, :2].T, color="black", linewidth=0.9, linestyle="--", zorder=6, label="worst detour"
        )
        draw_mark(plan, path[0], "o", "white", "start", 5.5)
        draw_mark(plan, path[-1], "*", "#F0E442", "goal", 9.0)
        for place in metres(outcome.places[:3], grid):
            draw_mark(plan, place, "X", COLORS[3], None, 6.0)
        plan.legend(loc="lower center", bbox_to_anchor=(0.55, 1.0), ncols=3, fontsize=6.5)
        side = drawn.add_axes((0.7, 0.2, 0.3, 0.7))
        drawn_from = np.maximum(outcome.predicted, 1e-4)
        for values, marker, color, label in (
            (outcome.measured[0], "o", COLORS[1], "field, −ℓ log φ"),
            (outcome.measured[1], "^", COLORS[0], "planned path"),
        ):
            side.plot(drawn_from, np.maximum(values, 1e-4), marker, color=color, markersize=3.5, label=label)
        ends = np.array([1e-4, max(1.0, float(outcome.measured.max()))])
        side.plot(ends, ends, color="black", linewidth=0.6, linestyle=":", label="as predicted")
        side.set(
            xscale="log", yscale="log", xlabel="predicted, S [m] (≤ 10⁻⁴: none)", ylabel="lengthening, measured [m]"
        )
        side.legend(fontsize=6.5)


def main(config: Config) -> list[Row]:
    """Run, draw, save; a row for each way of choosing places, and one for all of them."""
    rows, outcome = run(config)
    figures(outcome, config.figures)
    save(NAME, config, rows, config.out)
    return rows


def section(document: dict[str, Any]) -> str:
    """What the JSON says, in Markdown."""
    *kinds, whole = document["rows"]
    strong, drawn = kinds[0], kinds[-1]
    head = {
        "places": "places of the obstacle",
        "count": "tried",
        "predicted_m": "S [m]",
        "field_change_m": "change of −ℓ log φ [m]",
        "path_change_mean_m": "longer path, mean [m]",
        "path_change_most_m": "most [m]",
    }
    return f"""## Sensitivity: where would an obstacle change this path most?

One adjoint solve ranks every voxel of the map by what an obstacle there would add to a path of {whole["path_m"]:g} m.
Then obstacles of one voxel were put there, and the path was planned anew.

{table(head, kinds)}

Rank correlation of S with the change of the field {whole["rank_correlation_field"]:g}, with the change of the planned
path {whole["rank_correlation_path"]:g} ({whole["count"]} obstacles). The strongest places lengthen the path by
{strong["path_change_mean_m"]:g} m on average, places drawn from free space by {drawn["path_change_mean_m"]:g} m. First
order ranks, but it is too small for whole obstacles: {strong["predicted_m"]:g} m predicted,
{strong["field_change_m"]:g} m measured in the field at the strongest places.

![Sensitivity](../docs/figures/{NAME}.png)
"""


if __name__ == "__main__":
    main(configured(TINY))
