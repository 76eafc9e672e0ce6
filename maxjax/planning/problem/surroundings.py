"""Volumes that all problems of a map share: inflated obstacles, distances and prices, and what each voxel is.

    kind(x) = OBSTACLE, else GROUND, else BESIDE ground (a face neighbour of it), else NOTHING

Of a part of a map, obstacles and ground are seen beyond the part as well, in a *halo*. A part may reach beyond the
*rim* where the map ends: nothing is there to keep a distance from, and no path leads there.

Positions are index coordinates (whole numbers at voxel centres), distances [voxels].
"""

from __future__ import annotations

import functools
import math
import operator
from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, Integer, Shaped, UInt8

from maxjax.compile.lowering import materialise
from maxjax.core.grid import Grid
from maxjax.fields.distance import cube_distance, farthest, metres
from maxjax.fields.occupancy import squared_distance
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.inflation import inflate, least_quarters

NOTHING, BESIDE, GROUND, OBSTACLE = range(4)


class Surroundings(NamedTuple):
    """Volumes that all problems of one map share.

    Attributes:
        occupied: occupied voxels, ground included.
        quarters: `distance.cube_distance` of the obstacles (ground left out), exact up to the margin.
        inflated: the inflated obstacles.
        kind: of each voxel, of those in the halo as well.
        price: as in `Problem`.
    """

    occupied: Bool[Array, "nx ny nz"]
    quarters: Integer[Array, "nx ny nz"]
    inflated: Bool[Array, "nx ny nz"]
    kind: UInt8[Array, "hx hy hz"]
    price: Float[Array, "nx ny nz"] | None

    @property
    def halo(self) -> int:
        """How far `kind` reaches beyond the rest."""
        return halo_between(self.kind, self.inflated.shape)

    def inside(self, rim: Int32[Array, " 3"]) -> Surroundings:
        """The same, closed from `rim` on."""
        shape = self.inflated.shape
        beyond = functools.reduce(
            operator.or_, (lax.broadcasted_iota(jnp.int32, shape, axis) >= rim[axis] for axis in range(3))
        )
        return self._replace(occupied=self.occupied | beyond, inflated=self.inflated | beyond)

    def with_radius(self, least: Int32[Array, ""]) -> Surroundings:
        """The same, inflated by another radius, which is no larger than the margin, by its `least_quarters`."""
        kind = _inside(self.kind, self.halo)
        squared = jnp.where(kind == GROUND, 0, jnp.where(kind == BESIDE, 1, 2))
        return self._replace(inflated=inflate(self.quarters, squared, least))


def surroundings(
    occupied: Bool[Array, "nx ny nz"], ground: Bool[Array, "nx ny nz"], distances: Distances, grid: Grid
) -> Surroundings:
    """The inflated obstacles, the distances and the price of a map.

    Args:
        occupied: occupied voxels, ground included: of the grid, or of the grid and a halo around it.
        ground: the voxels of `occupied` that are ground.
        distances: asked for. Static.
        grid: the grid, whose origin does not matter. Static.
    """
    halo = halo_between(occupied, grid.shape)
    occupied, ground = materialise(occupied), materialise(ground)
    obstacles, squared = occupied & ~ground, squared_distance(ground, 1)
    quarters = _inside(cube_distance(obstacles, distances.margin / grid.spacing), halo)
    inflated = inflate(quarters, _inside(squared, halo), least_quarters(distances.radius / grid.spacing))
    kind = jnp.where(obstacles, OBSTACLE, jnp.where(ground, GROUND, jnp.where(squared <= 1, BESIDE, NOTHING)))
    price = None
    if distances.priced:
        price = materialise(distances.price_at(metres(quarters, grid.spacing)))
    inner = _inside(occupied, halo)
    return Surroundings(inner, quarters, materialise(inflated), materialise(kind.astype(jnp.uint8)), price)


def halo_between(seen: Shaped[Array, "hx hy hz"], shape: tuple[int, ...]) -> int:
    """How far a volume reaches beyond a part of this shape, on each side."""
    return (seen.shape[0] - shape[0]) // 2


def _inside(volume: Shaped[Array, "hx hy hz"], halo: int) -> Shaped[Array, "nx ny nz"]:
    """A volume without its halo."""
    return volume[halo:-halo, halo:-halo, halo:-halo] if halo else volume


def cubes_within(radius: float) -> int:
    """How many voxels from an end's along an axis a cube may be that is within the radius of the end's first step."""
    return math.floor(radius + 1.5)


def halo_of(distances: Distances, grid: Grid) -> int:
    """How many voxels beyond a part of a map obstacles or ground count in it, at least 1."""
    priced, own = farthest(distances.margin / grid.spacing), cubes_within(distances.radius / grid.spacing)
    return max(priced, own, 1)
