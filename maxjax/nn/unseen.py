"""What a metre costs where nobody saw: the law of distances, and more where a building is likely.

n(x) = n(d(x)) + a P(x)      P: probability that x is occupied, 0 where it was seen or is known

As the price of a metre is at least what it was, only the choice among ways changes: what is inflated, certified and
verified is what was seen.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Real

from maxjax.core.grid import Grid
from maxjax.core.terrain import Terrain
from maxjax.core.voxel_map import VoxelMap
from maxjax.fields.distance import cube_distance, metres
from maxjax.fields.occupancy import add_scan, pad_cloud
from maxjax.fields.sighting import sight
from maxjax.nn.completion import GRID, NETWORK, CompletionNet, Params, complete, load_completion
from maxjax.planning.problem.distances import Distances, PriceVolume
from maxjax.planning.problem.task import points_of

_GROUND = round(-GRID.origin[2] / GRID.spacing)  # its highest layer
_COMPLETE = jax.jit(complete, static_argnames="network")


def predict_unseen(
    points: Real[Array | np.ndarray, "n 3"],
    sensor: Real[Array | np.ndarray, " 3"] | Sequence[float],
    known: VoxelMap,
    completion: tuple[Params, CompletionNet] | None = None,
) -> Float32[np.ndarray, "nx ny nz"]:
    """P(occupied) of the voxels that one scan does not show, by the completion network; 0 for all others.

    Args:
        points: returns of the scan [m]; misses are not finite, or exactly (0, 0, 0).
        sensor: where its beams begin [m].
        known: a map with its ground, in whose voxels the answer is; the network was trained on voxels of 2 m. Farther
            than 96 m in plan, and higher than 72 m above the ground, P is 0.
        completion: weights and network; None: those that come with maxjax.

    Raises:
        ValueError: if the map has no ground below the sensor, or points or sensor have other than three coordinates.
    """
    returns, place = points_of("points", points, ("n", 3), least=0), points_of("sensor", sensor, (3,))
    x, y, _ = place.tolist()
    terrain = known.terrain
    height = terrain.at(x, y)
    if not np.isfinite(height):
        raise ValueError(
            f"known: expected a map with its ground, given none at ({x:g}, {y:g}); the network counts heights from it"
        )
    around = _around(known.grid, x, y, height)
    returns = np.where((returns == 0).all(axis=1, keepdims=True), np.nan, returns)
    local = (value - np.array(around.origin) for value in (place, pad_cloud(returns)))  # exact at national coordinates
    seen = sight(*(jnp.asarray(value, jnp.float32) for value in local), around.local)
    ground = _ground_in(terrain, around, height)
    params, network = completion or (load_completion(), NETWORK)
    chance = np.asarray(_COMPLETE(params, seen, jnp.asarray(ground), network))
    chance = np.where(np.asarray(seen.occupied) | ground, 0.0, chance)
    found = _sampled(chance, around, known.grid)
    return np.where(np.asarray(known.occupied) | np.asarray(known.ground), 0.0, found).astype(np.float32)


def price_unseen(
    points: Real[Array | np.ndarray, "n 3"],
    sensor: Real[Array | np.ndarray, " 3"] | Sequence[float],
    known: VoxelMap,
    distances: Distances = Distances(),  # noqa: B008 (frozen)
    height: float = 4.0,
) -> Distances:
    """Distances for a plan from one scan, by which ways through likely buildings that it does not show cost more.

        distances = maxjax.price_unseen(points, start, known)
        plan = maxjax.plan_scan(points, start, goal, known, distances=distances)

    Args:
        points, sensor, known: as of `predict_unseen`.
        distances: whose price is raised.
        height: a, what a metre through surely occupied voxels costs more; 4 is what was judged.

    Raises:
        ValueError: as `predict_unseen`, and for a height that is negative or not finite.
    """
    chance = predict_unseen(points, sensor, known)
    seen, _ = add_scan(known, points_of("points", points, ("n", 3), least=0))
    return raise_price(seen, distances, chance, height)


def raise_price(
    where: VoxelMap, distances: Distances, chance: Float[np.ndarray, "nx ny nz"], height: float
) -> Distances:
    """Distances whose price is raised where nobody saw.

    Args:
        where: what was seen and is known.
        distances: whose price is raised.
        chance: P, 0 where that was seen.
        height: a, what a metre through certain buildings costs more.

    Raises:
        ValueError: for a height that is negative or not finite.
    """
    if not 0.0 <= height < np.inf:
        raise ValueError(f"height: expected a finite price of at least 0, given {height:g}")
    if isinstance(distances.price, PriceVolume):
        law = np.asarray(distances.price.n)
    else:
        obstacles = np.asarray(where.barred) & ~np.asarray(where.kept_off)
        quarters = cube_distance(jnp.asarray(obstacles), distances.margin / where.grid.spacing)
        law = np.asarray(distances.price_at(metres(quarters, where.grid.spacing)))
    return dataclasses.replace(distances, price=(law + height * chance).astype(np.float32))


def _around(grid: Grid, x: float, y: float, height: float) -> Grid:
    """The network's grid around a place, on voxels of the map where both have the same spacing."""
    corner = np.array(grid.origin[:2])
    middle = corner + grid.spacing * np.round((np.array([x, y]) - corner) / grid.spacing)
    west, south = (middle + np.array(GRID.origin[:2])).tolist()
    return Grid(GRID.shape, GRID.spacing, (west, south, height - GRID.spacing * (_GROUND + 0.5)))


def _ground_in(terrain: Terrain, grid: Grid, height: float) -> np.ndarray:
    """The ground's voxels; where the map ends it is as high as below the sensor."""
    heights = terrain.on(grid).heights
    tops = np.where(np.isfinite(heights), heights, height)
    centres = grid.origin[2] + grid.spacing * np.arange(grid.shape[2])
    return np.asarray(centres < tops[:, :, None])


def _sampled(values: np.ndarray, of: Grid, at: Grid) -> np.ndarray:
    """The value of the voxel that holds each centre of another grid; 0 outside."""
    index = [
        np.floor((low + at.spacing * np.arange(n) - origin) / of.spacing + 0.5).astype(int)
        for low, n, origin in zip(at.origin, at.shape, of.origin, strict=True)
    ]
    inside = [(some >= 0) & (some < n) for some, n in zip(index, of.shape, strict=True)]
    found = values[np.ix_(*(np.clip(some, 0, n - 1) for some, n in zip(index, of.shape, strict=True)))]
    return np.where(inside[0][:, None, None] & inside[1][:, None] & inside[2], found, 0.0)
