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

import jax.numpy as jnp
import numpy as np

from maxjax.worlds.geoms import BOX, Geoms
from maxjax.worlds.movers import Movers, straight

SANDO_START, SANDO_GOAL = (0.0, 0.0, 2.0), (105.0, 0.0, 2.0)
SANDO_HEIGHT = (0.5, 6.0)  # permitted [m]
SANDO_LIMITS = {"speed": 5.0, "acceleration": 20.0, "jerk": 100.0}
_MOVING, _UPRIGHT = 0.65, 0.35
_MOVES, _STANDS, _LIES = (0.4, 0.4, 0.4), (0.2, 0.2, 2.0), (0.2, 2.0, 0.2)  # half edges [m]


def sando(count: int, seed: int) -> Movers:
    """The obstacles of SANDO's benchmark, moving ones first; those that stand still are movers at rest.

    Args:
        count: 50, 100 and 200 there.
        seed: of Python's generator.
    """
    draw = random.Random(seed)
    moving = int(_MOVING * count)
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
    amplitude, phase = np.zeros((count, 3, 3)), np.zeros((count, 3, 3))
    amplitude[:, 0, 0], amplitude[:, 1, 0] = size[:, 0] / 6.0, size[:, 0] / 3.0
    amplitude[:, 0, 1], amplitude[:, 1, 1] = size[:, 1] / 5.0, -2.0 * size[:, 1] / 5.0
    amplitude[:, 2, 2] = -size[:, 2] / 2.0
    turns = np.arange(1.0, 4.0)
    phase[:] = (offset[:, None] * turns)[..., None]
    phase[:, :, 1] += 0.5 * math.pi  # a cosine
    still = straight(_boxes(half), jnp.asarray(place, jnp.float32), jnp.zeros((count, 3)))
    return dataclasses.replace(
        still,
        amplitude=jnp.asarray(amplitude, jnp.float32),
        frequency=jnp.asarray(turns / slowness[:, None], jnp.float32),
        phase=jnp.asarray(phase, jnp.float32),
    )


def _boxes(half: np.ndarray) -> Geoms:
    count = len(half)
    upright = jnp.broadcast_to(jnp.eye(3), (count, 3, 3))
    return Geoms(jnp.zeros((count, 3)), upright, jnp.asarray(half, jnp.float32), (BOX,) * count)
