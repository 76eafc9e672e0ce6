"""The avoidance of movers: look for them, and choose the motion to fly from the cost-to-go around the vehicle.

The static plan, made once a second, says where the way leads; ten times a second the motion is chosen anew
(`sim.movers.choice`) from where the present one is by now. Frame: world.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from maxjax.sim.loop.flight_state import LOG_PERIOD, Extension, Flight, FlightConfig, World, estimated_position
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.movers.among import (
    AHEAD,
    Among,
    Flag,
    Flags,
    LookRecord,
    Perception,
    Sightings,
    flags_of_look,
    no_flags,
    no_sightings,
    raise_flags,
)
from maxjax.sim.movers.choice import Around, Chooser, Commitment, Keeping, choose_motion
from maxjax.sim.movers.hard_set import HardSet
from maxjax.sim.movers.known_surroundings import Knowledge, obstacles_around, way_around
from maxjax.sim.movers.local_value import Crowding, LocalValue
from maxjax.sim.movers.motions import MotionSet, at, later, motion_to, rest_at
from maxjax.sim.movers.reachable_sets import Bounds, Tracks, reachable
from maxjax.sim.sensors.lidar import Scan
from maxjax.trajectories.online import Setpoint, profile, straight_course

# Evidence that a map among movers loses by a scan that sees a voxel free: two scans clear what is gone.
_FORGETS = 3


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Avoidance(Extension):
    """How to fly among movers; static, an extension. A flight has the part `Among`, its log the part `Flags`.

    Attributes:
        perception: who finds them, ten times a second; None: nobody looks for any.
        bounds: that they are assumed to keep.
        choice: motions that are tried.
        keeping: distances that motions keep.
        crowd: what nearness costs on the way.
        drift: distance of the vehicle from its motion that is allowed for [m]; a part of `keeping.radius`.
        within: least and greatest coordinates of the air that may be flown in [m]; None: any.
        chooser: of motions; another one may take its place, as rivals do.
    """

    perception: Perception | None
    bounds: Bounds = Bounds()  # noqa: RUF009 (frozen)
    choice: MotionSet = MotionSet()  # noqa: RUF009 (frozen)
    keeping: Keeping = Keeping()  # noqa: RUF009 (frozen)
    crowd: Crowding = Crowding()  # noqa: RUF009 (frozen)
    drift: float = 0.4
    within: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    chooser: Chooser = choose_motion

    @property
    def looks(self) -> bool:
        """Whether there is a perception."""
        return self.perception is not None

    def take_off(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        """Hovering, with nothing seen, and a map that soon forgets what moved on."""
        rays = config.lidar.rays
        seen = no_sightings(rays) if self.perception is None else self.perception.start(world, flight, config)
        rests = _hover_at(flight.vehicle.position, self)
        one = self.record(seen, rests, jnp.zeros(len(Flag), bool))
        record = jax.tree.map(lambda x: jnp.broadcast_to(x, (config.log_samples, *x.shape)), one)
        rolling_map = dataclasses.replace(flight.rolling_map, loss=_FORGETS)
        flight = dataclasses.replace(flight, rolling_map=rolling_map, log=flight.log.with_part(no_flags()))
        return flight.with_part(Among(seen, rests, jnp.float32(0.0), record))

    def look(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        """With what the scan shows of movers."""
        among = flight.part(Among)
        seen = among.seen if self.perception is None else self.perception.look(world, flight, config)
        return flight.with_part(dataclasses.replace(among, seen=seen))

    def still_scan(self, world: World, flight: Flight, config: FlightConfig, scan: Scan) -> Scan:
        """The scan but for returns of movers."""
        return dataclasses.replace(scan, hit=scan.hit & ~flight.part(Among).seen.returns)

    def steer(self, world: World, flight: Flight, config: FlightConfig, number: Int32[Array, ""]) -> Flight:
        """With the motion to fly, and the flags that are up with it."""
        among, up = steer_vehicle(world, flight, config)
        return self.log_choice(flight.with_part(among), among.flown, up, number)

    def setpoint(self, world: World, flight: Flight, config: FlightConfig, setpoint: Setpoint) -> Setpoint:
        """Of the motion that is flown."""
        among, lead = flight.part(Among), config.controller.lead
        place, velocity, acceleration = at(among.flown.motion, among.since)
        if lead:
            acceleration = at(among.flown.motion, among.since + lead)[2]
        return Setpoint(place, velocity, acceleration, jnp.zeros((), place.dtype))

    def advance(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        """A time step further along the motion."""
        among = flight.part(Among)
        return flight.with_part(dataclasses.replace(among, since=among.since + config.vehicle.timestep))

    def record(self, seen: Sightings, flown: Commitment, up: Bool[Array, " f"]) -> LookRecord:
        """The record of one look."""
        boxes = reachable(seen.tracks, self.choice.horizon * jnp.asarray(AHEAD), self.bounds)
        return LookRecord(*boxes, flown, up)

    def log_choice(self, flight: Flight, flown: Commitment, up: Bool[Array, " f"], number: Int32[Array, ""]) -> Flight:
        """The flight with the record of a look, by its number in the planning period, and the flags that are up."""
        among, log = flight.part(Among), flight.log
        record = self.record(among.seen, flown, up)
        every = jax.tree.map(lambda every, x: every.at[number].set(x), among.record, record)
        flags = raise_flags(log.part(Flags), up, log.duration, LOG_PERIOD)
        flight = dataclasses.replace(flight, log=log.with_part(flags))
        return flight.with_part(dataclasses.replace(among, record=every))


def _hover_at(position: Float[Array, "3"], how: Avoidance) -> Commitment:
    """To stay where one is."""
    return Commitment(rest_at(position), jnp.float32(0.0))


def steer_vehicle(world: World, flight: Flight, config: FlightConfig) -> tuple[Among, Array]:
    """The motion from now on, and the flags that are up with it."""
    how, among = config.extension(Avoidance), flight.part(Among)
    left = later(among.flown.motion, among.since)
    # Where it believes to be: map, sets and motions are in that frame.
    position = estimated_position(world, flight, config)
    drifted = jnp.linalg.norm(left.place - position) > how.drift
    # Far from its motion the vehicle begins another one from where it is.
    here = motion_to((position, flight.vehicle.velocity, left.pushes[0]), jnp.zeros(3), jnp.float32(0.0), how.choice)
    left = jax.tree.map(lambda x, y: jnp.where(drifted, x, y), here, left)
    hard, appeared = hard_around(flight, config, left.place)
    guide = guide_around(flight, config, left.place, among.seen.tracks)
    around = Around(among.seen.tracks, hard, guide, how.within)
    verified = jnp.where(drifted, 0.0, among.flown.verified - among.since)
    flown, holds = how.chooser(around, Commitment(left, verified), how.choice, how.bounds, how.keeping)
    up = flags_of_look(among.seen.flags, drifted, ~holds, appeared)
    return dataclasses.replace(among, flown=flown, since=jnp.float32(0.0)), up


def hard_around(flight: Flight, config: FlightConfig, place: Float[Array, "3"]) -> tuple[HardSet, Bool[Array, ""]]:
    """`sim.movers.known_surroundings.obstacles_around` of a flight."""
    return obstacles_around(knowledge_of(flight, config), place, config.extension(Avoidance))


def guide_around(flight: Flight, config: FlightConfig, place: Float[Array, "3"], tracks: Tracks) -> LocalValue:
    """`sim.movers.known_surroundings.way_around` of a flight."""
    return way_around(knowledge_of(flight, config), place, tracks, config.extension(Avoidance))


def knowledge_of(flight: Flight, config: FlightConfig) -> Knowledge:
    """What a flight knows of what stands still, and its way; where nobody looks each scan is fused at once."""
    rolling_map, course, returns = flight.rolling_map, flight.reference.course, None
    if config.extension(Avoidance).perception is not None:
        still = flight.scan.hit & ~flight.part(Among).seen.returns
        returns = jnp.where(still[:, None], flight.scan.points, jnp.inf)
    return Knowledge(
        rolling_map=rolling_map,
        blocked=mapping.occupied_voxels(rolling_map) | mapping.ground(rolling_map),
        returns=returns,
        way=course.points,
        left=course.arclength[-1] - course.arclength,
        spacing=config.sampling.spacing,
    )


def straight_way(world: World, flight: Flight, config: FlightConfig) -> Flight:
    """A stage in place of the plan, for worlds whose goal no map reaches: the way is the straight line to the goal."""
    start, log = flight.vehicle.position, flight.log
    path = start + jnp.linspace(0.0, 1.0, len(flight.path))[:, None] * (world.goal - start)
    course = straight_course(start, world.goal, config.sampling)
    reference = profile(course, jnp.full(len(course.arclength), config.limits.speed), jnp.float32(0.0), config.limits)
    number = log.planning_iterations + 1
    log = dataclasses.replace(log, planning_iterations=number)
    return dataclasses.replace(flight, path=path, reference=reference, reference_time=jnp.float32(0.0), log=log)
