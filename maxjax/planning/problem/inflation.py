"""Inflated obstacles: voxels whose centres are nearer to an obstacle than the radius, or beside the ground.

    blocked = { x : d(x) < radius }  ∪  { x : within one voxel of the ground, centre to centre }

with the distance d from a centre to the nearest occupied cube (`fields.distance`). **Free centres are all that it
takes.** Faces of cubes lie midway between centres, so along an axis, over a step from one centre to the next, the gap
to a cube is least at an end of the step: it is monotone where it is not 0, and 0 at an end if anywhere. Hence over a
box between neighbouring centres (an edge, a face or a cell of their lattice) the distance to a cube is least at one of
the corners: where all of these keep the radius, so does all of the box.

Up to half a voxel of radius the set is what is occupied, as no other centre is nearer. At radius 0 the ground, too, is
blocked as it is.
"""

from __future__ import annotations

import math

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int32, Integer

# Keeps 1 m / 2 m = 1/2 voxel inclusive under rounding [quarters of a voxel²]; these are whole numbers.
_INCLUSIVE = 1e-4


def least_quarters(radius: float) -> int:
    """The least (2 d)² [voxels²] of a centre that keeps a radius [voxels]; 0 for radius 0."""
    return max(math.ceil(4 * radius**2 - _INCLUSIVE), int(radius > 0))


def inflate(
    quarters: Integer[Array, "nx ny nz"], ground_squared: Integer[Array, "nx ny nz"], least: Int32[Array, ""] | int
) -> Bool[Array, "nx ny nz"]:
    """Voxels that a path keeps out of.

    Args:
        quarters: `distance.cube_distance` of the obstacles (ground left out), exact up to the radius.
        ground_squared: `occupancy.squared_distance` of the ground, reach 1.
        least: `least_quarters` of the radius; may be traced.
    """
    return (quarters < jnp.maximum(least, 1)) | (ground_squared <= jnp.minimum(least, 1))
