"""Demonstrations: cheapest paths of a graph search in a city, and their directions.

cost of a step = its length × mean of n at its ends        26 neighbours, no corner cut (Dijkstra)
"""

from __future__ import annotations

import dataclasses
import itertools

import jax.numpy as jnp
import numpy as np
from scipy import ndimage, sparse
from scipy.sparse.csgraph import dijkstra

import maxjax
from experiments.differentiable.field import city, free_points, heights
from experiments.differentiable.priced import Town, price


@dataclasses.dataclass(frozen=True)
class Lesson:
    """One goal and the demonstrations to it, in voxels.

    Attributes:
        town: what the price is made of.
        clear: distance to the next building [m].
        goal: its voxel.
        starts: voxels.
        shown: a path from each start, index coordinates.
    """

    town: Town
    clear: np.ndarray
    goal: np.ndarray
    starts: np.ndarray
    shown: list[np.ndarray]


@dataclasses.dataclass(frozen=True)
class Demonstrator:
    """Who shows the paths.

    Attributes:
        hidden: a, w [voxels] and v.
        count: starts a goal.
    """

    hidden: tuple[float, float, float]
    count: int


def window(shape: tuple[int, int, int]) -> maxjax.Grid:
    """The middle of a city, from the ground up."""
    nx, ny, _ = shape
    return maxjax.Grid(shape, 2.0, (1.0 - nx, 1.0 - ny, -1.0))


def lesson(by: Demonstrator, grid: maxjax.Grid, seed: int) -> Lesson:
    """A goal in a city, starts around it, and the demonstrated paths."""
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
    points = free_points(rng, free, heights(grid, 3.0, 15.0), 40 * by.count)
    goal = points[0]
    apart = np.linalg.norm(points - goal, axis=1)
    low, high = 0.3 * min(grid.shape[:2]), 0.8 * min(grid.shape[:2])
    starts = points[(apart >= low) & (apart <= high)][: by.count]
    n = np.asarray(price(town, jnp.log(jnp.asarray(by.hidden))))
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
