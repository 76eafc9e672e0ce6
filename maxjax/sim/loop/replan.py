"""The planning stage of a flight: find a path, verify it, derive the reference, or move to another viewpoint.

    (world, flight) ↦ flight with a new reference

The path leads from the estimated position to the goal. It is verified on the present map, on the device
(`path.line_of_sight.clear`: every voxel that an edge meets, with the room that it has to keep; the step from an exact
end to where it has room was checked when the problem was formulated, against the cubes themselves). A path that fails
is not flown: the vehicle brakes along the last one that passed. Where it has come to rest, or where a path leads into
voxels outside the field of view (straight up, for example), it turns and moves to a viewpoint within the voxels seen
free (`sim.mapping.viewpoint`).

Unknown space is free for the path and blocked for the reference. The reference is slower near obstacles and ends before
the first voxel that was not seen free, so that the vehicle can always stop within known free space.

Paths are planned in index coordinates of the rolling map.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32, Integer, Shaped

from maxjax.core.rng_streams import Stream, stream
from maxjax.core.status import Status
from maxjax.fields.occupancy import squared_distance
from maxjax.fields.stencil import cell
from maxjax.planning.windows.windowed_route import MapAndEnds, corner_around, cut_box, route_in_windows
from maxjax.sim.loop.flight_state import (
    Answer,
    Flight,
    FlightConfig,
    Path,
    World,
    estimated_position,
    extensions_of,
    to_local,
)
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.mapping.viewpoint import AROUND, MapView, UnseenPath, next_viewpoint, still_reachable
from maxjax.trajectories.online import Course, Reference, profile, sample, setpoint_at

# Consecutive failed plans after which the flight ends.
_FAILURES = 20
# The reference ends this far before the first voxel not seen free [m].
_STAND_OFF = 1.5
# Distance along the path of the point that a viewpoint without a view of the unseen path has to approach [m]; without
# a path, that far straight up.
_FURTHER = 6.0
# Unseen voxels that a viewpoint should show, a metre of path apart.
_UNSEEN = 8
# Planning periods that the way to a viewpoint may take, and the distance at which it is reached [m].
_PERIODS, _REACHED = 4, 0.5
# Jitter of the choice of a viewpoint for each earlier one [voxels].
_JITTER = 0.25
# Speed allowed with 2 m between the centres of the vehicle's voxel and an obstacle's [m/s], and its increase a metre.
_SPEED_NEAR, _SPEED_GAIN = 2.0, 0.75
# Greatest velocity across a new path [m/s]; the vehicle leaves the path by 0.4 m then.
_SIDEWAYS = 2.0
# Without a new plan the vehicle flies on where obstacles' centres are further than this [m].
_FAR = 4.0
# A reference shorter than this in one period makes no progress [m].
_STUCK = 0.5


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Candidate:
    """A path that was planned and verified.

    Attributes:
        start: its first point [m].
        path: [m], world frame.
        status: of planning and verification.
        certified: whether it climbs a certified field.
        near: blocked voxels around its start (`planning.windows.windowed_route.WindowedRoute`).
    """

    start: Float[Array, "3"]
    path: Path
    status: Int32[Array, ""]
    certified: Bool[Array, ""]
    near: Bool[Array, "k k k"]

    @property
    def ok(self) -> Bool[Array, ""]:
        """Whether it may be flown."""
        return self.status == Status.OK


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Sidestep:
    """The straight way to a viewpoint.

    Attributes:
        exists: whether there is a viewpoint to set out for.
        continues: whether the vehicle is on the way to one and may continue.
        path: to the present viewpoint if it continues, else to the next one [m].
    """

    exists: Bool[Array, ""]
    continues: Bool[Array, ""]
    path: Path


def plan(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """A verified path and the reference along it; without one the vehicle brakes, then moves to a viewpoint.

    While the planner says nothing, it flies on along its present course as far as that is far from what is known.
    """
    position, gap = estimated_position(world, flight, config), _gap(flight, config)
    late = jnp.asarray(world.disturbances.latency) > 0
    pending = _refer(flight, flight.pending_path, flight.pending_valid, gap, position, config)
    start = jnp.where(late, setpoint_at(pending, jnp.float32(config.period)).position, position)
    candidate = _seek(world, flight, start, config)
    answer = planned = Answer(candidate.status, late, start)
    for extension in extensions_of(world, config):
        answer = extension.answer(world, flight, config, answer)
    candidate, late = dataclasses.replace(candidate, status=answer.status), answer.late
    ok, silent = candidate.ok, jnp.array(False)
    direct = _refer(flight, candidate.path, ok, gap, position, config)
    # A planner within the program always answers, unless an extension answers for it.
    if answer is not planned or not config.planner.batched:
        silent = candidate.status == Status.TIMEOUT
        direct = _choose(silent, _onwards(flight, gap, position, config), direct)
    reference = _choose(late, pending, direct)

    progress = (
        setpoint_at(reference, jnp.float32(config.period)).position - setpoint_at(reference, jnp.float32(0.0)).position
    )
    stuck = jnp.linalg.norm(progress) < _STUCK
    sidestep = _sidestep(world, flight, candidate, position, config)
    continues = sidestep.continues
    begins = sidestep.exists & (stuck | ~ok) & ~silent & ~continues
    moves = begins | continues
    reference = _choose(moves & ~late, _refer(flight, sidestep.path, moves, gap, position, config), reference)
    path = jnp.where(moves, sidestep.path, jnp.where(silent, flight.path, candidate.path))

    unsensed, iteration = flight.returns == 0, flight.log.planning_iterations
    failures = jnp.where(ok & ~unsensed, 0, flight.failures + 1)
    gives_up = failures >= _FAILURES
    reason = jnp.where(unsensed, Status.EMPTY_SCAN, candidate.status)
    log = dataclasses.replace(
        flight.log,
        status=jnp.where(gives_up, reason, flight.log.status).astype(jnp.int32),
        planning_iterations=iteration + 1,
        failed_plans=flight.log.failed_plans + ~ok,
        margin=flight.log.margin.at[iteration].set(jnp.where(ok, config.distances.margin, jnp.nan)),
        certified=flight.log.certified + (ok & candidate.certified),
    )
    return dataclasses.replace(
        flight,
        path=jnp.where(late, flight.pending_path, path),
        pending_path=path,
        pending_valid=ok | moves,
        reference=reference,
        reference_time=jnp.float32(0.0),
        yaw=jnp.where(stuck & ~continues, _heading(flight) + 0.5 * math.pi, flight.yaw),
        viewpoints=flight.viewpoints + begins,
        viewpoint_periods=jnp.where(continues, flight.viewpoint_periods - 1, jnp.where(begins, _PERIODS, 0)),
        failures=failures,
        done=flight.done | gives_up,
        log=log,
    )


def _seek(world: World, flight: Flight, start: Float[Array, "3"], config: FlightConfig) -> Candidate:
    """A path from `start` to the goal."""
    grid, ground = config.grid, mapping.ground(flight.rolling_map)
    # The vehicle's own voxel holds no obstacle; a return there is false.
    here = ~cell(config.shape, grid.index_of(to_local(flight, config, start)))
    ends = jnp.stack([grid.fractional_index(to_local(flight, config, end)) for end in (start, world.goal)])
    occupied = mapping.occupied_voxels(flight.rolling_map) | ground
    law, price = config.distances.split(grid)
    origin = mapping.origin(flight.rolling_map)
    volumes = occupied & here, ground & here
    asked = MapAndEnds.of(volumes, ends, origin, None if price is None else jnp.asarray(price))
    route, near, *_ = route_in_windows(asked, ~flight.done, law, grid.local, config.planner)
    path = origin + config.spacing * _filled_up(jnp.asarray(route.path), len(flight.path))
    return Candidate(start, path, jnp.asarray(route.status), jnp.asarray(route.certified), near)


def _filled_up(path: Float[Array, "n 3"], count: int) -> Float[Array, "m 3"]:
    """A path of so many points, the last one repeated."""
    if len(path) > count:
        raise ValueError(f"planner: expected a path of at most {count - 2} points in flight, given {len(path) - 2}")
    return jnp.pad(path, ((0, count - len(path)), (0, 0)), mode="edge")


def _gap(flight: Flight, config: FlightConfig) -> Integer[Array, "nx ny nz"]:
    """Squared distance to the nearest obstacle but the ground, between centres, up to the margin [voxels²]."""
    obstacles = mapping.occupied_voxels(flight.rolling_map) & ~mapping.ground(flight.rolling_map)
    return squared_distance(obstacles, max(1, math.floor(config.distances.margin / config.spacing)))


def _choose(first: Bool[Array, ""], a: Reference, b: Reference) -> Reference:
    chosen: Reference = jax.tree.map(lambda x, y: jnp.where(first, x, y), a, b)
    return chosen


def _heading(flight: Flight) -> Float[Array, ""]:
    """Heading of body x [rad], from which a turn is commanded."""
    return jnp.arctan2(flight.vehicle.rotation[1, 0], flight.vehicle.rotation[0, 0])


def _sidestep(
    world: World, flight: Flight, candidate: Candidate, position: Float[Array, "3"], config: FlightConfig
) -> Sidestep:
    """The way to the next viewpoint, or to the present one.

    A viewpoint is held until it is reached: on the way there, the unseen voxels would still be hidden.
    """
    path, spacing = candidate.path, config.spacing
    whole = (candidate.start - mapping.origin(flight.rolling_map)) / spacing
    # Viewpoints and what they look at lie near the start: of the map a box around it is enough.
    corner = corner_around(whole, AROUND)
    view = _view(flight.rolling_map, candidate.near, corner)
    origin = mapping.origin(flight.rolling_map) + spacing * corner
    start = whole - corner
    unseen = _unseen(flight, candidate, position, config)
    unseen = UnseenPath(unseen.voxels - corner, unseen.further - corner)
    jitter = _JITTER * flight.viewpoints.astype(jnp.float32)
    key = stream(world.key, Stream.VIEWPOINT, flight.log.planning_iterations)
    chosen = next_viewpoint(view, start, unseen, config.lidar, jitter, key)
    present = (flight.pending_path[-1] - origin) / spacing
    continues = (flight.viewpoint_periods > 0) & still_reachable(view, start, present)
    continues &= spacing * jnp.linalg.norm(present - start) > _REACHED
    end = origin + spacing * jnp.where(continues, present, chosen.position)
    rows = jnp.arange(path.shape[0])[:, None]
    return Sidestep(chosen.exists, continues, jnp.where(rows > 0, end, candidate.start))


def _view(rolling_map: mapping.RollingMap, near: Bool[Array, "k k k"], corner: Int32[Array, "3"]) -> MapView:
    """The rolling map from a lowest voxel on, as far as viewpoints look; its middle voxel is that of `near`."""
    edge = 2 * AROUND + 1
    occupied = mapping.occupied_voxels(rolling_map) | mapping.ground(rolling_map)
    return MapView(
        cut_box(mapping.seen(rolling_map), corner, (edge, edge, edge)),
        cut_box(occupied, corner, (edge, edge, edge), beyond=True),
        jnp.pad(near, (edge - near.shape[0]) // 2, constant_values=True),
    )


def _unseen(flight: Flight, candidate: Candidate, position: Float[Array, "3"], config: FlightConfig) -> UnseenPath:
    """The unseen part of a path; without a path, a point straight up."""
    grid, sampling, ok = config.grid, config.sampling, candidate.ok
    points = sample(candidate.path, config.limits, sampling).points
    voxels, known = _known(flight, points, position, config)
    first = jnp.where(jnp.all(known), 0, jnp.argmin(known))
    rows = first + jnp.arange(_UNSEEN) * round(1.0 / sampling.spacing)
    above = candidate.start + jnp.array([0.0, 0.0, _FURTHER])
    further = jnp.where(ok, points[min(round(_FURTHER / sampling.spacing), sampling.samples - 1)], above)
    further = grid.fractional_index(to_local(flight, config, further))
    on_path = voxels[jnp.minimum(rows, len(voxels) - 1)]
    return UnseenPath(jnp.where(ok, on_path, jnp.floor(further + 0.5).astype(jnp.int32)), further)


def _known(
    flight: Flight, points: Float[Array, "n 3"], position: Float[Array, "3"], config: FlightConfig
) -> tuple[Int32[Array, "n 3"], Bool[Array, " n"]]:
    """The voxels that hold points, and whether they were seen free; the vehicle's own voxel counts as seen."""
    voxels = config.grid.index_of(to_local(flight, config, points))
    own = jnp.all(voxels == config.grid.index_of(to_local(flight, config, position)), axis=1)
    return voxels, _values(mapping.seen(flight.rolling_map), voxels) | own


def _values(volume: Shaped[Array, "nx ny nz"], voxels: Int32[Array, "n 3"]) -> Shaped[Array, " n"]:
    """Values at voxels; outside the grid, those at the nearest face."""
    i, j, k = jnp.clip(voxels, 0, jnp.asarray(volume.shape) - 1).T
    return volume[i, j, k]


def _refer(
    flight: Flight,
    path: Path,
    valid: Bool[Array, ""],
    gap: Integer[Array, "nx ny nz"],
    position: Float[Array, "3"],
    config: FlightConfig,
) -> Reference:
    """The reference along a path; if the path is not `valid`, to a stop along the present course.

    A path that leads sideways from a fast flight is not valid either: the turn would carry the vehicle far beside it.
    """
    limits = config.limits
    fresh = sample(path, limits, config.sampling)
    _, across = _along(flight.vehicle.velocity, fresh.tangent[0])
    valid = valid & (across <= _SIDEWAYS)
    remaining = _remaining(flight.reference, flight.reference_time)
    course = jax.tree.map(lambda x, y: jnp.where(valid, x, y), fresh, remaining)
    caps, _ = _caps(flight, course, gap, position, config)
    speed, _ = _along(flight.vehicle.velocity, course.tangent[0])
    return profile(course, jnp.where(valid, caps, 0.0), speed, limits)


def _onwards(
    flight: Flight, gap: Integer[Array, "nx ny nz"], position: Float[Array, "3"], config: FlightConfig
) -> Reference:
    """The rest of the present course, for a planner that says nothing: as far as it is far from what is known now."""
    course = _remaining(flight.reference, flight.reference_time)
    caps, apart = _caps(flight, course, gap, position, config)
    # Nothing was verified since: what was found since may be near.
    far = jnp.cumsum(apart <= _FAR) == 0
    speed, _ = _along(flight.vehicle.velocity, course.tangent[0])
    return profile(course, jnp.where(far, caps, 0.0), speed, config.limits)


def _caps(
    flight: Flight, course: Course, gap: Integer[Array, "nx ny nz"], position: Float[Array, "3"], config: FlightConfig
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Speeds along a course, 0 from before the first voxel not seen free [m/s], and distances to obstacles [m]."""
    voxels, known = _known(flight, course.points, position, config)
    apart = config.spacing * jnp.sqrt(_values(gap, voxels).astype(jnp.float32))
    caps = jnp.clip(_SPEED_NEAR + _SPEED_GAIN * (apart - 2.0), 0.5 * _SPEED_NEAR, config.limits.speed)
    s = course.arclength
    ends = jnp.min(jnp.where(known, jnp.inf, s)) - _STAND_OFF
    return jnp.where(s < ends, caps, 0.0), apart


def _along(velocity: Float[Array, "3"], tangent: Float[Array, "3"]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Speed along a direction, 0 if backwards, and the speed of the rest [m/s]."""
    unit = tangent / jnp.maximum(jnp.linalg.norm(tangent), 1e-6)
    speed = jnp.maximum(jnp.dot(velocity, unit), 0.0)
    return speed, jnp.linalg.norm(velocity - speed * unit)


def _remaining(reference: Reference, time: Float[Array, ""]) -> Course:
    """The course of a reference from a time on."""
    course = reference.course
    last = course.arclength.size - 1
    first = jnp.clip(jnp.sum(reference.time <= time) - 1, 0, last)
    left: Course = jax.tree.map(lambda x: x[jnp.minimum(first + jnp.arange(last + 1), last)], course)
    return dataclasses.replace(left, arclength=left.arclength - left.arclength[0])
