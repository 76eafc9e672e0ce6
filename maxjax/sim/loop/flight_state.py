"""The data of a flight: its configuration, what it cannot change, what evolves, and its log; and what extends it.

    FlightConfig, World, Flight, FlightLog        Extension: hooks of a flight, with parts of their own in these

Frames: world, ENU, metres. The rolling map moves with the vehicle by whole voxels; `to_local` is the frame of
`FlightConfig.grid`, whose origin is the middle voxel of the rolling map.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32, Key, UInt32

from maxjax.core.grid import Grid, Index3
from maxjax.planning.planner import Planner
from maxjax.planning.problem.distances import Distances
from maxjax.sim.loop.parts import Parts, part_of, with_part
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.sensors.lidar import Lidar, Scan
from maxjax.sim.vehicle import controller as control
from maxjax.sim.vehicle import quadrotor as physics
from maxjax.sim.vehicle.disturbances import Disturbances, position_error
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.movers import Movers
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.online import Reference, Sampling, Setpoint

Path = Float[Array, "n 3"]
T = TypeVar("T")

# Positions are logged this often [s].
LOG_PERIOD = 0.1


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class FlightConfig:
    """How to fly; all of it static but the disturbances.

    Attributes:
        disturbances: strengths; may carry batch axes.
        planner: finds paths inside the compiled flight; one that is not batched is called back on the host.
        lidar, vehicle, controller, gusts: see there.
        limits: of the reference: speed, acceleration and deviation.
        sampling: of the reference.
        shape: of the rolling map, voxels.
        spacing: of its voxels [m].
        distances: that paths keep from obstacles.
        period: of planning [s].
        plans: planning iterations at most.
        tolerance: distance at which the goal counts as reached [m].
        radius: of the sphere around the vehicle that must not touch any solid [m].
        snapshot: plan on the latest scan alone, as the paper does, instead of the fused map.
        reactive: gain of the reactive layer [m/s²]; 0: none.
        exact: whether the vehicle is where its set-point is, as in protocols that judge commanded points.
        extensions: that all flights are built with, each of another class; see `Extension`.
        stages: of a planning iteration, pure functions (world, flight, config) ↦ flight. None:
            `sim.loop.flight.STAGES`.
    """

    disturbances: Disturbances = Disturbances()  # noqa: RUF009 (frozen)
    planner: Planner = dataclasses.field(metadata={"static": True}, kw_only=True)
    lidar: Lidar = dataclasses.field(default=Lidar(), metadata={"static": True})
    vehicle: physics.Vehicle = dataclasses.field(default=physics.Vehicle(), metadata={"static": True})
    controller: control.Controller = dataclasses.field(default=control.Controller(), metadata={"static": True})
    limits: FlightLimits = dataclasses.field(
        default=FlightLimits(speed=5.0, acceleration=3.0, deviation=0.3), metadata={"static": True}
    )
    sampling: Sampling = dataclasses.field(default=Sampling(), metadata={"static": True})
    gusts: physics.Gusts = dataclasses.field(default=physics.Gusts(), metadata={"static": True})
    shape: Index3 = dataclasses.field(default=(101, 101, 101), metadata={"static": True})
    spacing: float = dataclasses.field(default=2.0, metadata={"static": True})
    distances: Distances = dataclasses.field(default=Distances(), metadata={"static": True})
    period: float = dataclasses.field(default=1.0, metadata={"static": True})
    plans: int = dataclasses.field(default=100, metadata={"static": True})
    tolerance: float = dataclasses.field(default=2.0, metadata={"static": True})
    radius: float = dataclasses.field(default=0.5, metadata={"static": True})
    snapshot: bool = dataclasses.field(default=False, metadata={"static": True})
    reactive: float = dataclasses.field(default=0.0, metadata={"static": True})
    exact: bool = dataclasses.field(default=False, metadata={"static": True})
    extensions: tuple[Extension, ...] = dataclasses.field(default=(), metadata={"static": True})
    stages: tuple[Callable[[World, Flight, FlightConfig], Flight], ...] | None = dataclasses.field(
        default=None, metadata={"static": True}
    )

    @property
    def grid(self) -> Grid:
        """The rolling map's grid, its middle voxel at the origin."""
        x, y, z = (-(n // 2) * self.spacing for n in self.shape)
        return Grid(self.shape, self.spacing, (x, y, z))

    def has(self, kind: type) -> bool:
        """Whether there is an extension of a class."""
        return any(isinstance(one, kind) for one in self.extensions)

    def extension(self, kind: type[T]) -> T:
        """The extension of a class; raises a ValueError where there is none."""
        return part_of(self.extensions, kind)

    def with_extension(self, extension: Extension) -> FlightConfig:
        """The same with an extension in place of that of its class, or after all others."""
        return dataclasses.replace(self, extensions=with_part(self.extensions, extension))

    @property
    def log_samples(self) -> int:
        """Positions logged in a planning period."""
        return round(self.period / LOG_PERIOD)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class FlightLog(Parts):
    """The result of a flight; batch axes lead.

    Attributes:
        status: OK where the goal was reached without contact; IN_CONTACT, OUT_OF_PLANS, or why planning failed.
        position: every 0.1 s [m], the start first; NaN after the end of the flight.
        flown_length: [m].
        duration: [s].
        planning_iterations: number of plans computed.
        failed_plans: those without a path, at which the vehicle brakes and holds.
        clearance: least distance from the centre of the vehicle to any solid [m].
        margin: of each plan [m]; NaN where there was none.
        certified: number of paths that climb a certified field.
        parts: what extensions record, an object of another class each.
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
    """The constants of a flight; batch axes lead.

    Attributes:
        geoms: solids at rest.
        start, goal: [m].
        key: of all random numbers.
        disturbances: their strengths.
        movers: solids that move, looked for or not; None: there are none.
        extensions: with data that each flight has of its own; see `Extension`.
    """

    geoms: Geoms
    start: Float[Array, "*batch 3"]
    goal: Float[Array, "*batch 3"]
    key: Key[Array, "*batch"] | UInt32[Array, "*batch 2"]
    disturbances: Disturbances
    movers: Movers | None = None
    extensions: tuple[Extension, ...] = ()


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Flight(Parts):
    """The state of a flight; batch axes lead.

    Attributes:
        vehicle: its true state.
        observer: the controller's disturbance observer.
        gust: air velocity in addition to the mean wind [m/s].
        scan: the latest; its points at the estimated position.
        returns: number of returns in all scans so far.
        rolling_map: what the scans have shown around the vehicle.
        path: the verified path that is flown [m].
        pending_path: the latest path [m]; with latency it is flown one period later.
        pending_valid: whether `pending_path` was verified; if not, the vehicle brakes along its present reference.
        reference: along `path`.
        reference_time: time since the start of the reference [s].
        yaw: heading setpoint [rad].
        viewpoints: number of viewpoints that the vehicle has set out for.
        viewpoint_periods: planning periods left for the present one; 0: none.
        failures: consecutive plans without a path.
        done: whether the flight is over.
        log: so far.
        parts: what extensions remember, an object of another class each.
    """

    vehicle: physics.State
    observer: control.Observer
    gust: Float[Array, "*batch 3"]
    scan: Scan
    returns: Int32[Array, "*batch"]
    rolling_map: mapping.RollingMap
    path: Float[Array, "*batch n 3"]
    pending_path: Float[Array, "*batch n 3"]
    pending_valid: Bool[Array, "*batch"]
    reference: Reference
    reference_time: Float[Array, "*batch"]
    yaw: Float[Array, "*batch"]
    viewpoints: Int32[Array, "*batch"]
    viewpoint_periods: Int32[Array, "*batch"]
    failures: Int32[Array, "*batch"]
    done: Bool[Array, "*batch"]
    log: FlightLog


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Answer:
    """The planner's answer.

    Attributes:
        status: of planning and verification; TIMEOUT: it says nothing, and the vehicle flies on while that is safe.
        late: whether the path is flown a period later.
        start: from where the path leads [m].
    """

    status: Int32[Array, ""]
    late: Bool[Array, ""]
    start: Float[Array, "3"]


class Extension:
    """An extension of a flight, for subclasses: hooks inside its stages, which here change nothing.

    Hooks are pure. Each is given the world, the flight and the configuration; most are given a value, too, and return
    it as it is with the extension. Extensions follow one another in their order. State and records are objects of the
    extension's own classes, which `take_off` adds to the parts of the flight or of its log (`with_part`).

    An extension without arrays is static (`jax.tree_util.register_static`) and stands in `FlightConfig.extensions`. One
    that has other arrays in each flight is a pytree (`jax.tree_util.register_dataclass`) in `World.extensions`.
    """

    @property
    def looks(self) -> bool:
        """Whether a scan is to be taken ten times a second, for `look`, in place of one in a planning period."""
        return False

    def take_off(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        """The flight at the start, with the parts of the extension."""
        return flight

    def look(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        """The flight after each scan, which is in `flight.scan`; only for an extension that `looks`."""
        return flight

    def steer(self, world: World, flight: Flight, config: FlightConfig, number: Int32[Array, ""]) -> Flight:
        """The flight before a tenth of a second, by its number in the planning period."""
        return flight

    def advance(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        """The flight with the extension's own parts a time step later, after the set-point was taken."""
        return flight

    def estimate(
        self, world: World, flight: Flight, config: FlightConfig, position: Float[Array, "3"]
    ) -> Float[Array, "3"]:
        """Where the vehicle takes itself to be [m]."""
        return position

    def scan_origin(
        self, world: World, flight: Flight, config: FlightConfig, position: Float[Array, "3"]
    ) -> Float[Array, "3"]:
        """Where the scan that arrives now was taken [m]."""
        return position

    def deliver_scan(self, world: World, flight: Flight, config: FlightConfig, number: Int32[Array, ""]) -> Flight:
        """The flight with what arrives of the scan in `flight.scan`, by its number."""
        return flight

    def still_scan(self, world: World, flight: Flight, config: FlightConfig, scan: Scan) -> Scan:
        """The scan as the map learns of it: `hit` only where something stands still."""
        return scan

    def answer(self, world: World, flight: Flight, config: FlightConfig, answer: Answer) -> Answer:
        """The planner's answer."""
        return answer

    def setpoint(self, world: World, flight: Flight, config: FlightConfig, setpoint: Setpoint) -> Setpoint:
        """The set-point that is flown to."""
        return setpoint

    def wind(self, world: World, flight: Flight, config: FlightConfig, wind: Float[Array, "3"]) -> Float[Array, "3"]:
        """The wind, gusts included [m/s]."""
        return wind

    def thrusts(
        self, world: World, flight: Flight, config: FlightConfig, command: Float[Array, "4"]
    ) -> tuple[Flight, Float[Array, "4"]]:
        """The flight, and the thrusts that reach the motors [N]."""
        return flight, command

    def clock(self, world: World, flight: Flight, config: FlightConfig, time: Float[Array, ""]) -> Float[Array, ""]:
        """Time on the reference a time step later [s]."""
        return time


def extensions_of(world: World, config: FlightConfig) -> tuple[Extension, ...]:
    """All extensions of a flight in their order: the configuration's, then the world's.

    Raises:
        ValueError: for two of one class.
    """
    found = (*config.extensions, *world.extensions)
    names = [type(one).__name__ for one in found]
    if len(set(map(type, found))) < len(found):
        raise ValueError(f"extensions: expected at most one of a class, given {', '.join(names)}")
    return found


def estimated_position(world: World, flight: Flight, config: FlightConfig) -> Float[Array, "3"]:
    """Position of the vehicle with its estimation error [m]."""
    position = flight.vehicle.position + position_error(world.disturbances, world.key, flight.log.duration)
    for extension in extensions_of(world, config):
        position = extension.estimate(world, flight, config, position)
    return position


def to_local(flight: Flight, config: FlightConfig, x: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """World coordinates in the frame of `config.grid`, whose origin is the middle voxel of the rolling map."""
    return x - config.spacing * (flight.rolling_map.corner + jnp.asarray(config.shape) // 2)
