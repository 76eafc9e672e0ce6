"""Public worlds with movers, re-created from their parameters: SANDO's dynamic benchmark and P2M's world.

SANDO (mit-acl/sando, its launch and benchmark scripts at 93b2eed; Kondo et al., arXiv 2604.07599): boxes between
(0, 0, 2) and (105, 0, 2), 65 % of them moving on trefoils

    x = x₀ + S_x/6 (sin τ + 2 sin 2τ),   y = y₀ + S_y/5 (cos τ − 2 cos 2τ),   z = z₀ − S_z/2 sin 3τ,   τ = t/s + o

drawn in their order by Python's generator. There t is the wall clock; here it starts at 0.

P2M (arclab-hku/P2M, sim_test.launch, dynamic_env.cpp and infer.py at 9f55ec9): columns that move over 10 x 25 m between
cylinders, with velocities A sin ωt + 1.1 A on each axis whose amplitudes change sign at the border.
"""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float64

from maxjax.sim.worlds.geoms import BOX, CAPSULE, Geoms, concatenate, ground_plane
from maxjax.sim.worlds.movers import Movers, join_populations, straight, through

SANDO_START, SANDO_GOAL = (0.0, 0.0, 2.0), (105.0, 0.0, 2.0)
SANDO_HEIGHT = (0.5, 6.0)  # permitted [m]
SANDO_MOVING = 0.65  # share of the obstacles
_UPRIGHT = 0.35
_MOVES, _STANDS, _LIES = (0.4, 0.4, 0.4), (0.2, 0.2, 2.0), (0.2, 2.0, 0.2)  # half edges [m]


def sando(count: int, seed: int) -> tuple[Geoms, Movers]:
    """The ground with the obstacles of SANDO's benchmark that stand still, and those that move.

    Args:
        count: 50, 100 and 200 there.
        seed: of Python's generator.
    """
    draw = random.Random(seed)
    moving = int(SANDO_MOVING * count)
    upright = _UPRIGHT * (count - moving)
    place, half, size = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 3))
    offset, slowness = np.zeros(count), np.ones(count)
    for k in range(count):
        place[k] = draw.uniform(5.0, 100.0), draw.uniform(-6.0, 6.0), draw.uniform(0.5, 4.5)
        half[k] = _MOVES
        if k < moving:
            size[k] = [draw.uniform(2.0, 4.0) for _ in range(3)]
            offset[k], slowness[k] = draw.uniform(0.0, 3.0), draw.uniform(4.0, 6.0)
        elif k - moving < upright:
            half[k], place[k, 2] = _STANDS, 2.0
        else:
            half[k] = _LIES
    amplitude, frequency, phase = trefoils(size[:moving], offset[:moving], slowness[:moving])
    resting = straight(_boxes(half[:moving]), jnp.asarray(place[:moving], jnp.float32), jnp.zeros((moving, 3)))
    movers = dataclasses.replace(
        resting,
        amplitude=jnp.asarray(amplitude, jnp.float32),
        frequency=jnp.asarray(frequency, jnp.float32),
        phase=jnp.asarray(phase, jnp.float32),
    )
    stands = dataclasses.replace(_boxes(half[moving:]), position=jnp.asarray(place[moving:], jnp.float32))
    return concatenate([ground_plane(), stands]), movers


def trefoils(
    size: Float64[np.ndarray, "m 3"], offset: Float64[np.ndarray, " m"], slowness: Float64[np.ndarray, " m"]
) -> tuple[Float64[np.ndarray, "m 3 3"], Float64[np.ndarray, "m 3"], Float64[np.ndarray, "m 3 3"]]:
    """Amplitude, frequency and phase of SANDO's motions, as `Movers` have them: three oscillations each.

    Args:
        size: S [m].
        offset: o [rad].
        slowness: s [s/rad].
    """
    amplitude, phase = np.zeros((len(size), 3, 3)), np.zeros((len(size), 3, 3))
    amplitude[:, 0, 0], amplitude[:, 1, 0] = size[:, 0] / 6.0, size[:, 0] / 3.0
    amplitude[:, 0, 1], amplitude[:, 1, 1] = size[:, 1] / 5.0, -2.0 * size[:, 1] / 5.0
    amplitude[:, 2, 2] = -size[:, 2] / 2.0
    turns = np.arange(1.0, 4.0)
    phase[:] = (offset[:, None] * turns)[..., None]
    phase[:, :, 1] += 0.5 * math.pi  # a cosine
    return amplitude, turns / slowness[:, None], phase


P2M_START, P2M_GOAL = (0.0, -15.0, 2.0), (0.0, 15.0, 2.0)
P2M_SECONDS = 60.0
_AREA = (5.0, 12.5)  # half extents of what is drawn in [m]
_WALLS = (6.5, 17.5)
_AMPLITUDE, _FREQUENCY, _OFFSET = (0.34, 1.68), (0.0, 2.0), 1.1
_WIDTH, _TALL = (0.4, 0.5), (3.5, 4.0)
_DIAMETER, _FACTOR, _APART = (0.5, 0.7), (0.5, 1.5), 0.8
_KNOT = 0.02  # between the knots of a mover [s]
# Where solids are that no world has, and nobody sees [m].
_BURIED = -1000.0


def filled(geoms: Geoms, movers: Movers, still: int, moving: int) -> tuple[Geoms, Movers]:
    """The same world with so many solids and movers, the rest far below the ground: equal shapes fly in one batch."""
    more = still - len(geoms.type)
    if more:
        place = jnp.tile(jnp.array([0.0, 0.0, _BURIED]), (more, 1))
        rotation, size = (jnp.repeat(x[-1:], more, axis=0) for x in (geoms.rotation, geoms.size))
        geoms = concatenate([geoms, Geoms(place, rotation, size, geoms.type[-1:] * more)])
    more = moving - movers.count
    if more:
        place = jnp.tile(jnp.array([0.0, 0.0, _BURIED]), (more, 1))
        movers = join_populations([movers, straight(_boxes(np.full((more, 3), 0.1)), place, jnp.zeros((more, 3)))])
    return geoms, movers


def p2m(moving: int, still: int, seeds: Sequence[int]) -> list[tuple[Geoms, Movers]]:
    """The walls and cylinders of P2M's world, and its movers, over `P2M_SECONDS`, for each seed.

    Args:
        moving, still: 7 + 7, 13 + 13, 25 + 19, 25 + 0 and 0 + 44 there.
        seeds: of NumPy's generator; worlds of many take hardly longer than one.
    """
    generators = [np.random.default_rng(seed) for seed in seeds]
    still_ones = [_p2m_still(rng, still) for rng in generators]
    return list(zip(still_ones, _p2m_movers(generators, max(moving, 1), moving == 0), strict=True))


def _p2m_still(rng: np.random.Generator, still: int) -> Geoms:
    places: list[np.ndarray] = []
    while len(places) < still:
        place = rng.uniform(-1.0, 1.0, 2) * _AREA
        if all(np.linalg.norm(place - other) >= _APART for other in places):
            places.append(place)
    radius = 0.5 * rng.uniform(*_DIAMETER, still) * rng.uniform(*_FACTOR, still)
    # Capsules whose caps lie below the ground and above the permitted air are cylinders in between.
    sizes = np.stack([radius, np.full(still, 3.0), np.zeros(still)], -1)
    middle = np.concatenate([np.array(places).reshape(still, 2), np.full((still, 1), 2.0)], 1)
    upright = jnp.broadcast_to(jnp.eye(3), (still, 3, 3))
    cylinders = Geoms(jnp.asarray(middle, jnp.float32), upright, jnp.asarray(sizes, jnp.float32), (CAPSULE,) * still)
    return concatenate([ground_plane(), _walls(), cylinders])


def _walls() -> Geoms:
    x, y = _WALLS
    places = jnp.array([[x + 0.1, 0, 3], [-x - 0.1, 0, 3], [0, y + 0.1, 3], [0, -y - 0.1, 3]])
    half = np.array([[0.1, y, 3], [0.1, y, 3], [x, 0.1, 3], [x, 0.1, 3]])
    return dataclasses.replace(_boxes(half), position=places)


def _p2m_movers(generators: list[np.random.Generator], count: int, hidden: bool) -> list[Movers]:
    """Columns whose velocities turn round at the border of the area; `hidden`: below the ground."""

    def drawn(low: float, high: float, *shape: int) -> np.ndarray:
        return np.stack([rng.uniform(low, high, (count, *shape)) for rng in generators])

    place = drawn(-1.0, 1.0, 2) * _AREA
    amplitude, frequency = drawn(*_AMPLITUDE, 2), drawn(*_FREQUENCY, 2)
    half = 0.5 * np.stack([drawn(*_WIDTH)] * 2 + [drawn(*_TALL)], -1)
    times = _KNOT * np.arange(round(P2M_SECONDS / _KNOT) + 1)
    knots, velocity = np.zeros((2, len(generators), count, len(times), 3), np.float32)
    knots[..., 2] = half[..., None, 2] + (_BURIED if hidden else 0.0)
    step = np.zeros_like(place)
    for k, time in enumerate(times):
        # Who leaves the area turns round, on both axes at once: in a knot at rest, half a step short of that.
        outward = np.sign(place) * amplitude * (np.sin(frequency * time) + _OFFSET) > 0.0
        leaves = np.any((np.abs(place) > _AREA) & outward, axis=-1, keepdims=True)
        amplitude = np.where(leaves, -amplitude, amplitude)
        place = np.where(leaves, place - 0.5 * step, place)
        knots[..., k, :2] = place
        velocity[..., k, :2] = np.where(leaves, 0.0, amplitude * (np.sin(frequency * time) + _OFFSET))
        # ∫ A (sin ωt + 1.1) dt over a step, exactly.
        swing = _KNOT * np.sinc(frequency * _KNOT / (2.0 * np.pi)) * np.sin(frequency * (time + 0.5 * _KNOT))
        step = amplitude * (swing + _OFFSET * _KNOT) * np.where(leaves, 0.5, 1.0)
        place = place + step
    pace = jnp.full(count, _KNOT)
    return [
        through(_boxes(size), jnp.asarray(way), jnp.asarray(fast), pace)
        for size, way, fast in zip(half, knots, velocity, strict=True)
    ]


def _boxes(half: np.ndarray) -> Geoms:
    count = len(half)
    upright = jnp.broadcast_to(jnp.eye(3), (count, 3, 3))
    return Geoms(jnp.zeros((count, 3)), upright, jnp.asarray(half, jnp.float32), (BOX,) * count)
