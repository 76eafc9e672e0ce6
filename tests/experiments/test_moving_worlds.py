"""The public worlds with movers against their own formulas, evaluated here in float64."""

from __future__ import annotations

import math
import random

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.moving_worlds import P2M_SECONDS, p2m, sando
from maxjax.sim.worlds.geoms import BOX, CAPSULE
from maxjax.sim.worlds.movers import places, solids_at
from maxjax.sim.worlds.solid_distance import distance


@pytest.mark.parametrize("count", [50, 200])
def test_sando_is_drawn_in_its_order_and_moves_on_its_trefoils(count: int) -> None:
    geoms, movers = sando(count, 7)
    draw = random.Random(7)
    expected = []
    for _ in range(int(0.65 * count)):
        x, y, z = draw.uniform(5, 100), draw.uniform(-6, 6), draw.uniform(0.5, 4.5)
        sx, sy, sz = (draw.uniform(2, 4) for _ in range(3))
        offset, slowness = draw.uniform(0, 3), draw.uniform(4, 6)

        def at(t: float, p=(x, y, z), s=(sx, sy, sz), o=offset, w=slowness) -> list[float]:  # type: ignore[no-untyped-def]
            tau = t / w + o
            return [
                p[0] + s[0] / 6 * (math.sin(tau) + 2 * math.sin(2 * tau)),
                p[1] + s[1] / 5 * (math.cos(tau) - 2 * math.cos(2 * tau)),
                p[2] - s[2] / 2 * math.sin(3 * tau),
            ]

        expected.append(at)
    assert movers.count == len(expected)
    for time in (0.0, 3.7, 41.0, 99.0):
        place, _ = places(movers, jnp.float32(time))
        np.testing.assert_allclose(place, [at(time) for at in expected], atol=2e-3)
    # What stands still: the first third upright, the rest lying across.
    still = geoms.of_type(BOX)
    assert len(still.type) == count - len(expected)
    upright = np.isclose(np.asarray(still.size)[:, 2], 2.0)
    assert upright.sum() == math.ceil(0.35 * len(upright))
    assert upright[: upright.sum()].all()
    np.testing.assert_allclose(np.asarray(still.position)[upright, 2], 2.0)


def test_most_of_sandos_obstacles_are_as_fast_as_is_told() -> None:
    speeds = []
    for seed in range(4):
        _, movers = sando(100, seed)
        for time in np.linspace(0.0, 30.0, 60):
            speeds.append(np.linalg.norm(places(movers, jnp.float32(time))[1], axis=1))
    assert np.mean(speeds) == pytest.approx(0.77, abs=0.04)
    assert np.max(speeds) < 1.8


def test_p2m_turns_round_at_its_border_and_keeps_its_laws() -> None:
    movers = p2m(25, 19, [3])[0][1]
    step = 0.005
    times = np.arange(0.0, P2M_SECONDS, step)
    place, velocity = jax.jit(jax.vmap(lambda t: places(movers, t)))(jnp.asarray(times, jnp.float32))
    place, velocity = np.asarray(place, float), np.asarray(velocity, float)
    assert (np.abs(place[..., 0]) < 5.0 + 0.2).all()
    assert (np.abs(place[..., 1]) < 12.5 + 0.2).all()
    speed = np.linalg.norm(velocity[..., :2], axis=-1)
    assert speed.max() < 1.68 * 2.1 * math.sqrt(2.0) + 0.1
    assert speed.max() > 3.0
    # Between two turns the speed along an axis is A (sin ωt + 1.1): it never changes sign.
    forward = np.sign(velocity[..., 0])
    turns = np.flatnonzero((forward[1:] != forward[:-1]).any(axis=1))
    assert len(turns) > 10
    moved = np.diff(place, axis=0) / step
    smooth = np.abs(moved - velocity[1:]).max(axis=-1) < 0.1
    assert smooth.mean() > 0.98  # but where they turn round
    assert (np.asarray(movers.knots)[..., 2] == np.asarray(movers.solids.size)[:, None, 2]).all()  # they stand


def test_p2ms_cylinders_stand_apart_and_are_cylinders_as_high_as_may_be_flown() -> None:
    geoms, movers = p2m(7, 7, [0])[0]
    cylinders = geoms.of_type(CAPSULE)
    middle, radius = np.asarray(cylinders.position, float), np.asarray(cylinders.size, float)[:, 0]
    apart = np.linalg.norm(middle[:, None, :2] - middle[None, :, :2], axis=-1)
    assert apart[~np.eye(len(middle), dtype=bool)].min() >= 0.8
    assert ((radius >= 0.125) & (radius <= 0.525)).all()
    for height in (0.7, 3.95):  # nearer than the ground
        point = middle[0] + np.array([radius[0] + 0.3, 0.0, height - middle[0, 2]])
        assert float(distance(cylinders, jnp.asarray(point, jnp.float32))) <= 0.3 + 1e-4
    alone = geoms.of_type(CAPSULE)
    assert float(distance(alone, jnp.array([100.0, 0.0, 2.0]))) > 80.0
    assert solids_at(movers, jnp.float32(1.0)).position.shape == (7, 3)
    assert len(p2m(25, 0, [1])[0][0].of_type(CAPSULE).type) == 0
    assert (np.asarray(p2m(0, 7, [1])[0][1].knots)[..., 2] < -50.0).all()
