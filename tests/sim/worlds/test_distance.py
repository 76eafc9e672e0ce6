"""Exact distances against C MuJoCo, closed forms and dense search; derivatives where they break."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import jaxtyping
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from maxjax.sim.worlds.geoms import BOX, CAPSULE, ELLIPSOID, PLANE, SPHERE, Geoms, ground_plane
from maxjax.sim.worlds.scenes import make_scene, scene_xml
from maxjax.sim.worlds.solid_distance import distance, distances, horizontal_distance

BALL = 0.25  # radius of the oracle's probe [m]

jit_distances = jax.jit(distances)
jit_distance = jax.jit(distance)
jit_horizontal = jax.jit(horizontal_distance)


def scene_of(types: tuple[int, ...], position: np.ndarray, rotation: np.ndarray, size: np.ndarray) -> Geoms:
    return Geoms(*(jnp.asarray(np.asarray(a), jnp.float32) for a in (position, rotation, size)), types)


class MujocoOracle:
    """C MuJoCo's distance between every geom and a small sphere."""

    def __init__(self, geoms: Geoms) -> None:
        ball = f'<body mocap="true"><geom type="sphere" size="{BALL}"/></body>'
        xml = scene_xml(geoms).replace("</worldbody>", ball + "</worldbody>")
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.model.opt.ccd_tolerance = 1e-9
        self.model.opt.ccd_iterations = 500
        self.data = mujoco.MjData(self.model)

    def distances(self, point: np.ndarray) -> np.ndarray:
        self.data.mocap_pos[0] = point
        mujoco.mj_kinematics(self.model, self.data)
        ball = self.model.ngeom - 1
        return BALL + np.array([mujoco.mj_geomDistance(self.model, self.data, g, ball, 1e4, None) for g in range(ball)])


def ellipsoid_distance(semi: np.ndarray, point: np.ndarray) -> float:
    """Float64 bisection for the nearest point, after Eberly."""
    e, p = np.asarray(semi, float), np.maximum(np.abs(np.asarray(point, float)), 1e-14)
    lift, weighted = (e**2 - e.min() ** 2) / e.min() ** 2, e * p / e.min() ** 2
    low, high = 0.0, float(np.linalg.norm(weighted))
    for _ in range(400):
        s = 0.5 * (low + high)
        low, high = (s, high) if np.sum((weighted / (s + lift)) ** 2) > 1.0 else (low, s)
    nearest = (e / e.min()) ** 2 * p / (s + lift)
    return float(np.copysign(np.linalg.norm(p - nearest), s - 1.0))


def test_every_geom_of_a_city_agrees_with_c_mujoco() -> None:
    """From outside; MuJoCo's own ellipsoids converge to some 1e-4 m. Inside it reports other depths, tested below."""
    geoms = make_scene("suburb", 3).geoms
    oracle = MujocoOracle(geoms)
    rng = np.random.default_rng(0)
    checked = 0
    for point in rng.uniform([-100.0, -100.0, 0.6], [100.0, 100.0, 40.0], (6, 3)):
        expected = oracle.distances(point)
        given_ = np.asarray(jit_distances(geoms, jnp.asarray(point, jnp.float32)))
        outside = expected > BALL
        checked += int(outside.sum())
        np.testing.assert_allclose(given_[outside], expected[outside], atol=5e-4)
        assert np.all(given_[~outside] < BALL + 5e-4)
        assert jit_distance(geoms, jnp.asarray(point, jnp.float32)) == given_.min()
    assert checked > 4 * len(geoms.type)


def test_inside_depths_and_turned_solids_agree_with_a_search_of_the_surface() -> None:
    """Signed distance of each type by definition: nearest of many surface points, sign by membership."""
    rng = np.random.default_rng(1)
    u = rng.normal(size=(200_000, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    size = np.array([1.5, 0.8, 1.1])
    face = u / np.max(np.abs(u), axis=1, keepdims=True) * size
    surfaces = {
        BOX: (face, lambda p: np.all(np.abs(p) < size)),
        ELLIPSOID: (u * size, lambda p: np.sum((p / size) ** 2) < 1.0),
        SPHERE: (u * size[0], lambda p: np.linalg.norm(p) < size[0]),
        CAPSULE: (
            np.concatenate(
                [
                    u * size[0] + np.sign(u[:, 2:]) * [0.0, 0.0, size[1]],
                    size[0] * u / np.linalg.norm(u[:, :2], axis=1, keepdims=True) * [1.0, 1.0, 0.0]
                    + rng.uniform(-size[1], size[1], (len(u), 1)) * [0.0, 0.0, 1.0],
                ]
            ),
            lambda p: np.linalg.norm(p - [0.0, 0.0, np.clip(p[2], -size[1], size[1])]) < size[0],
        ),
    }
    for kind, (surface, within) in surfaces.items():
        rotation = Rotation.random(rng=rng).as_matrix()
        center = rng.uniform(-3.0, 3.0, 3)
        geoms = scene_of((kind,), center[None], rotation[None], size[None])
        for local in rng.uniform(-2.5, 2.5, (12, 3)):
            least = np.linalg.norm(surface - local, axis=1).min()
            expected = -least if within(local) else least
            point = jnp.asarray(rotation @ local + center, jnp.float32)
            # The samples lie centimetres apart.
            assert abs(float(jit_distances(geoms, point)[0]) - expected) < 0.015


@settings(max_examples=150, deadline=None)
@given(
    st.tuples(*[st.floats(0.0, 1.0)] * 2),
    st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    st.sampled_from([1e-6, 0.3, 1.0, 1.001, 3.0, 60.0]),
    st.tuples(*[st.booleans()] * 3),
)
def test_ellipsoids_to_aspect_ten(
    shape: tuple[float, float], direction: tuple[float, float, float], scale: float, kept: tuple[bool, bool, bool]
) -> None:
    """On axes, planes of symmetry, the surface, near the centre and far away: 1e-4 m (float32 of 100 m: 1e-5)."""
    semi = 3.0 * np.array([1.0, 0.1 + 0.9 * shape[0], 0.1 + 0.9 * shape[1]])
    point = (np.array(direction) * kept * semi * scale).astype(np.float32)
    geoms = scene_of((ELLIPSOID,), np.zeros((1, 3)), np.eye(3)[None], semi[None])
    given_ = float(jit_distances(geoms, jnp.asarray(point))[0])
    assert abs(given_ - ellipsoid_distance(np.asarray(geoms.size[0]), point)) < 1e-4


def test_the_centre_and_the_axes_in_closed_form() -> None:
    geoms = scene_of((ELLIPSOID,), np.zeros((1, 3)), np.eye(3)[None], np.array([[5.0, 2.0, 0.5]]))
    for point, expected in (
        ([0.0, 0.0, 0.0], -0.5),
        ([7.0, 0.0, 0.0], 2.0),
        ([0.0, 7.0, 0.0], 5.0),
        ([0.0, 0.0, 0.25], -0.25),
        ([0.0, 0.0, -0.5], 0.0),
        # Inside the focal ellipse the nearest point is off the axis; at its end it is the vertex.
        ([4.99, 0.0, 0.0], -0.01),
        ([2.0, 0.0, 0.0], -0.5 * np.sqrt(1.0 - 4.0 / (25.0 - 0.25))),
    ):
        assert float(jit_distances(geoms, jnp.array(point))[0]) == pytest.approx(expected, abs=1e-5)


def test_gradients_are_unit_normals_and_finite_where_they_break() -> None:
    types = (PLANE, BOX, ELLIPSOID, CAPSULE, SPHERE)
    rng = np.random.default_rng(2)
    rotation = np.concatenate([np.eye(3)[None], Rotation.random(4, rng).as_matrix()])
    position = np.array([[0.0, 0.0, 0.0], [6.0, 0.0, 3.0], [-6.0, 1.0, 4.0], [0.0, 7.0, 3.0], [0.0, -7.0, 4.0]])
    size = np.array([[0.0, 0.0, 1.0], [1.5, 2.0, 1.0], [2.0, 1.0, 0.4], [1.2, 1.5, 0.0], [1.7, 0.0, 0.0]])
    geoms = scene_of(types, position, rotation, size)
    jacobian = jax.jit(jax.jacfwd(distances, argnums=1))
    for point in [*rng.uniform(-8.0, 8.0, (30, 3)), *position]:
        derivative = np.asarray(jacobian(geoms, jnp.asarray(point, jnp.float32)))
        assert np.all(np.isfinite(derivative))
    for point in rng.uniform([-9.0, -9.0, 0.0], 9.0, (8, 3)):
        p = jnp.asarray(point, jnp.float32)
        derivative = np.asarray(jacobian(geoms, p), float)
        # Off the edges, where the normal jumps, it is a unit vector, and a step along it is the distance gained.
        np.testing.assert_allclose(np.linalg.norm(derivative, axis=1), 1.0, atol=1e-4)
        outside = np.asarray(jit_distances(geoms, p)) > 0.0
        for g in np.flatnonzero(outside):
            step = jnp.asarray(point + 0.5 * derivative[g], jnp.float32)
            gain = jit_distances(geoms, step)[g] - jit_distances(geoms, p)[g]
            assert float(gain) == pytest.approx(0.5, abs=1e-4)
    # By the shape of the solids too: a ball that grows comes nearer by as much.
    by_geoms = jax.jit(jax.grad(lambda scene: distances(scene, jnp.array([1.0, -2.0, 6.0]))[4]))(geoms)
    assert float(by_geoms.size[4, 0]) == pytest.approx(-1.0)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(by_geoms))


def test_horizontal_distance_against_a_dense_vertical() -> None:
    """Turned roofs, crowns and trunks, and boxes of every kind stand in a suburb."""
    geoms = make_scene("suburb", 3).geoms
    solid = np.array([kind != PLANE for kind in geoms.type])
    along = jax.jit(jax.vmap(distances, (None, 0)))
    heights = np.arange(0.0, 20.0, 0.02)
    for x, y in np.random.default_rng(3).uniform(-110.0, 110.0, (12, 2)):
        points = np.stack([np.full_like(heights, x), np.full_like(heights, y), heights], -1)
        dense = np.asarray(along(geoms, jnp.asarray(points, jnp.float32)))[:, solid].min()
        exact = float(jit_horizontal(geoms, jnp.array([x, y, 9.0])))
        # Samples can only lie above the least value, by half a step at most.
        assert dense - 0.011 <= exact <= dense + 2e-4


def test_horizontal_distance_leaves_out_ground_and_padding() -> None:
    assert np.isinf(jit_horizontal(ground_plane(), jnp.zeros(3)))
    lamp = scene_of((CAPSULE,), np.array([[3.0, 4.0, 5.0]]), np.eye(3)[None], np.array([[0.1, 4.0, 0.0]]))
    assert float(jit_horizontal(lamp, jnp.array([0.0, 0.0, 80.0]))) == pytest.approx(4.9, abs=1e-4)
    assert float(jit_horizontal(lamp, jnp.array([3.0, 4.0, 80.0]))) == pytest.approx(-0.1, abs=1e-4)
    buried = scene_of((BOX,), np.array([[0.0, 0.0, -1000.0]]), np.eye(3)[None], np.full((1, 3), 0.01))
    assert float(jit_horizontal(buried, jnp.array([0.0, 0.0, 9.0]))) == pytest.approx(1000.0, abs=0.1)


def test_batches_equal_the_loop_and_order_is_kept() -> None:
    """Types in any order, and one that stands alone."""
    rng = np.random.default_rng(4)
    types = (*(int(t) for t in rng.choice([PLANE, BOX, SPHERE, CAPSULE], 9)), ELLIPSOID)
    rotation = Rotation.random(10, rng).as_matrix()
    geoms = scene_of(types, rng.uniform(-5, 5, (10, 3)), rotation, rng.uniform(0.5, 2.0, (10, 3)))
    points = jnp.asarray(rng.uniform(-8.0, 8.0, (5, 3)), jnp.float32)
    batch = np.asarray(jax.jit(jax.vmap(distances, (None, 0)))(geoms, points))
    for i, point in enumerate(points):
        np.testing.assert_allclose(batch[i], jit_distances(geoms, point), atol=1e-5)
        for g in range(10):
            alone = Geoms(geoms.position[g : g + 1], geoms.rotation[g : g + 1], geoms.size[g : g + 1], types[g : g + 1])
            assert float(distances(alone, point)[0]) == pytest.approx(float(batch[i, g]), abs=1e-5)


def test_empty_scenes_and_wrong_shapes(monkeypatch: pytest.MonkeyPatch) -> None:
    none = Geoms(jnp.zeros((0, 3)), jnp.zeros((0, 3, 3)), jnp.zeros((0, 3)), ())
    assert distances(none, jnp.zeros(3)).shape == (0,)
    assert np.isinf(distance(none, jnp.zeros(3)))
    assert np.isinf(horizontal_distance(none, jnp.zeros(3)))
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    for function in (distances, distance, horizontal_distance):
        with pytest.raises(ValueError, match=r"geoms \(g, 3\) and point \(3,\)"):
            function(ground_plane(), jnp.zeros((2, 3)))
