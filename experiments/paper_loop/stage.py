"""The planning stage of a flight as the paper describes it, and with what maxjax adds, one layer at a time.

    latest scan → obstacles, dilated → σ → φ → gradients, smoothed → ascent → reference along it

The paper (Bong and Beltrame, arXiv:2605.10880) plans in the latest scan alone, dilated by 4 voxels, lets the gradients
of a predicted field be smoothed by a Gaussian (σ = 5 voxels), climbs them by momentum, and flies along each path.
Nothing stands between a path and the vehicle but the reactive layer. What it leaves open is a `Reading`; where no such
dilation joins the ends, the largest that does is taken, as in `benchmarks.common.paper`; the ground is dilated by one
voxel.

Paths are planned in index coordinates of the rolling map.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32

from experiments.ablations.parts import Bare, bare, gaussian, smooth
from experiments.paper_loop.reading import Reading
from experiments.paper_loop.sources import potential_from
from maxjax.compile.batching import settle
from maxjax.core.status import Status
from maxjax.fields.conductivity import conductivity
from maxjax.fields.connectivity import first_joined
from maxjax.fields.gradient import gradient
from maxjax.fields.occupancy import squared_distance
from maxjax.fields.price import SCREENING_LENGTH, lattice_price
from maxjax.fields.stencil import cell
from maxjax.planning.path.ascent import Ascent, ascend
from maxjax.planning.path.line_of_sight import clear, sight_of
from maxjax.planning.path.string_pulling import tighten
from maxjax.planning.problem.surroundings import surroundings
from maxjax.sim.loop.flight_state import Flight, FlightConfig, Path, World, estimated_position, to_local
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.online import Reference, profile, sample, setpoint_at

# Dilation of obstacles, and of the ground, and of all where prices keep the rest of the distance [voxels].
_DILATION, _GROUND, _PRICED = 4, 1, 1
# Standard deviation of the smoothing [voxels].
_SMOOTHING = 5.0
# Steps of an ascent: 512 of momentum lead 51 voxels and more.
_STEPS = Ascent().steps
# Fields of a batch that are computed at once: a network's features fill the memory of a device.
_AT_ONCE = 32
# A plan that leads less far [m], at rest, makes no progress: after so many in a row the same is planned for ever.
_STUCK = 0.5
# Slower than this is at rest [m/s].
_REST = 0.1
# Period of planning [s] where it is not the segment that ends it, and time to settle at the end of a segment.
_PERIOD, _SETTLE = 1.0, 0.3


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Sought:
    """A path that is sought on a rolling map, or found.

    Attributes:
        over: whether there is nothing more to do.
        path: in index coordinates of the map; its last point is repeated.
        arrives: whether it reaches the goal.
        certified: whether it climbs a certified field.
    """

    over: Bool[Array, ""]
    path: Float[Array, "n 3"]
    arrives: Bool[Array, ""]
    certified: Bool[Array, ""]


@dataclasses.dataclass(frozen=True)
class Loop:
    """The planning stage of the paper's loop; (world, flight, config) ↦ flight.

    Attributes:
        reading: of the paper.
        guarded: whether the ascent is that of `planning.path.ascent`, which enters neither walls nor lower ground and
            has the discrete step. It sees walls and climbs log φ.
        verified: whether only a path that is clear all the way to the goal is flown; without one the vehicle brakes.
        taut: whether the path is pulled taut, for an ascent that is guarded.
        priced: whether prices keep the distance to walls that dilation keeps else, for a field that knows them.
    """

    reading: Reading = Reading()  # noqa: RUF009 (frozen)
    guarded: bool = False
    verified: bool = False
    taut: bool = False
    priced: bool = False

    def __call__(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        """A path on the present map, and the reference along it."""
        grid, rolling_map = config.grid, flight.rolling_map
        position = estimated_position(world, flight, config)
        ends = jnp.stack([grid.fractional_index(to_local(flight, config, end)) for end in (position, world.goal)])
        given = mapping.occupied_voxels(rolling_map), mapping.ground(rolling_map), ends
        no = jnp.array(False)
        nothing = Sought(flight.done, jnp.broadcast_to(ends[0], flight.path.shape), no, no)
        # Under `vmap` a part of the batch at a time; of flights that are over nothing is asked.
        found = settle(_waits, functools.partial(self.seek, config), given, nothing, at_once=_AT_ONCE)
        path = mapping.origin(rolling_map) + config.spacing * found.path
        reference = self.refer(flight, path, found.arrives | (not self.verified), config)
        leads = jnp.linalg.norm(setpoint_at(reference, jnp.float32(config.period)).position - position)
        rests = (leads < _STUCK) & (jnp.linalg.norm(flight.vehicle.velocity) < _REST)
        failures = jnp.where(rests, flight.failures + 1, 0)
        patience = self.reading.patience
        gives_up, log = jnp.array(False) if patience is None else failures >= patience, flight.log
        log = dataclasses.replace(
            log,
            status=jnp.where(gives_up, Status.PATH_STALLED, log.status).astype(jnp.int32),
            planning_iterations=log.planning_iterations + 1,
            failed_plans=log.failed_plans + ~found.arrives,
            certified=log.certified + (found.arrives & found.certified),
        )
        return dataclasses.replace(
            flight,
            path=path,
            reference=reference,
            reference_time=jnp.float32(0.0),
            failures=failures,
            done=flight.done | gives_up,
            log=log,
        )

    def seek(self, config: FlightConfig, given: tuple[Array, Array, Array], sought: Sought) -> Sought:
        """The path by which the field of a map is climbed from one end to the other."""
        occupied, ground, ends = given
        grid, reading, price = config.grid, self.reading, None
        voxels = jnp.floor(ends + 0.5).astype(jnp.int32)
        blocked, joined = dilated(occupied, ground, voxels, _PRICED if self.priced else _DILATION)
        if self.priced:
            price = surroundings(occupied | ground, ground, config.distances, grid.local).price
        leak = None if price is None else lattice_price(price, SCREENING_LENGTH)
        field = potential_from(reading.field)(conductivity(blocked, voxels[1], grid.local), voxels[1], leak)
        if self.guarded:
            guards = Ascent(smoothing=_SMOOTHING, steps=_STEPS)
            path, arrives = ascend(field.log_phi, sight_of(blocked), ~blocked, ends[0], ends[1], guards)
        else:
            slope = smoothed_gradients(field.log_phi, ~blocked, reading).astype(ends.dtype)
            way = passable(occupied | ground, blocked, voxels, reading)
            settings = Bare(steps=_STEPS, near=reading.straight / config.spacing)
            path, status = bare(slope, way, ends[0], ends[1], settings)
            path, arrives = before_walls(path, way), status == Status.OK
        if self.taut:
            path = tighten(sight_of(blocked), path, price)
        if self.verified:
            arrives &= jnp.all(clear(sight_of(blocked), path[:-1], path[1:]))
        path = jnp.where(joined, path, ends[0])
        path = jnp.pad(path, ((0, len(sought.path) - len(path)), (0, 0)), mode="edge")
        return Sought(jnp.array(True), path, joined & arrives, joined & field.certified)

    def refer(self, flight: Flight, path: Path, ok: Bool[Array, ""], config: FlightConfig) -> Reference:
        """Along a path, or its first segment, as fast as the limits allow; not `ok`: to a stop along it."""
        course = sample(path, config.limits, config.sampling)
        speed = jnp.maximum(jnp.dot(flight.vehicle.velocity, course.tangent[0]), 0.0)
        segment = math.inf if self.reading.segment is None else self.reading.segment
        caps = jnp.where(ok & (course.arclength < segment), config.limits.speed, 0.0)
        return profile(course, caps, speed, config.limits)


def period_of(segment: float | None, limits: FlightLimits) -> float:
    """How long each plan is flown [s]: a second, or until a segment ends at rest.

    Args:
        segment: length [m], begun at rest.
        limits: of speed and acceleration.
    """
    if segment is None:
        return _PERIOD
    fastest = min(limits.speed, math.sqrt(limits.acceleration * segment))
    return math.ceil(10 * (segment / fastest + fastest / limits.acceleration + _SETTLE)) / 10


def smoothed_gradients(
    log_phi: Float[Array, "nx ny nz"], free: Bool[Array, "nx ny nz"], reading: Reading
) -> Float[Array, "nx ny nz 3"]:
    """The gradients that an ascent without guards climbs [1/voxel].

    Args:
        log_phi: −inf where there is no current.
        free: voxels that are not dilated obstacles.
        reading: of the paper.
    """
    u = log_phi if reading.climbs == "log φ" else jnp.where(jnp.isfinite(log_phi), jnp.exp(log_phi), -jnp.inf)
    if reading.sees_walls:
        return gradient(smooth(u, free, _SMOOTHING, "walls"), free)
    if reading.walls == "least":
        return gradient(smooth(u, free, _SMOOTHING, "plain"), jnp.ones_like(free))
    return gaussian(gradient(u, free), _SMOOTHING)


def passable(
    occupied: Bool[Array, "nx ny nz"], blocked: Bool[Array, "nx ny nz"], ends: Int32[Array, "2 3"], reading: Reading
) -> Bool[Array, "nx ny nz"]:
    """Voxels through which a path may lead, by where the reading ends it; those of the two ends among them."""
    closed = {"dilated": blocked, "occupied": occupied, "nowhere": jnp.zeros_like(occupied)}[reading.ends]
    return ~closed | cell(occupied.shape, ends[0]) | cell(occupied.shape, ends[1])


def _waits(_: tuple[Array, Array, Array], sought: Sought) -> Bool[Array, ""]:
    return ~sought.over


def dilated(
    occupied: Bool[Array, "nx ny nz"],
    ground: Bool[Array, "nx ny nz"],
    ends: Int32[Array, "2 3"],
    most: int = _DILATION,
) -> tuple[Bool[Array, "nx ny nz"], Bool[Array, ""]]:
    """Voxels closed by the largest dilation that joins two voxels, and whether any does.

    The two voxels are open themselves: a vehicle is where it is.

    Args:
        occupied: occupied voxels, ground included.
        ground: those that are ground.
        ends: voxels of start and goal.
        most: the largest dilation that is tried [voxels]; static.
    """
    apart = squared_distance(occupied & ~ground, most)
    low = squared_distance(ground, _GROUND) <= _GROUND**2
    at_ends = cell(occupied.shape, ends[0]) | cell(occupied.shape, ends[1])

    def free(k: Int32[Array, ""]) -> Bool[Array, "nx ny nz"]:
        reach = most - k
        closed = occupied | (apart <= reach**2) | (low & (reach >= _GROUND))
        return ~closed | at_ends

    k, joined = first_joined(free, jnp.int32(0), most, ends[0], ends[1])
    return ~free(k), joined


def before_walls(path: Float[Array, "t 3"], free: Bool[Array, "nx ny nz"]) -> Float[Array, "t 3"]:
    """A path up to its last point before a closed voxel, which is repeated from there."""
    i, j, k = jnp.clip(jnp.floor(path + 0.5).astype(jnp.int32), 0, jnp.asarray(free.shape) - 1).T
    open_so_far = lax.cummin(free[i, j, k].astype(jnp.int32))
    last = jnp.maximum(jnp.sum(open_so_far) - 1, 0)
    return path[jnp.minimum(jnp.arange(len(path)), last)]
