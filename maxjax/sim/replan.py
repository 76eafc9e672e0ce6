"""The planning stage of a flight: seek a path, refer to it, or look from elsewhere.

    (world, flight) ↦ flight with a fresh reference

A path from here to the goal at the largest margin that joins them, never below `least_margin`, is verified against the
map as it is now, on the device (`sight.clear`: every voxel that an edge touches). A path that fails is not flown: the
vehicle brakes and holds on the last one that passed, and looks again. Where it holds, or where a path leads into what
cannot be seen from here (straight up, say), it turns and steps aside within what it has seen, for another view
(`sim.lookout`).

Unknown space is free for the path and closed for the reference along it, which is slower near obstacles and ends before
the first place that was not seen free: a plan goes through what is hidden, the vehicle never faster than it can look.
Paths are planned in the index coordinates of the window.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32, Shaped

from maxjax.core.lowering import materialise
from maxjax.core.status import Status
from maxjax.core.streams import Stream, stream
from maxjax.fields.occupancy import reach_of, squared_distance
from maxjax.fields.stencil import cell
from maxjax.planning.problem import Problem, pose
from maxjax.planning.sight import clear, span_codes
from maxjax.sim import rolling_map as mapping
from maxjax.sim.flight_state import Flight, FlightConfig, Path, World, believed, to_local, to_world
from maxjax.sim.lookout import step_to, still_open
from maxjax.sim.reference import Course, Reference, evaluate, profile, sample

# Plans in a row that may fail before the flight gives up.
_FAILURES = 20
# The vehicle stops this far before what it has not seen [m].
_STAND_OFF = 1.5
# What counts as the way ahead, from here [m]; straight up, where there is none. Metres of a hidden way to look at.
_AHEAD, _LOOKED_AT = 6.0, 8
# Planning periods that a step aside may take, the distance at which it is done [m], and the part of a voxel by which
# every look that was needed makes the next one more a matter of chance.
_STEP, _STEPPED, _RESTLESS = 4, 0.5, 0.25
# Speed allowed at 2 m between the centres of the vehicle's voxel and an obstacle's, and what each metre more adds.
_SPEED_NEAR, _SPEED_GAIN = 2.0, 0.75
# A path is taken up when the vehicle moves across it no faster than this [m/s]: it drifts off by 0.4 m then.
_SIDEWAYS = 2.0
# A reference that will not get further than this in one period is stuck [m].
_STUCK = 0.5


def plan(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """A verified path and the reference along it; without one the vehicle brakes, then looks from elsewhere."""
    at, gap = believed(world, flight), _gap(flight, config)
    late = jnp.asarray(world.disturbances.latency) > 0
    awaited = _refer(flight, flight.waiting, flight.waits, gap, at, config)
    start = jnp.where(late, evaluate(awaited, jnp.float32(config.period)).position, at)
    path, status, certified, problem = _seek(world, flight, start, config)
    ok = status == Status.OK
    direct = _refer(flight, path, ok, gap, at, config)
    reference = _choose(late, awaited, direct)

    ahead = evaluate(reference, jnp.float32(config.period)).position - evaluate(reference, jnp.float32(0.0)).position
    stuck = jnp.linalg.norm(ahead) < _STUCK
    begins, goes_on, aside = _look_elsewhere(world, flight, path, ok, start, at, problem, config)
    begins &= (stuck | ~ok) & ~goes_on
    steps = begins | goes_on
    reference = _choose(steps & ~late, _refer(flight, aside, steps, gap, at, config), reference)
    fresh = jnp.where(steps, aside, path)

    blind, iteration = flight.hits == 0, flight.log.planning_iterations
    failures = jnp.where(ok & ~blind, 0, flight.failures + 1)
    gives_up = failures >= _FAILURES
    reason = jnp.where(blind, Status.EMPTY_SCAN, status)
    log = dataclasses.replace(
        flight.log,
        status=jnp.where(gives_up, reason, flight.log.status).astype(jnp.int32),
        planning_iterations=iteration + 1,
        failed_plans=flight.log.failed_plans + ~ok,
        margin=flight.log.margin.at[iteration].set(jnp.where(ok, problem.margin, jnp.nan)),
        certified=flight.log.certified + (ok & certified),
    )
    return dataclasses.replace(
        flight,
        path=jnp.where(late, flight.waiting, fresh),
        waiting=fresh,
        waits=ok | steps,
        reference=reference,
        since=jnp.float32(0.0),
        yaw=jnp.where(stuck & ~goes_on, _heading(flight) + 0.5 * math.pi, flight.yaw),
        looks=flight.looks + begins,
        stepping=jnp.where(goes_on, flight.stepping - 1, jnp.where(begins, _STEP, 0)),
        failures=failures,
        done=flight.done | gives_up,
        log=log,
    )


def _seek(
    world: World, flight: Flight, start: Float[Array, "3"], config: FlightConfig
) -> tuple[Path, Int32[Array, ""], Bool[Array, ""], Problem]:
    """A path from `start` to the goal, its status after verification, whether its field was certified; the problem."""
    grid, ground = config.grid, mapping.ground(flight.rolling_map)
    # Where the vehicle is, nothing else can be, whatever a false return says.
    here = ~cell(config.shape, grid.index_of(to_local(flight, config, start)))
    ends = to_local(flight, config, start), to_local(flight, config, world.goal)
    occupied = mapping.occupied(flight.rolling_map) | ground
    problem = pose(occupied & here, ground & here, *ends, config.margin, grid, config.least_margin)
    found, status, certified = config.find(problem, grid)
    path = to_world(flight, config, grid.to_world(found))
    bits = materialise(span_codes(problem.blocked))
    # What is verified is the path as it will be flown, after its way through world coordinates.
    on_grid = grid.fractional_index(to_local(flight, config, path))
    passed = jnp.all(clear(bits, on_grid[:-1], on_grid[1:]))
    status = jnp.where((status == Status.OK) & ~passed, Status.PATH_IN_COLLISION, status)
    return path, status, certified, problem


def _gap(flight: Flight, config: FlightConfig) -> Float[Array, "nx ny nz"]:
    """Distance to the nearest obstacle but the ground, between centres of voxels, up to the margin's reach [m]."""
    obstacles = mapping.occupied(flight.rolling_map) & ~mapping.ground(flight.rolling_map)
    squared = squared_distance(obstacles, reach_of(config.margin, config.grid))
    return config.spacing * jnp.sqrt(squared.astype(jnp.float32))


def _choose(first: Bool[Array, ""], a: Reference, b: Reference) -> Reference:
    chosen: Reference = jax.tree.map(lambda x, y: jnp.where(first, x, y), a, b)
    return chosen


def _heading(flight: Flight) -> Float[Array, ""]:
    """Which way the vehicle's x points [rad]; a turn asked for from here is begun at once, however slow it is."""
    return jnp.arctan2(flight.vehicle.rotation[1, 0], flight.vehicle.rotation[0, 0])


def _look_elsewhere(
    world: World,
    flight: Flight,
    path: Path,
    ok: Bool[Array, ""],
    start: Float[Array, "3"],
    at: Float[Array, "3"],
    problem: Problem,
    config: FlightConfig,
) -> tuple[Bool[Array, ""], Bool[Array, ""], Path]:
    """Whether there is a voxel to step to, whether a step is under way and may go on, and the straight way there.

    A step is made to its end: half-way, what it is to show would be as hidden as before.
    """
    grid, limits = config.grid, config.limits
    seen, occupied = (
        mapping.seen(flight.rolling_map),
        mapping.occupied(flight.rolling_map) | mapping.ground(flight.rolling_map),
    )
    here = grid.fractional_index(to_local(flight, config, start))
    points = sample(path, limits).points
    voxels, known = _known(flight, points, at, config)
    unknown = jnp.where(jnp.all(known), 0, jnp.argmin(known)) + jnp.arange(_LOOKED_AT) * round(1.0 / limits.spacing)
    above = start + jnp.array([0.0, 0.0, _AHEAD])
    ahead = jnp.where(ok, points[min(round(_AHEAD / limits.spacing), limits.samples - 1)], above)
    ahead = grid.fractional_index(to_local(flight, config, ahead))
    hidden = jnp.where(ok, voxels[jnp.minimum(unknown, len(voxels) - 1)], jnp.floor(ahead + 0.5).astype(jnp.int32))
    restless = _RESTLESS * flight.looks.astype(jnp.float32)
    key = stream(world.key, Stream.VIEWPOINT, flight.log.planning_iterations)
    fresh, exists = step_to(seen, occupied, problem.blocked, here, hidden, ahead, config.lidar, restless, key)
    before = grid.fractional_index(to_local(flight, config, flight.waiting[-1]))
    goes_on = (flight.stepping > 0) & still_open(seen, problem.blocked, here, before)
    goes_on &= config.spacing * jnp.linalg.norm(before - here) > _STEPPED
    end = to_world(flight, config, grid.to_world(jnp.where(goes_on, before, fresh)))
    rows = jnp.arange(path.shape[0])[:, None]
    return exists, goes_on, jnp.where(rows > 0, end, start)


def _known(
    flight: Flight, points: Float[Array, "n 3"], at: Float[Array, "3"], config: FlightConfig
) -> tuple[Int32[Array, "n 3"], Bool[Array, " n"]]:
    """The voxels that points lie in, and whether they were seen free; the vehicle's own is known without looking."""
    voxels = config.grid.index_of(to_local(flight, config, points))
    here = jnp.all(voxels == config.grid.index_of(to_local(flight, config, at)), axis=1)
    return voxels, _values(mapping.seen(flight.rolling_map), voxels) | here


def _values(volume: Shaped[Array, "nx ny nz"], voxels: Int32[Array, "n 3"]) -> Shaped[Array, " n"]:
    """Of some voxels; outside the grid, those of the nearest face."""
    i, j, k = jnp.clip(voxels, 0, jnp.asarray(volume.shape) - 1).T
    return volume[i, j, k]


def _refer(
    flight: Flight,
    path: Path,
    valid: Bool[Array, ""],
    gap: Float[Array, "nx ny nz"],
    at: Float[Array, "3"],
    config: FlightConfig,
) -> Reference:
    """The reference from here along a path; if it is not `valid`, to a stop along the one that is flown already.

    So too where the path leads off sideways from a fast flight: turning at speed would carry the vehicle far beside it.
    """
    limits = config.limits
    fresh = sample(path, limits)
    _, across = _along(flight.vehicle.velocity, fresh.tangent[0])
    valid = valid & (across <= _SIDEWAYS)
    course = jax.tree.map(lambda x, y: jnp.where(valid, x, y), fresh, _rest_of(flight.reference, flight.since))
    voxels, known = _known(flight, course.points, at, config)
    caps = jnp.clip(_SPEED_NEAR + _SPEED_GAIN * (_values(gap, voxels) - 2.0), 0.5 * _SPEED_NEAR, limits.speed)
    s = course.arclength
    ends = jnp.min(jnp.where(known, jnp.inf, s)) - _STAND_OFF
    caps = jnp.where(valid & (s < ends), caps, 0.0)
    speed, _ = _along(flight.vehicle.velocity, course.tangent[0])
    return profile(course, caps, speed, limits)


def _along(velocity: Float[Array, "3"], tangent: Float[Array, "3"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Speed along a direction, backwards counting as none, and the speed that is left [m/s]."""
    unit = tangent / jnp.maximum(jnp.linalg.norm(tangent), 1e-6)
    speed = jnp.maximum(jnp.dot(velocity, unit), 0.0)
    return speed, jnp.linalg.norm(velocity - speed * unit)


def _rest_of(reference: Reference, since: Float[Array, ""]) -> Course:
    """What is left of the course of a reference after a time."""
    course = reference.course
    last = course.arclength.size - 1
    first = jnp.clip(jnp.sum(reference.time <= since) - 1, 0, last)
    left: Course = jax.tree.map(lambda x: x[jnp.minimum(first + jnp.arange(last + 1), last)], course)
    return dataclasses.replace(left, arclength=left.arclength - left.arclength[0])
