"""From a path to a time-parameterised reference on the device: round the corners, find the speed, integrate the time.

Corners are those of `trajectories.corner_rounding`, x̃ = x + Σ_i Δu_i G_i. Turns mirrored at the start with the opposite
sign keep x̃(0) = x(0), and widths that end before the path does keep its last point.

Speed ṡ = v along s, in three limits: v ≤ caps and limits.speed; |x̃''| v² ≤ limits.acceleration, and |v̇| ≤ that as
well. With v² for the unknown, the last is a bound of the slope: the backward pass is the lower envelope
min_j (v_j² + 2 a |s − s_j|) over later points, the forward pass that over earlier points, each one cumulative minimum.
v̇ is constant between samples. As |x̃'| ≤ 1 up to the interplay of unequal widths (which is divided out), no acceleration
exceeds twice the limit. Of `FlightLimits`, a reference keeps speed, acceleration and deviation.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from maxjax.compile.lowering import matmul
from maxjax.trajectories.corner_rounding import blend, widths_within
from maxjax.trajectories.limits import FlightLimits

# Edges shorter than this [m] count as repeated points.
_SHORTEST = 1e-3
# Candidate blending widths [m]: with 4 m every corner that 0.3 m of deviation allows at 5 m/s is flown at 5 m/s.
_WIDTHS = tuple(4.0 * 2.0 ** (-k / 2) for k in range(10))
# Represents "never" among times [s]; finite, so that no difference is inf - inf.
_NEVER = 1e6


# Braking where the start speed is too high for the acceleration to meet a cap, as a multiple of that.
BRAKING = 2.0


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Sampling:
    """How a reference is sampled; static.

    Attributes:
        spacing: of the samples, arc length of the path [m].
        samples: their number; the reference ends after spacing * (samples - 1) metres of path.

    Raises:
        ValueError: unless the spacing is positive and there are two samples or more.
    """

    spacing: float = 0.25
    samples: int = 256

    def __post_init__(self) -> None:
        if not self.spacing > 0.0:
            raise ValueError(f"Sampling.spacing: expected a positive number of metres, given {self.spacing}")
        if self.samples < 2:
            raise ValueError(f"Sampling.samples: expected at least 2, given {self.samples}")


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Course:
    """A rounded path, sampled; batch axes lead. Samples beyond the end of the path repeat it.

    Attributes:
        points: x̃ [m].
        tangent: dx̃/ds; of unit length on straights, shorter in corners.
        arclength: s of each sample, along the polyline [m].
        bend: bound of |d²x̃/ds²| within half a spacing of each sample [1/m].
    """

    points: Float[Array, "*batch m 3"]
    tangent: Float[Array, "*batch m 3"]
    arclength: Float[Array, "*batch m"]
    bend: Float[Array, "*batch m"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Reference:
    """A course with its times; batch axes lead.

    Attributes:
        course: the curve.
        speed: ds/dt at the samples [m/s].
        time: at which each sample is reached, from the start of the reference [s]; 1e6 and more for "never".
        duration: time at which it comes to rest [s].
        excess: greatest speed beyond a cap [m/s]: 0, unless the start speed is too high even for that.
    """

    course: Course
    speed: Float[Array, "*batch m"]
    time: Float[Array, "*batch m"]
    duration: Float[Array, "*batch"]
    excess: Float[Array, "*batch"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Setpoint:
    """Desired state at one time, which the controller tracks; batch axes lead.

    Attributes:
        position: [m].
        velocity: [m/s].
        acceleration: [m/s²].
        yaw: heading of body x [rad].
    """

    position: Float[Array, "*batch 3"]
    velocity: Float[Array, "*batch 3"]
    acceleration: Float[Array, "*batch 3"]
    yaw: Float[Array, "*batch"]


def _norm(x: Float[Array, "*n 3"]) -> Float[Array, "*n"]:
    """Length with derivative 0 at 0."""
    return _sqrt(jnp.sum(x * x, -1))


def _sqrt(y: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Root of what is positive, else 0, with derivative 0 there."""
    return jnp.where(y > 0.0, jnp.sqrt(jnp.where(y > 0.0, y, 1.0)), 0.0)


def _directions(path: Float[Array, "n 3"]) -> tuple[Float[Array, "e 3"], Float[Array, " e"]]:
    """Unit direction and length of each edge; repeated points take the direction of the edge before them, or after."""
    edges = jnp.diff(path, axis=0)
    length = _norm(edges)
    real = length > _SHORTEST
    length = jnp.where(real, length, 0.0)
    before = lax.cummax(jnp.where(real, jnp.arange(length.size), -1))
    source = jnp.where(before >= 0, before, jnp.argmax(real))
    unit = jnp.where(real[:, None], edges / jnp.where(real, length, 1.0)[:, None], 0.0)
    return unit[source], length


def sample(path: Float[Array, "n 3"], limits: FlightLimits, sampling: Sampling = Sampling()) -> Course:
    """Round the corners of a path and sample it evenly.

    Args:
        path: polyline [m]; the last point is repeated to the end of the array, a path of one point is allowed.
        limits: of the deviation; static.
        sampling: static.

    Returns:
        `sampling.samples` samples, `sampling.spacing` apart along the path, the first one its start. No point of the
        curve through them is further than `limits.deviation` from the path. Longer paths are cut off.

    Raises:
        ValueError: for wrong shapes.
    """
    if path.ndim != 2 or path.shape[1] != 3 or path.shape[0] < 2:
        raise ValueError(f"sample: expected a path (n, 3) of at least two points, given {path.shape}; use vmap")
    unit, length = _directions(path)
    corner = jnp.concatenate([jnp.zeros(1), jnp.cumsum(length)])
    total = corner[-1]
    turn = jnp.pad(jnp.diff(unit, axis=0), ((1, 1), (0, 0)))
    angle = _norm(turn)
    width = widths_within(limits.deviation, corner, angle, jnp.asarray(_WIDTHS))
    width = jnp.maximum(jnp.minimum(width, total - corner), _SHORTEST)

    s = jnp.minimum(sampling.spacing * jnp.arange(sampling.samples, dtype=path.dtype), total)
    edge = jnp.clip(jnp.searchsorted(corner, s, side="right") - 1, 0, length.size - 1)
    after, image = s[:, None] - corner, s[:, None] + corner
    (shift, slope, _), (back, mirrored, _) = blend(after, width), blend(image, width)
    half = 0.5 * sampling.spacing
    nearest, mirrored_bend = (blend(x, width)[2] for x in (jnp.maximum(jnp.abs(after) - half, 0.0), image + half))
    bend = matmul(nearest - mirrored_bend, angle)
    along = (s - corner[edge])[:, None] * unit[edge]
    points = path[edge] + along + matmul(shift - back, turn)
    return Course(points, unit[edge] + matmul(slope - mirrored, turn), s, bend)


def straight_course(start: Float[Array, "3"], end: Float[Array, "3"], sampling: Sampling = Sampling()) -> Course:
    """The course from one point straight to another: what `sample` makes of the two, without its corners."""
    way = end - start
    total = _norm(way)
    unit = way / jnp.maximum(total, _SHORTEST)
    s = jnp.minimum(sampling.spacing * jnp.arange(sampling.samples, dtype=way.dtype), total)
    return Course(start + s[:, None] * unit, jnp.broadcast_to(unit, (s.size, 3)), s, jnp.zeros_like(s))


def profile(course: Course, caps: Float[Array, " m"], start_speed: Float[Array, ""], limits: FlightLimits) -> Reference:
    """The fastest speeds within caps and limits, and the times that follow.

    Args:
        course: from `sample`.
        caps: greatest speed at each sample [m/s]. The reference comes to rest at the first sample whose cap is not
            above 0 (NaN included), and stays.
        start_speed: along the path, at its start [m/s].
        limits: of speed and acceleration; static.

    Returns:
        The reference. It begins with `start_speed` whatever the caps are: where `limits.acceleration` cannot meet
        them it brakes with the least sufficient deceleration up to `BRAKING` times it; `excess` remains above the caps.

    Raises:
        ValueError: for wrong shapes.
    """
    s = course.arclength
    if s.ndim != 1 or caps.shape != s.shape or start_speed.shape != ():
        raise ValueError(
            f"profile: expected as many caps as samples and one start speed, given {s.shape}, {caps.shape} "
            f"and {start_speed.shape}; use vmap for batches"
        )
    # The end itself is repeated: computed twice by a compiler, its arclengths may differ in their last bits.
    moving = lax.cummin(((caps > 0.0) & (s < s[-1] - _SHORTEST)).astype(jnp.int32)).astype(bool)
    # The three limits as squares; without bend or length there is no limit.
    allowed = jnp.minimum(
        jnp.square(limits.speed / jnp.maximum(_norm(course.tangent), 1.0)),
        limits.acceleration / jnp.maximum(course.bend, 1e-6),
    )
    allowed = jnp.where(moving, jnp.minimum(allowed, jnp.square(jnp.where(moving, caps, 0.0))), 0.0)

    start = jnp.square(jnp.maximum(start_speed, 0.0))
    rise = 2.0 * limits.acceleration * s
    backward = lax.cummin(allowed + rise, reverse=True) - rise
    # The least deceleration that meets every cap, then the speed that remains with it.
    later = s > 0.0
    needed = jnp.max(jnp.where(later, (start - allowed) / jnp.where(later, 2.0 * s, 1.0), 0.0))
    unavoidable = start - 2.0 * jnp.clip(needed, limits.acceleration, BRAKING * limits.acceleration) * s
    forward = jnp.maximum(backward, unavoidable).at[0].set(start)
    square = jnp.maximum(lax.cummin(forward - rise) + rise, 0.0)
    speed = _sqrt(square)

    mean = 0.5 * (speed[1:] + speed[:-1])
    moves = mean > 0.0
    takes = jnp.where(moves, jnp.diff(s) / jnp.where(moves, mean, 1.0), _NEVER)
    # Between samples without motion no time passes for `duration`.
    time = jnp.concatenate([jnp.zeros(1), jnp.cumsum(takes)])
    duration = jnp.sum(jnp.where(moves, takes, 0.0))
    excess = jnp.max(jnp.where(later, speed - _sqrt(allowed), 0.0))
    return Reference(course, speed, time, duration, jnp.where(excess > 1e-2, excess, 0.0))


def setpoint_at(
    reference: Reference, time: Float[Array, ""], yaw: Float[Array, ""] | float = 0.0, lead: float = 0.0
) -> Setpoint:
    """Position, velocity and acceleration of the reference; `vmap` over times.

    Args:
        reference: from `profile`.
        time: since its start [s]; before 0 it rests at its start, after `duration` at its end.
        yaw: heading of the setpoint [rad].
        lead: the acceleration is that `lead` seconds later, which compensates the lag of the thrust [s].
    """
    position, velocity, acceleration = _at(reference, time)
    if lead:
        acceleration = _at(reference, time + lead)[2]
    return Setpoint(position, velocity, acceleration, jnp.asarray(yaw, position.dtype))


def _at(reference: Reference, time: Float[Array, ""]) -> tuple[Array, Array, Array]:
    """Position, velocity, acceleration at a time."""
    course, s = reference.course, reference.course.arclength
    passed = jnp.sum(reference.time <= time) - 1
    i = jnp.clip(passed, 0, s.size - 2)
    step = s[i + 1] - s[i]
    width = jnp.where(step > 0.0, step, 1.0)
    v, w = reference.speed[i], reference.speed[i + 1]
    gain = jnp.where(step > 0.0, (w * w - v * v) / (2.0 * width), 0.0)
    # At the next sample before its time: only rounding gives a speed where time says that nothing moves.
    over = (v + w) * (time - reference.time[i]) > 2.02 * step
    done = (passed > s.size - 2) | over
    rests = done | (time < 0.0) | (v + w <= 0.0) | (step <= 0.0)
    elapsed = jnp.where(rests, 0.0, time - reference.time[i])
    speed = jnp.where(rests, 0.0, v + gain * elapsed)
    # Cubic in s: exact between samples, except where a blend begins, ends or has its maximum between them.
    h = jnp.clip((v * elapsed + 0.5 * gain * elapsed * elapsed) / width, 0.0, 1.0)
    a, b = course.points[i], course.points[i + 1]
    ta, tb = course.tangent[i] * width, course.tangent[i + 1] * width
    c2, c3 = 3.0 * (b - a) - 2.0 * ta - tb, 2.0 * (a - b) + ta + tb
    slope = (ta + h * (2.0 * c2 + 3.0 * h * c3)) / width
    bend = (2.0 * c2 + 6.0 * h * c3) / width**2
    position = a + h * (ta + h * (c2 + h * c3))
    velocity = jnp.where(rests, 0.0, slope * speed)
    acceleration = jnp.where(rests, 0.0, bend * speed**2 + slope * gain)
    return jnp.where(rests, jnp.where(done, b, a), position), velocity, acceleration
