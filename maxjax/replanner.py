"""The loop on board: a scan in, a verified path out, many times a second, without ever compiling anything.

    scan → voxels → known map ∪ scan → route → verifier → new plan
                                                 ↘ none, or too late:  what is left of the last plan, verified anew

Shapes are fixed. Clouds are filled up to one number of points; windows of the map come from a list
(`planning.windows.fixed_shapes`); the grid may lie elsewhere in each call, as it may follow the vehicle. Scans are not
gathered: what is known from earlier ones is for the caller to say.

Among movers (`MoverSettings`) they are, into a map that forgets, and ten times a second a motion is chosen:

    scan → movers → motion                          each call
         ↘ map → way                                once a second, at different calls
"""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float64, Real

from maxjax.compile.threads import concurrently
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap, check_map
from maxjax.fields.occupancy import pad_cloud, voxelize
from maxjax.planners import Field
from maxjax.planning.plan import Plan, no_plans
from maxjax.planning.planner import FieldClimber, check_climber
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.occupied_end import plans_of_occupied_ends
from maxjax.planning.problem.task import Task, points_of
from maxjax.planning.run.remainder import remainder
from maxjax.planning.run.verifying import verify_routes, with_closures
from maxjax.planning.windows.fixed_shapes import FixedShapes
from maxjax.sim.movers.lookout import MoverSettings
from maxjax.sim.movers.onboard_watch import OnboardWatch
from maxjax.sim.movers.traffic import SensorScan, Traffic
from maxjax.verification.verifier import verify

_LARGEST = 2**22
"""Voxels of a grid: a larger map has ways that no window holds, and takes seconds as a whole."""

# Of a deadline, kept for the verifier [s].
_JUDGING = 0.005
# Among movers, where nothing is left of the last plan, a new one is asked for so long after it [s].
_AGAIN = 0.3


@dataclasses.dataclass(frozen=True, eq=False)
class Replanned:
    """The path to fly next, and why there is no new one.

    Attributes:
        plan: verified in the map of this call: a new one, or what is left of the last one; None: there is neither.
        status: OK where it is new; else why there is no new one, TIMEOUT where there was no time for it.
        age: how old the scan is that it was planned in [s]; 0 for a new one, NaN without a plan.
        seconds: what the call took.
        late: whether that was more than the deadline. A plan that is late was verified all the same.
        map: what was known and this scan; given as `known` to the next call, scans are gathered. Among movers: what was
            surveyed, and what scans have shown, without movers.
        traffic: who moves, and the motion to fly; None: without `MoverSettings`.
    """

    plan: Plan | None
    status: Status
    age: float
    seconds: float
    late: bool
    map: VoxelMap = dataclasses.field(repr=False)
    traffic: Traffic | None = None


class Replanner:
    """Plans anew with each scan, on a grid of one shape and spacing.

    Args:
        grid: where voxels lie unless a call says otherwise; at most 4 million of them.
        planner: one that climbs a field.
        distances: to keep. A price of each voxel goes with the voxels, wherever the grid lies.
        points: that a program takes at a time. A cloud of more is taken in several turns; nothing of it is dropped.
        movers: how to look for movers and to keep away from them; None: nothing is expected to move.

    Raises:
        ValueError: for a grid of more voxels, a planner that climbs no field, distances longer than the grid, or no
            points.
    """

    def __init__(
        self,
        grid: Grid,
        planner: FieldClimber = Field(),  # noqa: B008 (frozen)
        distances: Distances = Distances(),  # noqa: B008 (frozen)
        points: int = 32_768,
        movers: MoverSettings | None = None,
    ) -> None:
        if math.prod(grid.shape) > _LARGEST:
            raise ValueError(f"grid: expected at most {_LARGEST} voxels, given {grid.shape}; take those around the way")
        climber = check_climber(planner)
        if points < 1:
            raise ValueError(f"points: expected at least 1, given {points}")
        self.grid, self.distances, self.points = grid, distances.within(grid), points
        self._shapes = FixedShapes(grid, climber, distances)
        self._warm = False
        # The last new plan, when its call began [s], and the last map that a scan was seen in.
        self._last: tuple[Plan, float] | None = None
        self._seen: VoxelMap | None = None
        self._watch = None if movers is None else OnboardWatch(grid, movers)
        # Among movers, what was planned last: when [s, of scans], to which goal, and what came of it.
        self._planned: tuple[float, Float64[np.ndarray, " 3"], Status] | None = None

    def warmup(self) -> None:
        """Compile all that `replan` runs, or read it from disk: minutes the first time on a machine, then seconds.

        Among movers all that was seen and planned before is forgotten, so that another flight may begin.
        """
        self._add_scan(np.full((1, 3), np.nan), self._known_map(None))
        self._shapes.warm_up()
        if self._watch is not None:
            self._watch.warm_up()
            self._last = self._planned = None
        self._warm = True

    def replan(
        self,
        points: Real[Array | np.ndarray, "n 3"] | SensorScan,
        start: Real[Array | np.ndarray, " 3"] | Sequence[float],
        goal: Real[Array | np.ndarray, " 3"] | Sequence[float],
        deadline: float = 0.1,
        known: Grid | VoxelMap | None = None,
    ) -> Replanned:
        """Plan from a scan, or verify anew what is left of the last plan.

        Nothing is begun that took too long last time to end before the deadline; a program that runs is waited for, so
        a call can be late, and says so. Where a scan holds no return, what is left of the last plan has to pass in the
        map of the last scan that held one, too. What is left of a plan to another goal is led straight on to the one
        asked for, if that is less than a voxel away; else it is not handed out.

        Among movers each call looks for them and chooses the motion to fly (`Replanned.traffic`). Once a second, at
        different calls, the map is told of a scan, and a way is planned; `status` is that of the last planning. What is
        left of a plan is not handed out either where who flies along it could not stop before what may hold a mover.

        Args:
            points: returns in the world frame [m], as `maxjax.plan_scan` takes them. Among movers a `SensorScan`.
            start: where the vehicle is, or will be [m].
            goal: [m].
            deadline: when to answer, from the call on [s].
            known: what is known beside the scan, or where the grid lies now; of the grid's shape and spacing. None:
                nothing, and where it was. Among movers what was surveyed, which stays whatever scans say, or where the
                map lies now, a whole number of voxels from where it was; None: as in the call before.

        Raises:
            ValueError: for points or positions that are none, a deadline that is no positive time, a map or grid of
                another shape or spacing, or, among movers, points without pose and time, a grid a part of a voxel
                aside, or what was handed out before as `known`.
            RuntimeError: before `warmup`.
        """
        began = time.perf_counter()
        if not self._warm:
            raise RuntimeError("Replanner: expected a call of warmup() before that of replan(), given none")
        if not deadline > 0:
            raise ValueError(f"deadline: expected a positive time [s], given {deadline}")
        ends = points_of("start", start, (3,)), points_of("goal", goal, (3,))
        if self._watch is not None or isinstance(points, SensorScan):
            return self._replan_among(points, ends, began, deadline, known)
        cloud = points_of("points", points, ("n", 3), least=0)
        seen, kept = self._add_scan(cloud, self._known_map(known))
        task = Task.of(seen, ends[0][None], ends[1], self.distances)
        found = self._plan(task, began + deadline - _JUDGING) if kept else self._nothing(task)
        plan, age = (found, 0.0) if found.status == Status.OK else self._remainder(*ends, seen, kept, began)
        if kept:
            self._seen = seen
        if found.status == Status.OK:
            self._last = found, began
        seconds = time.perf_counter() - began
        return Replanned(plan, found.status, age, seconds, seconds > deadline, seen)

    # --- Among movers. ---

    def _replan_among(
        self,
        scan: Real[Array | np.ndarray, "n 3"] | SensorScan,
        ends: tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, " 3"]],
        began: float,
        deadline: float,
        known: Grid | VoxelMap | None,
    ) -> Replanned:
        """Look for movers and choose a motion; tell the map of a scan, or plan, where that is due."""
        watch = self._watch
        if watch is None or not isinstance(scan, SensorScan):
            raise ValueError(
                "points: expected returns in the world frame of a Replanner without movers=, and a SensorScan of one "
                f"with it, given {type(scan).__name__}; see MoverSettings"
            )
        self._survey(known, watch)
        left, age = self._remainder(*ends, watch.map, 1, began)
        if left is not None:
            watch.follow_way(left.path)
        first, learns = watch.traffic is None, watch.due(scan.time)
        plans = self._plan_due(scan.time, ends[1], learns, _AGAIN if left is None else watch.settings.period)

        def planned() -> Plan:
            task = Task.of(watch.map, ends[0][None], ends[1], self.distances)
            return self._plan(task, began + deadline - _JUDGING)

        found: Any
        if first:
            watch.look(scan, ends[0])
            watch.take(watch.learned(), scan.time)
            found = planned()
        else:
            look = functools.partial(watch.look, scan, ends[0])
            found = _look_and(look, watch.learned if learns else planned if plans else None)
        if learns and not first:
            watch.take(found, scan.time)
        if learns:
            left, age = self._remainder(*ends, watch.map, 1, began)
        plan = left
        if plans:
            self._planned = float(scan.time), ends[1], found.status
            if found.status == Status.OK:
                self._last, plan, age = (found, began), found, 0.0
            watch.hold() if plan is None else watch.follow_way(plan.path)
        clear = math.nan if plan is None else watch.clear_length(plan.path)
        if age > 0.0 and not clear >= watch.stopping(scan):
            plan, age, clear = None, math.nan, math.nan
        status = Status.EMPTY_SCAN if self._planned is None else self._planned[2]
        assert watch.traffic is not None
        traffic = dataclasses.replace(watch.traffic, clear=clear)
        seconds = time.perf_counter() - began
        return Replanned(plan, status, age, seconds, seconds > deadline, watch.map, traffic)

    def _survey(self, known: Grid | VoxelMap | None, watch: OnboardWatch) -> None:
        """Take what was surveyed, or where the map lies."""
        if known is None or known is watch.surveyed or known == watch.grid:
            return
        if known is watch.map:
            raise ValueError(
                "known: expected what was surveyed, given the map that was handed out; among movers scans are gathered "
                "by the Replanner, which forgets them again: leave `known` out"
            )
        watch.place_map(self._known_map(known))

    def _plan_due(self, now: float, goal: Float64[np.ndarray, " 3"], learns: bool, wait: float) -> bool:
        """Whether to plan at a time of scans [s], where plans wait so long for one another [s]."""
        if learns and self._planned is not None:
            return False
        if self._planned is None or not math.dist(self._planned[1], goal) < self.grid.spacing:
            return True
        return bool(now - self._planned[0] > wait - 1e-3)

    def _known_map(self, given: Grid | VoxelMap | None) -> VoxelMap:
        """The map before a scan."""
        if given is None or isinstance(given, Grid):
            grid = self.grid if given is None else given
            known = VoxelMap.on(grid, np.zeros(grid.shape, bool))
        else:
            known = check_map(given, "known").on_host()
        grid = known.grid
        if known.batch is not None or (grid.shape, grid.spacing) != (self.grid.shape, self.grid.spacing):
            raise ValueError(
                f"known: expected one map or grid of shape {self.grid.shape} and spacing {self.grid.spacing:g} m, "
                f"given {known.occupied.shape} and {grid.spacing:g} m"
            )
        return known

    def _add_scan(self, cloud: Float64[np.ndarray, "n 3"], known: VoxelMap) -> tuple[VoxelMap, int]:
        """The known map with a scan in it, and how many points fell into the grid."""
        occupied, kept = np.asarray(known.occupied), 0
        for first in range(0, max(len(cloud), 1), self.points):
            some = pad_cloud(cloud[first : first + self.points], self.points)
            scan = jax.block_until_ready(voxelize(some, known.grid))
            occupied, kept = occupied | np.asarray(scan.occupied), kept + int(scan.kept)
        return dataclasses.replace(known, occupied=occupied), kept

    def _plan(self, task: Task, until: float) -> Plan:
        """A new plan, or why there is none."""
        name = self._shapes.planner.name
        taken = plans_of_occupied_ends(task, name)
        if taken is None:
            routes = self._shapes.route(task, until)
            taken = verify_routes(routes.route, task, name, routes.timings)
        return with_closures(taken)[0]

    def _nothing(self, task: Task) -> Plan:
        return no_plans(task, Status.EMPTY_SCAN, self._shapes.planner.name)[0]

    def _remainder(
        self,
        start: Float64[np.ndarray, " 3"],
        goal: Float64[np.ndarray, " 3"],
        seen: VoxelMap,
        kept: int,
        now: float,
    ) -> tuple[Plan | None, float]:
        """The rest of the last plan, and its age."""
        if (
            self._last is None
            or not np.isfinite(start).all()
            or math.dist(self._last[0].path[-1], goal) >= self.grid.spacing
        ):
            return None, math.nan
        last, when = self._last
        left = remainder(last, start, goal, seen if kept or self._seen is None else self._seen)
        if left is None or not verify(left.path, seen, radius=left.radius, exemptions=left.exemptions).ok:
            return None, math.nan
        return left, now - when


def _look_and(look: Callable[[], Any], work: Callable[[], Any] | None) -> Any:
    """Look for movers, and have other work done beside it, on another core, which changes nothing of the watch."""
    if work is None:
        look()
        return None
    _, done = concurrently(lambda one: one(), [look, work], 2)
    return done
