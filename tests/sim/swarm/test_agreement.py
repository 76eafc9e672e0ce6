"""Motions that an agreement lets vehicles commit to, against adversarial messages, in float64 and by brute force."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline

from maxjax.sim.movers.motions import MotionPrimitive, MotionSet, at, motion_to, rest_at
from maxjax.sim.swarm.agreement import NEVER, Agreement, Message, at_rest, proposing, rank, swap_proposal
from maxjax.sim.swarm.separation import Sampled, Scheduled, courses, separation

PERIOD, SPEED, PUSH = 0.1, 5.0, 4.0
BRAKES = 0.8
CHOICE = MotionSet(SPEED, PUSH, brakes=(BRAKES,), horizon=3.2)
SAMPLED = Sampled(PERIOD, steps=32, acceleration=PUSH)
APART = 2.0
COUNT = 12


def exact(motion: MotionPrimitive, time: np.ndarray) -> np.ndarray:
    """Places at times since the start [m], in float64: SciPy's integrals of straight lines between accelerations."""
    knots = np.concatenate([[0.0], np.cumsum(np.asarray(motion.lasts, float))])
    kept = np.concatenate([[True], np.diff(knots) > 0.0])
    if kept.sum() == 1:
        return np.asarray(motion.place, float) + time[:, None] * np.asarray(motion.velocity, float)
    push = BSpline(np.concatenate([knots[:1], knots[kept], knots[-1:]]), np.asarray(motion.pushes, float)[kept], 1)
    velocity, place = push.antiderivative(1), push.antiderivative(2)
    t = np.clip(time, 0.0, knots[-1])
    away = place(t) - place(0.0) - t[:, None] * velocity(0.0)
    return np.asarray(motion.place, float) + t[:, None] * np.asarray(motion.velocity, float) + away


def nearest(committed: Scheduled, look: int) -> float:
    """Least distance between any two motions from a look on, in steps of 4 ms."""
    seconds = np.arange(0.0, 3.0, 0.004)
    ways = []
    for k in range(len(committed.start)):
        motion = jax.tree.map(lambda x, k=k: x[k], committed.motion)
        ways.append(exact(motion, PERIOD * (look - int(committed.start[k])) + seconds))
    apart = np.linalg.norm(np.array(ways)[:, None] - np.array(ways)[None], axis=-1).min(axis=-1)
    return float(apart[np.triu_indices(len(ways), 1)].min())


def drawn(rng: np.random.Generator, shape: tuple[int, ...]) -> MotionPrimitive:
    """Any motions."""
    f32 = functools.partial(jnp.asarray, dtype=jnp.float32)
    velocity, target = (rng.normal(size=(*shape, 3)) for _ in range(2))
    velocity, target = (
        x * SPEED * rng.random() / np.linalg.norm(x, axis=-1, keepdims=True) for x in (velocity, target)
    )
    push = rng.uniform(-1.0, 1.0, (*shape, 3)) * PUSH / 2.0
    start = f32(rng.uniform(-4.0, 4.0, (*shape, 3))), f32(velocity), f32(push)
    return motion_to(start, f32(target), f32(rng.uniform(0.0, BRAKES, shape)), CHOICE)


def test_the_separation_is_a_lower_bound_and_near_the_least_distance() -> None:
    rng = np.random.default_rng(0)
    both = Scheduled(drawn(rng, (2, 60)), jnp.asarray(rng.integers(-5, 1, (2, 60)), jnp.int32))
    places = courses(both, jnp.int32(0), SAMPLED)
    bound = np.asarray(separation(places[0], places[1], SAMPLED), float)
    for k in range(60):
        pair = jax.tree.map(lambda x, k=k: x[:, k], both)
        assert -1e-4 <= nearest(pair, 0) - bound[k] <= 2.0 * SAMPLED.between + 0.02


def flown(
    seed: int, wait: int, late: int, lost: float, trusting: bool = False, looks: int = 80
) -> tuple[float, float, int]:
    """A crowd that agrees while an adversary delays and drops messages.

    Args:
        seed: of all draws.
        wait: of the agreement.
        late: greatest age of a message [looks].
        lost: share of the looks at which nothing new arrives, for a pair.
        trusting: leave out proposals of others, and who sent nothing since.

    Returns:
        Least distance between motions in force [m], how far vehicles went in the mean [m], and swaps.
    """
    rng = np.random.default_rng(seed)
    agreement = Agreement(wait, APART, SAMPLED)
    spots = 3.0 * np.stack(np.meshgrid(*3 * [np.arange(3)], indexing="ij"), -1).reshape(-1, 3)
    place = jnp.asarray(spots[rng.permutation(27)[:COUNT]], jnp.float32)
    own = jax.vmap(at_rest, (0, None))(Scheduled(rest_at(place), jnp.zeros(COUNT, jnp.int32)), jnp.int32(0))
    sent: list[Message] = [own]
    known = np.zeros((COUNT, COUNT), int)
    least, swaps, begun = np.inf, 0, np.asarray(place)
    for look in range(1, looks):
        arrives = np.maximum(known, look - 1 - rng.integers(0, late + 1, (COUNT, COUNT)))
        known = np.where(rng.random((COUNT, COUNT)) < lost, known, np.maximum(arrives, 0))
        told = jax.tree.map(lambda *x, known=known: jnp.asarray(np.stack(x)[known, np.arange(COUNT)]), *sent)
        if trusting:
            told = dataclasses.replace(
                told, proposed=jnp.full_like(told.proposed, NEVER), sent=jnp.full_like(told.sent, look)
            )
        heading = 6.0 * rng.normal(size=(COUNT, 3)) - np.asarray(own.committed.motion.place) + 3.0
        own, took = _look(own, told, jnp.int32(look), jnp.asarray(heading, jnp.float32), agreement)
        sent.append(own)
        swaps += int(took.sum())
        least = min(least, nearest(own.committed, look))
    moved = np.linalg.norm(np.asarray(courses(own.committed, jnp.int32(looks), SAMPLED))[:, -1] - begun, axis=1)
    return least, float(moved.mean()), swaps


@functools.partial(jax.jit, static_argnums=4)
def _look(
    own: Message, told: Message, look: jax.Array, heading: jax.Array, agreement: Agreement
) -> tuple[Message, jax.Array]:
    """One look of all vehicles: swap, and propose to fly in a direction, without a look at anybody."""

    def of_one(own: Message, told: Message, heading: jax.Array, index: jax.Array) -> tuple[Message, jax.Array]:
        own, took = swap_proposal(own, told, index, look, agreement)
        start = look + agreement.wait
        state = at(own.committed.motion, PERIOD * (start - own.committed.start).astype(jnp.float32))
        motion = motion_to(state, SPEED * heading / jnp.linalg.norm(heading), jnp.float32(BRAKES), CHOICE)
        return proposing(own, Scheduled(motion, start), jnp.array(True), look), took

    return jax.vmap(of_one)(own, told, heading, jnp.arange(COUNT))


@pytest.mark.parametrize(("wait", "late", "lost"), [(1, 0, 0.0), (3, 2, 0.0), (3, 3, 0.05)])
def test_no_two_motions_in_force_ever_come_nearer_than_agreed(wait: int, late: int, lost: float) -> None:
    least, moved, swaps = flown(wait, wait, late, lost)
    assert least >= APART
    # Where messages come later than the agreement waits, few swap; else there is a coming and going.
    assert swaps > (0 if late >= wait else 2 * COUNT)
    assert moved > (0.0 if late >= wait else 0.5)


def test_the_adversary_brings_those_together_who_trust_what_they_knew() -> None:
    least, _, _ = flown(6, 3, 2, 0.0, trusting=True)
    assert least < 0.5 * APART


def test_who_is_not_told_in_time_keeps_its_motion() -> None:
    _, moved, swaps = flown(0, 2, 5, 1.0, looks=20)
    assert (moved, swaps) == (0.0, 0)


def test_no_two_vehicles_have_one_rank_and_all_have_their_turn() -> None:
    ranks = np.array([np.asarray(rank(jnp.arange(32), jnp.int32(look))) for look in range(400)])
    assert all(len(set(row)) == 32 for row in ranks)
    firsts = np.bincount(ranks.argmin(axis=1), minlength=32)
    assert firsts.min() >= 2
    assert firsts.max() <= 40


def test_impossible_agreements_are_refused() -> None:
    with pytest.raises(ValueError, match="expected at least 1 look, given 0"):
        Agreement(0, APART, SAMPLED)
    with pytest.raises(ValueError, match="expected a positive number, given 0"):
        Agreement(1, 0.0, SAMPLED)
    with pytest.raises(ValueError, match=r"Sampled.steps: expected a positive number"):
        Sampled(PERIOD, 0, PUSH)
