"""Ray casting: how far along each ray is the first surface?

Every convex solid meets a ray x = o + t d (|d| = 1) in one interval [near, far], and the first surface is

    t = near  if near >= 0,    far  if near < 0 <= far (the origin is inside),    infinity otherwise;

the ground plane is met from above only, a triangle from both sides, in an interval of no length. These are the
conventions of C MuJoCo's `mj_ray`, tested case by case.

`cast_rays` is a fused kernel: origins are moved into each geom's frame once, then a running minimum over the
geoms is taken over all rays at once, so that memory is O(rays). `mjx_model.cast_rays_mjx` calls MJX, which forms
all ray-geom pairs.

Quadrics are solved by the distance of the line from the middle, not by b^2 - a c: at 60 m the latter leaves a
lamp post's 12 cm radius only two digits in float32.
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from maxjax.compile.lowering import rotate
from maxjax.sim.worlds.geoms import BOX, CAPSULE, ELLIPSOID, PLANE, SPHERE, TRIANGLE, Geoms
from maxjax.sim.worlds.movers import Movers, solids_at

# Geoms per loop iteration: one pass over the rays' memory serves this many. Higher values compile longer and run no
# faster.
_UNROLL = 4
# Direction components below this count as parallel; its inverse times a city's size is far below float32's maximum.
_PARALLEL = 1e-12
# By which triangles are taken larger, so that no ray slips between two that share an edge [m].
_SEAM = 1e-4

Rays = Float[Array, " r"]
Vector = Float[Array, "3"]
Direction = tuple[Rays, Rays, Rays]
Interval = tuple[Rays, Rays]


def cast_rays(geoms: Geoms, origin: Float[Array, "3"], directions: Float[Array, "r 3"]) -> Float[Array, " r"]:
    """Distance along each ray to the first surface [m], infinity where there is none; `jit` and `vmap` safe.

    Args:
        geoms: one scene.
        origin: common origin of the rays, world frame [m].
        directions: unit vectors, world frame.

    Raises:
        ValueError: for wrong shapes.
    """
    if geoms.position.ndim != 2 or origin.shape != (3,) or directions.ndim != 2 or directions.shape[1] != 3:
        raise ValueError(
            "cast_rays: expected geoms (g, 3), origin (3,) and directions (r, 3), given "
            f"{geoms.position.shape}, {origin.shape} and {directions.shape}; use vmap for batches"
        )
    x, y, z = directions.T
    best = jnp.full(directions.shape[0], jnp.inf, directions.dtype)
    for geom_type in sorted(set(geoms.type)):
        group = geoms.of_type(geom_type)
        local_origin = jnp.einsum("gji,gj->gi", group.rotation, origin - group.position, precision="highest")
        meet = _MEET[geom_type]

        def nearer(
            best: Rays, geom: tuple[Vector, Array, Vector], meet: Callable[..., Interval] = meet
        ) -> tuple[Rays, None]:
            local, rotation, size = geom
            # Columns of `rotation` are the geom's axes: their products with the ray are its local components.
            dx, dy, dz = (rotation[0, i] * x + rotation[1, i] * y + rotation[2, i] * z for i in range(3))
            near, far = meet(local, (dx, dy, dz), size)
            first = jnp.where(near >= 0.0, near, far)
            return jnp.where((near <= far) & (far >= 0.0), jnp.minimum(best, first), best), None

        best, _ = lax.scan(nearer, best, (local_origin, group.rotation, group.size), unroll=_UNROLL)
    return best


def cast_rays_moving(
    movers: Movers, origin: Float[Array, "3"], directions: Float[Array, "c r 3"], times: Float[Array, " c"]
) -> Float[Array, "c r"]:
    """Distance along each ray to the first mover [m], where the movers are when the ray is cast; infinity: none.

    Args:
        movers: of one world.
        origin: common origin of the rays, world frame [m].
        directions: unit vectors, world frame; those of a column are cast at a time.
        times: of the columns [s].
    """
    solids = jax.vmap(solids_at, (None, 0))(movers, times)
    best = jnp.full(directions.shape[:2], jnp.inf, directions.dtype)
    for geom_type in sorted(set(solids.type)):
        meet = jax.vmap(_MEET[geom_type], (0, 0, None))

        def nearer(
            best: Array, geom: tuple[Array, Array, Array], meet: Callable[..., Interval] = meet
        ) -> tuple[Array, None]:
            place, rotation, size = geom
            inward = jnp.swapaxes(rotation, 1, 2)
            local = rotate(inward, origin - place)
            rays = jnp.moveaxis(rotate(inward[:, None], directions), -1, 0)
            near, far = meet(local, (rays[0], rays[1], rays[2]), size[0])
            first = jnp.where(near >= 0.0, near, far)
            return jnp.where((near <= far) & (far >= 0.0), jnp.minimum(best, first), best), None

        group = solids.of_type(geom_type)
        each = jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1), (group.position, group.rotation, group.size))
        best, _ = lax.scan(nearer, best, each)
    return best


def _slab(offset: Array, component: Rays, half: Array) -> Interval:
    """Where the ray is between two parallel planes at +-half."""
    inverse = 1.0 / jnp.where(jnp.abs(component) < _PARALLEL, _PARALLEL, component)
    middle, reach = -offset * inverse, jnp.abs(half * inverse)
    return middle - reach, middle + reach


def _meet_plane(origin: Vector, direction: Direction, size: Vector) -> Interval:
    down = direction[2] < -_PARALLEL
    t = -origin[2] / jnp.where(down, direction[2], -1.0)
    # From below or upwards the interval is empty: only the upper face of the ground is met.
    return jnp.where(down, t, jnp.inf), jnp.where(down, t, -jnp.inf)


def _meet_box(origin: Vector, direction: Direction, size: Vector) -> Interval:
    (x0, x1), (y0, y1), (z0, z1) = (_slab(origin[i], direction[i], size[i]) for i in range(3))
    return jnp.maximum(jnp.maximum(x0, y0), z0), jnp.minimum(jnp.minimum(x1, y1), z1)


def _meet_ellipsoid(origin: Vector, direction: Direction, size: Vector) -> Interval:
    """The unit sphere, after division by the semi-axes."""
    inverse = 1.0 / size
    ox, oy, oz = origin * inverse
    dx, dy, dz = (direction[i] * inverse[i] for i in range(3))
    a = dx * dx + dy * dy + dz * dz
    t = -(ox * dx + oy * dy + oz * dz) / a
    px, py, pz = ox + t * dx, oy + t * dy, oz + t * dz
    return _chord(t, 1.0 - (px * px + py * py + pz * pz), a)


def _meet_sphere(origin: Vector, direction: Direction, size: Vector) -> Interval:
    return _meet_ellipsoid(origin, direction, jnp.broadcast_to(size[0], (3,)))


def _meet_capsule(origin: Vector, direction: Direction, size: Vector) -> Interval:
    """A cylinder and two spheres: the solid is convex, so the ray's interval is the hull of the three."""
    radius, half = size[0], size[1]
    dx, dy, dz = direction
    a = dx * dx + dy * dy
    along_axis = a < _PARALLEL
    a = jnp.where(along_axis, 1.0, a)
    t = -(origin[0] * dx + origin[1] * dy) / a
    px, py = origin[0] + t * dx, origin[1] + t * dy
    near, far = _chord(t, radius**2 - (px * px + py * py), a)
    inside = origin[0] ** 2 + origin[1] ** 2 <= radius**2
    near = jnp.where(along_axis, jnp.where(inside, -jnp.inf, jnp.inf), near)
    far = jnp.where(along_axis, jnp.where(inside, jnp.inf, -jnp.inf), far)
    bottom, top = _slab(origin[2], dz, half)
    near, far = jnp.maximum(near, bottom), jnp.minimum(far, top)
    empty = near > far
    near, far = jnp.where(empty, jnp.inf, near), jnp.where(empty, -jnp.inf, far)
    for side in (-1.0, 1.0):
        center = origin - side * half * jnp.array([0.0, 0.0, 1.0])
        t = -(center[0] * dx + center[1] * dy + center[2] * dz)
        qx, qy, qz = center[0] + t * dx, center[1] + t * dy, center[2] + t * dz
        cap_near, cap_far = _chord(t, radius**2 - (qx * qx + qy * qy + qz * qz), jnp.ones_like(t))
        near, far = jnp.minimum(near, cap_near), jnp.maximum(far, cap_far)
    return near, far


def _meet_triangle(origin: Vector, direction: Direction, size: Vector) -> Interval:
    """The plane z = 0, within three edges: the first along x, the others left of their lines."""
    a, b, c = size
    dx, dy, dz = direction
    crosses = jnp.abs(dz) > _PARALLEL
    t = -origin[2] / jnp.where(crosses, dz, 1.0)
    x, y = origin[0] + t * dx, origin[1] + t * dy
    second, third = (a - b) * y + c * (x - a), c * x - b * y
    seam = _SEAM * (jnp.abs(a) + jnp.abs(b) + jnp.abs(c))
    inside = crosses & (y >= -_SEAM) & (second <= seam) & (third >= -seam)
    return jnp.where(inside, t, jnp.inf), jnp.where(inside, t, -jnp.inf)


def _chord(middle: Rays, squared_depth: Rays, a: Rays) -> Interval:
    """Interval about `middle` in which a line is inside a quadric, from its squared depth there; empty if negative."""
    hit = squared_depth >= 0.0
    half = jnp.sqrt(jnp.where(hit, squared_depth, 0.0) / a)
    return jnp.where(hit, middle - half, jnp.inf), jnp.where(hit, middle + half, -jnp.inf)


_MEET: dict[int, Callable[[Vector, Direction, Vector], Interval]] = {
    PLANE: _meet_plane,
    SPHERE: _meet_sphere,
    CAPSULE: _meet_capsule,
    ELLIPSOID: _meet_ellipsoid,
    BOX: _meet_box,
    TRIANGLE: _meet_triangle,
}
