"""Motions that are called verified, against movers that do their worst and walls, in float64; and what is kept."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.typing import ArrayLike

from maxjax.sim.movers.choice import Around, Commitment, Keeping, MotionScores, choose_motion, score
from maxjax.sim.movers.hard_set import hard_set
from maxjax.sim.movers.local_value import LocalValue
from maxjax.sim.movers.motions import MotionPrimitive, MotionSet, at, duration, motion_to, motions, rest_at
from maxjax.sim.movers.reachable_sets import Bounds, Tracks, no_tracks

BOUNDS = Bounds(speed=6.0, acceleration=2.0, size=1.0)
STILL = Bounds(speed=6.0, acceleration=1e-3, size=1.0)
CHOICE = MotionSet(speed=5.0, acceleration=6.0, jerk=60.0, directions=24, brakes=(0.3, 0.8), horizon=2.2)
KEEPING = Keeping(radius=0.8, wall=1.0)
SLOTS = 8
SHAPE, SPACING = (21, 21, 11), 2.0
ORIGIN = -SPACING * np.array([10.0, 10.0, 5.0])
CENTRES = ORIGIN + SPACING * np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), -1)


def around(tracks: Tracks, blocked: np.ndarray | None = None, seen: np.ndarray | None = None) -> Around:
    """An open sky, or what is given; the way leads east."""
    blocked = np.zeros(SHAPE, bool) if blocked is None else blocked
    seen = ~blocked if seen is None else seen
    origin = jnp.asarray(ORIGIN, jnp.float32)
    hard = fast_hard_set(jnp.asarray(blocked), jnp.asarray(seen), origin, SPACING)
    free = no_tracks(SLOTS - len(tracks.used))  # as many slots everywhere: one program
    filled = jax.tree.map(lambda x, y: jnp.asarray(np.concatenate([x, y])), tracks, free)
    return Around(
        filled, hard, LocalValue(jnp.asarray(30.0 - CENTRES[..., 0], jnp.float32), origin, jnp.full(3, 1e3), SPACING)
    )


def at_rest(place: np.ndarray, verified: float = 0.0) -> Commitment:
    return Commitment(rest_at(jnp.asarray(place, jnp.float32)), jnp.float32(verified))


def flown_from(place: ArrayLike, velocity: ArrayLike, target: ArrayLike, brakes: float) -> MotionPrimitive:
    start = jnp.asarray(place, jnp.float32), jnp.asarray(velocity, jnp.float32), jnp.zeros(3)
    return motion_to(start, jnp.asarray(target, jnp.float32), jnp.float32(brakes), CHOICE)


def crowd(rng: np.random.Generator, count: int) -> Tracks:
    """Movers around the origin, none nearer than six metres, as sets of some width."""
    place = rng.normal(size=(count, 3)) * [8.0, 8.0, 3.0]
    place *= np.maximum(1.0, 6.0 / np.linalg.norm(place, axis=1, keepdims=True))
    velocity = rng.uniform(-2.0, 2.0, (count, 3))
    given = {"low": place - 0.1, "high": place + 0.1, "slowest": velocity - 0.3, "fastest": velocity + 0.3}
    given |= {"half": rng.uniform(0.2, 0.5, (count, 3)), "place": place, "velocity": velocity}
    used = jnp.ones(count, bool)
    tracks = dataclasses.replace(no_tracks(count), **{k: jnp.asarray(v, jnp.float32) for k, v in given.items()})
    return dataclasses.replace(tracks, used=used, confirmed=used)


fast_hard_set = jax.jit(hard_set, static_argnums=3)
fast_motions = jax.jit(functools.partial(motions, CHOICE))
fast_choose = jax.jit(functools.partial(choose_motion, choice=CHOICE, keeping=KEEPING), static_argnames="bounds")
fast_score = jax.jit(functools.partial(score, choice=CHOICE, keeping=KEEPING), static_argnames="bounds")
fast_places = jax.jit(jax.vmap(lambda motion, time: at(motion, time)[0], (None, 0), out_axes=-2))


def choose(given: Around, flown: Commitment, bounds: Bounds = BOUNDS) -> tuple[Commitment, jax.Array]:
    chosen: tuple[Commitment, jax.Array] = fast_choose(given, flown, bounds=bounds)
    return chosen


def judge(given: Around, tried: MotionPrimitive, bounds: Bounds = BOUNDS) -> MotionScores:
    scored: MotionScores = fast_score(given, tried, bounds=bounds)
    return scored


def tried_from(place: ArrayLike, velocity: ArrayLike, towards: ArrayLike) -> MotionPrimitive:
    present = flown_from(place, velocity, np.zeros(3), 0.0)
    tried: MotionPrimitive = fast_motions(present, jnp.asarray(towards, jnp.float32))
    return tried


REST = np.zeros(3)


def hover() -> MotionPrimitive:
    """At the origin, as often as motions are tried: one program for both."""
    one = at_rest(REST).motion
    all_of_it: MotionPrimitive = jax.tree.map(
        lambda x, y: jnp.broadcast_to(x, y.shape), one, tried_from(REST, REST, REST)
    )
    return all_of_it


def way_along(motion: MotionPrimitive, samples: int) -> np.ndarray:
    """(..., t, 3), at times spread over the horizon."""
    return np.asarray(fast_places(motion, jnp.linspace(0.0, CHOICE.horizon, samples)), float)


def nearest_approach(motion: MotionPrimitive, tracks: Tracks) -> float:
    """Least distance, as long as promised, from the vehicle to any body that does its worst within the bounds.

    By brute force in time: at each moment the worst body has pushed towards where the vehicle is then ever since the
    start, from the end of its set that is nearest; along each axis by itself, as bounds are.
    """
    step, promised = 0.005, max(float(duration(motion)), KEEPING.promise)
    ways = way_along(motion, round(CHOICE.horizon / step) + 1)[: round(promised / step) + 1]
    half, least = np.asarray(tracks.half, float), np.inf
    low, high = np.asarray(tracks.low, float), np.asarray(tracks.high, float)
    down, up = -np.asarray(tracks.slowest, float), np.asarray(tracks.fastest, float)
    for vehicle in ways:
        outside = np.maximum(np.maximum(low - half - vehicle, vehicle - high - half), 0.0)
        least = min(least, np.linalg.norm(outside, axis=1).min())
        faster = [np.minimum(speed + step * BOUNDS.acceleration, BOUNDS.speed) for speed in (down, up)]
        low, high = low - 0.5 * step * (down + faster[0]), high + 0.5 * step * (up + faster[1])
        down, up = faster
    return least


def test_nobody_who_keeps_the_bounds_can_touch_a_verified_motion() -> None:
    rng = np.random.default_rng(0)
    held, moved = 0, 0.0
    for _ in range(12):
        tracks = crowd(rng, 4)
        flown, holds = choose(around(tracks), at_rest(np.zeros(3)))
        if holds:
            held += 1
            moved += float(np.linalg.norm(way_along(flown.motion, 2)[-1]))
            assert float(flown.verified) == pytest.approx(max(float(duration(flown.motion)), KEEPING.promise))
            assert nearest_approach(flown.motion, tracks) >= KEEPING.radius - 5e-3
    assert held >= 4
    assert moved / held > 0.5  # and it gets on


def test_every_verified_motion_and_no_other_is_out_of_reach() -> None:
    """But for those that come as near as half a step takes them, at most 0.3 m more than asked."""
    rng = np.random.default_rng(1)
    verified = 0
    for _ in range(4):
        tracks = crowd(rng, 8)
        tried = tried_from(REST, [2.0, -1.0, 0.0], REST)
        scored = judge(around(tracks), tried)
        for k in range(0, len(tried.lasts), 3):
            near = nearest_approach(jax.tree.map(lambda x, k=k: x[k], tried), tracks)
            verified += bool(scored.verified[k])
            if scored.verified[k]:
                assert near >= KEEPING.radius - 5e-3
            else:
                assert near <= KEEPING.radius + 0.4
    assert verified > 10


def test_motions_keep_their_distance_from_walls_and_stay_where_was_seen() -> None:
    rng = np.random.default_rng(2)
    blocked = rng.random(SHAPE) < 0.15
    blocked[9:12, 9:12, 4:7] = False
    seen = ~blocked & (np.linalg.norm(CENTRES, axis=-1) < 11.0)
    tried = tried_from(REST, np.array([2.0, 0.0, 0.0]), np.array([5.0, 0.0, 0.0]))
    scored = judge(around(no_tracks(2), blocked, seen), tried)
    places = way_along(tried, 150)
    cubes = CENTRES[blocked]
    outside = np.maximum(np.abs(places[:, :, None] - cubes) - 0.5 * SPACING, 0.0)
    gap = np.sqrt((outside**2).sum(-1)).min(axis=(1, 2))
    index = np.floor((places - ORIGIN) / SPACING + 0.5).astype(int)
    known = seen[tuple(np.moveaxis(index, -1, 0))].all(axis=1)
    verified = np.asarray(scored.verified)
    assert 0.2 < verified.mean() < 0.9
    assert (gap[verified] >= KEEPING.wall - 0.02).all()
    assert known[verified].all()
    # What is well clear of everything is not refused.
    assert verified[(gap > KEEPING.wall + 0.3) & known].all()


def test_the_permitted_air_is_not_left() -> None:
    within = ((-3.0, -30.0, -1.0), (30.0, 30.0, 2.0))
    given = dataclasses.replace(around(no_tracks(1)), within=within)
    tried = tried_from(REST, REST, REST)
    scored = judge(given, tried)
    places = way_along(tried, 23)
    inside = np.all((places >= np.array(within[0]) - 2e-3) & (places <= np.array(within[1]) + 2e-3), axis=(1, 2))
    assert (np.asarray(scored.verified) == inside).all()
    assert 0 < inside.sum() < len(inside)


def test_what_was_verified_is_kept_until_its_end_and_then_the_trap_is_told() -> None:
    """A mover whose set soon covers all around: nothing is verified for as long as it takes to rest."""
    tracks = crowd(np.random.default_rng(3), 1)
    wide = dataclasses.replace(tracks, place=jnp.array([[5.2, 0.0, 0.0]]), low=jnp.array([[4.2, -1.0, -1.0]]),
                               high=jnp.array([[6.2, 1.0, 1.0]]), slowest=jnp.full((1, 3), -4.0),
                               fastest=jnp.full((1, 3), 4.0), velocity=jnp.zeros((1, 3)),
                               place_deviation=jnp.ones((1, 3)),
                               velocity_deviation=jnp.full((1, 3), 4.0))  # fmt: skip
    free = judge(around(wide), hover())
    assert 0.5 < float(free.free[0]) < KEEPING.promise
    assert not free.verified[0]
    kept, holds = choose(around(wide), at_rest(np.zeros(3), verified=0.4))
    assert holds
    assert float(kept.verified) == pytest.approx(0.4)
    np.testing.assert_array_equal(kept.motion.target, np.zeros(3))
    fled, holds = choose(around(wide), at_rest(np.zeros(3)))
    assert not holds
    assert float(fled.motion.target[0]) < 0.0  # away from it
    # Where it is likely to be is known better than where it may be: then past that, as fast as it goes.
    calm = dataclasses.replace(wide, place_deviation=jnp.full((1, 3), 0.1), velocity_deviation=jnp.full((1, 3), 0.1))
    passed, holds = choose(around(calm), at_rest(np.zeros(3)))
    assert not holds
    assert float(passed.verified) == 0.0
    assert float(passed.motion.target[0]) > 0.0
    ways = way_along(passed.motion, 50) - [5.2, 0.0, 0.0]
    assert np.linalg.norm(np.maximum(np.abs(ways) - np.asarray(tracks.half), 0.0), axis=1).min() > KEEPING.radius


def test_who_is_too_near_already_gets_away() -> None:
    tracks = crowd(np.random.default_rng(4), 1)
    zero = jnp.zeros((1, 3))
    near = dataclasses.replace(tracks, place=jnp.array([[-0.9, 0.0, 0.0]]), low=jnp.array([[-0.9, 0.0, 0.0]]),
                               high=jnp.array([[-0.9, 0.0, 0.0]]), slowest=zero, fastest=zero, velocity=zero,
                               rests=jnp.array([True]), half=jnp.full((1, 3), 0.5))  # fmt: skip
    flown, holds = choose(around(near), at_rest(np.zeros(3)))
    assert not holds
    assert way_along(flown.motion, 2)[-1, 0] > 1.0


def test_of_two_sides_that_are_as_good_the_one_that_was_taken_is_kept() -> None:
    """What the way costs either side differs by centimetres, and by which changes from look to look."""
    up, down = (jnp.array([3.0, side * 4.0, 0.0]) for side in (1.0, -1.0))
    for side, other in ((up, down), (down, up)):
        given = around(no_tracks(1))
        lean = jnp.asarray(0.02 * CENTRES[..., 1] * np.sign(float(side[1])), jnp.float32)  # a little dearer this side
        beside = jnp.asarray(0.6 * np.abs(np.abs(CENTRES[..., 1]) - 8.0), jnp.float32)
        guide = dataclasses.replace(given.guide, value=given.guide.value + lean + beside)
        motion = flown_from(REST, REST, side, 0.7)
        kept, holds = choose(dataclasses.replace(given, guide=guide), Commitment(motion, jnp.float32(2.0)))
        assert holds
        assert float(kept.motion.target[1] * side[1]) > 0.0
        # Without a motion before it is the cheaper one.
        fresh, _ = choose(dataclasses.replace(given, guide=guide), at_rest(np.zeros(3)))
        assert float(fresh.motion.target[1] * other[1]) > 0.0


def boxed(place: list[list[float]], velocity: list[list[float]], width: list[float]) -> Tracks:
    """Movers of half an edge of 0.5 m whose middles are known to half a width, and velocities well."""
    count = len(place)
    where, moves, half = (jnp.asarray(x, jnp.float32) for x in (place, velocity, width))
    used = jnp.ones(count, bool)
    return dataclasses.replace(
        no_tracks(count),
        low=where - half[:, None], high=where + half[:, None], slowest=moves - 0.1, fastest=moves + 0.1,
        half=jnp.full((count, 3), 0.5), place=where, velocity=moves, used=used, confirmed=used,
    )  # fmt: skip


def test_a_set_around_the_vehicle_excuses_nothing_from_the_others() -> None:
    """One that was hidden for long, somewhere around the vehicle, and one head-on, 4 m away at 5 m/s."""
    both = boxed([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]], [[0.0, 0.0, 0.0], [-5.0, 0.0, 0.0]], [1.5, 0.1])
    scored = judge(around(both), hover())
    assert scored.near[0]
    assert not scored.verified[0]
    assert float(scored.free[0]) <= (4.0 - 0.5 - KEEPING.radius) / 5.0  # soon the second one is there
    _, holds = choose(around(both), at_rest(np.zeros(3), verified=2.0))
    assert not holds
    # With the first alone the vehicle is as little promised anything, and with the second alone it gets away.
    first, second = (jax.tree.map(lambda x, k=k: x[k : k + 1], both) for k in (0, 1))
    assert not choose(around(first), at_rest(np.zeros(3), verified=2.0))[1]
    assert not judge(around(second), hover()).near[0]


def test_who_is_too_near_to_one_keeps_out_of_the_way_of_the_others() -> None:
    """What is chosen then keeps its whole distance to every mover but the one whose set is too near."""
    rng, kept = np.random.default_rng(5), 0
    for _ in range(12):
        others = crowd(rng, 3)
        here = boxed([[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], [1.5])
        tracks = jax.tree.map(lambda x, y: jnp.concatenate([x, y]), here, others)
        tried = tried_from(REST, REST, REST)
        found = judge(around(tracks), tried)
        alone = judge(around(others), tried)
        np.testing.assert_array_equal(found.verified, alone.verified)
        assert np.asarray(found.near).all()
        assert not np.asarray(alone.near).any()
        flown, holds = choose(around(tracks), at_rest(np.zeros(3)))
        assert not holds
        if alone.verified.any():
            kept += 1
            assert nearest_approach(flown.motion, others) >= KEEPING.radius - 0.02
    assert kept > 3


def test_a_set_that_is_too_near_is_not_approached() -> None:
    """0.6 m from a mover of which 0.8 m are asked: nothing that is called verified goes nearer than 0.6 m."""
    one = dataclasses.replace(boxed([[1.1, 0.0, 0.0]], [[0.0, 0.0, 0.0]], [0.0]), slowest=jnp.zeros((1, 3)),
                              fastest=jnp.zeros((1, 3)))  # fmt: skip
    tried = tried_from(REST, REST, REST)
    scored = judge(around(one), tried, STILL)
    ways = way_along(tried, 23)
    gap = np.linalg.norm(np.maximum(np.abs(ways - [1.1, 0.0, 0.0]) - 0.5, 0.0), axis=-1).min(axis=1)
    verified = np.asarray(scored.verified)
    assert scored.near.all()
    assert 0.2 < verified.mean() < 0.8
    assert gap[verified].min() > 0.59
    assert not verified[gap < 0.58].any()


def test_what_keeps_its_distance_is_too_near_to_nobody() -> None:
    """At 1 cm more than is asked nothing is excused: what goes along a mover keeps its whole distance, too."""
    away = 0.5 + KEEPING.radius + 0.01
    one = dataclasses.replace(boxed([[away, 0.0, 0.0]], [[0.0, 0.0, 0.0]], [0.0]), slowest=jnp.zeros((1, 3)),
                              fastest=jnp.zeros((1, 3)))  # fmt: skip
    tried = tried_from(REST, REST, REST)
    scored = judge(around(one), tried, STILL)
    ways = way_along(tried, 220)
    gap = np.linalg.norm(np.maximum(np.abs(ways - [away, 0.0, 0.0]) - 0.5, 0.0), axis=-1).min(axis=1)
    assert not scored.near.any()
    assert gap[np.asarray(scored.verified)].min() >= KEEPING.radius - 2e-3
    assert choose(around(one), at_rest(np.zeros(3)), bounds=STILL)[1]


def test_who_can_no_longer_stop_before_a_wall_brakes_whatever_follows_him() -> None:
    """At 5 m/s and 3 m from a wall, with 3.1 m to stop and a metre to keep, and a mover that may be anywhere behind."""
    blocked = np.zeros(SHAPE, bool)
    blocked[13:] = True  # from x = 5 m on
    behind = jnp.array([[-6.0, 0.0, 0.0]])
    tracks = dataclasses.replace(
        no_tracks(1),
        low=behind - 3.0, high=behind + 3.0, slowest=jnp.full((1, 3), -4.0), fastest=jnp.full((1, 3), 4.0),
        half=jnp.full((1, 3), 0.5), place=behind, used=jnp.ones(1, bool), confirmed=jnp.ones(1, bool),
    )  # fmt: skip
    fast = jnp.array([5.0, 0.0, 0.0])
    motion = flown_from([2.0, 0.0, 0.0], fast, fast, 0.5)
    taken, holds = choose(around(tracks, blocked), Commitment(motion, jnp.float32(0.0)))
    assert not holds
    tried = tried_from(motion.place, motion.velocity, fast)
    furthest = way_along(tried, 45)[..., 0].max(axis=1)
    own = way_along(taken.motion, 45)[:, 0].max()
    assert own <= furthest.min() + 0.3
    assert np.isfinite(way_along(taken.motion, 45)).all()
