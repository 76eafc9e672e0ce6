"""The watch on board: a vehicle's own scans in, what is known of movers and the motion to fly out, call by call.

    cloud → range image (host) → `watch_movers` → tracks, motion, flags
                                   ↘ once a second: map           ↘ elsewhere: way (`maxjax.Replanner`)

All programs are of fixed shapes, and compiled by `warm_up`. A call that is not as it should be raises a flag, and the
motion that was committed goes on: nothing is refused in flight that can be flown without.

| flag | what failed | what is done |
| --- | --- | --- |
| `POSE` | the pose is unknown or no rotation | the scan shows nothing |
| `POSE` | the pose jumped | what earlier scans saw free is dropped, so that no wall seems to move |
| `BLIND` | the scan holds no return | sets grow, nothing is seen free |
| `CLOCK` | the time is not later than that of the call before, or much later | an earlier scan is left out |

Frame: the map's, which lies a whole number of voxels from the grid's, so that coordinates are small; times since the
first scan.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import numpy as np
from jaxtyping import Bool, Float32, Float64

from maxjax.compile.executable import Stored
from maxjax.core.grid import Grid
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.problem.task import points_of
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.movers import lookout
from maxjax.sim.movers.among import Flag
from maxjax.sim.movers.choice import Commitment
from maxjax.sim.movers.known_surroundings import Knowledge
from maxjax.sim.movers.lookout import Flown, MoverSettings, Own, Watched
from maxjax.sim.movers.motions import MotionPrimitive
from maxjax.sim.movers.perception import initial_perception
from maxjax.sim.movers.traffic import CommittedMotion, SensorScan, Traffic
from maxjax.sim.sensors.own_returns import ReturnCounts, project_returns

# Points of the way that motions are told, half a voxel apart.
_POINTS = 64
# Longest time between two scans in which movers are confirmed as soon as assumed [s].
_LONGEST = 0.5
# Speed of a sensor beyond which its pose has jumped, in that of motions; and how long no mover is seen after that [s].
_JUMP, _UNSEEN = 2.0, 1.0
# Largest entry of R Rᵀ − 1 of a rotation.
_TURNED = 1e-2
# Times are compared with so much room for rounding [s].
_ROUNDING = 1e-3

# From the host to where programs run, without a program of its own.
_put = jax.device_put
# Position [m] and rotation of the sensor.
Pose = tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"]]

_WATCH = Stored("look for movers", lookout.watch_movers, ("rules",))
_LEARN = Stored("map of a scan", lookout.learn_scan, ("rules",))
_MOVE = Stored("moved map", lookout.move_map)
_REST = Stored("motion to rest", lookout.come_to_rest, ("rules",))
_CLEAR = Stored("clear way", lookout.clear_of_movers, ("rules",))


class OnboardWatch:
    """Who moves around one vehicle.

    Args:
        grid: of the map.
        settings: how to look and to fly.
    """

    def __init__(self, grid: Grid, settings: MoverSettings) -> None:
        floor, ground = settings.sight.floor, settings.ground
        below = 1000.0 if ground is None else max(grid.origin[2] - ground, 0.0) + grid.spacing
        deeper = math.ceil(below / grid.spacing)
        # Returns below the floor are the ground's; without one, none are.
        self._origin = np.array(grid.origin) - grid.spacing * np.array([0.0, 0.0, deeper])
        floor = 1e-3 if ground is None else floor + ground - float(self._origin[2])
        within = settings.within
        if within is not None:
            low, high = (tuple((np.array(x) - self._origin).tolist()) for x in within)
            within = (low, high)
        self.settings = settings
        self._rules = dataclasses.replace(
            settings, sight=dataclasses.replace(settings.sight, floor=floor), within=within
        )
        self.grid, self._first_grid, self._deeper = grid, grid, deeper

    def _start_anew(self) -> None:
        """Nothing seen, nothing flown."""
        shape, spacing = self._first_grid.shape, self._first_grid.spacing
        # By the host, so that its types are those of any later one: of weak ones there would be a second program.
        self._seeing = jax.tree.map(lambda x: _put(np.asarray(x)), initial_perception(self._rules.sight))
        self._memory = self._seeing.memory
        self.surveyed = VoxelMap.on(self._first_grid, np.zeros(shape, bool))
        corner = np.array([0, 0, self._deeper])
        middle = spacing * (corner + np.array(shape) // 2)
        self._map = mapping.empty(_put(middle.astype(np.float32)), shape, spacing, self._rules.forgets)
        self.place_map(self.surveyed)
        self._pieces: list[tuple[float, MotionPrimitive]] = []
        self._verified, self._lasts = math.nan, math.nan
        self._way: tuple[np.ndarray, np.ndarray] | None = None
        self._holds = False
        self._zero = self._time = self._learned = self._seen_at = math.nan
        self._jumped = -math.inf
        self._position: Float64[np.ndarray, " 3"] | None = None
        self._latest: tuple[Watched, Own] | None = None
        self.traffic: Traffic | None = None

    def warm_up(self) -> None:
        """Compile all that runs in flight, or read it from disk; forgets all that was seen."""
        self._start_anew()
        rays = self._rules.sight.lidar.rays
        middle = np.array(self.grid.to_metres(0.5 * np.array(self.grid.shape)))
        self.look(SensorScan(np.zeros((0, 3)), middle, np.eye(3), np.zeros(3), -1.0), middle)
        for k in range(2):
            scan = SensorScan(np.full(rays, np.inf), middle, np.eye(3), np.zeros(3), 0.1 * k)
            self.look(scan, middle)
            self.take(self.learned(), 0.1 * k)
            self.clear_length(np.stack([middle, middle + 1.0]))
        assert self.traffic is not None
        self.traffic.motion.at(0.0)
        self.place_map(self.surveyed)
        self._start_anew()

    def place_map(self, surveyed: VoxelMap) -> None:
        """Put the map where a grid of what was surveyed lies; what leaves it is forgotten.

        Raises:
            ValueError: for a grid that lies a part of a voxel aside.
        """
        grid = surveyed.grid
        steps = (np.array(grid.origin) - self._origin) / grid.spacing
        corner = np.round(steps).astype(np.int32)
        if np.abs(steps - corner).max() > 1e-3:
            raise ValueError(
                f"known: expected a grid whole voxels of {grid.spacing:g} m from that of the replanner, at "
                f"{self._first_grid.origin}, given one at {grid.origin}"
            )
        self.grid, self.surveyed = grid, surveyed
        self._closed = np.asarray(surveyed.barred) | self._ground(grid)
        self._take(_MOVE(self._map, *_put((self._closed, corner))))

    def _take(self, moved: lookout.MapAndVoxels) -> None:
        """The map anew, as motions and plans need it."""
        self._map, occupied, self._blocked = moved
        ground = np.asarray(self.surveyed.ground) | self._ground(self.grid)
        whole = VoxelMap.on(self.grid, np.asarray(occupied) | np.asarray(self.surveyed.occupied) | ground, ground)
        self.map = whole if self.surveyed.closed is None else whole.closing(np.asarray(self.surveyed.closed))

    def _ground(self, grid: Grid) -> Bool[np.ndarray, "nx ny nz"]:
        """Voxels that reach below the ground."""
        lowest = grid.origin[2] + grid.spacing * (np.arange(grid.shape[2]) - 0.5)
        below = lowest < (-math.inf if self.settings.ground is None else self.settings.ground - 1e-6)
        return np.broadcast_to(below, grid.shape)

    # --- Ways. ---

    def follow_way(self, path: Float64[np.ndarray, "t 3"]) -> None:
        """Let motions lead along a path [m] from now on."""
        points, along = self._sampled(path)
        self._way, self._holds = (points, along[-1] - along), False

    def hold(self) -> None:
        """Let motions lead to where the vehicle is, or was when it first had no way."""
        if not self._holds and self._latest is not None:
            self._way, self._holds = _staying(self._latest[1]), True

    def stopping(self, scan: SensorScan) -> float:
        """How far the vehicle flies until it rests [m]; at a speed that is unknown: at the greatest."""
        speed = float(np.linalg.norm(np.asarray(scan.velocity, np.float64)))
        choice = self._rules.choice
        speed = speed if math.isfinite(speed) else choice.speed
        return speed * (self._rules.delay + 0.5 * choice.stopping)

    def clear_length(self, path: Float64[np.ndarray, "t 3"]) -> float:
        """How far along a path from the vehicle on nothing that may hold a mover is too near [m]."""
        if self._latest is None:
            return math.inf
        watched = self._latest[0]
        tracks = dataclasses.replace(watched.tracks, used=watched.kept)
        way, along = _put(self._sampled(path))
        return float(_CLEAR(way, along, tracks, rules=self._rules))

    def _sampled(
        self, path: Float64[np.ndarray, "t 3"]
    ) -> tuple[Float32[np.ndarray, "m 3"], Float32[np.ndarray, " m"]]:
        """Points half a voxel apart along a path, and how far along it they lie [m]."""
        passed = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        along = np.minimum(0.5 * self.grid.spacing * np.arange(_POINTS), passed[-1])
        points = np.stack([np.interp(along, passed, path[:, k]) for k in range(3)], axis=1) - self._origin
        return points.astype(np.float32), along.astype(np.float32)

    # --- Scans. ---

    def look(self, scan: SensorScan, start: Float64[np.ndarray, " 3"]) -> bool:
        """Look for movers, and choose the motion that is flown next: `traffic`.

        Returns:
            Whether it was done: a scan that is no later than the last one is left out.

        Raises:
            ValueError: for arrays of other shapes, a time that is no number, or a first call that does not know where
                the vehicle is.
        """
        time, pose, velocity = _checked(scan)
        lidar = self._rules.sight.lidar
        returns = np.asarray(scan.returns, np.float64)
        if returns.ndim != 1:
            returns = points_of("SensorScan.returns", returns, ("n", 3), least=0)
        if self.traffic is None and not np.isfinite(start).all():
            raise ValueError(f"start: expected where the vehicle is in the first call [m], given {start.tolist()}")
        if math.isnan(self._zero):
            self._zero = time
        if time <= self._time and self.traffic is not None:
            flags = self.traffic.flags | {"CLOCK"}
            self.traffic = dataclasses.replace(self.traffic, flags=flags)
            return False
        distance, counts = project_returns(returns, lidar, self._rules.airframe)
        up = self._judge_pose(pose, start, velocity, time)
        up |= {"BLIND"} if counts.seen == 0 else set()
        up |= {"CLOCK"} if time - self._time > _LONGEST else set()
        own = self._own(pose, start, velocity, time)
        began = time + self._rules.delay
        flown = self._flown(own, time, began)
        self._time = time
        way, left = _staying(own) if self._way is None else self._way
        distance, way, left = _put((distance, way, left))
        known = Knowledge(self._map, self._blocked, None, way, left, 0.5 * self.grid.spacing)
        self._seeing, watched = _WATCH(self._seeing, distance, own, flown, known, rules=self._rules)
        watched = jax.block_until_ready(watched)
        self._commit(watched, time, began)
        self._latest = watched, own
        self.traffic = self._told(watched, frozenset(up), counts)
        return True

    def learned(self) -> lookout.MapAndVoxels:
        """The map with the last scan; changes nothing, so that it may run while the next one is looked at."""
        assert self._latest is not None
        watched, own = self._latest
        learned = _LEARN(self._map, _put(self._closed), watched, own, rules=self._rules)
        jax.block_until_ready(learned)
        return learned

    def take(self, learned: lookout.MapAndVoxels, time: float) -> None:
        """Go on with a map that has learned, at a time of scans [s]."""
        self._take(learned)
        self._learned = time

    def due(self, time: float) -> bool:
        """Whether the map should learn of a scan of such a time [s]."""
        return not time - self._learned < self._rules.period - _ROUNDING

    def _own(
        self, pose: Pose, start: Float64[np.ndarray, " 3"], velocity: Float64[np.ndarray, " 3"], time: float
    ) -> Own:
        position, rotation = pose
        values = position - self._origin, rotation, start - self._origin, velocity, np.array(time - self._zero)
        return Own(*_put([one.astype(np.float32) for one in values]))

    def _judge_pose(
        self, pose: Pose, start: Float64[np.ndarray, " 3"], velocity: Float64[np.ndarray, " 3"], time: float
    ) -> set[str]:
        """The flag of poses, if it is up; after a jump images of before say nothing."""
        position, before = pose[0], self._position
        known = all(np.isfinite(one).all() for one in (*pose, start, velocity))
        if np.isfinite(position).all():
            furthest = _JUMP * self._rules.choice.speed * max(time - self._seen_at, 0.0) + self._rules.drift
            if before is not None and math.dist(position, before) > furthest:
                self._seeing = dataclasses.replace(self._seeing, memory=self._memory)
                self._jumped = time
            self._position, self._seen_at = position, time
        return set() if known and time - self._jumped >= _UNSEEN else {"POSE"}

    def _flown(self, own: Own, time: float, began: float) -> Flown:
        """What is flown at the end of a scan, and was committed last."""
        if not self._pieces:
            velocity = _put(np.where(np.isfinite(own.velocity), own.velocity, np.float32(0.0)))
            rest = _REST(own.place, velocity, rules=self._rules)
            self._pieces, self._verified = [(time, rest)], time
        # Of motions that others have replaced by now nothing is told any more.
        while len(self._pieces) > 1 and self._pieces[1][0] <= time:
            del self._pieces[0]
        (first, now), (last, committed) = self._pieces[0], self._pieces[-1]
        since, until, verified = _put([np.float32(x) for x in (time - first, began - last, self._verified - last)])
        return Flown(now, since, Commitment(committed, verified), until)

    def _commit(self, watched: Watched, time: float, began: float) -> None:
        """Fly the chosen motion from its begin on."""
        self._pieces.append((began, watched.flown.motion))
        self._verified, self._lasts = began + float(watched.flown.verified), began + float(watched.lasts)

    def _told(self, watched: Watched, up: frozenset[str], counts: ReturnCounts) -> Traffic:
        """What is handed out."""
        tracks, raised = watched.tracks, np.asarray(watched.up)
        rows = np.flatnonzero(np.asarray(tracks.used))
        named = {flag.name for flag in Flag if raised[flag]}
        return Traffic(
            places=np.asarray(tracks.place)[rows] + self._origin,
            velocities=np.asarray(tracks.velocity)[rows].astype(np.float64),
            least=np.asarray(watched.least)[rows] + self._origin,
            greatest=np.asarray(watched.greatest)[rows] + self._origin,
            confirmed=np.asarray(watched.kept)[rows],
            rests=np.asarray(tracks.rests)[rows],
            motion=CommittedMotion(self._pieces[-1][0], self._lasts, self._verified, tuple(self._pieces), self._origin),
            flags=up | named,
            returns=counts,
            clear=math.nan,
        )


def _staying(own: Own) -> tuple[Float32[np.ndarray, "m 3"], Float32[np.ndarray, " m"]]:
    """The way of who has none: to stay."""
    place = np.where(np.isfinite(own.place), own.place, 0.0)
    return np.tile(place, (_POINTS, 1)).astype(np.float32), np.zeros(_POINTS, np.float32)


def _checked(scan: SensorScan) -> tuple[float, Pose, Float64[np.ndarray, " 3"]]:
    """Time, pose and velocity of a scan; a pose that is none is NaN."""
    time = float(scan.time)
    if not math.isfinite(time):
        raise ValueError(f"SensorScan.time: expected a finite number of seconds, given {scan.time!r}")
    position, velocity = (
        points_of("SensorScan.position", scan.position, (3,)),
        points_of("SensorScan.velocity", scan.velocity, (3,)),
    )
    rotation = points_of("SensorScan.rotation", scan.rotation, (3, 3))
    turned = np.isfinite(rotation).all() and np.abs(rotation @ rotation.T - np.eye(3)).max() <= _TURNED
    if not (turned and np.isfinite(position).all() and np.linalg.det(rotation) > 0.0):
        position, rotation = np.full(3, np.nan), np.full((3, 3), np.nan)
    return time, (position, rotation), velocity
