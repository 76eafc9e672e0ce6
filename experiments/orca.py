"""ORCA among movers that do not give way: the rival that everybody knows, on the same tracks as ours.

    min |v − v°|   subject to   (v − v_A − u_k) · n_k ≥ 0  for every mover,   |v| ≤ the greatest speed

Optimal reciprocal collision avoidance (van den Berg, Guy, Lin and Manocha, "Reciprocal n-Body Collision Avoidance",
2011): u_k is the least change of the relative velocity that leaves the velocity obstacle of mover k within τ seconds.
There each of two takes half of it; movers that do not know of us take none, so the vehicle takes all. Movers are balls
around their boxes, of which places and velocities are those of the tracks' best estimates. The quadratic program is
solved by cyclic projections with Dykstra's corrections; where it has no solution these end between the constraints.
Walls are not ORCA's: the velocity is aimed down the same cost-to-go as ours, which keeps off them.
"""

from __future__ import annotations

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from maxjax.sim.movers.choice import Around, Commitment, Keeping, downhill
from maxjax.sim.movers.motions import MotionSet, motion_to
from maxjax.sim.movers.reachable_sets import Bounds, Tracks

_SECONDS = 2.0  # τ
_SWEEPS = 40


def orca(
    around: Around, flown: Commitment, choice: MotionSet, bounds: Bounds, keeping: Keeping
) -> tuple[Commitment, Bool[Array, ""]]:
    """The motion towards ORCA's velocity; it verifies nothing. Arguments as of `choose_motion`."""
    present = flown.motion
    wanted = downhill(around.guide, present, choice)
    change, normal = half_spaces(around.tracks, present.place, present.velocity, keeping.radius)
    velocity = solved(wanted, present.velocity + change, normal, around.tracks.used, choice.speed)
    velocity = jnp.where(jnp.all(jnp.isfinite(velocity)), velocity, 0.0)
    start = present.place, present.velocity, present.pushes[0]
    motion = motion_to(start, velocity, jnp.float32(choice.horizon), choice)
    return Commitment(motion, jnp.float32(0.0)), jnp.array(True)


def half_spaces(
    tracks: Tracks, place: Float[Array, "3"], velocity: Float[Array, "3"], radius: float
) -> tuple[Float[Array, "s 3"], Float[Array, "s 3"]]:
    """Changes u and normals n, of every mover.

    Args:
        tracks: of the movers.
        place: of the vehicle [m].
        velocity: of the vehicle [m/s].
        radius: to keep to what holds a mover [m].
    """
    apart, relative = tracks.place - place, velocity - tracks.velocity
    reach = radius + jnp.linalg.norm(tracks.half, axis=1)
    distance = jnp.linalg.norm(apart, axis=1)
    # Already too near: out of it within a tenth of a second.
    seconds = jnp.where(distance > reach, _SECONDS, 0.1)[:, None]
    ball = relative - apart / seconds
    along = jnp.sum(ball * apart, axis=1)
    size = jnp.maximum(jnp.linalg.norm(ball, axis=1), 1e-6)
    # On the ball that closes the cone, or on the cone itself.
    on_ball = (distance <= reach) | ((along < 0.0) & (along**2 > reach**2 * size**2))
    ball_normal = ball / size[:, None]
    ball_change = (reach / seconds[:, 0] - size)[:, None] * ball_normal

    squared = jnp.maximum(distance**2 - reach**2, 1e-6)
    a, b = jnp.maximum(distance**2, 1e-6), jnp.sum(apart * relative, axis=1)
    cross = jnp.linalg.norm(jnp.cross(apart, relative), axis=1)
    c = jnp.sum(relative**2, axis=1) - cross**2 / squared
    t = (b + jnp.sqrt(jnp.maximum(b**2 - a * c, 0.0))) / a
    out = relative - t[:, None] * apart
    width = jnp.maximum(jnp.linalg.norm(out, axis=1), 1e-6)
    cone_normal = out / width[:, None]
    cone_change = (reach * t - width)[:, None] * cone_normal
    pick = on_ball[:, None]
    return jnp.where(pick, ball_change, cone_change), jnp.where(pick, ball_normal, cone_normal)


def solved(
    wanted: Float[Array, "3"],
    points: Float[Array, "s 3"],
    normals: Float[Array, "s 3"],
    used: Bool[Array, " s"],
    speed: float,
) -> Float[Array, "3"]:
    """The velocity nearest to the wanted one in all half-spaces (v − point) · normal ≥ 0 and in the ball of a speed."""

    def project(carry: tuple[Array, Array], k: Array) -> tuple[tuple[Array, Array], None]:
        velocity, corrections = carry
        before = velocity + corrections[k]
        short = jnp.minimum(jnp.sum((before - points[k]) * normals[k]), 0.0)
        after = jnp.where(used[k], before - short * normals[k], before)
        return (after, corrections.at[k].set(before - after)), None

    def sweep(_: Array, carry: tuple[Array, Array]) -> tuple[Array, Array]:
        (velocity, corrections), _none = lax.scan(project, carry, jnp.arange(len(points)))
        before = velocity + corrections[-1]
        size = jnp.linalg.norm(before)
        after = before * jnp.minimum(speed / jnp.maximum(size, 1e-6), 1.0)
        return after, corrections.at[-1].set(before - after)

    start = wanted, jnp.zeros((len(points) + 1, 3))
    found: Array = lax.fori_loop(0, _SWEEPS, sweep, start)[0]
    return found
