"""The data of a flight: its configuration, what it cannot change, what evolves, and its log.

    FlightConfig, World, Flight, FlightLog

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
from maxjax.sim.faults.modes import Failing, Faults
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.movers.among import Among, Avoidance, Flags
from maxjax.sim.sensors.lidar import Lidar, Scan
from maxjax.sim.swarm.member import Member
from maxjax.sim.vehicle import controller as control
from maxjax.sim.vehicle import quadrotor as physics
from maxjax.sim.vehicle.disturbances import Disturbances, position_error
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.movers import Movers
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.online import Reference, Sampling

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
        moving: how to fly among movers, which are looked for ten times a second; None: none are expected.
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
    moving: Avoidance | None = dataclasses.field(default=None, metadata={"static": True})
    stages: tuple[Callable[[World, Flight, FlightConfig], Flight], ...] | None = dataclasses.field(
        default=None, metadata={"static": True}
    )

    @property
    def grid(self) -> Grid:
        """The rolling map's grid, its middle voxel at the origin."""
        x, y, z = (-(n // 2) * self.spacing for n in self.shape)
        return Grid(self.shape, self.spacing, (x, y, z))

    @property
    def avoidance(self) -> Avoidance:
        """How to fly among movers; raises a ValueError where none are expected."""
        return _present(self.moving, "moving")

    @property
    def log_samples(self) -> int:
        """Positions logged in a planning period."""
        return round(self.period / LOG_PERIOD)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class FlightLog:
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
        flags: assumptions about movers that failed, with their times; None where no movers are expected.
        unseen: times, ten a second, at which the vehicle was more than a voxel from any that was seen free, as
            `faults.account` counts them; None where nothing may fail.
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
    flags: Flags | None = None
    unseen: Int32[Array, "*batch"] | None = None

    @property
    def flags_among_movers(self) -> Flags:
        """`flags`; raises a ValueError where no movers were expected."""
        return _present(self.flags, "moving")

    @property
    def unseen_among_faults(self) -> Int32[Array, "*batch"]:
        """`unseen`; raises a ValueError where nothing may fail."""
        return _present(self.unseen, "faults")


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class World:
    """The constants of a flight: solids, ends [m], random key, disturbances, and movers and faults if there are any.

    Batch axes lead.
    """

    geoms: Geoms
    start: Float[Array, "*batch 3"]
    goal: Float[Array, "*batch 3"]
    key: Key[Array, "*batch"] | UInt32[Array, "*batch 2"]
    disturbances: Disturbances
    movers: Movers | None = None
    faults: Faults | None = None

    @property
    def failures(self) -> Faults:
        """`faults`; raises a ValueError where nothing may fail."""
        return _present(self.faults, "faults")


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Flight:
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
        among: what is known of movers, and the motion that is flown; None where none are expected.
        member: what is said to the other vehicles of a fleet, and how near they were; None for a vehicle by itself.
        failing: what is remembered of faults; None where nothing may fail.
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
    among: Among | None = None
    member: Member | None = None
    failing: Failing | None = None

    @property
    def tracked(self) -> Among:
        """`among`; raises a ValueError where no movers are expected."""
        return _present(self.among, "moving")

    @property
    def fault_memory(self) -> Failing:
        """`failing`; raises a ValueError where nothing may fail."""
        return _present(self.failing, "faults")

    @property
    def swarm_member(self) -> Member:
        """`member`; raises a ValueError for a vehicle by itself."""
        return _present(self.member, "a swarm")


def _present(part: T | None, of: str) -> T:
    if part is None:
        raise ValueError(f"expected a flight with {of}, given one without")
    return part


def estimated_position(world: World, flight: Flight) -> Float[Array, "3"]:
    """Position of the vehicle with its estimation error [m]."""
    if flight.failing is not None:
        return flight.failing.position
    return flight.vehicle.position + position_error(world.disturbances, world.key, flight.log.duration)


def to_local(flight: Flight, config: FlightConfig, x: Float[Array, "*n 3"]) -> Float[Array, "*n 3"]:
    """World coordinates in the frame of `config.grid`, whose origin is the middle voxel of the rolling map."""
    return x - config.spacing * (flight.rolling_map.corner + jnp.asarray(config.shape) // 2)
