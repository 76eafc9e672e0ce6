"""Covering by a field: a vehicle climbs the potential of what no photo shows yet, and takes photos on its way.

    −∇²u + u/ℓ² = s      s = what the best photo from a voxel would newly show [m²], 0 where that is little
    next voxel = the highest of its neighbours;  at a source the photo is taken, and s changes

This is heat-equation driven area coverage (HEDAC: Ivić, Crnković and Grbčić, arXiv 2109.10756), with photos in place of
a sensor that covers all the time. Where s = 0 the discrete maximum principle leaves no local maximum, so that the climb
ends at a source. One solve serves all steps to the next photo. What comes out is an order of photos; legs between them
are planned and verified like any others.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64, Int64
from scipy import sparse

from maxjax.core.grid import Grid, Point3
from maxjax.fields import stencil
from maxjax.inspection.free_space import FreeSpace
from maxjax.solvers.krylov import chebyshev, pcg

_DEGREE, _ITERATIONS, _EXACT = 16, 200, 1e-6
_NEIGHBOURS = np.array([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])
_AROUND = 3  # voxels around what is flown in


@dataclasses.dataclass(frozen=True)
class FieldCover:
    """How far sources are felt, and which photos are worth a source.

    Attributes:
        length: ℓ [voxels]: the longer, the more far sources count.
        share: of what the best photo would newly show, from which on a photo is a source; below it waits.

    Raises:
        ValueError: unless the length is positive and the share between 0 and 1.
    """

    length: float = 8.0
    share: float = 0.5

    def __post_init__(self) -> None:
        if not self.length > 0.0:
            raise ValueError(f"FieldCover.length: expected a positive number of voxels, given {self.length}")
        if not 0.0 < self.share <= 1.0:
            raise ValueError(f"FieldCover.share: expected a number above 0, up to 1, given {self.share}")


@dataclasses.dataclass(frozen=True, eq=False)
class PhotoOrder:
    """Photos in the order in which they are taken.

    Attributes:
        photos: numbers of the views.
        seen: area that is shown often enough after each [m²].
    """

    photos: Int64[np.ndarray, " p"]
    seen: Float64[np.ndarray, " p"]


@dataclasses.dataclass(frozen=True, eq=False)
class Photos:
    """What photos show, for a search.

    Attributes:
        places: where they are taken [m].
        shows: 1 where a photo shows a point.
        areas: of the points [m²].
        wanted: photos that are to show each point.
    """

    places: Float64[np.ndarray, "m 3"]
    shows: sparse.csr_array
    areas: Float64[np.ndarray, " n"]
    wanted: int


def cover_by_field(photos: Photos, free: FreeSpace, start: Point3, how: FieldCover | None = None) -> PhotoOrder:
    """The order in which a climber of the field takes photos, until none would show anything that is wanted.

    Args:
        photos: to choose from.
        free: where a vehicle may fly.
        start: where it begins [m].
        how: settings.

    Raises:
        ValueError: if a photo, or the start, has no free voxel beside it.
    """
    how = FieldCover() if how is None else how
    low, air = _box(free, np.vstack([photos.places, [start]]))
    voxel = _nearest(np.vstack([photos.places, [start]]), low, air, free.grid)
    here, at = voxel[-1], voxel[:-1]
    count = np.minimum(np.bincount(photos.shows.indices, minlength=photos.shows.shape[1]), photos.wanted)
    need, taken, seen = count.copy(), list[int](), list[float]()
    left = np.ones(len(photos.places), bool)
    potential = np.zeros(air.shape, np.float32)
    solve = functools.partial(_solve, jnp.asarray(air), how.length)
    while True:
        gain = np.where(left, photos.shows @ (photos.areas * (need > 0)), 0.0)
        if gain.max(initial=0.0) <= 0.0:
            return PhotoOrder(np.array(taken, np.int64), np.array(seen))
        counts = gain >= how.share * gain.max()
        source = np.zeros(air.shape, np.float32)
        np.maximum.at(source, tuple(at[counts].T), gain[counts] / gain.max())
        potential = np.asarray(solve(source, potential))
        here = _climb(potential, source, air, here)
        beside = np.flatnonzero(counts & (at == here).all(axis=1))
        best = int(beside[gain[beside].argmax()])
        left[best] = False
        taken.append(best)
        need[photos.shows.indices[photos.shows.indptr[best] : photos.shows.indptr[best + 1]]] -= 1
        seen.append(float(photos.areas[(need <= 0) & (count > 0)].sum()))


@functools.partial(jax.jit, static_argnames="length")
def _solve(
    air: Bool[Array, "nx ny nz"], length: float, source: Float[Array, "nx ny nz"], first: Float[Array, "nx ny nz"]
) -> Float[Array, "nx ny nz"]:
    """The potential of a source, by conjugate gradients on the scaled system from a first guess."""
    operator = stencil.assemble(air.astype(jnp.float32), 1.0 / length**2)
    faces, scale = stencil.normalize(operator)
    smooth = functools.partial(stencil.inflow, faces)
    b = scale * source
    norm = jnp.sum(b * b)
    found = pcg(
        lambda y: y - smooth(y),
        b,
        x0=jnp.where(scale > 0, first / jnp.where(scale > 0, scale, 1), 0),
        precondition=chebyshev(smooth, 1.0 - 0.5 / length**2 / 6.0, _DEGREE),
        stop=lambda _, r: jnp.sum(r * r) <= _EXACT**2 * norm,
        max_iterations=_ITERATIONS,
    )
    return scale * found.x


def _climb(
    potential: Float[np.ndarray, "nx ny nz"],
    source: Float[np.ndarray, "nx ny nz"],
    air: Bool[np.ndarray, "nx ny nz"],
    here: Int64[np.ndarray, " 3"],
) -> Int64[np.ndarray, " 3"]:
    """The source that a climb ends at; where rounding leaves a local maximum, the one that the fewest steps lead to."""
    height = potential[tuple(here)]
    while source[tuple(here)] == 0.0:
        around = here + _NEIGHBOURS
        around = around[((around >= 0) & (around < air.shape)).all(axis=1)]
        around = around[air[tuple(around.T)]]
        heights = potential[tuple(around.T)]
        if not len(around) or heights.max() <= height:
            return _nearest_source(source, air, here)
        here, height = around[heights.argmax()], heights.max()
    return here


def _nearest_source(
    source: Float[np.ndarray, "nx ny nz"], air: Bool[np.ndarray, "nx ny nz"], here: Int64[np.ndarray, " 3"]
) -> Int64[np.ndarray, " 3"]:
    from scipy import ndimage  # a quarter of a second that most commands can do without

    reached = np.zeros(air.shape, bool)
    reached[tuple(here)] = True
    while not (reached & (source > 0.0)).any():
        grown = ndimage.binary_dilation(reached, mask=air)
        if (grown == reached).all():
            raise ValueError("expected a way to every photo, found none: the air is in parts")
        reached = grown
    return np.asarray(np.argwhere(reached & (source > 0.0))[0])


def _box(
    free: FreeSpace, places: Float64[np.ndarray, "n 3"]
) -> tuple[Int64[np.ndarray, " 3"], Bool[np.ndarray, "x y z"]]:
    """The lowest voxel and the free voxels of the part of the map around some places."""
    index = np.floor((places - np.array(free.grid.origin)) / free.grid.spacing + 0.5).astype(np.int64)
    low = np.maximum(index.min(axis=0) - _AROUND, 0)
    high = np.minimum(index.max(axis=0) + _AROUND + 1, free.grid.shape)
    return low, free.free[tuple(map(slice, low, high))]


def _nearest(
    places: Float64[np.ndarray, "n 3"], low: Int64[np.ndarray, " 3"], air: Bool[np.ndarray, "x y z"], grid: Grid
) -> Int64[np.ndarray, "n 3"]:
    """The nearest free voxel of each place in a part of the map."""
    from scipy.spatial import cKDTree  # a quarter of a second that most commands can do without

    voxels = np.argwhere(air)
    away, nearest = map(np.asarray, cKDTree(voxels).query((places - np.array(grid.origin)) / grid.spacing - low))
    if away.max() > 2.0:
        x, y, z = places[int(away.argmax())].tolist()
        raise ValueError(f"expected places in free air, given one without: x {x:.1f}, y {y:.1f}, z {z:.1f}")
    return np.asarray(voxels[nearest])
