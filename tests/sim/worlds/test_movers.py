"""Movers: their places against closed forms and SciPy, their returns against C MuJoCo at each column's time."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from scipy.interpolate import CubicHermiteSpline

from maxjax.sim.sensors.lidar import Lidar, cast_at, directions, scan
from maxjax.sim.worlds.geoms import BOX, CAPSULE, SPHERE, Geoms, concatenate, ground_plane
from maxjax.sim.worlds.movers import Movers, Moving, join_populations, places, solids_at, straight, through


def shapes(*kinds: int) -> Geoms:
    size = {BOX: (0.4, 0.8, 0.3), SPHERE: (0.5, 0.0, 0.0), CAPSULE: (0.2, 0.6, 0.0)}
    count = len(kinds)
    rotation = jnp.broadcast_to(jnp.eye(3), (count, 3, 3))
    return Geoms(jnp.zeros((count, 3)), rotation, jnp.array([size[kind] for kind in kinds]), kinds)


def test_curves_are_those_of_scipy_and_go_on_straight() -> None:
    rng = np.random.default_rng(0)
    knots, velocity = rng.normal(size=(2, 3, 5, 3)) * 4.0
    step = np.array([0.5, 1.0, 2.0])
    movers = through(shapes(BOX, BOX, BOX), *map(jnp.asarray, (knots, velocity, step)))
    for k in range(3):
        curve = CubicHermiteSpline(step[k] * np.arange(5), knots[k], velocity[k])
        for time in np.linspace(0.0, 4.0 * step[k], 17):
            place, speed = (x[k] for x in places(movers, jnp.float32(time)))
            np.testing.assert_allclose(place, curve(time), atol=2e-5)
            np.testing.assert_allclose(speed, curve(time, 1), atol=1e-4)
        end = 4.0 * step[k]
        place, speed = (x[k] for x in places(movers, jnp.float32(end + 3.0)))
        np.testing.assert_allclose(place, knots[k, -1] + 3.0 * velocity[k, -1], atol=2e-5)
        np.testing.assert_allclose(speed, velocity[k, -1], atol=1e-5)


def test_a_loop_closes_and_repeats() -> None:
    angle = 2.0 * np.pi * np.arange(16) / 16
    circle = np.stack([5.0 * np.cos(angle), 5.0 * np.sin(angle), np.full(16, 3.0)], -1)
    turning = np.stack([-5.0 * np.sin(angle), 5.0 * np.cos(angle), np.zeros(16)], -1)  # one radian a second
    step = jnp.array([2.0 * np.pi / 16])
    movers = through(shapes(BOX), jnp.asarray(circle[None]), jnp.asarray(turning[None]), step, loops=True, faces=True)
    for time in (0.1, 2.0, 6.2, 6.9, 29.0):
        place, speed = (x[0] for x in places(movers, jnp.float32(time)))
        np.testing.assert_allclose(place, [5.0 * np.cos(time), 5.0 * np.sin(time), 3.0], atol=1e-3)
        np.testing.assert_allclose(np.linalg.norm(speed), 5.0, rtol=1e-3)
        forward = solids_at(movers, jnp.float32(time)).rotation[0, :, 0]
        np.testing.assert_allclose(forward, [-np.sin(time), np.cos(time), 0.0], atol=2e-3)


def test_velocities_are_the_derivatives_of_places() -> None:
    rng = np.random.default_rng(1)
    still = straight(shapes(SPHERE, SPHERE), jnp.asarray(rng.normal(size=(2, 3))), jnp.zeros((2, 3)))
    swinging = Movers(
        **{
            **vars(still),
            "amplitude": jnp.asarray(rng.normal(size=(2, 3, 3))),
            "frequency": jnp.asarray(rng.uniform(0.2, 2.0, (2, 3))),
            "phase": jnp.asarray(rng.uniform(0.0, 6.0, (2, 3, 3))),
        }
    )
    movers = join_populations([swinging, straight(shapes(BOX), jnp.ones((1, 3)), jnp.array([[1.0, -2.0, 0.5]]))])
    for time in (0.0, 0.7, 13.0):
        _, velocity = places(movers, jnp.float32(time))
        _, slope = jax.jvp(lambda t: places(movers, t)[0], (jnp.float32(time),), (jnp.float32(1.0),))
        np.testing.assert_allclose(velocity, slope, atol=1e-4)
    np.testing.assert_allclose(places(movers, jnp.float32(2.0))[0][2], [3.0, -3.0, 2.0], atol=1e-5)


def test_populations_of_several_curves_keep_their_places() -> None:
    rng = np.random.default_rng(2)
    line = straight(shapes(BOX, SPHERE), jnp.asarray(rng.normal(size=(2, 3))), jnp.asarray(rng.normal(size=(2, 3))))
    curve = through(shapes(CAPSULE), *(jnp.asarray(rng.normal(size=(1, 4, 3))) for _ in range(2)), jnp.array([0.8]))
    both = join_populations([line, curve])
    assert both.count == 3
    assert both.solids.type == (BOX, SPHERE, CAPSULE)
    for time in (0.0, 0.9, 2.3, 9.0):
        expected = [places(movers, jnp.float32(time))[0] for movers in (line, curve)]
        np.testing.assert_allclose(places(both, jnp.float32(time))[0], np.concatenate(expected), atol=1e-4)


def test_a_scan_meets_movers_where_they_are_when_it_is_cast() -> None:
    """Column by column, the whole scene set to that column's time, against C MuJoCo."""
    lidar = Lidar(32, 32 * 120, elevation_min=-15.0, elevation_max=25.0, range_noise=0.0, dropout=0.0, turn=0.4)
    place = jnp.array([[6.0, 0.0, 3.0], [-4.0, 3.0, 4.0], [0.0, -5.0, 3.5]])
    velocity = jnp.array([[0.0, 8.0, 0.0], [3.0, 3.0, 0.0], [-9.0, 0.0, 1.0]])
    movers = straight(shapes(BOX, SPHERE, CAPSULE), place, velocity)
    origin, time = np.array([0.3, 0.2, 3.5]), 0.2
    found = scan(
        ground_plane(), lidar, jnp.asarray(origin, jnp.float32), jnp.eye(3), jax.random.key(0),
        Moving(movers, jnp.float32(time)),
    )  # fmt: skip
    rays = np.asarray(directions(lidar), float).reshape(lidar.channels, lidar.columns, 3)
    times = np.asarray(cast_at(lidar, jnp.float32(time)), float)
    assert times[-1] == np.float32(time)
    assert times[0] > time - lidar.turn
    met = 0
    for column in range(lidar.columns):
        now = solids_at(movers, jnp.float32(times[column]))
        expected = by_mujoco(concatenate([ground_plane(), now]), origin, rays[:, column])
        given = np.asarray(found.distance).reshape(lidar.channels, lidar.columns)[:, column]
        np.testing.assert_allclose(np.where(expected > lidar.max_range, np.inf, expected), given, atol=1e-3)
        met += int(np.sum(expected < by_mujoco(ground_plane(), origin, rays[:, column]) - 1e-3))
    assert met > 20  # returns of movers, or nothing was tested


def test_a_narrow_field_of_view_returns_nothing_beside_it() -> None:
    lidar = Lidar(channels=8, rays=8 * 36, width=90.0, elevation_min=-45.0, elevation_max=-5.0, dropout=0.0)
    found = scan(ground_plane(), lidar, jnp.array([0.0, 0.0, 2.0]), jnp.eye(3), jax.random.key(0))
    azimuth = 10 * np.arange(36)
    hit = np.asarray(found.hit).reshape(8, 36)
    assert hit[:, np.minimum(azimuth, 360 - azimuth) <= 45].all()
    assert not hit[:, np.minimum(azimuth, 360 - azimuth) > 45].any()


def by_mujoco(geoms: Geoms, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    names = {0: "plane", BOX: "box", SPHERE: "sphere", CAPSULE: "capsule"}
    solids = "".join(
        f'<geom type="{names[kind]}" pos="{" ".join(map(str, p))}" size="{" ".join(map(str, s))}"/>'
        for kind, p, s in zip(geoms.type, np.asarray(geoms.position), np.asarray(geoms.size), strict=True)
    )
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{solids}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found = np.array([mujoco.mj_ray(model, data, origin, ray, None, True, -1, None) for ray in rays])
    return np.where(found < 0.0, np.inf, found)
