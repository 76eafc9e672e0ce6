"""Movers: solids whose place is a closed form of time.

    p(t) = c(t) + Σ_k A_k sin(ω_k t + φ_k)                   c: a curve through knots, cubic between two of them

A knot holds place and velocity, and knots of a mover are `step` seconds apart. Cubics between places with velocities
(Hermite) reproduce constant velocity and constant acceleration exactly, and by many knots any recorded motion. After
its last knot a mover goes on with the last velocity, or, where it loops, from the last knot to the first again: one
knot is constant velocity, or, at rest, the middle of an oscillation.

    x_world = p(t) + rotation(t) · x_solid                   rotation(t) = heading(t) · rotation

A mover that `faces` its way is turned about the vertical to the direction of its horizontal velocity: its solid's x is
then forward. Nothing here reacts to a vehicle.

All but the types of the solids is traced, so that populations of equal size and types are one program under `vmap`.
Frame: world, ENU, metres, seconds since the start of the flight.
"""

from __future__ import annotations

import dataclasses
import itertools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from maxjax.compile.lowering import rotate
from maxjax.sim.worlds.geoms import Geoms, concatenate, half_edges, rotation_z

# Horizontal speed below which a mover has no direction to face [m/s].
_SLOW = 1e-3
_CORNERS = tuple(itertools.product((-1.0, 1.0), repeat=3))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Movers:
    """Moving solids of one world; batch axes lead.

    Attributes:
        solids: their shapes; `position` is the offset of each solid from its mover's place, mostly zero.
        knots: places on the curve c [m].
        velocity: at the knots [m/s].
        step: between two knots [s].
        loops: whether the curve goes on from its last knot to its first.
        amplitude: A of each oscillation [m].
        frequency: ω of each oscillation [rad/s].
        phase: φ of each oscillation, one an axis [rad].
        faces: whether the solid is turned to its horizontal velocity.
    """

    solids: Geoms
    knots: Float[Array, "*batch m k 3"]
    velocity: Float[Array, "*batch m k 3"]
    step: Float[Array, "*batch m"]
    loops: Bool[Array, "*batch m"]
    amplitude: Float[Array, "*batch m h 3"]
    frequency: Float[Array, "*batch m h"]
    phase: Float[Array, "*batch m h 3"]
    faces: Bool[Array, "*batch m"]

    @property
    def count(self) -> int:
        """Number of movers."""
        return self.knots.shape[-3]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Moving:
    """Movers at a time [s]."""

    movers: Movers
    time: Float[Array, "*batch"]


def straight(solids: Geoms, place: Float[Array, "m 3"], velocity: Float[Array, "m 3"]) -> Movers:
    """Movers with constant velocities.

    Args:
        solids: a shape each, centred on the mover's place.
        place: at time 0 [m].
        velocity: [m/s].
    """
    return through(solids, place[:, None], velocity[:, None], jnp.ones(place.shape[0]))


def through(
    solids: Geoms,
    knots: Float[Array, "m k 3"],
    velocity: Float[Array, "m k 3"],
    step: Float[Array, " m"],
    *,
    loops: bool = False,
    faces: bool = False,
) -> Movers:
    """Movers along curves through knots, without oscillations.

    Raises:
        ValueError: unless there are as many solids, knots and velocities as movers.
    """
    count = knots.shape[0]
    if knots.shape != velocity.shape or step.shape != (count,) or len(solids.type) != count:
        raise ValueError(
            f"movers: expected as many solids, velocities and steps as knots {knots.shape}, given {len(solids.type)}, "
            f"{velocity.shape} and {step.shape}"
        )
    none = jnp.zeros((count, 0, 3))
    flags = (jnp.full(count, loops), jnp.full(count, faces))
    return Movers(solids, knots, velocity, step, flags[0], none, none[..., 0], none, flags[1])


def places(movers: Movers, time: Float[Array, ""]) -> tuple[Float[Array, "m 3"], Float[Array, "m 3"]]:
    """Place [m] and velocity [m/s] of every mover at a time [s]; `vmap` over times."""
    count = movers.knots.shape[-2]
    # A loop is as many steps long as it has knots; an open curve ends with its last one.
    passed = time / movers.step
    passed = jnp.where(movers.loops, passed % count, passed)
    first = jnp.clip(jnp.floor(passed), 0, count - 1).astype(jnp.int32)
    goes_on = ~movers.loops & (first == count - 1)
    second = jnp.where(goes_on, first, (first + 1) % count)

    def at(values: Float[Array, "m k 3"], index: Array) -> Float[Array, "m 3"]:
        return jnp.take_along_axis(values, index[:, None, None], axis=1)[:, 0]

    a, b = at(movers.knots, first), at(movers.knots, second)
    step = movers.step[:, None]
    u, v = at(movers.velocity, first) * step, at(movers.velocity, second) * step
    h = (passed - first)[:, None]
    square, cube = 3.0 * (b - a) - 2.0 * u - v, 2.0 * (a - b) + u + v
    last = goes_on[:, None]
    place = a + h * jnp.where(last, u, u + h * (square + h * cube))
    velocity = jnp.where(last, u, u + h * (2.0 * square + 3.0 * h * cube)) / step

    angle = movers.frequency[..., None] * time + movers.phase
    place += jnp.sum(movers.amplitude * jnp.sin(angle), axis=-2)
    velocity += jnp.sum(movers.amplitude * movers.frequency[..., None] * jnp.cos(angle), axis=-2)
    return place, velocity


def solids_at(movers: Movers, time: Float[Array, ""]) -> Geoms:
    """The solids where they are at a time [s]; `vmap` over times."""
    place, velocity = places(movers, time)
    x, y = velocity[:, 0], velocity[:, 1]
    turns = movers.faces & (x * x + y * y > _SLOW**2)
    heading = rotation_z(jnp.where(turns, jnp.arctan2(jnp.where(turns, y, 0.0), jnp.where(turns, x, 1.0)), 0.0))
    solids = movers.solids
    columns = rotate(heading[:, None], jnp.swapaxes(solids.rotation, 1, 2))
    offset = rotate(heading, solids.position)
    return Geoms(place + offset, jnp.swapaxes(columns, 1, 2), solids.size, solids.type)


def boxes_at(movers: Movers, times: Float[Array, " t"], least: float = 0.0) -> Float[Array, "t m 8 3"]:
    """Corners of a box around each solid, along the solid's own axes, at some times [s].

    Args:
        movers: of one world.
        times: [s].
        least: half edge of a box at least [m], so that small ones can be seen.
    """
    at = jax.vmap(solids_at, (None, 0))(movers, times)
    along = dataclasses.replace(movers.solids, rotation=jnp.broadcast_to(jnp.eye(3), movers.solids.rotation.shape))
    half = jnp.maximum(half_edges(along), least)
    corners = at.position[..., None, :] + jnp.einsum(
        "tmij,cj,mj->tmci", at.rotation, jnp.asarray(_CORNERS), half, precision="highest"
    )
    return corners


def join_populations(groups: list[Movers]) -> Movers:
    """All groups as one population; shorter curves and sums are filled up without a change.

    Raises:
        ValueError: for curves of several knots whose numbers differ: a loop cannot be filled up.
    """
    knots = max(group.knots.shape[-2] for group in groups)
    terms = max(group.amplitude.shape[-2] for group in groups)
    return _concatenated([_filled(group, knots, terms) for group in groups])


def _filled(movers: Movers, knots: int, terms: int) -> Movers:
    have, more = movers.knots.shape[-2], knots - movers.knots.shape[-2]
    if have not in (1, knots):
        raise ValueError(f"movers: expected curves of one knot or of {knots}, given one of {have}")
    # One knot with its velocity is a straight line, through any knots on it.
    steps = jnp.arange(knots)[:, None] * movers.step[:, None, None]
    line = movers.knots if not more else movers.knots + steps * movers.velocity
    extra = ((0, 0), (0, terms - movers.amplitude.shape[-2]))
    return dataclasses.replace(
        movers,
        knots=line,
        velocity=jnp.broadcast_to(movers.velocity, line.shape),
        amplitude=jnp.pad(movers.amplitude, (*extra, (0, 0))),
        frequency=jnp.pad(movers.frequency, extra),
        phase=jnp.pad(movers.phase, (*extra, (0, 0))),
    )


def _concatenated(groups: list[Movers]) -> Movers:
    solids = concatenate([group.solids for group in groups])
    parts = {
        field.name: jnp.concatenate([getattr(group, field.name) for group in groups])
        for field in dataclasses.fields(Movers)
        if field.name != "solids"
    }
    return Movers(solids, **parts)
