"""Ways of movers, one drawn from twelve uniform numbers, and what has to be free for it.

    p(t) = c + P sin α + Q cos α + C sin(2 α + β) ẑ,   α = ω t + α₀            P ⟂ Q horizontal
    |p'| ≤ ω √(max(|P|, |Q|)² + 4 C²)                  |p''| on an axis ≤ ω² (√(P² + Q²) + 4 C on z)

and ω is the greatest that keeps the asked speed and 2 m/s² on each axis, so a small curve is flown slowly. Free have to
be points of it: at these the distance to walls is by half their spacing larger than asked, and a distance changes by no
more than the point moves, so it is kept all the way. Encounters are straight, by closest approach to the vehicle's way.

Frame: world, ENU, metres; the ground is z = 0.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from maxjax.sim.worlds.geoms import BOX, CAPSULE, PLANE, SPHERE, Geoms, concatenate, rotation_z

ACCELERATION = 2.0
"""Greatest acceleration of a mover, on each axis [m/s²]."""

_AROUND = 40.0  # around the box of both ends, in which curves have their middles [m]
_HEIGHT = (3.0, 40.0)
_NOMINAL = 5.0  # speed of the vehicle that encounters are drawn for [m/s]
_MISS = 2.0  # greatest distance of their closest approach [m]
_FREE = 15.0  # from closest approach to where encounters may pass through walls [m]
_LONGEST = 60.0  # half length of a curve [m]

_SAMPLES = 128  # of a curve
_JIB = (11, 48)  # samples of a jib's disc: radii, angles
_CAR = np.array([2.25, 0.9, 0.75])  # half edges [m]
# Axes of a capsule that lies along the way, and across it.
_ALONG = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
_ACROSS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Place:
    """Where movers are drawn: the city, and the ends of the vehicle's way [m]."""

    geoms: Geoms
    start: Float[Array, "3"]
    goal: Float[Array, "3"]

    @property
    def walls(self) -> Geoms:
        """The solids without the ground; none in a plain."""
        kinds = sorted(set(self.geoms.type) - {PLANE})
        return concatenate([self.geoms.of_type(kind) for kind in kinds or [-1]])


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Drawn:
    """A mover that may be, and what has to be free for it; batch axes lead.

    Attributes:
        knot, velocity: of its straight part [m], [m/s].
        sine, cosine: P and Q [m].
        lift: C [m].
        phase: α₀ and β [rad].
        rate: ω [rad/s].
        rotation, size: of its solid.
        points: that have to be free [m]; none once that was tested.
        need: distance of those to walls [m].
        reach: from its place to its surface, at most [m].
    """

    knot: Float[Array, "*batch 3"]
    velocity: Float[Array, "*batch 3"]
    sine: Float[Array, "*batch 3"]
    cosine: Float[Array, "*batch 3"]
    lift: Float[Array, "*batch"]
    phase: Float[Array, "*batch 2"]
    rate: Float[Array, "*batch"]
    rotation: Float[Array, "*batch 3 3"]
    size: Float[Array, "*batch 3"]
    points: Float[Array, "*batch n 3"]
    need: Float[Array, "*batch"]
    reach: Float[Array, "*batch"]

    def at(self, time: Float[Array, ""]) -> Float[Array, "3"]:
        """Its place [m] at a time [s]."""
        angle = self.rate * time + self.phase[0]
        place = self.knot + time * self.velocity + self.sine * jnp.sin(angle) + self.cosine * jnp.cos(angle)
        return place.at[2].add(self.lift * jnp.sin(2.0 * angle + self.phase[1]))


# Draws one from uniform numbers, the share of curves before it, the place, the speed asked for, and the mover's number.
Draw = Callable[[Float[Array, "12"], Float[Array, ""], Place, float, Array], Drawn]


def _middle(u: Float[Array, "3"], place: Place) -> Float[Array, "3"]:
    """A point around the way, in heights that movers fly at."""
    low = jnp.minimum(place.start, place.goal) - _AROUND
    high = jnp.maximum(place.start, place.goal) + _AROUND
    low, high = low.at[2].set(_HEIGHT[0]), high.at[2].set(_HEIGHT[1])
    return low + u * (high - low)


def _heading(u: Float[Array, "2"], place: Place) -> Float[Array, ""]:
    """A direction along or across one of the solids, as streets have [rad]."""
    rotation = place.geoms.rotation
    one = rotation[jnp.floor(u[0] * len(rotation)).astype(jnp.int32)]
    return jnp.arctan2(one[1, 0], one[0, 0]) + 0.5 * jnp.pi * jnp.floor(2.0 * u[1])


def _curve(
    u: Float[Array, "12"], late: Array, place: Place, speed: float | Array, body: tuple[Array, Array, Array]
) -> Drawn:
    """A long curve that bends up and down, of a body: its rotation, size and reach."""
    rotation, size, reach = body
    least = jnp.maximum(speed * speed / ACCELERATION, 8.0)
    a = jnp.minimum((1.0 - 0.8 * late) * least * (1.0 + u[0]), _LONGEST)
    b = jnp.minimum(a, 1.0 + 6.0 * u[1])
    lift = 2.0 * u[2]
    yaw = _heading(u[3:5], place)
    ahead = jnp.stack([jnp.cos(yaw), jnp.sin(yaw), jnp.zeros(())])
    aside = jnp.stack([-jnp.sin(yaw), jnp.cos(yaw), jnp.zeros(())])
    per_turn = jnp.hypot(a, 2.0 * lift)  # the greatest speed at one radian a second
    bent = jnp.hypot(a * ahead, b * aside).at[2].add(4.0 * lift)
    drawn = Drawn(
        knot=_middle(u[5:8], place),
        velocity=jnp.zeros(3),
        sine=a * ahead,
        cosine=b * aside,
        lift=lift,
        phase=2.0 * jnp.pi * u[8:10],
        rate=jnp.minimum(speed / per_turn, jnp.sqrt(ACCELERATION / jnp.max(bent))),
        rotation=rotation,
        size=size,
        points=jnp.zeros((0, 3)),
        need=2.0 + reach + per_turn * jnp.pi / _SAMPLES,
        reach=reach,
    )
    turns = jnp.arange(_SAMPLES) * (2.0 * jnp.pi / _SAMPLES)
    points = jax.vmap(drawn.at)(turns / drawn.rate)
    # Outside the heights that are flown at, nothing is free.
    within = jnp.all((points[:, 2] >= _HEIGHT[0]) & (points[:, 2] <= _HEIGHT[1]))
    return dataclasses.replace(drawn, points=points, need=jnp.where(within, drawn.need, jnp.inf))


def _drone_body(u: Array, number: Array) -> tuple[Array, Array, Array]:
    """Every other one a box, half as high as wide."""
    half = 0.15 + 0.15 * u
    box = number % 2 == 1
    size = jnp.where(box, jnp.stack([half, half, 0.5 * half]), jnp.stack([half, 0.0 * half, 0.0 * half]))
    return jnp.eye(3), size, jnp.where(box, 1.5, 1.0) * half


def _drone(u: Float[Array, "12"], late: Array, place: Place, speed: float, number: Array) -> Drawn:
    return _curve(u, late, place, speed, _drone_body(u[10], number))


def _bird(u: Float[Array, "12"], late: Array, place: Place, speed: float, number: Array) -> Drawn:
    body = jnp.asarray(_ALONG), jnp.array([0.15, 0.15, 0.0]), jnp.float32(0.3)
    return _curve(u, late, place, jnp.clip((0.6 + 0.8 * u[10]) * speed, 3.0, 15.0), body)


def _car(u: Float[Array, "12"], late: Array, place: Place, speed: float, number: Array) -> Drawn:
    """To and fro on a straight way: a box that is turned half round is the same box."""
    least = max(speed * speed / ACCELERATION, 10.0)
    a = jnp.minimum((1.0 - 0.7 * late) * least * (1.0 + u[0]), _LONGEST)
    yaw = _heading(u[3:5], place)
    ahead = jnp.stack([jnp.cos(yaw), jnp.sin(yaw), jnp.zeros(())])
    middle = _middle(u[5:8], place).at[2].set(_CAR[2] + 0.05)
    half = a + _CAR[0]
    along = jnp.linspace(-1.0, 1.0, _SAMPLES)[:, None] * half
    return Drawn(
        knot=middle,
        velocity=jnp.zeros(3),
        sine=a * ahead,
        cosine=jnp.zeros(3),
        lift=jnp.zeros(()),
        phase=2.0 * jnp.pi * u[8:10],
        rate=jnp.minimum(speed / a, jnp.sqrt(ACCELERATION / a)),
        rotation=rotation_z(yaw),
        size=jnp.asarray(_CAR, jnp.float32),
        points=middle + along * ahead,
        need=0.5 + float(np.hypot(*_CAR[1:])) + half / (_SAMPLES - 1),
        reach=jnp.float32(np.linalg.norm(_CAR)),
    )


def _crane(u: Float[Array, "12"], late: Array, place: Place, speed: float, number: Array) -> Drawn:
    """A jib that turns about one of its ends, above what it would meet."""
    radius, length = 0.4, 12.0 + 8.0 * u[0]
    r = 0.5 * length
    foot = _middle(u[5:8], place)
    shares, angles = jnp.linspace(0.0, 1.0, _JIB[0]), jnp.arange(_JIB[1]) * (2.0 * jnp.pi / _JIB[1])
    rim = jnp.stack([jnp.cos(angles), jnp.sin(angles), 0.0 * angles], -1)
    disc = foot + length * (shares[:, None, None] * rim).reshape(-1, 3)
    x, y = r * jnp.eye(3)[:2]
    return Drawn(
        knot=foot,
        velocity=jnp.zeros(3),
        sine=x,
        cosine=y,
        lift=jnp.zeros(()),
        phase=2.0 * jnp.pi * u[8:10],
        rate=jnp.minimum(speed / length, jnp.sqrt(ACCELERATION / length)),  # its tip keeps both bounds
        rotation=jnp.asarray(_ACROSS, jnp.float32),
        size=jnp.stack([jnp.float32(radius), r - radius, jnp.zeros(())]),
        points=disc,
        need=1.0 + radius + 0.5 * length * float(np.hypot(1.0 / (_JIB[0] - 1), 2.0 * np.pi / _JIB[1])),
        reach=r,
    )


def _encounter(u: Float[Array, "12"], late: Array, place: Place, speed: float, number: Array) -> Drawn:
    """A straight way by closest approach to a vehicle on its nominal way."""
    way = place.goal - place.start
    length = jnp.maximum(jnp.linalg.norm(way), 1e-3)
    nominal = _NOMINAL * way / length
    time = u[0] * length / _NOMINAL
    yaw, up = 2.0 * jnp.pi * u[1], 0.6 * (u[2] - 0.5)
    velocity = speed * jnp.stack([jnp.cos(yaw) * jnp.cos(up), jnp.sin(yaw) * jnp.cos(up), jnp.sin(up)])
    # Closest approach: the distance stands at right angles to the relative velocity.
    relative = velocity - nominal
    relative /= jnp.maximum(jnp.linalg.norm(relative), 1e-6)
    any_way = jax.scipy.special.ndtri(jnp.clip(u[3:6], 1e-6, 1.0 - 1e-6))
    aside = any_way - jnp.dot(any_way, relative) * relative
    aside *= _MISS * u[6] / jnp.maximum(jnp.linalg.norm(aside), 1e-6)
    met = place.start + time * nominal + aside
    rotation, size, reach = _drone_body(u[10], number)
    return Drawn(
        knot=met - time * velocity,
        velocity=velocity,
        sine=jnp.zeros(3),
        cosine=jnp.zeros(3),
        lift=jnp.zeros(()),
        phase=jnp.zeros(2),
        rate=jnp.zeros(()),
        rotation=rotation,
        size=size,
        points=met + jnp.linspace(-_FREE, _FREE, _SAMPLES)[:, None] * velocity / speed,
        need=0.5 + reach + _FREE / (_SAMPLES - 1),
        reach=reach,
    )


DRAWS: dict[str, Draw] = {
    "drones": _drone, "birds": _bird, "cars": _car, "cranes": _crane, "encounters": _encounter,
}  # fmt: skip
# Types of their solids, in turn.
TYPES = {
    "drones": (SPHERE, BOX), "birds": (CAPSULE,), "cars": (BOX,), "cranes": (CAPSULE,), "encounters": (SPHERE, BOX),
}  # fmt: skip
