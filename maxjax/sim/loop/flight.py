"""One flight in closed loop: sense → fuse → plan → follow, until goal, contact, or the last planning iteration.

    fly_closed_loop(scene, start, goal, key, config) -> FlightLog

A planning iteration is a tuple of pure stages, each (world, flight, config) ↦ flight (`FlightConfig.stages`):

1. `sense` (`sim.loop.sensing`): a scan from the true position, degraded by the disturbances.
2. `fuse` (`sim.loop.sensing`): the scan into the rolling map, at the estimated position.
3. `plan` (`sim.loop.replan`): a path from the estimated position to the goal, verified on the present map, and a
   reference along it that ends before the first voxel that was not seen free. Without a path the vehicle brakes and
   moves to another viewpoint.
4. `follow` (`sim.loop.follow`): one planning period of physics along the reference.

A flight may be built with extensions (`sim.loop.flight_state.Extension`): objects with hooks inside these stages and
state of their own.

Coordinates are float32, which resolves 1 mm up to 16 km from the origin: cities are centred before they are flown in.

Frames: world, ENU, metres.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray

from maxjax.compile.batching import settle, settle_batch
from maxjax.compile.executable import Stored
from maxjax.compile.threads import concurrently
from maxjax.core.rng_streams import ITERATIONS, Stream, stream
from maxjax.core.status import Status
from maxjax.planning.path.ascent import Ascent
from maxjax.sim.loop.flight_state import Extension, Flight, FlightConfig, FlightLog, World, extensions_of
from maxjax.sim.loop.follow import clearance_of, follow
from maxjax.sim.loop.replan import plan
from maxjax.sim.loop.sensing import fuse, look, sense
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.sensors.lidar import Scan
from maxjax.sim.vehicle import controller as control
from maxjax.sim.vehicle import quadrotor as physics
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.movers import Movers
from maxjax.sim.worlds.scenes import Scene
from maxjax.sim.worlds.solid_distance import distance
from maxjax.trajectories.online import profile, straight_course

__all__ = [
    "AT_ONCE",
    "STAGES",
    "Extension",
    "Flight",
    "FlightConfig",
    "FlightLog",
    "Stage",
    "World",
    "fly_all_closed_loop",
    "fly_closed_loop",
    "stages_of",
    "take_off",
    "watch",
]

# Flights of a batch that take an iteration at a time: of one that arrives, another takes the place.
AT_ONCE = 512

# A stage of a planning iteration: pure, of arrays; the configuration is static but for its disturbances.
Stage = Callable[[World, Flight, FlightConfig], Flight]


def fly_closed_loop(
    scene: Scene | Geoms,
    start: Float[Array, "3"],
    goal: Float[Array, "3"],
    key: PRNGKeyArray,
    config: FlightConfig,
    movers: Movers | None = None,
) -> FlightLog:
    """Fly once; pure, for `jit` and `vmap` over geoms, ends, keys, disturbances and movers.

    Args:
        scene: the city.
        start, goal: world frame [m].
        key: of all random numbers of the flight.
        config: how to fly.
        movers: in the city besides; the vehicle looks for them if an extension of `config` does.

    Returns:
        The log. Its status is OK only if the vehicle came within `config.tolerance` of the goal and no solid within
        `config.radius` of its centre. START_OCCUPIED, GOAL_OCCUPIED: an end is in contact; GOAL_OUTSIDE_MAP: the goal
        is further away than the rolling map reaches; START_EQUALS_GOAL: nearer than the tolerance; NONFINITE_INPUT.

    Raises:
        ValueError: for wrong shapes, or more plans than a random stream has indices.
    """
    geoms = scene.geoms if isinstance(scene, Scene) else scene
    if start.shape != (3,) or goal.shape != (3,):
        raise ValueError(
            f"fly_closed_loop: expected start and goal (3,), given {start.shape} and {goal.shape}; use vmap"
        )
    _check(config)
    world = World(geoms, start, goal, key, config.disturbances, movers)
    return settle(_flies, iteration_of(config), world, take_off(world, config), at_once=AT_ONCE).log


def fly_all_closed_loop(worlds: World, config: FlightConfig) -> FlightLog:
    """`fly_closed_loop` under `vmap`, of worlds whose arrays all have the batch's axis; in half the time traced.

    Raises:
        ValueError: for more plans than a random stream has indices.
    """
    _check(config)
    first = jax.vmap(functools.partial(take_off, config=config))(worlds)
    return settle_batch(_flies, iteration_of(config), worlds, first, at_once=AT_ONCE).log


def _check(config: FlightConfig) -> None:
    if not 1 <= config.plans <= ITERATIONS:
        raise ValueError(f"plans: expected 1 to {ITERATIONS}, given {config.plans}")


def _flies(_: World, flight: Flight) -> Bool[Array, ""]:
    return ~flight.done


def watch(world: World, config: FlightConfig) -> Iterator[Flight]:
    """`fly_closed_loop` with its loop on the host: the flight before its first planning iteration, and after each.

    Each stage is a program of its own, and all are compiled at a time. Up to rounding the flight is the same.
    """
    flight = _TAKE_OFF(world, config)
    yield flight
    if not flight.done:
        given = world, flight, config
        programs = list(map(program_of, stages_of(config)))
        for _ in concurrently(lambda stage: stage.executable(given, {}), programs, len(programs)):
            pass
    while not flight.done:
        for stage in programs:
            flight = stage(world, flight, config)
        yield flight


def iteration_of(config: FlightConfig) -> Callable[[World, Flight], Flight]:
    """One planning iteration: its stages one after the other."""
    stages = stages_of(config)

    def iterate(world: World, flight: Flight) -> Flight:
        for stage in stages:
            flight = stage(world, flight, config)
        return flight

    return iterate


def stages_of(config: FlightConfig) -> tuple[Stage, ...]:
    """The stages of one planning iteration, in order."""
    return STAGES if config.stages is None else config.stages


def take_off(world: World, config: FlightConfig) -> Flight:
    """The flight before its first iteration: hovering at the start, its map empty; already done for unusable ends."""
    start = jnp.where(jnp.all(jnp.isfinite(world.start)), world.start, 0.0)
    clearance = clearance_of(world, start, jnp.float32(0.0))
    status = _usable(world, clearance, config)
    vehicle = physics.hover(config.vehicle, start)
    path = jnp.broadcast_to(start, (Ascent().steps + 3, 3))  # exact ends, and the points of an ascent
    nan, zero = jnp.float32(jnp.nan), jnp.float32(0.0)
    none, rays = jnp.int32(0), config.lidar.rays
    log = FlightLog(
        status=status,
        position=jnp.full((config.plans * config.log_samples + 1, 3), nan).at[0].set(start),
        flown_length=zero,
        duration=zero,
        planning_iterations=none,
        failed_plans=none,
        clearance=clearance,
        margin=jnp.full(config.plans, nan),
        certified=none,
    )
    gust = physics.gust(config.gusts, jnp.zeros(3), jax.random.normal(stream(world.key, Stream.FIRST_GUST), (3,)), 1e3)
    course = straight_course(start, start, config.sampling)
    flight = Flight(
        vehicle=vehicle,
        observer=control.init(vehicle),
        gust=gust,
        scan=Scan(jnp.full((rays, 3), nan), jnp.full(rays, jnp.float32(jnp.inf)), jnp.zeros(rays, bool)),
        returns=none,
        rolling_map=mapping.empty(start, config.shape, config.spacing),
        path=path,
        pending_path=path,
        pending_valid=jnp.array(False),
        reference=profile(course, jnp.zeros_like(course.arclength), zero, config.limits),
        reference_time=zero,
        yaw=zero,
        viewpoints=none,
        viewpoint_periods=none,
        failures=none,
        done=status != Status.OK,
        log=log,
    )
    for extension in extensions_of(world, config):
        flight = extension.take_off(world, flight, config)
    return look(world, flight, config)


def _usable(world: World, clearance: Float[Array, ""], config: FlightConfig) -> Int32[Array, ""]:
    """OK, or what is wrong with the ends; `clearance` is the start's [m]."""
    finite = jnp.all(jnp.isfinite(world.start)) & jnp.all(jnp.isfinite(world.goal))
    start, goal = (jnp.where(finite, x, 0.0) for x in (world.start, world.goal))
    reach = config.spacing * (jnp.asarray(config.shape) // 2)
    found: Array = jnp.select(
        [
            ~finite,
            (plan in stages_of(config)) & jnp.any(jnp.abs(goal - start) > reach),
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
    )
    return found.astype(jnp.int32)


_TAKE_OFF = Stored("take-off", take_off)
STAGES: tuple[Stage, ...] = (sense, fuse, plan, follow)
"""The stages of a planning iteration; a user's own go into `FlightConfig.stages`, in place of some or between them."""


@functools.cache
def program_of(stage: Stage) -> Stored[..., Flight]:
    """A stage as a program of its own, which is compiled once."""
    return Stored(getattr(stage, "__name__", "stage"), stage)
