"""A lookout on board: from one scan of a vehicle's own sensor to tracks, flags, and the motion to fly.

    scan → tracks                                  at the end of the scan, t
    motion flown, what is around → motion          from t + delay on; until then the present one goes on

The pure part of `maxjax.Replanner` among movers, as one program of fixed shapes. Maps are fused and ways are planned
once a second; motions are chosen from each scan. Frame: that of the map.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Float32, Int32

from maxjax.compile.lowering import matmul
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.movers.among import flags_of_look
from maxjax.sim.movers.choice import Around, Commitment, Keeping, choose_motion
from maxjax.sim.movers.known_surroundings import Box, Knowledge, obstacles_around, way_around
from maxjax.sim.movers.lidar_perception import sightings_of
from maxjax.sim.movers.local_value import Crowding
from maxjax.sim.movers.motions import MotionPrimitive, MotionSet, at, duration, later, motion_to
from maxjax.sim.movers.perception import PerceptionState, process_scan
from maxjax.sim.movers.reachable_sets import Bounds, Tracks, propagate, reachable
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.sensors.lidar import Scan, directions
from maxjax.sim.sensors.own_returns import Airframe

# Times of the horizon at which a way is compared with movers.
_TIMES = 12

# A map, its occupied voxels, and those that no way may lead through.
MapAndVoxels = tuple[mapping.RollingMap, Bool[Array, "nx ny nz"], Bool[Array, "nx ny nz"]]


ON_BOARD = TrackingSettings(slots=16, detections=24, points=1024)
"""Room for ten movers and a few more, for two cores."""


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class MoverSettings:
    """How a vehicle looks for movers and keeps away from them; static.

    Attributes:
        sight: its sensor, the bounds that movers are assumed to keep, and how they are followed. `floor` counts from
            the ground.
        choice: motions that are tried.
        keeping: distances that motions keep.
        crowd: what nearness costs on the way.
        airframe: what the sensor sees of the vehicle.
        drift: distance of the vehicle from its motion that is allowed for [m]; a part of `keeping.radius`.
        delay: from the end of a scan until the motion that is chosen from it is flown [s].
        period: between scans that the map is told of, and between plans [s].
        forgets: evidence, 1 to 6, that a voxel of the map loses by each of these that sees it free; a return adds 2.
        ground: height of the ground, below which no way leads [m]; None: there is none.
        within: least and greatest coordinates of the air that may be flown in [m]; None: any.

    Raises:
        ValueError: for a number that is not positive and finite (`delay`: below 0), or a drift that is not less than
            the radius.
    """

    sight: TrackingSettings = ON_BOARD
    choice: MotionSet = MotionSet()  # noqa: RUF009 (frozen)
    keeping: Keeping = Keeping()  # noqa: RUF009 (frozen)
    crowd: Crowding = Crowding()  # noqa: RUF009 (frozen)
    airframe: Airframe = Airframe()  # noqa: RUF009 (frozen)
    drift: float = 0.4
    delay: float = 0.1
    period: float = 1.0
    forgets: int = 3
    ground: float | None = 0.0
    within: Box | None = None

    def __post_init__(self) -> None:
        for name, least in (("drift", math.ulp(0.0)), ("delay", 0.0), ("period", math.ulp(0.0))):
            value = getattr(self, name)
            if not least <= value < math.inf:
                expected = "at least 0" if name == "delay" else "above 0"
                raise ValueError(f"MoverSettings.{name}: expected a finite number, {expected}, given {value!r}")
        if not self.drift < self.keeping.radius:
            raise ValueError(
                f"MoverSettings.drift: expected less than the radius of {self.keeping.radius} m that motions keep, "
                f"given {self.drift}"
            )
        if self.ground is not None and not math.isfinite(self.ground):
            raise ValueError(f"MoverSettings.ground: expected a height [m] or None, given {self.ground!r}")

    @property
    def bounds(self) -> Bounds:
        """Bounds that movers are assumed to keep."""
        return self.sight.bounds


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Own:
    """The vehicle at the end of a scan.

    Attributes:
        position, rotation: of the sensor: world frame [m], and sensor frame → world frame. NaN: unknown.
        place, velocity: of the vehicle [m], [m/s].
        time: [s].
    """

    position: Float[Array, "3"]
    rotation: Float[Array, "3 3"]
    place: Float[Array, "3"]
    velocity: Float[Array, "3"]
    time: Float[Array, ""]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Flown:
    """The motions that are flown at the end of a scan.

    Attributes:
        now: the motion at that time.
        since: time since its start [s].
        last: the motion committed last, which may begin later, and for how long from its start it was verified [s].
        until: from its start until the next one begins [s].
    """

    now: MotionPrimitive
    since: Float[Array, ""]
    last: Commitment
    until: Float[Array, ""]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Watched:
    """What a scan has led to.

    Attributes:
        distance: along each ray [m]; infinity: nothing, 0: the vehicle itself.
        still: rays that returned, but not from movers.
        tracks: of all that is followed, at the end of the scan.
        kept: which of them motions keep away from: confirmed movers, at rest as well.
        least, greatest: coordinates of boxes that hold them then [m].
        flown: the motion from now + delay on, and for how long it is verified.
        lasts: until it rests [s].
        up: flags, by `sim.movers.among.Flag`.
    """

    distance: Float32[Array, " r"]
    still: Bool[Array, " r"]
    tracks: Tracks
    kept: Bool[Array, " s"]
    least: Float[Array, "s 3"]
    greatest: Float[Array, "s 3"]
    flown: Commitment
    lasts: Float[Array, ""]
    up: Bool[Array, " f"]


def watch_movers(
    seeing: PerceptionState,
    distance: Float32[Array, " r"],
    own: Own,
    flown: Flown,
    known: Knowledge,
    *,
    rules: MoverSettings,
) -> tuple[PerceptionState, Watched]:
    """Look for movers in a scan, and choose the motion that is flown next.

    Args:
        seeing: after the scan before.
        distance: along each ray [m]; infinity: nothing, 0: the vehicle itself.
        own: the vehicle.
        flown: what it flies.
        known: what stands still, and the way; its returns are not used.
        rules: static.
    """
    scan = as_scan(distance)
    seeing = process_scan(seeing, scan, own.position, own.rotation, own.time, rules.sight)
    seen = sightings_of(seeing)
    still = scan.hit & ~seen.returns & jnp.all(jnp.isfinite(own.position))
    points = own.position + distance[:, None] * matmul(directions(rules.sight.lidar), own.rotation.T)
    returns = jnp.where(still[:, None], points, jnp.inf)
    known = dataclasses.replace(known, returns=returns)

    expected = at(flown.now, flown.since)[0]
    drifted = jnp.linalg.norm(expected - own.place) > rules.drift
    left = later(flown.last.motion, flown.until)
    # Far from its motion the vehicle begins another one from where it will be.
    here = come_to_rest(own.place + rules.delay * own.velocity, own.velocity, rules=rules)
    left = jax.tree.map(lambda x, y: jnp.where(drifted, x, y), here, left)
    verified = jnp.where(drifted, 0.0, flown.last.verified - flown.until)
    tracks = propagate(seen.tracks, rules.delay, rules.bounds)
    hard, appeared = obstacles_around(known, left.place, rules)
    around = Around(tracks, hard, way_around(known, left.place, tracks, rules), rules.within)
    chosen, holds = choose_motion(around, Commitment(left, verified), rules.choice, rules.bounds, rules.keeping)
    up = flags_of_look(seen.flags, drifted, ~holds, appeared)
    followed = dataclasses.replace(seeing.tracks, rests=seeing.rests)
    least, greatest = reachable(followed, jnp.zeros(1), rules.bounds)
    lasts, kept = duration(chosen.motion), seen.tracks.used
    return seeing, Watched(distance, still, followed, kept, least[0], greatest[0], chosen, lasts, up)


def come_to_rest(place: Float[Array, "3"], velocity: Float[Array, "3"], *, rules: MoverSettings) -> MotionPrimitive:
    """The motion from a state [m], [m/s] towards rest."""
    zero = jnp.zeros(3)
    return motion_to((place, velocity, zero), zero, jnp.float32(0.0), rules.choice)


def as_scan(distance: Float32[Array, " r"]) -> Scan:
    """A scan of distances alone; 0 is no return."""
    hit = (distance > 0.0) & (distance < jnp.inf)
    return Scan(jnp.full((*distance.shape, 3), jnp.nan), distance, hit)


def learn_scan(
    rolling_map: mapping.RollingMap,
    surveyed: Bool[Array, "nx ny nz"],
    watched: Watched,
    own: Own,
    *,
    rules: MoverSettings,
) -> MapAndVoxels:
    """The map with the scan of a look, whose returns of movers only end their beams."""
    scan = dataclasses.replace(as_scan(watched.distance), hit=watched.still)
    learned = mapping.fuse_scan(rolling_map, scan, rules.sight.lidar, own.position, own.rotation)
    return _with_voxels(learned, surveyed)


def move_map(
    rolling_map: mapping.RollingMap, surveyed: Bool[Array, "nx ny nz"], corner: Int32[Array, "3"]
) -> MapAndVoxels:
    """The map moved by whole voxels, so that `corner` is its lowest voxel."""
    middle = corner + jnp.asarray(rolling_map.cells.shape, jnp.int32) // 2
    moved = mapping.recentre(rolling_map, rolling_map.spacing * middle.astype(jnp.float32))
    return _with_voxels(moved, surveyed)


def _with_voxels(rolling_map: mapping.RollingMap, surveyed: Bool[Array, "nx ny nz"]) -> MapAndVoxels:
    occupied = mapping.occupied_voxels(rolling_map)
    return rolling_map, occupied, occupied | surveyed


def clear_of_movers(
    way: Float[Array, "m 3"], along: Float[Array, " m"], tracks: Tracks, *, rules: MoverSettings
) -> Float[Array, ""]:
    """How far along a way nothing that may hold a mover is too near whenever the vehicle can be there [m].

    At a point of the way the vehicle is at the soonest when it comes at full speed, and may stay until the horizon. So
    the way is clear at whatever speed it is flown, up to the horizon; infinity where all is clear that can be reached.

    Args:
        way: its points [m].
        along: length of the way up to each [m].
        tracks: at the time at which the vehicle is at its start.
        rules: static.
    """
    horizon, speed = rules.choice.horizon, rules.choice.speed
    times = jnp.linspace(0.0, horizon, _TIMES)
    least, greatest = reachable(tracks, times, rules.bounds)
    # Boxes of a step: those of both of its ends.
    least, greatest = jnp.minimum(least[:-1], least[1:]), jnp.maximum(greatest[:-1], greatest[1:])
    outside = jnp.maximum(jnp.maximum(least - way[:, None, None], way[:, None, None] - greatest), 0.0)
    nobody = jnp.any(jnp.isnan(least) | jnp.isnan(greatest), axis=-1)
    apart = jnp.where(nobody, jnp.inf, jnp.linalg.norm(jnp.where(nobody[..., None], 0.0, outside), axis=-1))
    # Each point stands for the way around it, up to half the distance between two of them.
    half = 0.5 * jnp.max(jnp.diff(along), initial=0.0)
    may_be_there = ((along - half) / speed)[:, None] <= times[1:]
    least_gap = jnp.min(jnp.where(may_be_there[..., None], apart, jnp.inf), axis=(1, 2), initial=jnp.inf)
    nearer = least_gap < rules.keeping.radius + half
    return jnp.maximum(jnp.min(jnp.where(nearer, along, jnp.inf)) - half, 0.0)
