"""What a scan shows of one body: its middle and its faces lie in their sets, whatever its shape, turn and place."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from maxjax.sim.movers.clusters import Clusters
from maxjax.sim.movers.detection import Detections, detect_bodies
from maxjax.sim.movers.reachable_sets import Bounds
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.sensors.lidar import Lidar, scan
from maxjax.sim.worlds.geoms import BOX, SPHERE, Geoms, concatenate, ground_plane
from maxjax.sim.worlds.movers import Moving
from tests.sim.movers.scenes import box, spheres

SIGHT = TrackingSettings(lidar=Lidar(), bounds=Bounds(8.0, 2.0, 1.0), detections=1, points=1024)
AT = np.array([0.0, 0.0, 12.0])
# It hides parts of what is behind.
STANDS = concatenate([ground_plane(), box([4.0, 0.0, 12.0], [0.1, 0.1, 12.0])])


@jax.jit
def fast_shown(body: Geoms, rotation: jax.Array, key: jax.Array) -> Detections:
    """A body as its own returns show it."""
    lidar, at = SIGHT.lidar, jnp.asarray(AT, jnp.float32)
    result, without = (scan(geoms, lidar, at, rotation, key) for geoms in (concatenate([STANDS, body]), STANDS))
    own = result.hit & (result.distance < without.distance - 1e-3)
    ray = jnp.nonzero(own, size=SIGHT.points, fill_value=0)[0].astype(jnp.int32)
    count = jnp.sum(own)
    cluster = jnp.where(jnp.arange(SIGHT.points) < count, 0, 1)
    clusters = Clusters(ray, cluster, count[None] > 0, count[None], jnp.zeros((), bool))
    return detect_bodies(clusters, result, at, rotation, SIGHT)


def drawn(rng: np.random.Generator, shape: str) -> tuple[Geoms, np.ndarray, np.ndarray]:
    """A body no larger than assumed, its middle, and half the edges of the box around it."""
    away, azimuth, elevation = rng.uniform(3.0, 22.0), rng.uniform(-0.6, 0.6), rng.uniform(-0.5, 0.6)
    azimuth = azimuth if rng.uniform() < 0.3 else rng.uniform(-np.pi, np.pi)
    level = away * np.cos(elevation)
    middle = AT + np.array([level * np.cos(azimuth), level * np.sin(azimuth), away * np.sin(elevation)])
    middle[2] = max(middle[2], 1.0)
    if shape == "sphere":
        half = np.full(3, rng.uniform(0.15, 0.5))
        size, turned, kind = half * [1.0, 0.0, 0.0], np.eye(3), SPHERE
    else:
        size = rng.uniform(0.15, 0.5, 3)
        turned = {
            "box": np.eye(3),
            "yawed": Rotation.from_euler("z", rng.uniform(0.0, np.pi)).as_matrix(),
            "turned": Rotation.random(random_state=rng).as_matrix(),
        }[shape]
        size *= min(1.0, 0.5 / (np.abs(turned) @ size).max())
        half, kind = np.abs(turned) @ size, BOX
    values = (jnp.asarray(x[None], jnp.float32) for x in (middle, turned, size))
    return Geoms(*values, (kind,)), middle, half


@pytest.mark.parametrize("shape", ["sphere", "box", "yawed", "turned"])
def test_middle_and_faces_lie_in_their_sets(shape: str) -> None:
    rng, faces = np.random.default_rng(0), []
    for k in range(150):
        body, middle, half = drawn(rng, shape)
        angles = [rng.uniform(-np.pi, np.pi), *rng.uniform(-0.2, 0.2, 2)]
        rotation = jnp.asarray(Rotation.from_euler("ZYX", angles).as_matrix(), jnp.float32)
        seen = fast_shown(body, rotation, jax.random.key(k))
        if float(seen.count[0]) < 2:
            continue
        low, high = np.asarray(seen.marks.low)[:, 0], np.asarray(seen.marks.high)[:, 0]
        truth = np.stack([middle, middle - half, middle + half])
        assert (low - 2e-3 <= truth).all(), (k, low, truth)
        assert (truth <= high + 2e-3).all(), (k, high, truth)
        faces.append((high - low)[1:].min(axis=0))
    assert len(faces) > 100
    # One of two faces is seen: it is known better than the depth of a body.
    assert np.median(faces) < 0.6


@pytest.mark.parametrize("speed", [-3.0, 3.0])
def test_what_moves_while_it_is_scanned_lies_in_its_sets_at_the_middle_of_that_time(speed: float) -> None:
    """A sphere across the seam of the scan: one half of it is measured a turn of the sensor before the other."""
    sight = TrackingSettings(lidar=Lidar(range_noise=0.0), bounds=Bounds(3.0, 2.0, 1.0), detections=1, points=1024)
    radius, end, position = 0.35, 0.7, jnp.asarray(AT, jnp.float32)
    start, velocity = AT + np.array([7.0, -speed * (end - 0.05), 0.0]), np.array([0.0, speed, 0.0])
    movers = Moving(spheres(start[None], velocity[None], radius), jnp.float32(end))
    result = scan(ground_plane(), sight.lidar, position, jnp.eye(3), jax.random.key(0), movers)
    own = np.asarray(result.hit & (result.distance < 8.0))
    assert {True, False} == {bool(column < 256) for column in np.flatnonzero(own) % 512}  # both ends of the turn
    ray = jnp.nonzero(jnp.asarray(own), size=sight.points, fill_value=0)[0].astype(jnp.int32)
    count = jnp.sum(jnp.asarray(own))
    cluster = jnp.where(jnp.arange(sight.points) < count, 0, 1)
    clusters = Clusters(ray, cluster, count[None] > 0, count[None], jnp.zeros((), bool))
    seen = detect_bodies(clusters, result, position, jnp.eye(3), sight)
    assert not seen.large[0]
    middle = start + (end - float(seen.age[0])) * velocity
    truth = np.stack([middle, middle - radius, middle + radius])
    low, high = np.asarray(seen.marks.low)[:, 0], np.asarray(seen.marks.high)[:, 0]
    assert float(seen.age[0]) == pytest.approx(0.05, abs=0.003)
    assert (low - 2e-3 <= truth).all(), (low, truth)
    assert (truth <= high + 2e-3).all(), (truth, high)
