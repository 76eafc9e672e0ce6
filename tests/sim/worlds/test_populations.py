"""Populations: bounds by differences in float64, distances to walls by hand, encounters by closest approach."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.sim.worlds.geoms import BOX, CAPSULE, SPHERE, Geoms, concatenate, ground_plane
from maxjax.sim.worlds.mover_ways import ACCELERATION
from maxjax.sim.worlds.movers import Movers, solids_at
from maxjax.sim.worlds.populations import KINDS, Population, place_movers, population
from maxjax.sim.worlds.solids import upright_boxes

START, GOAL = np.array([-40.0, 0.0, 6.0]), np.array([40.0, 0.0, 9.0])
# Nine houses between streets 20 m wide: x, y, half edges, bottom, top, yaw.
HOUSES = np.array([[40.0 * i, 20.0 + 40.0 * j, 10, 10, 0, 25, 0] for i in (-1, 0, 1) for j in (-1, 0, -2)], float)
TIMES = np.arange(0.0, 90.0, 0.05)


@functools.cache
def town() -> Geoms:
    return concatenate([ground_plane(), upright_boxes(jnp.asarray(HOUSES, jnp.float32))])


@functools.cache
def drawn(kind: str, count: int = 6, speed: float = 5.0, key: int = 0) -> Movers:
    ends = jnp.asarray(START, jnp.float32), jnp.asarray(GOAL, jnp.float32)
    return population(town(), *ends, jax.random.key(key), how=Population(count, speed, kind))


def places64(movers: Movers, times: np.ndarray) -> np.ndarray:
    """Movers by times, from the closed form by hand."""
    knot, velocity, amplitude, frequency, phase = (
        np.asarray(x, float)
        for x in (movers.knots[:, 0], movers.velocity[:, 0], movers.amplitude, movers.frequency, movers.phase)
    )
    t = times[None, :, None]
    swing = [
        amplitude[:, None, k] * np.sin(frequency[:, None, k, None] * t + phase[:, None, k])
        for k in range(amplitude.shape[1])
    ]
    return knot[:, None] + t * velocity[:, None] + sum(swing)


def to_houses(points: np.ndarray) -> np.ndarray:
    """Least distance of points to the houses, upright boxes along the axes."""
    beyond = np.abs(points[..., None, :2] - HOUSES[:, :2]) - HOUSES[:, 2:4]
    above = points[..., None, 2:] - HOUSES[:, 5:6]
    return np.linalg.norm(np.maximum(np.concatenate([beyond, above], -1), 0.0), axis=-1).min(axis=-1)


def surface(movers: Movers, time: float) -> np.ndarray:
    """Points on (or a little outside of) each solid."""
    solids = solids_at(movers, jnp.float32(time))
    size = np.asarray(solids.size, float)
    corner = np.array(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3)).reshape(3, -1).T
    half = np.array(
        [
            {BOX: s, SPHERE: s[:1].repeat(3) / np.sqrt(3.0), CAPSULE: np.array([0.0, 0.0, s[0] + s[1]])}[kind]
            for kind, s in zip(solids.type, size, strict=True)
        ]
    )
    local = corner * half[:, None]
    return np.asarray(solids.position, float)[:, None] + np.einsum(
        "mij,mnj->mni", np.asarray(solids.rotation, float), local
    )


@pytest.mark.parametrize("kind", [*KINDS, "encounters"])
def test_all_find_a_way_and_keep_the_bounds_that_they_claim(kind: str) -> None:
    movers = drawn(kind)
    assert place_movers(movers).all()
    path, step = places64(movers, TIMES), TIMES[1]
    speed = np.linalg.norm(np.diff(path, axis=1), axis=-1) / step
    fastest = Population(6, 5.0, kind).fastest
    assert speed.max() <= fastest * 1.001
    if kind != "cranes":
        assert (speed.max(axis=1) > (0.55 if kind == "birds" else 0.9) * 5.0).all()
    assert np.abs(np.diff(path, 2, axis=1)).max() / step**2 <= ACCELERATION * 1.001
    # The device's movers are these.
    for time in (0.0, 7.3):
        now = np.asarray(solids_at(movers, jnp.float32(time)).position)
        np.testing.assert_allclose(now, places64(movers, np.array([time]))[:, 0], atol=2e-3)


@pytest.mark.parametrize("kind", ["drones", "birds", "cars", "encounters"])
def test_the_box_that_is_assumed_holds_them(kind: str) -> None:
    movers, box = drawn(kind), Population(6, 5.0, kind).body
    for time in (0.0, 3.0, 9.0):
        assert (np.ptp(surface(movers, time), axis=1) <= box).all()


@pytest.mark.parametrize(("kind", "walls"), [("drones", 2.0), ("birds", 2.0), ("cars", 0.5), ("cranes", 1.0)])
def test_solids_keep_away_from_walls_ground_and_both_ends(kind: str, walls: float) -> None:
    movers = drawn(kind)
    for time in np.linspace(0.0, 60.0, 61):
        points = surface(movers, time)
        assert to_houses(points).min() >= walls - 1e-3
        assert points[..., 2].min() > 0.0
    for time in np.linspace(0.0, 2.0, 11):
        for end in (START, GOAL):
            assert np.linalg.norm(surface(movers, time) - end, axis=-1).min() >= 5.0


def test_cars_stand_on_the_ground_along_their_way_and_jibs_turn_about_an_end() -> None:
    cars = drawn("cars")
    path = places64(cars, TIMES)
    forward = np.asarray(cars.solids.rotation)[:, :, 0]
    way = path - path.mean(axis=1, keepdims=True)
    assert np.abs(np.cross(forward[:, None], way)).max() < 1e-3
    assert np.allclose(path[..., 2], 0.8)
    assert np.ptp(np.einsum("mti,mi->mt", way, forward), axis=1).min() > 10.0

    jibs = drawn("cranes")
    foot = np.asarray(jibs.knots[:, 0], float)
    for time in (0.0, 11.0, 43.0):
        solids = solids_at(jibs, jnp.float32(time))
        length = np.asarray(solids.size[:, :2], float).sum(axis=1)
        axis = np.asarray(solids.rotation, float)[:, :, 2]
        ends = [np.asarray(solids.position, float) + side * length[:, None] * axis for side in (-1.0, 1.0)]
        nearer = np.min([np.linalg.norm(end - foot, axis=1) for end in ends], axis=0)
        assert nearer.max() < 0.02


def test_encounters_pass_the_nominal_way_where_it_is_flown() -> None:
    movers = drawn("encounters", 40, 6.0)
    way = GOAL - START
    length = np.linalg.norm(way)
    times = np.arange(0.0, length / 5.0, 0.005)
    vehicle = START + 5.0 * times[:, None] * way / length
    gap = np.linalg.norm(places64(movers, times) - vehicle, axis=-1)
    least, when = gap.min(axis=1), times[gap.argmin(axis=1)]
    assert least.max() < 2.05
    assert least.min() < 0.7  # misses are spread over 0 to 2 m
    assert np.ptp(when) > 0.6 * length / 5.0
    np.testing.assert_allclose(np.linalg.norm(np.asarray(movers.velocity[:, 0]), axis=1), 6.0, rtol=1e-5)
    early = places64(movers, np.linspace(0.0, 2.0, 21))
    assert (np.linalg.norm(early - START, axis=-1) - 0.45).min() >= 5.0
    # Near the way they are free of walls.
    for k, time in enumerate(when):
        near = places64(movers, time + np.linspace(-2.0, 2.0, 41))[k]
        assert to_houses(near).min() > 0.5
        assert near[:, 2].min() > 0.5


def test_kinds_are_mixed_evenly_and_equal_counts_are_one_program() -> None:
    movers, other = drawn("mixed", 10), drawn("mixed", 10, key=1)
    assert Population(10, 5.0, "mixed").counts == {"drones": 3, "birds": 3, "cars": 2, "cranes": 2}
    assert movers.count == 10
    assert jax.tree.structure(movers) == jax.tree.structure(other)
    assert not np.array_equal(movers.knots, other.knots)
    again = drawn.__wrapped__("mixed", 10)
    for leaf, same in zip(jax.tree.leaves(movers), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(leaf, same)


def test_a_batch_of_cities_and_keys_is_its_populations_one_by_one() -> None:
    how, keys = Population(2, 5.0, "cars"), jax.vmap(jax.random.key)(jnp.arange(2))
    ends = jnp.asarray(START, jnp.float32), jnp.asarray(GOAL, jnp.float32)
    moved = town(), Geoms(town().position + jnp.array([3.0, 0.0, 0.0]), town().rotation, town().size, town().type)
    cities = jax.tree.map(lambda *x: jnp.stack(x), *moved)
    both = jax.jit(jax.vmap(lambda city, key: population(city, *ends, key, how=how)))(cities, keys)
    for k in range(2):
        alone = population(moved[k], *ends, keys[k], how=how)
        np.testing.assert_allclose(both.knots[k], alone.knots, atol=1e-4)
        np.testing.assert_allclose(both.amplitude[k], alone.amplitude, atol=1e-4)
        np.testing.assert_allclose(both.frequency[k], alone.frequency, rtol=1e-5)


def test_who_finds_no_way_is_hidden_and_told() -> None:
    full = upright_boxes(jnp.array([[0.0, 0.0, 200.0, 200.0, 0.0, 80.0, 0.0]]))
    how = Population(2, 5.0, "drones")
    movers = population(full, jnp.asarray(START), jnp.asarray(GOAL), jax.random.key(0), how=how)
    assert not place_movers(movers).any()
    assert places64(movers, TIMES)[..., 2].max() < -500.0
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(movers))


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"kind": "bats"}, "expected one of drones, birds, cars, cranes, mixed, encounters, given 'bats'"),
        ({"count": 0}, "expected 1 to 256"),
        ({"speed": 0.0}, "above 0"),
        ({"speed": float("nan")}, "above 0"),
        ({"speed": 15.5}, "at most 15"),
    ],
)
def test_other_populations_are_refused(changes: dict[str, object], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        Population(**changes)  # type: ignore[arg-type]


def test_what_faces_its_way_may_turn_and_what_does_not_keeps_its_orientation() -> None:
    turn = {
        kind: Population(4, 5.0, kind).turn for kind in ("drones", "cars", "encounters", "birds", "cranes", "mixed")
    }
    assert [kind for kind, rate in turn.items() if rate > 0.0] == ["birds", "cranes", "mixed"]
    assert turn["birds"] * 0.1 >= np.pi - 1e-6
