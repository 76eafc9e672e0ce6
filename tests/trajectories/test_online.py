"""References: the path is kept, every limit is, and stops are where they were asked for."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import pytest
from jaxtyping import Array

from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.online import (
    BRAKING,
    Course,
    Reference,
    Sampling,
    Setpoint,
    profile,
    sample,
    setpoint_at,
    straight_course,
)

LIMITS = FlightLimits(speed=5.0, acceleration=3.0, deviation=0.3)
SAMPLING = Sampling()
POINTS = 64
BATCH = 24
TIMES = 1200
DT = 0.02
OPEN = jnp.full(SAMPLING.samples, 9.0, jnp.float32)


def build(path: Array, caps: Array, start_speed: Array) -> tuple[Reference, Setpoint]:
    reference = profile(sample(path, LIMITS), caps, start_speed, LIMITS)
    times = DT * jnp.arange(TIMES, dtype=jnp.float32)
    return reference, jax.vmap(lambda t: setpoint_at(reference, t))(times)


builds = jax.jit(jax.vmap(build))


def padded(points: list[list[float]] | np.ndarray) -> np.ndarray:
    """A path in the planner's form: the last point repeated to the end of the array."""
    points = np.asarray(points, np.float32)
    return np.concatenate([points, np.repeat(points[-1:], POINTS - len(points), 0)])


def paths() -> np.ndarray:
    """Corners of every angle, staircases, U-turns, kinks a hand's breadth apart, repeated points, one point only."""
    rng = np.random.default_rng(0)
    chosen = [
        padded([[0, 0, 10], [20, 0, 10]]),
        padded([[0, 0, 10], [25, 0, 10], [25, 25, 10]]),
        padded([[0, 0, 5], [15, 0, 5], [15, 0, 25], [30, 0, 25]]),
        padded([[2.0 * ((i + 1) // 2), 2.0 * (i // 2), 8.0] for i in range(30)]),
        padded([[0, 0, 10], [20, 0, 10], [0, 0, 10]]),
        padded([[0, 0, 10], [0.1, 0.1, 10], [10, 0, 10], [10.05, 0.02, 10], [10.1, 0.1, 10], [10, 15, 10]]),
        padded([[0, 0, 10], [0, 0, 10], [5, 0, 10], [5, 0, 10], [5, 0, 10], [5, 9, 10]]),
        padded([[3, 4, 5]]),
        # A quarter of a circle in short edges, then half a metre more.
        padded([[6 * np.sin(a), 6 - 6 * np.cos(a), 4] for a in np.linspace(0, np.pi / 2, 40)] + [[6, 6.5, 4]]),
    ]
    while len(chosen) < BATCH:
        edges = rng.normal(size=(rng.integers(2, 30), 3)) * rng.uniform(0.05, 8.0)
        chosen.append(padded(np.cumsum(edges, axis=0)))
    return np.stack(chosen)


PATHS = paths()


@pytest.fixture(scope="module")
def still() -> tuple[Reference, Setpoint]:
    """References from rest, without caps."""
    result: tuple[Reference, Setpoint] = builds(PATHS, jnp.tile(OPEN, (BATCH, 1)), jnp.zeros(BATCH))
    return result


def off_path(points: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Distance of points to a polyline, in float64."""
    points, a, b = points.astype(float), path[:-1].astype(float), path[1:].astype(float)
    edge = b - a
    square = np.maximum((edge**2).sum(1), 1e-30)
    along = np.clip(((points[:, None] - a) * edge).sum(-1) / square, 0.0, 1.0)
    return np.linalg.norm(points[:, None] - (a + along[..., None] * edge), axis=-1).min(1)


def lengths(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path.astype(float), axis=0), axis=1).sum())


def test_curve_keeps_ends_and_the_bounded_deviation(still: tuple[Reference, Setpoint]) -> None:
    reference, setpoints = still
    horizon = SAMPLING.spacing * (SAMPLING.samples - 1)
    widest = 0.0
    for k, path in enumerate(PATHS):
        points = np.asarray(reference.course.points[k])
        np.testing.assert_allclose(points[0], path[0], atol=1e-5)
        if lengths(path) < horizon - 0.1:
            np.testing.assert_allclose(points[-1], path[-1], atol=1e-4)
        # Samples exactly, what lies between them to a millimetre or two (the cubic misses a corner's peak).
        assert off_path(points, path).max() < LIMITS.deviation + 1e-4
        between = off_path(np.asarray(setpoints.position[k]), path).max()
        assert between < LIMITS.deviation + 2e-3
        widest = max(widest, between)
        np.testing.assert_allclose(reference.course.arclength[k, -1], min(lengths(path), horizon), rtol=1e-5, atol=1e-4)
    # The bound is used, not merely kept.
    assert widest > 0.9 * LIMITS.deviation


def test_single_corner_is_the_closed_form(still: tuple[Reference, Setpoint]) -> None:
    course = still[0].course
    turn = np.array([-1.0, 1.0, 0.0])
    width = min(4.0, 6.0 * LIMITS.deviation / np.sqrt(2.0))
    away = np.asarray(course.arclength[1]) - 25.0
    line = np.where(
        away[:, None] < 0, [25.0, 0, 10] + away[:, None] * [1, 0, 0], [25.0, 0, 10] + away[:, None] * [0, 1, 0]
    )
    expected = line + turn * (width / 6.0 * np.maximum(1.0 - np.abs(away) / width, 0.0) ** 3)[:, None]
    np.testing.assert_allclose(course.points[1], expected, atol=1e-4)


def test_limits_hold_by_finite_differences(still: tuple[Reference, Setpoint]) -> None:
    reference, setpoints = still
    for k in range(BATCH):
        velocity, position = np.asarray(setpoints.velocity[k], float), np.asarray(setpoints.position[k], float)
        speed = np.linalg.norm(velocity, axis=1)
        assert speed.max() < LIMITS.speed + 1e-3
        # Velocity is the derivative of position, acceleration that of velocity, on the average over a step.
        moved = np.diff(position, axis=0) / DT
        middle = 0.5 * (velocity[1:] + velocity[:-1])
        assert np.abs(moved - middle).max() < 0.05
        change = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / DT
        total = 2.0 * LIMITS.acceleration
        # The peak of a hat between two samples is met by the cubic to a tenth.
        assert change.max() < 1.1 * total
        assert np.linalg.norm(setpoints.acceleration[k], axis=1).max() < 1.1 * total
        # Along the path, exactly.
        s, v = np.asarray(reference.course.arclength[k], float), np.asarray(reference.speed[k], float)
        apart = np.diff(s)
        slope = np.diff(v**2)[apart > 0.02] / (2.0 * apart[apart > 0.02])
        assert np.abs(slope).max(initial=0.0) < LIMITS.acceleration * 1.01
        assert np.all(v**2 * np.asarray(reference.course.bend[k]) < LIMITS.acceleration * 1.001)


def test_straight_line_takes_the_time_of_a_trapezoid(still: tuple[Reference, Setpoint]) -> None:
    reference, setpoints = still
    # 20 m: up to 5 m/s, along, and down again: s / v + v / a.
    expected = 20.0 / LIMITS.speed + LIMITS.speed / LIMITS.acceleration
    assert abs(float(reference.duration[0]) - expected) < 0.02
    at = int(1.0 / DT)
    np.testing.assert_allclose(setpoints.velocity[0, at], [LIMITS.acceleration * DT * at, 0, 0], atol=1e-2)
    np.testing.assert_allclose(
        setpoints.position[0, at], [0.5 * LIMITS.acceleration * (DT * at) ** 2, 0, 10], atol=1e-2
    )
    np.testing.assert_allclose(setpoints.position[0, -1], [20, 0, 10], atol=1e-4)
    np.testing.assert_allclose(setpoints.velocity[0, -1], 0.0, atol=0)
    assert np.all(np.asarray(reference.excess) == 0.0)


def test_short_edges_do_not_stop_the_flight(still: tuple[Reference, Setpoint]) -> None:
    # A bend of radius 6 m in edges of a hand's breadth is flown nearly like that bend, v² / 6 m = lateral, and two
    # kinks 5 cm apart like one corner.
    reference, _ = still
    assert np.asarray(reference.speed[8])[14:24].min() > 0.88 * np.sqrt(6.0 * LIMITS.acceleration)
    assert np.asarray(reference.speed[5])[4:80].min() > 1.0


def straight(caps: Array, start_speed: float) -> tuple[Reference, Setpoint]:
    """One path of 60 m under caps, within the batch that is compiled already."""
    path = padded([[0, 0, 10], [60, 0, 10]])
    result: tuple[Reference, Setpoint] = builds(
        np.tile(path, (BATCH, 1, 1)), jnp.tile(caps, (BATCH, 1)), jnp.full(BATCH, start_speed, jnp.float32)
    )
    first: tuple[Reference, Setpoint] = jax.tree.map(lambda a: a[0], result)
    return first


def test_caps_are_kept_and_a_cap_of_zero_is_final() -> None:
    where = SAMPLING.spacing * np.arange(SAMPLING.samples)
    caps = OPEN.at[40:60].set(2.0).at[120:122].set(0.0)
    for closed in (caps, caps.at[120].set(jnp.nan)):
        reference, setpoints = straight(closed, 3.0)
        assert np.all(np.asarray(reference.speed)[40:60] <= 2.0 + 1e-4)
        assert np.asarray(reference.speed)[80] > 4.0
        x = np.asarray(setpoints.position)[:, 0]
        # At rest at the sample itself, never beyond, and permanently although the later caps allow motion.
        assert x.max() <= where[120] + 1e-4
        np.testing.assert_allclose(x[-100:], where[120], atol=1e-3)
        assert float(reference.excess) == 0.0
        assert float(reference.duration) < 20.0
        assert np.all(np.diff(x) > -1e-5)


def test_start_speed_is_continued_and_braking_grows_with_the_need() -> None:
    reference, setpoints = straight(OPEN, 4.0)
    np.testing.assert_allclose(setpoints.velocity[0], [4.0, 0, 0], atol=1e-3)
    # 5 m/s, closed after 3 m: v² / 2 s = 4.17 m/s² is more than `acceleration` and less than `braking`.
    reference, setpoints = straight(OPEN.at[12:].set(0.0), 5.0)
    speed = np.asarray(reference.speed)
    assert speed[0] == pytest.approx(5.0, abs=1e-3)
    assert float(reference.excess) == 0.0
    assert np.asarray(setpoints.position)[:, 0].max() < 3.0 + 1e-3
    np.testing.assert_allclose(np.asarray(setpoints.acceleration)[2:30, 0], -25.0 / 6.0, rtol=1e-3)
    # Closed after 1 m: even 6 m/s² cannot; it says by how much and brakes at that.
    reference, setpoints = straight(OPEN.at[4:].set(0.0), 5.0)
    assert float(reference.excess) == pytest.approx(np.sqrt(25.0 - 12.0), abs=1e-2)
    assert np.asarray(setpoints.position)[-1, 0] == pytest.approx(25.0 / 12.0, abs=SAMPLING.spacing)
    assert np.asarray(setpoints.acceleration)[:, 0].min() > -BRAKING * LIMITS.acceleration * 1.01
    # Closed everywhere, at rest: it stays.
    reference, setpoints = straight(0.0 * OPEN, 0.0)
    np.testing.assert_allclose(setpoints.position, np.tile([0, 0, 10.0], (TIMES, 1)), atol=1e-6)
    assert float(reference.duration) == 0.0


def test_lead_hands_over_only_the_acceleration_early(still: tuple[Reference, Setpoint]) -> None:
    reference = jax.tree.map(lambda a: a[1], still[0])
    for time in (-0.1, 0.5, 5.4, 9.0):
        now = setpoint_at(reference, jnp.float32(time), 0.7, lead=0.12)
        same, later = setpoint_at(reference, jnp.float32(time)), setpoint_at(reference, jnp.float32(time + 0.12))
        np.testing.assert_array_equal(now.position, same.position)
        np.testing.assert_array_equal(now.velocity, same.velocity)
        np.testing.assert_allclose(now.acceleration, later.acceleration, atol=1e-4)
        assert float(now.yaw) == pytest.approx(0.7)
    waiting = setpoint_at(reference, jnp.float32(-0.1))
    np.testing.assert_array_equal(waiting.velocity, 0.0)
    np.testing.assert_array_equal(waiting.position, reference.course.points[0])


def test_batch_equals_loop_and_nan_stays_within_its_trial(still: tuple[Reference, Setpoint]) -> None:
    caps = jnp.tile(OPEN, (BATCH, 1))
    single = jax.jit(build)
    for k in (2, 10):
        for a, b in zip(jax.tree.leaves(single(PATHS[k], OPEN, jnp.float32(0.0))), jax.tree.leaves(still), strict=True):
            np.testing.assert_allclose(a, b[k], atol=1e-3, rtol=1e-5)
    spoilt = PATHS.copy()
    spoilt[3, 5] = np.nan
    for a, b in zip(jax.tree.leaves(builds(spoilt, caps, jnp.zeros(BATCH))), jax.tree.leaves(still), strict=True):
        assert np.array_equal(np.delete(a, 3, 0), np.delete(b, 3, 0))


def test_nobody_flies_past_a_sample_that_time_says_is_never_reached() -> None:
    """A course of 6 cm whose repeated end differs in its last bits: at rest at its end, not at 8 m/s after a second."""
    s = jnp.full(8, 0.06).at[0].set(0.0)
    straight = Course(s[:, None] * jnp.array([1.0, 0.0, 0.0]), jnp.tile(jnp.array([1.0, 0.0, 0.0]), (8, 1)), s, 0.0 * s)
    torn = Reference(straight, jnp.ones(8).at[0].set(0.0), 1e6 * jnp.arange(8.0), jnp.float32(0.0), jnp.float32(0.0))
    off = jnp.float32(np.spacing(np.float32(0.06)))
    course = Course(straight.points, straight.tangent, s.at[-1].add(off), straight.bend)
    made = profile(course, jnp.ones(8), jnp.float32(0.0), FlightLimits(5.0, 3.0, 0.3))
    assert np.array_equal(made.speed, np.zeros(8))
    for reference in (torn, made):
        for time in (0.2, 0.5, 1.0, 3.0):
            setpoint = setpoint_at(reference, jnp.float32(time))
            assert float(setpoint.position[0]) <= 0.06 + 1e-6
            if time > 0.2 or reference is made:
                assert np.array_equal(setpoint.velocity, np.zeros(3))
                assert np.array_equal(setpoint.acceleration, np.zeros(3))


def test_derivatives_are_finite_where_nothing_moves() -> None:
    few = Sampling(samples=16)

    def end(path: Array, caps: Array, speed: Array, time: Array) -> Array:
        reference = profile(sample(path, LIMITS, few), caps, speed, LIMITS)
        setpoint = setpoint_at(reference, time, lead=0.1)
        return jnp.sum(setpoint.position) + jnp.sum(setpoint.velocity) + jnp.sum(setpoint.acceleration)

    slope = jax.jit(jax.grad(end, (0, 1, 2, 3)))
    still, turns, bends = (jnp.asarray(p, jnp.float32) for p in (
        [[3, 4, 5]] * 4, [[0, 0, 1], [1, 0, 1], [0, 0, 1], [0, 0, 1]], [[0, 0, 1], [2, 0, 1], [2, 1, 1], [2, 1, 1]]
    ))  # fmt: skip
    free = jnp.full(16, 9.0, jnp.float32)
    for path, caps in ((still, free), (turns, free), (bends, 0.0 * free), (bends, free.at[5].set(jnp.nan))):
        for time in (0.0, 0.5, 60.0):
            for speed in (0.0, 2.0):
                for leaf in slope(path, caps, jnp.float32(speed), jnp.float32(time)):
                    assert np.all(np.isfinite(leaf))


def test_bad_settings_and_shapes_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for setting, match in (
        ({"spacing": 0.0}, "spacing"),
        ({"samples": 1}, "samples"),
        ({"spacing": float("nan")}, "spacing"),
    ):
        with pytest.raises(ValueError, match=match):
            Sampling(**setting)
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(ValueError, match=r"path \(n, 3\)"):
        sample(jnp.zeros((4, 2)), LIMITS)
    course = Course(jnp.zeros((4, 3)), jnp.zeros((4, 3)), jnp.zeros(4), jnp.zeros(4))
    with pytest.raises(ValueError, match="as many caps as samples"):
        profile(course, jnp.zeros(3), jnp.float32(0.0), LIMITS)


def test_a_straight_course_is_what_is_sampled_of_two_points() -> None:
    start, end = jnp.array([1.0, -2.0, 3.0]), jnp.array([40.0, 20.0, 5.0])
    straight, sampled = straight_course(start, end, SAMPLING), sample(jnp.stack([start, end]), LIMITS, SAMPLING)
    for ours, theirs in zip(jax.tree.leaves(straight), jax.tree.leaves(sampled), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=2e-5)
    nowhere = straight_course(start, start, SAMPLING)
    assert all(bool(jnp.all(jnp.isfinite(x))) for x in jax.tree.leaves(nowhere))
