"""One flight in closed loop: sense → fuse → plan → follow, until the goal, contact, or no plan is left.

    fly(scene, start, goal, key, config) -> FlightLog

A planning iteration is a tuple of pure stages, each (world, flight) ↦ flight:

1. `sense`: a scan from where the vehicle is, as disturbed as the configuration says.
2. `fuse`: the scan into the rolling map, from where the vehicle believes to be.
3. `plan`: a path from here to the goal at the largest margin that joins them, never below `least_margin`, and its
   verification against the map as it is now, on the device (`sight.clear`: every voxel that an edge touches). A path
   that fails is not flown: the vehicle brakes and holds on the last one that passed, and looks again. Where it holds,
   or where a path leads into what cannot be seen from here (straight up, say), it turns and steps aside within what it
   has seen, for another view (`sim.lookout`).
4. `follow`: one planning period of physics along the path, at speeds from which it can stop before the first place that
   it has not seen free, slower near obstacles. At every physics step the exact distance to every solid is taken.

Unknown space is free for `plan` and closed for `follow`: a plan goes through what is hidden, the vehicle never faster
than it can look.

Frames: world, ENU, metres. The window moves with the vehicle by whole voxels; paths are planned in its index
coordinates.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray

from maxjax.core.grid import Grid, Index3
from maxjax.core.loops import computed_once, settle
from maxjax.core.status import Status
from maxjax.fields.occupancy import reach_of, squared_distance
from maxjax.fields.stencil import cell
from maxjax.nn.model import network_potential
from maxjax.planning.ascent import Ascent
from maxjax.planning.planner import route
from maxjax.planning.problem import Problem, pose
from maxjax.planning.sight import blocks, clear
from maxjax.sim import controller as control
from maxjax.sim import vehicle as physics
from maxjax.sim import window as mapping
from maxjax.sim.distance import distance
from maxjax.sim.disturbances import GUSTS_AT, Disturbances, corrupt, mean_wind, pose_error
from maxjax.sim.geoms import Geoms
from maxjax.sim.lidar import Lidar, Scan, scan
from maxjax.sim.lookout import step_to, still_open
from maxjax.sim.reactive import push
from maxjax.sim.reference import Course, Limits, Reference, evaluate, profile, sample
from maxjax.sim.scenes import Scene
from maxjax.solvers.potential import solve_potential

Path = Float[Array, "n 3"]
Finder = Callable[[Problem, Grid], tuple[Path, Int32[Array, ""], Bool[Array, ""]]]

# Positions are logged this often [s].
LOG_PERIOD = 0.1
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


def climb_field(problem: Problem, grid: Grid) -> tuple[Path, Int32[Array, ""], Bool[Array, ""]]:
    """The default path finder: solve the conduction potential, climb it, pull the path taut."""
    return route(problem, grid, solve_potential, Ascent())


def climb_prediction(problem: Problem, grid: Grid) -> tuple[Path, Int32[Array, ""], Bool[Array, ""]]:
    """`climb_field` with the potential that the network predicts, improved until it is certified.

    Raises:
        ValueError: if its weights are missing.
    """
    return route(problem, grid, network_potential(), Ascent())


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class FlightConfig:
    """How to fly; all of it static but the disturbances.

    Attributes:
        disturbances: strengths; may carry batch axes.
        find: path finder.
        lidar, vehicle, controller, limits, gusts: see there.
        shape: of the rolling map, voxels.
        spacing: of its voxels [m].
        margin: distance to keep from obstacles [m], lowered by one voxel at a time where it seals start or goal in.
        least_margin: but never below this [m].
        period: of planning [s].
        plans: planning iterations at most.
        tolerance: distance at which the goal counts as reached [m].
        radius: of the sphere around the vehicle that must stay clear of every solid [m].
        snapshot: plan from the latest scan alone, as the paper does, not from the fused map.
        reactive: gain of the reactive layer [m/s²]; 0 leaves it out.
    """

    disturbances: Disturbances = Disturbances()  # noqa: RUF009 (frozen)
    find: Finder = dataclasses.field(default=climb_field, metadata={"static": True})
    lidar: Lidar = dataclasses.field(default=Lidar(), metadata={"static": True})
    vehicle: physics.Vehicle = dataclasses.field(default=physics.Vehicle(), metadata={"static": True})
    controller: control.Controller = dataclasses.field(default=control.Controller(), metadata={"static": True})
    limits: Limits = dataclasses.field(default=Limits(), metadata={"static": True})
    gusts: physics.Gusts = dataclasses.field(default=physics.Gusts(), metadata={"static": True})
    shape: Index3 = dataclasses.field(default=(101, 101, 101), metadata={"static": True})
    spacing: float = dataclasses.field(default=2.0, metadata={"static": True})
    margin: float = dataclasses.field(default=8.0, metadata={"static": True})
    least_margin: float = dataclasses.field(default=2.0, metadata={"static": True})
    period: float = dataclasses.field(default=1.0, metadata={"static": True})
    plans: int = dataclasses.field(default=100, metadata={"static": True})
    tolerance: float = dataclasses.field(default=2.0, metadata={"static": True})
    radius: float = dataclasses.field(default=0.5, metadata={"static": True})
    snapshot: bool = dataclasses.field(default=False, metadata={"static": True})
    reactive: float = dataclasses.field(default=0.0, metadata={"static": True})

    @property
    def grid(self) -> Grid:
        """The rolling map's grid, its middle voxel at the origin."""
        x, y, z = (-(n // 2) * self.spacing for n in self.shape)
        return Grid(self.shape, self.spacing, (x, y, z))

    @property
    def notes(self) -> int:
        """Positions logged in a planning period."""
        return round(self.period / LOG_PERIOD)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class FlightLog:
    """What became of a flight; batch axes lead.

    Attributes:
        status: OK where the goal was reached without contact; IN_CONTACT, OUT_OF_PLANS, or why there was no plan.
        position: every 0.1 s [m], the start first; NaN once the flight is over.
        flown_length: [m].
        duration: [s].
        planning_iterations: plans asked for.
        failed_plans: those that found no path, so that the vehicle held.
        clearance: least distance from the centre of the vehicle to any solid [m].
        margin: used by each plan [m]; NaN where there was none.
        certified: how many of the paths found climbed a certified field.
    """

    status: Int32[Array, "*batch"]
    position: Float[Array, "*batch t 3"]
    flown_length: Float[Array, "*batch"]
    duration: Float[Array, "*batch"]
    planning_iterations: Int32[Array, "*batch"]
    failed_plans: Int32[Array, "*batch"]
    clearance: Float[Array, "*batch"]
    margin: Float[Array, "*batch p"]
    certified: Int32[Array, "*batch"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class World:
    """What a flight cannot change: the city, its ends, its key, its disturbances."""

    geoms: Geoms
    start: Float[Array, "3"]
    goal: Float[Array, "3"]
    key: PRNGKeyArray
    disturbances: Disturbances


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Flight:
    """What evolves.

    Attributes:
        vehicle: its true state.
        memory: of the controller.
        gust: [m/s].
        scan: the latest, its points where the vehicle believes them to be.
        hits: returns of all scans so far.
        window: the map.
        path: that is flown, verified [m].
        waiting: the latest one, flown a period later if the planner is late [m].
        waits: whether `waiting` was verified; if not, the vehicle stops on what it has.
        reference: along `path`.
        since: time since the reference began [s].
        yaw: heading that is asked for [rad].
        looks: steps aside that were begun.
        stepping: planning periods left for the one under way.
        failures: plans in a row without a path.
        done: whether the flight is over.
        log: so far.
    """

    vehicle: physics.State
    memory: control.Memory
    gust: Float[Array, "3"]
    scan: Scan
    hits: Int32[Array, ""]
    window: mapping.Window
    path: Path
    waiting: Path
    waits: Bool[Array, ""]
    reference: Reference
    since: Float[Array, ""]
    yaw: Float[Array, ""]
    looks: Int32[Array, ""]
    stepping: Int32[Array, ""]
    failures: Int32[Array, ""]
    done: Bool[Array, ""]
    log: FlightLog


Stage = Callable[[World, Flight], Flight]


def fly(
    scene: Scene | Geoms,
    start: Float[Array, "3"],
    goal: Float[Array, "3"],
    key: PRNGKeyArray,
    config: FlightConfig = FlightConfig(),
) -> FlightLog:
    """Fly once; pure, for `jit` and `vmap` over geoms, ends, keys and disturbances.

    Args:
        scene: the city.
        start, goal: world frame [m].
        key: of everything random.
        config: how.

    Returns:
        The log. Its status is OK only if the vehicle came within `config.tolerance` of the goal and nothing within
        `config.radius` of its centre on the way. START_OCCUPIED, GOAL_OCCUPIED: an end is in contact;
        GOAL_OUTSIDE_MAP: the goal is further away than the rolling map reaches; START_EQUALS_GOAL: nearer than the
        tolerance; NONFINITE_INPUT.

    Raises:
        ValueError: for wrong shapes.
    """
    geoms = scene.geoms if isinstance(scene, Scene) else scene
    if start.shape != (3,) or goal.shape != (3,):
        raise ValueError(f"fly: expected start and goal (3,), given {start.shape} and {goal.shape}; use vmap")
    world = World(geoms, start, goal, key, config.disturbances)
    flight = take_off(world, config)
    stages = stages_of(config)

    def going(_: World, flight: Flight) -> Bool[Array, ""]:
        return ~flight.done

    def iterate(world: World, flight: Flight) -> Flight:
        for stage in stages:
            flight = stage(world, flight)
        return flight

    # Most trials of a set take about as many iterations; the few that take long go on by themselves.
    return settle(going, iterate, world, flight, together=max(config.plans // 4, 1)).log


def stages_of(config: FlightConfig) -> tuple[Stage, ...]:
    """The stages of one planning iteration, in order."""

    def stage(function: Callable[[World, Flight, FlightConfig], Flight]) -> Stage:
        return lambda world, flight: function(world, flight, config)

    return tuple(map(stage, (sense, fuse, plan, follow)))


def take_off(world: World, config: FlightConfig) -> Flight:
    """The flight before its first iteration: hovering at the start, its map empty. Bad ends are over at once."""
    start, goal = world.start, world.goal
    finite = jnp.all(jnp.isfinite(start)) & jnp.all(jnp.isfinite(goal))
    start, goal = (jnp.where(finite, x, 0.0) for x in (start, goal))
    reach = config.spacing * (jnp.asarray(config.shape) // 2)
    clearance = distance(world.geoms, start)
    status = jnp.select(
        [
            ~finite,
            jnp.any(jnp.abs(goal - start) > reach),
            jnp.linalg.norm(goal - start) <= config.tolerance,
            clearance <= config.radius,
            distance(world.geoms, goal) <= config.radius,
        ],
        [
            Status.NONFINITE_INPUT,
            Status.GOAL_OUTSIDE_MAP,
            Status.START_EQUALS_GOAL,
            Status.START_OCCUPIED,
            Status.GOAL_OCCUPIED,
        ],
        Status.OK,
    ).astype(jnp.int32)
    vehicle = physics.hover(config.vehicle, start)
    path = jnp.broadcast_to(start, (Ascent().steps + 1, 3))
    nothing, zero = jnp.float32(jnp.nan), jnp.float32(0.0)
    none, rays = jnp.int32(0), config.lidar.rays
    log = FlightLog(
        status=status,
        position=jnp.full((config.plans * config.notes + 1, 3), nothing).at[0].set(start),
        flown_length=zero,
        duration=zero,
        planning_iterations=none,
        failed_plans=none,
        clearance=clearance,
        margin=jnp.full(config.plans, nothing),
        certified=none,
    )
    gust = physics.gust(config.gusts, jnp.zeros(3), jax.random.normal(jax.random.fold_in(world.key, 4), (3,)), 1e3)
    return Flight(
        vehicle=vehicle,
        memory=control.init(vehicle),
        gust=gust,
        scan=Scan(jnp.full((rays, 3), nothing), jnp.full(rays, jnp.inf), jnp.zeros(rays, bool)),
        hits=none,
        window=mapping.empty(start, config.shape, config.spacing),
        path=path,
        waiting=path,
        waits=jnp.array(False),
        reference=profile(sample(path, config.limits), jnp.zeros(config.limits.samples), zero, config.limits),
        since=zero,
        yaw=zero,
        looks=none,
        stepping=none,
        failures=none,
        done=status != Status.OK,
        log=log,
    )


def _believed(world: World, flight: Flight) -> Float[Array, "3"]:
    """Where the vehicle thinks it is [m]."""
    return flight.vehicle.position + pose_error(world.disturbances, world.key, flight.log.duration)


def _local(flight: Flight, config: FlightConfig, x: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """World coordinates in the frame of `config.grid`, whose origin is the window's middle voxel."""
    return x - config.spacing * (flight.window.corner + jnp.asarray(config.shape) // 2)


def _world(flight: Flight, config: FlightConfig, x: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    return x + config.spacing * (flight.window.corner + jnp.asarray(config.shape) // 2)


def sense(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """One scan from the true pose, its points placed where the vehicle believes them."""
    draw, noise = jax.random.split(jax.random.fold_in(world.key, 1000 + flight.log.planning_iterations))
    at = flight.vehicle.position
    seen = scan(world.geoms, config.lidar, at, flight.vehicle.rotation, draw)
    seen = corrupt(seen, world.disturbances, config.lidar, at, world.key, noise, flight.log.duration)
    seen = dataclasses.replace(seen, points=seen.points + (_believed(world, flight) - at))
    return dataclasses.replace(flight, scan=seen, hits=flight.hits + jnp.sum(seen.hit, dtype=jnp.int32))


def fuse(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """The scan into the map, which moves along."""
    at = _believed(world, flight)
    window = mapping.recentre(flight.window, at)
    window = mapping.fuse(window, flight.scan, config.lidar, at, flight.vehicle.rotation, config.snapshot)
    return dataclasses.replace(flight, window=window)


def plan(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """A verified path and the reference along it; without one the vehicle brakes, then looks from elsewhere."""
    at, gap = _believed(world, flight), _gap(flight, config)
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
    grid, ground = config.grid, mapping.ground(flight.window)
    # Where the vehicle is, nothing else can be, whatever a false return says.
    here = ~cell(config.shape, grid.index_of(_local(flight, config, start)))
    ends = _local(flight, config, start), _local(flight, config, world.goal)
    occupied = mapping.occupied(flight.window) | ground
    problem = pose(occupied & here, ground & here, *ends, config.margin, grid, config.least_margin)
    found, status, certified = config.find(problem, grid)
    path = _world(flight, config, grid.to_world(found))
    bits = computed_once(blocks(problem.blocked))
    # What is verified is the path as it will be flown, after its way through world coordinates.
    on_grid = grid.fractional_index(_local(flight, config, path))
    passed = jnp.all(jax.vmap(lambda a, b: clear(bits, a, b))(on_grid[:-1], on_grid[1:]))
    status = jnp.where((status == Status.OK) & ~passed, Status.PATH_IN_COLLISION, status)
    return path, status, certified, problem


def _gap(flight: Flight, config: FlightConfig) -> Float[Array, "nx ny nz"]:
    """Distance to the nearest obstacle but the ground, between centres of voxels, up to the margin's reach [m]."""
    obstacles = mapping.occupied(flight.window) & ~mapping.ground(flight.window)
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
    seen, occupied = mapping.seen(flight.window), mapping.occupied(flight.window) | mapping.ground(flight.window)
    here = grid.fractional_index(_local(flight, config, start))
    points = sample(path, limits).points
    voxels, known = _known(flight, points, at, config)
    unknown = jnp.where(jnp.all(known), 0, jnp.argmin(known)) + jnp.arange(_LOOKED_AT) * round(1.0 / limits.spacing)
    above = start + jnp.array([0.0, 0.0, _AHEAD])
    ahead = jnp.where(ok, points[min(round(_AHEAD / limits.spacing), limits.samples - 1)], above)
    ahead = grid.fractional_index(_local(flight, config, ahead))
    hidden = jnp.where(ok, voxels[jnp.minimum(unknown, len(voxels) - 1)], jnp.floor(ahead + 0.5).astype(jnp.int32))
    restless = _RESTLESS * flight.looks.astype(jnp.float32)
    key = jax.random.fold_in(world.key, 10_000 + flight.log.planning_iterations)
    fresh, exists = step_to(seen, occupied, problem.blocked, here, hidden, ahead, config.lidar, restless, key)
    before = grid.fractional_index(_local(flight, config, flight.waiting[-1]))
    goes_on = (flight.stepping > 0) & still_open(seen, problem.blocked, here, before)
    goes_on &= config.spacing * jnp.linalg.norm(before - here) > _STEPPED
    end = _world(flight, config, grid.to_world(jnp.where(goes_on, before, fresh)))
    rows = jnp.arange(path.shape[0])[:, None]
    return exists, goes_on, jnp.where(rows > 0, end, start)


def _known(
    flight: Flight, points: Float[Array, "n 3"], at: Float[Array, "3"], config: FlightConfig
) -> tuple[Int32[Array, "n 3"], Bool[Array, " n"]]:
    """The voxels that points lie in, and whether they were seen free; the vehicle's own is known without looking."""
    voxels = config.grid.index_of(_local(flight, config, points))
    i, j, k = jnp.clip(voxels, 0, jnp.asarray(config.shape) - 1).T
    here = jnp.all(voxels == config.grid.index_of(_local(flight, config, at)), axis=1)
    return voxels, mapping.seen(flight.window)[i, j, k] | here


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
    i, j, k = jnp.clip(voxels, 0, jnp.asarray(config.shape) - 1).T
    caps = jnp.clip(_SPEED_NEAR + _SPEED_GAIN * (gap[i, j, k] - 2.0), 0.5 * _SPEED_NEAR, limits.speed)
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


def follow(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """One planning period of physics; a flight that is over stays as it is."""
    vehicle = config.vehicle
    steps = round(LOG_PERIOD / vehicle.timestep)
    wind = mean_wind(world.disturbances, world.key)
    strength = jnp.asarray(world.disturbances.wind) / GUSTS_AT
    noise = jax.random.normal(
        jax.random.fold_in(world.key, 100_000 + flight.log.planning_iterations), (config.notes, steps, 3)
    )

    def step(flight: Flight, noise: Float[Array, "3"]) -> tuple[Flight, None]:
        log, before = flight.log, flight.vehicle
        error = pose_error(world.disturbances, world.key, log.duration)
        setpoint = evaluate(flight.reference, flight.since, flight.yaw, config.controller.lead)
        believed = dataclasses.replace(before, position=before.position + error)
        if config.reactive > 0:
            extra = push(flight.scan.points, believed.position, setpoint.velocity, config.reactive)
            setpoint = dataclasses.replace(setpoint, acceleration=setpoint.acceleration + extra)
        memory, command = control.step(config.controller, vehicle, flight.memory, believed, setpoint)
        gust = physics.gust(config.gusts, flight.gust, noise, vehicle.timestep)
        after = physics.step(vehicle, before, command, wind + strength * gust)
        clearance = distance(world.geoms, after.position)
        finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in jax.tree.leaves(after)]))
        touches = clearance <= config.radius
        arrives = jnp.linalg.norm(world.goal - after.position) <= config.tolerance
        status = jnp.select([~finite, touches], [Status.NONFINITE_STATE, Status.IN_CONTACT], Status.OK)
        log = dataclasses.replace(
            log,
            status=jnp.where(log.status == Status.OK, status, log.status).astype(jnp.int32),
            flown_length=log.flown_length + jnp.linalg.norm(after.position - before.position),
            duration=log.duration + vehicle.timestep,
            clearance=jnp.minimum(log.clearance, clearance),
        )
        moved = dataclasses.replace(
            flight,
            vehicle=after,
            memory=memory,
            gust=gust,
            since=flight.since + vehicle.timestep,
            done=~finite | touches | arrives,
            log=log,
        )
        return _unless(flight.done, flight, moved), None

    def note(flight: Flight, inputs: tuple[Array, Array]) -> tuple[Flight, None]:
        row, noise = inputs
        was_over = flight.done
        flight, _ = lax.scan(step, flight, noise)
        position = jnp.where(was_over, jnp.nan, flight.vehicle.position)
        log = dataclasses.replace(flight.log, position=flight.log.position.at[row].set(position))
        return dataclasses.replace(flight, log=log), None

    rows = 1 + config.notes * (flight.log.planning_iterations - 1) + jnp.arange(config.notes)
    flight, _ = lax.scan(note, flight, (rows, noise))
    last = ~flight.done & (flight.log.planning_iterations >= config.plans)
    status = jnp.where(last, Status.OUT_OF_PLANS, flight.log.status).astype(jnp.int32)
    return dataclasses.replace(flight, done=flight.done | last, log=dataclasses.replace(flight.log, status=status))


def _unless(over: Bool[Array, ""], before: Flight, after: Flight) -> Flight:
    """`before` where the flight is over, leaf by leaf: what a step leaves alone costs nothing."""
    kept: Flight = jax.tree.map(lambda x, y: x if x is y else jnp.where(over, x, y), before, after)
    return kept
