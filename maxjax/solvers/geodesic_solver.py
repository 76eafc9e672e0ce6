"""The flood's own distance as a potential: what is climbed where no solution is at hand.

    log φ = −θ (r + k/4),    2 (cosh θ − 1) = 1/ℓ²

r is the distance of `fields.geodesic`, in whole steps, prices counted as tolls. A step to the 26 neighbours reaches
voxels one after the other, along z, then y, then x; k ∈ {0, 1, 2} tells which came first: 0 where a face neighbour has
a smaller r, 1 where one of the same r has k = 0, else 2. Then every voxel but the goal has a face neighbour of smaller
r + k/4 by construction: the field has no local maximum but the goal, whatever the map.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.lowering import in_this_turn, neighbours
from maxjax.fields.certificate import count_uncertified
from maxjax.fields.price import decay
from maxjax.solvers.medium import Medium, Progress

# Of r, where there is none.
_NOWHERE = 2**30


def distance_potential(
    distance: Int32[Array, "nx ny nz"], component: Bool[Array, "nx ny nz"], length: Float[Array, ""]
) -> Float[Array, "nx ny nz"]:
    """Log φ of the flood's distance; 0 outside the component.

    Args:
        distance: steps to the goal inside the component.
        component: the goal's.
        length: ℓ [voxels].
    """
    steps = jnp.where(component, distance, _NOWHERE)
    nearer = (_least(steps) < steps) | (steps == 0)
    second = _least(jnp.where(nearer, steps, _NOWHERE)) == steps
    rank = jnp.where(nearer, 0, jnp.where(second, 1, 2))
    return jnp.where(component, -decay(1.0, length) * (steps + rank / 4).astype(length.dtype), 0)


def _least(steps: Int32[Array, "nx ny nz"]) -> Int32[Array, "nx ny nz"]:
    """The least of the six neighbours."""
    return functools.reduce(jnp.minimum, itertools.chain(*neighbours(steps, beyond=_NOWHERE)))


def or_geodesic(medium: Medium, progress: Progress) -> Progress:
    """The flood's distance where φ is not certified."""

    def replaced(progress: Progress) -> Progress:
        distance, component = in_this_turn((medium.distance, medium.component), progress.log_phi)
        log_phi = distance_potential(distance, component, progress.length)
        return dataclasses.replace(
            progress,
            log_phi=log_phi,
            uncertified=count_uncertified(log_phi, component, medium.goal),
            geodesic=jnp.array(True),
        )

    chosen: Progress = lax.cond(progress.uncertified > 0, replaced, lambda progress: progress, progress)
    return chosen
