"""From checked inputs to an answer: the part of the node that plans, without ROS.

cloud, state, goal → Replanner → path, set-points, and what to tell of both
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from jaxtyping import Float64

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.problem.distances import Distances
from maxjax.replanner import Replanned, Replanner
from maxjax.ros.inputs import Cloud, Inputs, VehicleState
from maxjax.ros.settings import NodeSettings
from maxjax.ros.timed_path import STEP, Setpoints, time_path
from maxjax.sim.movers.lookout import ON_BOARD, MoverSettings
from maxjax.sim.movers.motions import MotionSet
from maxjax.sim.movers.reachable_sets import Bounds
from maxjax.sim.movers.traffic import CommittedMotion, SensorScan
from maxjax.sim.sensors.lidar import Lidar
from maxjax.trajectories.limits import FlightLimits


@dataclasses.dataclass(frozen=True, eq=False)
class Answer:
    """What is published for a cloud.

    Attributes:
        found: by the replanner.
        path: to the goal [m]; no points: there is none.
        setpoints: to fly, from `begins` on; none: brake.
        begins: time of their start [s].
    """

    found: Replanned
    path: Float64[np.ndarray, "n 3"]
    setpoints: Setpoints | None
    begins: float


class CloudPlanner:
    """A replanner with the map that it gathers."""

    def __init__(self, settings: NodeSettings, middle: Float64[np.ndarray, "3"]) -> None:
        self.settings = settings
        x, y, z = map(float, np.where(np.isfinite(settings.center), settings.center, middle))
        nx, ny, nz = settings.shape
        self.grid = Grid.centered((x, y, z), (nx, ny, nz), settings.spacing)
        distances = Distances(settings.radius, settings.margin)
        movers = _mover_settings(settings) if settings.movers else None
        self.replanner = Replanner(self.grid, distances=distances, movers=movers)
        self.limits = FlightLimits(speed=settings.speed, acceleration=settings.acceleration)
        self._known: VoxelMap | None = None

    def warm_up(self) -> None:
        """Compile, or read from disk, all that answers run."""
        self.replanner.warmup()
        time_path(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), 0.0, self.limits)
        self._known = _ground(self.grid, self.settings.ground)

    def answer(self, cloud: Cloud, state: VehicleState, goal: Float64[np.ndarray, "3"], inputs: Inputs) -> Answer:
        """The path to fly after a cloud."""
        if self.settings.movers:
            position, rotation = inputs.sensor_pose(cloud, state)
            scan = SensorScan(inputs.sensor_points(cloud, state), position, rotation, state.velocity, cloud.time)
            found = self.replanner.replan(scan, state.position, goal, self.settings.deadline)
        else:
            points = inputs.world_points(cloud, state)
            found = self.replanner.replan(points, state.position, goal, self.settings.deadline, self._known)
            self._known = found.map
        path = np.zeros((0, 3)) if found.plan is None else np.asarray(found.plan.path, np.float64)
        if found.traffic is not None:
            motion = found.traffic.motion
            return Answer(found, path, _setpoints_of(motion), motion.begins)
        if len(path) < 2:
            return Answer(found, path, None, cloud.time)
        ahead = path[min(1, len(path) - 1)] - path[0]
        speed = float(state.velocity @ ahead) / max(float(np.linalg.norm(ahead)), 1e-9)
        return Answer(found, path, time_path(path, speed, self.limits), cloud.time)


def summary_of(answer: Answer) -> tuple[int, str, dict[str, str]]:
    """Level of diagnostics (0 OK, 1 warning, 2 error), a sentence, and values by name."""
    found = answer.found
    traffic = found.traffic
    values = {
        "status": found.status.name,
        "plan_age_s": f"{found.age:.2f}",
        "answer_s": f"{found.seconds:.3f}",
        "late": str(found.late),
        "length_m": "nan" if found.plan is None else f"{found.plan.length:.1f}",
        "clearance_m": "nan" if found.plan is None else f"{found.plan.clearance:.2f}",
    }
    if traffic is not None:
        values |= {"flags": " ".join(sorted(traffic.flags)), "movers": str(int(traffic.confirmed.sum()))}
    if found.plan is None:
        return 2, f"no path: {found.status.advice}", values
    if traffic is not None and traffic.flags:
        return 1, f"not all that is assumed of movers holds: {values['flags']}", values
    if found.status != Status.OK:
        return 1, f"what is left of the last path is flown: {found.status.advice}", values
    if found.late:
        return 1, f"verified path, later than the deadline of {found.seconds:.2f} s", values
    return 0, "verified path", values


def _setpoints_of(motion: CommittedMotion) -> Setpoints:
    """The motion until it rests, at even times from its begin on."""
    lasts = max(motion.ends - motion.begins, 0.0)
    times = STEP * np.arange(math.ceil(lasts / STEP) + 1)
    found = motion.at(motion.begins + times)
    return Setpoints(times, found.positions, found.velocities, found.accelerations)


def _ground(grid: Grid, height: float) -> VoxelMap:
    """What is known before the first cloud: the ground, if there is one."""
    middles = grid.origin[2] + grid.spacing * np.arange(grid.shape[2])
    ground = np.broadcast_to(middles < (height if math.isfinite(height) else -math.inf), grid.shape)
    return VoxelMap.on(grid, ground, ground)


def _mover_settings(settings: NodeSettings) -> MoverSettings:
    rays = settings.channels * settings.columns
    lidar = Lidar(
        settings.channels, rays, settings.elevation_min, settings.elevation_max, max_range=settings.range
    )  # fmt: skip
    bounds = Bounds(settings.mover_speed, settings.mover_acceleration, settings.mover_size)
    sight = dataclasses.replace(ON_BOARD, lidar=lidar, bounds=bounds)
    ground = settings.ground if math.isfinite(settings.ground) else None
    return MoverSettings(sight=sight, choice=MotionSet(speed=settings.speed), ground=ground)
