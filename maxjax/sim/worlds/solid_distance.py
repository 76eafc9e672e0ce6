"""Signed distance from a point to the solids of a scene, exact.

    d(p) = min over the surface of |p − x|, negative inside            contact:  d(p) ≤ radius of the vehicle

Box, sphere, capsule and plane are closed forms. For any convex solid with support function h,

    d(p) = max over unit n of  n · p − h(n)         (ellipsoid: h(n) = |S n|, S the semi-axes)

and the maximising n is the outward normal at the nearest surface point. So an error ε in n costs only O(ε²), always on
the low side, and n itself is the derivative of d: the ellipsoid's normal is found by iteration and held constant, and
the two terms above are evaluated and differentiated.

The normal is n ∝ p_i / (s + r_i − 1) with r_i = (e_i / e)², e the least semi-axis, where s > 0 solves |u(s)| = 1,
u_i = r_i (p_i / e_i) / (s + r_i − 1) (Eberly, "Distance from a point to an ellipse, an ellipsoid, or a
hyperellipsoid"). 1 / |u(s)| is concave, rising and almost straight, as in trust regions: Newton's method on it, started
on the low side, increases to the root without overshoot (Conn, Gould and Toint, Trust-Region Methods, section 7.3).

Geoms are grouped by their static types; inside a group everything is elementwise, without gathers or small matrix
products, because a flight evaluates the distance a hundred times a second.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from maxjax.sim.worlds.geoms import BOX, CAPSULE, ELLIPSOID, PLANE, SPHERE, Geoms

# Newton steps for an ellipsoid's normal.
_STEPS = 8
# Coordinates are kept this far from an ellipsoid's planes of symmetry [share of the least semi-axis]: the root s then
# stays positive, and the distance moves by no more than that.
_OFF_PLANE = 1e-6
# Golden sections of a search along a vertical: 0.618^32 of a city's height is 30 µm.
_SECTIONS = 32
_GOLDEN = 0.6180339887498949

PerGeom = Float[Array, " g"]
Local = tuple[Array, Array, Array]


def distances(geoms: Geoms, point: Float[Array, "3"]) -> Float[Array, " g"]:
    """Signed distance from a point to every geom, in the order of the geoms; `jit`, `vmap` and `grad` safe.

    Args:
        geoms: one scene.
        point: world frame [m].

    Returns:
        Distances [m], negative inside.

    Raises:
        ValueError: for batched geoms or points; use `vmap`.
    """
    _check(geoms, point)
    found = {kind: _of_type(kind, geoms, point) for kind in sorted(set(geoms.type))}
    # Restore the order of the geoms: each run of equal types is a slice of its group.
    parts, used = [], dict.fromkeys(found, 0)
    for kind, run in itertools.groupby(geoms.type):
        count = len(tuple(run))
        parts.append(lax.slice_in_dim(found[kind], used[kind], used[kind] + count))
        used[kind] += count
    return jnp.concatenate(parts) if parts else jnp.zeros(0, point.dtype)


def distance(geoms: Geoms, point: Float[Array, "3"]) -> Float[Array, ""]:
    """The least of `distances` [m]; infinity in a scene without geoms."""
    _check(geoms, point)
    least = [jnp.min(_of_type(kind, geoms, point)) for kind in sorted(set(geoms.type))]
    return jnp.min(jnp.stack(least)) if least else jnp.asarray(jnp.inf, point.dtype)


def horizontal_distance(geoms: Geoms, point: Float[Array, "3"]) -> Float[Array, ""]:
    """Least distance from the vertical through a point, above z = 0, to any solid; planes (the ground) are left out.

    The solids are convex, so their distance is convex along a line, and golden-section search finds its minimum. The
    distance to solids below z = 0 is that from the vertical's foot, so padding does not count.

    Args:
        geoms: one scene.
        point: world frame [m]; its height does not matter.

    Returns:
        Distance [m]; negative where the vertical passes through a solid; infinity where there is none.

    Raises:
        ValueError: for batched geoms or points; use `vmap`.
    """
    _check(geoms, point)
    least = [jnp.min(_along_vertical(kind, geoms, point)) for kind in sorted(set(geoms.type)) if kind != PLANE]
    return jnp.min(jnp.stack(least)) if least else jnp.asarray(jnp.inf, point.dtype)


def _check(geoms: Geoms, point: Array) -> None:
    if geoms.position.ndim != 2 or point.shape != (3,):
        raise ValueError(
            f"distance: expected geoms (g, 3) and point (3,), given {geoms.position.shape} and {point.shape}; "
            "use vmap for batches"
        )


def _group(geoms: Geoms, kind: int) -> tuple[Array, Array, Array]:
    """Positions, rotations and sizes of one type, by static slices."""
    stops = list(itertools.accumulate(len(tuple(run)) for _, run in itertools.groupby(geoms.type)))
    runs = [(start, stop) for start, stop in zip([0, *stops], stops, strict=False) if geoms.type[start] == kind]
    position, rotation, size = (
        jnp.concatenate([lax.slice_in_dim(a, start, stop) for start, stop in runs])
        for a in (geoms.position, geoms.rotation, geoms.size)
    )
    return position, rotation, size


def _local(rotation: Array, offset: Array) -> Local:
    """Rᵀ (p − centre), component by component."""
    x, y, z = (jnp.sum(rotation[..., i] * offset, axis=-1) for i in range(3))
    return x, y, z


def _of_type(kind: int, geoms: Geoms, point: Array) -> PerGeom:
    position, rotation, size = _group(geoms, kind)
    return _DISTANCE[kind](_local(rotation, point - position), size)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _SectionCarry:
    """Golden-section search of each geom: the interval [low, high], two points a < b inside, and the values there."""

    low: PerGeom
    high: PerGeom
    a: PerGeom
    b: PerGeom
    at_a: PerGeom
    at_b: PerGeom


def _along_vertical(kind: int, geoms: Geoms, point: Array) -> PerGeom:
    position, rotation, size = _group(geoms, kind)
    foot = _local(rotation, point * jnp.array([1.0, 1.0, 0.0]) - position)
    up = rotation[:, 2, :]

    def at(z: PerGeom) -> PerGeom:
        x, y, w = (foot[i] + z * up[:, i] for i in range(3))
        return _DISTANCE[kind]((x, y, w), size)

    def section(_: Array, carry: _SectionCarry) -> _SectionCarry:
        a, b, at_a, at_b = carry.a, carry.b, carry.at_a, carry.at_b
        left = at_a <= at_b  # the least value lies in [low, b], else in [a, high]
        low, high = jnp.where(left, carry.low, a), jnp.where(left, b, carry.high)
        kept, value = jnp.where(left, a, b), jnp.where(left, at_a, at_b)
        width = _GOLDEN * (high - low)
        fresh = jnp.where(left, high - width, low + width)
        new = at(fresh)
        a, at_a = jnp.where(left, fresh, kept), jnp.where(left, new, value)
        b, at_b = jnp.where(left, kept, fresh), jnp.where(left, value, new)
        return _SectionCarry(low, high, a, b, at_a, at_b)

    # The nearest point of a solid lies at a height where the solid is.
    reach = jnp.sum(size, axis=-1)
    low, high = (jnp.maximum(position[:, 2] + side * reach, 0.0) for side in (-1.0, 1.0))
    width = _GOLDEN * (high - low)
    a, b = high - width, low + width
    at_a, at_b = jax.vmap(at)(jnp.stack([a, b]))
    found = lax.fori_loop(0, _SECTIONS, section, _SectionCarry(low, high, a, b, at_a, at_b))
    return jnp.minimum(found.at_a, found.at_b)


def _norm(squared: Array) -> Array:
    """Square root of a sum of squares; its derivative at zero is zero."""
    positive = squared > 0.0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, squared, 1.0)), 0.0)


def _to_plane(p: Local, size: Array) -> PerGeom:
    return p[2]


def _to_box(p: Local, size: Array) -> PerGeom:
    x, y, z = (jnp.abs(p[i]) - size[:, i] for i in range(3))
    beyond = [jnp.maximum(q, 0.0) for q in (x, y, z)]
    outside = _norm(beyond[0] ** 2 + beyond[1] ** 2 + beyond[2] ** 2)
    return outside + jnp.minimum(jnp.maximum(jnp.maximum(x, y), z), 0.0)


def _to_capsule(p: Local, size: Array) -> PerGeom:
    x, y, z = p
    z = z - jnp.clip(z, -size[:, 1], size[:, 1])
    return _norm(x * x + y * y + z * z) - size[:, 0]


def _to_sphere(p: Local, size: Array) -> PerGeom:
    return _norm(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) - size[:, 0]


def _to_ellipsoid(p: Local, size: Array) -> PerGeom:
    e = [size[:, i] for i in range(3)]
    least = jnp.minimum(jnp.minimum(e[0], e[1]), e[2])
    # One octant, off the planes of symmetry, in units of the least semi-axis. Constants of the derivative.
    y = [lax.stop_gradient(jnp.maximum(jnp.abs(p[i]) / least, _OFF_PLANE)) for i in range(3)]
    f = [lax.stop_gradient(e[i] / least) for i in range(3)]
    lift = [(f[i] - 1.0) * (f[i] + 1.0) for i in range(3)]  # r_i − 1
    weighted = [f[i] * y[i] for i in range(3)]  # r_i p_i / e_i

    # At this s the greatest component of u is 1: |u| ≥ 1, the low side.
    s = jnp.maximum(jnp.maximum(weighted[0] - lift[0], weighted[1] - lift[1]), weighted[2] - lift[2])
    for _ in range(_STEPS):
        inverse = [1.0 / (s + lift[i]) for i in range(3)]
        u = [weighted[i] * inverse[i] for i in range(3)]
        squared = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
        slope = u[0] * u[0] * inverse[0] + u[1] * u[1] * inverse[1] + u[2] * u[2] * inverse[2]
        s = s + jnp.maximum(jnp.sqrt(squared) - 1.0, 0.0) * squared / slope
    n = [y[i] / (s + lift[i]) for i in range(3)]
    scale = lax.rsqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    n = [jnp.where(p[i] < 0.0, -1.0, 1.0) * n[i] * scale for i in range(3)]
    support = _norm((e[0] * n[0]) ** 2 + (e[1] * n[1]) ** 2 + (e[2] * n[2]) ** 2)
    return n[0] * p[0] + n[1] * p[1] + n[2] * p[2] - support


_DISTANCE: dict[int, Callable[[Local, Array], PerGeom]] = {
    PLANE: _to_plane,
    SPHERE: _to_sphere,
    CAPSULE: _to_capsule,
    ELLIPSOID: _to_ellipsoid,
    BOX: _to_box,
}
