"""Which points of a surface a photo shows, and how well.

    d = (u, v, 1)·(right, up, forward),  |u| ≤ tan ½w, |v| ≤ tan ½h      within the photo, at depth z along forward
    cos i = −d·n / |d| ≥ cos i_max                                       seen from its outer side, not too obliquely
    g = z max(|r − d (r·n)/(d·n)| p_u, |s − d (s·n)/(d·n)| p_v) ≤ g_max   a pixel's longer side on the surface
    no surface is nearer on the ray                                      (`inspection.scenery`)

r and s are the photo's right and up, n the outward normal, p the side of a pixel at depth 1. Straight ahead onto a wall
g is the ground sample distance of the data sheet; a wall that turns away draws it out.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64
from scipy import sparse

from maxjax.inspection.photo_camera import Camera
from maxjax.inspection.scenery import Scenery, bundles
from maxjax.inspection.target_surface import Surface
from maxjax.inspection.views import Views

_PAIRS = 2**24  # of views and points at a time
_WIDTH = 2**18  # rays of a bundle, at most


@dataclasses.dataclass(frozen=True)
class SightLimits:
    """What counts as seen.

    Attributes:
        incidence: greatest angle between the line of sight and the surface's normal [deg].
        resolution: greatest side of what a pixel covers on the surface [m].

    Raises:
        ValueError: unless the angle is between 0 and 90, and the side positive.
    """

    incidence: float
    resolution: float

    def __post_init__(self) -> None:
        if not 0.0 < self.incidence < 90.0:
            raise ValueError(f"incidence: expected an angle between 0 and 90 degrees, given {self.incidence}")
        if not self.resolution > 0.0:
            raise ValueError(f"resolution: expected a positive number of metres, given {self.resolution}")


@dataclasses.dataclass(frozen=True, eq=False)
class Sights:
    """Pairs of a photo and a point that it shows, by photo.

    Attributes:
        photo, point: numbers of the two.
        incidence: angle between the line of sight and the normal [deg].
        resolution: longer side of what a pixel covers there [m].
        shape: how many photos and points there are.
    """

    photo: np.ndarray
    point: np.ndarray
    incidence: Float64[np.ndarray, " s"]
    resolution: Float64[np.ndarray, " s"]
    shape: tuple[int, int]

    @property
    def matrix(self) -> sparse.csr_array:
        """Whether each photo shows each point, as 1 where it does."""
        ones = np.ones(len(self.photo), np.int32)
        return sparse.csr_array((ones, (self.photo, self.point)), shape=self.shape)


def find_sights(views: Views, surface: Surface, scenery: Scenery, camera: Camera, limits: SightLimits) -> Sights:
    """Which points of a surface each view shows.

    Args:
        views: photos.
        surface: what is to be seen.
        scenery: what hides.
        camera: that takes them.
        limits: what counts.
    """
    middle = surface.points.mean(axis=0) if len(surface) else np.zeros(3)
    cast = _Cast(views, surface, scenery, middle, _numbers(camera, limits))
    found = [cast.sights(rows) for rows in bundles(views.position, max(1, min(64, _PAIRS // max(len(surface), 1))))]
    photo, point, incidence, resolution = (
        np.concatenate([np.zeros(0, kind), *(part[k] for part in found)])
        for k, kind in enumerate((np.int64, np.int64, np.float64, np.float64))
    )
    order = np.lexsort((point, photo))
    return Sights(photo[order], point[order], incidence[order], resolution[order], (len(views), len(surface)))


def _numbers(camera: Camera, limits: SightLimits) -> Float64[np.ndarray, "6"]:
    """Half tangents, sides of a pixel at depth 1, cosine of the greatest incidence, greatest side on the surface."""
    halves = camera.half_tangents
    pixels = [2.0 * half / count for half, count in zip(halves, camera.pixels, strict=True)]
    return np.array([*halves, *pixels, math.cos(math.radians(limits.incidence)), limits.resolution])


@dataclasses.dataclass(frozen=True, eq=False)
class _Cast:
    """A surface and what hides it, ready for bundles of views.

    Attributes:
        middle: about which positions are float32 [m].
        numbers: of camera and limits.
    """

    views: Views
    surface: Surface
    scenery: Scenery
    middle: Float64[np.ndarray, "3"]
    numbers: Float64[np.ndarray, "6"]

    def sights(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Photo, point, incidence and resolution of what some views show."""
        some = self.views.some(rows)
        near = self._near(some)
        cosine, side = self._geometry(some, near)
        framed = np.isfinite(side)
        width = int(framed.sum(axis=1).max(initial=0))
        if not width:
            return rows[:0], rows[:0], np.zeros(0), np.zeros(0)
        # The points within each photo in a row, those of photos with fewer filled up.
        first = np.argsort(~framed, axis=1, kind="stable")[:, :width]
        asked = np.take_along_axis(framed, first, axis=1)
        seen = np.concatenate(
            [
                self.scenery.visible(some.position[part], self.surface.points[near][first[part]], asked[part])
                for part in np.array_split(np.arange(len(rows)), -(-len(rows) * width // _WIDTH))
            ]
        )
        row, column = np.nonzero(seen)
        column = first[row, column]
        angle = np.degrees(np.arccos(np.clip(cosine[row, column], -1.0, 1.0)))
        return rows[row], near[column], angle, side[row, column].astype(np.float64)

    def _near(self, some: Views) -> np.ndarray:
        """Numbers of points that are near enough for the resolution of any of some views."""
        reach = self.numbers[5] / self.numbers[2:4].min() * math.hypot(1.0, *self.numbers[:2])
        low, high = some.position.min(axis=0) - reach, some.position.max(axis=0) + reach
        return np.flatnonzero(((self.surface.points >= low) & (self.surface.points <= high)).all(axis=1))

    def _geometry(self, some: Views, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cosine of the incidence and side of a pixel for each view and point; infinite where it does not count."""
        rows, columns = (1 << max(n - 1, 0).bit_length() for n in (len(some), len(near)))
        padded = (
            _padded(some.position - self.middle, rows),
            _padded(some.axes, rows),
            _padded(self.surface.points[near] - self.middle, columns),
            _padded(self.surface.normals[near], columns),
        )
        cosine, side = _frame(*padded, jnp.asarray(self.numbers, jnp.float32))
        return tuple(np.asarray(one)[: len(some), : len(near)] for one in (cosine, side))  # type: ignore[return-value]


def _padded(rows: np.ndarray, count: int) -> Array:
    return jnp.asarray(np.pad(rows, ((0, count - len(rows)), *((0, 0),) * (rows.ndim - 1))), jnp.float32)


@jax.jit
def _frame(
    position: Float[Array, "b 3"],
    axes: Float[Array, "b 3 3"],
    points: Float[Array, "n 3"],
    normals: Float[Array, "n 3"],
    numbers: Float[Array, "6"],
) -> tuple[Float[Array, "b n"], Float[Array, "b n"]]:
    """See the module: cos i, and g, infinite outside of the photo or of the limits."""

    def along(axis: int) -> tuple[Float[Array, "b n"], Float[Array, "b n"]]:
        """Components of the way to each point, and of its normal."""
        own = axes[:, axis]
        way = jnp.einsum("bk,nk->bn", own, points, precision="highest") - jnp.sum(own * position, axis=1)[:, None]
        return way, jnp.einsum("bk,nk->bn", own, normals, precision="highest")

    (x, nx), (y, ny), (depth, nz) = along(0), along(1), along(2)
    ahead = depth > 0
    safe = jnp.where(ahead, depth, 1.0)
    u, v = x / safe, y / safe
    towards = u * nx + v * ny + nz  # d·n
    length = jnp.sqrt(u * u + v * v + 1.0)
    cosine = -towards / length
    facing = ahead & (towards < 0)
    towards = jnp.where(facing, towards, -1.0)

    def side(component: Array, own: tuple[float, float, float]) -> Array:
        """|axis − d (axis·n)/(d·n)|."""
        share = component / towards
        return jnp.sqrt((own[0] - share * u) ** 2 + (own[1] - share * v) ** 2 + (own[2] - share) ** 2)

    across, along_height, pixel_u, pixel_v, least, most = numbers
    pixel = depth * jnp.maximum(side(nx, (1.0, 0.0, 0.0)) * pixel_u, side(ny, (0.0, 1.0, 0.0)) * pixel_v)
    kept: Bool[Array, "b n"] = (
        facing & (jnp.abs(u) <= across) & (jnp.abs(v) <= along_height) & (cosine >= least) & (pixel <= most)
    )
    return cosine, jnp.where(kept, pixel, jnp.inf)
