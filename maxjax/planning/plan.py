"""Plans: routes that the verifier passed, as arrays over a batch, and one of them as a value.

    Route (index coordinates, a claim) → verifier → Plans (world coordinates) → plans[k] = Plan

Verified is the polyline in the local frame of the grid, whose origin is zero, in float64: u · spacing. The world's
coordinates are that plus the grid's origin, in float64 as well.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, overload

import numpy as np
from jaxtyping import Bool, Float64, Int32, Int64

from maxjax.core.status import Status
from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.problem.task import Task

# What is one number of each plan.
NUMBERS = "length", "clearance", "cruise_clearance", "cost", "radius"
# Seconds of each problem by stage; NaN where it had none of that stage.
Seconds = Mapping[str, Float64[np.ndarray, " b"]]


@dataclasses.dataclass(frozen=True)
class PlanStats:
    """Diagnostics of a plan: how its path was found.

    Attributes:
        potential: the certified field that it climbed, "maxwell" or, where that was the flood's own distance,
            "geodesic"; "" where it climbed none.
        ratio: of a route across a map too large for a window, its cost over that of what guided it: the cheapest path
            from voxel to voxel, or the straight line where there is no compiled A* (`planning.windows.corridor`); NaN
            where nothing had to guide it, as a window proves its route the cheapest.
    """

    potential: str
    ratio: float


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """A verified path, or why there is none.

    Attributes:
        status: OK only for a path that passed `verify`.
        path: (t, 3) float64 [m], ENU, start first, goal last; empty unless OK. An end that lies on the face of an
            occupied voxel is moved off it by less than a thousandth of a voxel (1 mm at 2 m).
        length: length of the path [m]; NaN unless OK.
        clearance: least distance from the path to the cube of an occupied voxel [m], ground left out; NaN unless OK.
        cruise_clearance: the least such distance more than 10 m from the ends, and outside the exemptions;
            `clearance` where the path does not leave them; NaN unless OK.
        clearance_at: (t,) float64 [m], such a distance at each point of the path.
        radius: distance [m] that the path keeps outside the exemptions; with NO_SAFE_PATH one that joins the ends.
        exemptions: their radii [m] around start and goal, in which it keeps these ends' own distances, since they stand
            nearer, or beside the ground; 0: none.
        cost: the price paid, ∫ n ds [m]; the length where nothing was priced; NaN unless OK.
        certified: whether the field it climbed had no local maximum but the goal (always False for graph searches).
        margin: distance from which on a metre costs no more than its length [m].
        timings: seconds by stage (`formulate`, `solve`, `ascend`, `tighten`, `verify`, …; `transfer` is the way back
            from the device; `device` is all of that in one program), `compile` apart, and `total` without it.
        method: name of the planner.
        map: that it was planned and verified in.
        stats: how it was found.
    """

    status: Status
    path: Float64[np.ndarray, "t 3"]
    length: float
    clearance: float
    cruise_clearance: float
    clearance_at: Float64[np.ndarray, " t"]
    radius: float
    exemptions: tuple[float, float]
    cost: float
    certified: bool
    margin: float
    timings: Mapping[str, float]
    method: str
    map: VoxelMap = dataclasses.field(repr=False)
    stats: PlanStats

    def to_dict(self) -> dict[str, Any]:
        """Everything but the map as texts, numbers and lists, as `plan.json` holds it; lengths to the micrometre."""
        return {
            "status": self.status.name,
            "path": np.round(self.path, 6).tolist(),
            "length": self.length,
            "clearance": self.clearance,
            "cruise_clearance": self.cruise_clearance,
            "clearance_at": np.round(self.clearance_at, 6).tolist(),
            "radius": self.radius,
            "exemptions": list(self.exemptions),
            "cost": self.cost,
            "ratio": self.stats.ratio,
            "certified": self.certified,
            "potential": self.stats.potential,
            "margin": self.margin,
            "timings": dict(self.timings),
            "method": self.method,
        }


@dataclasses.dataclass(frozen=True, eq=False)
class Plans(Sequence[Plan]):
    """Plans of a batch as arrays; `plans[k]` is a `Plan`.

    Attributes:
        status: (b,) int32, `Status`.
        points: (b, t, 3) float64 [m], ENU: paths, each filled up with its last point; NaN without a path.
        counts: (b,) how many points each path has.
        length, clearance, cruise_clearance, cost: (b,) float64 [m], as in `Plan`; NaN without a path.
        ratio: (b,) float64, as in `PlanStats`.
        clearance_at: (b, t) float64 [m], at each point; NaN beyond a path.
        radius: (b,) float64 [m], as in `Plan`.
        exemptions: (b, 2) float64 [m], as in `Plan`.
        certified: (b,) bool.
        geodesic: (b,) bool, whether the certified field was the flood's own distance.
        timings: (b,) float64 [s] by stage, as in `Plan`; NaN where a problem had none of that stage.
        method: name of the planner.
        task: what was asked.
    """

    status: Int32[np.ndarray, " b"]
    points: Float64[np.ndarray, "b t 3"]
    counts: Int64[np.ndarray, " b"]
    length: Float64[np.ndarray, " b"]
    clearance: Float64[np.ndarray, " b"]
    cruise_clearance: Float64[np.ndarray, " b"]
    cost: Float64[np.ndarray, " b"]
    ratio: Float64[np.ndarray, " b"]
    clearance_at: Float64[np.ndarray, "b t"]
    radius: Float64[np.ndarray, " b"]
    exemptions: Float64[np.ndarray, "b 2"]
    certified: Bool[np.ndarray, " b"]
    geodesic: Bool[np.ndarray, " b"]
    timings: Seconds
    method: str
    task: Task = dataclasses.field(repr=False)

    @property
    def ok(self) -> Bool[np.ndarray, " b"]:
        """Which of them have a path."""
        return np.asarray(self.status == Status.OK)

    @property
    def margin(self) -> float:
        """Distance from which on a metre costs no more than its length [m]."""
        return self.task.distances.margin

    @property
    def map(self) -> VoxelMap:
        """That all were planned in, or a batch of maps."""
        return self.task.map

    def __len__(self) -> int:
        return len(self.status)

    @overload
    def __getitem__(self, index: int) -> Plan: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Plan, ...]: ...
    def __getitem__(self, index: int | slice) -> Plan | tuple[Plan, ...]:
        if isinstance(index, slice):
            return tuple(self._plan(k) for k in range(len(self))[index])
        return self._plan(range(len(self))[index])

    def __iter__(self) -> Iterator[Plan]:
        return (self._plan(k) for k in range(len(self)))

    def _plan(self, k: int) -> Plan:
        count = int(self.counts[k])
        start, goal = self.exemptions[k].tolist()
        kind = "geodesic" if self.geodesic[k] else "maxwell" if self.certified[k] else ""
        spent = {name: float(seconds[k]) for name, seconds in self.timings.items() if not math.isnan(seconds[k])}
        return Plan(
            status=Status(int(self.status[k])),
            path=self.points[k, :count].copy(),
            **{name: float(getattr(self, name)[k]) for name in NUMBERS},
            clearance_at=self.clearance_at[k, :count].copy(),
            exemptions=(start, goal),
            certified=bool(self.certified[k]),
            margin=self.margin,
            timings=spent,
            method=self.method,
            map=self.task.map_at(k),
            stats=PlanStats(kind if count else "", float(self.ratio[k])),
        )


def no_plans(task: Task, status: Status, method: str, timings: Seconds | None = None) -> Plans:
    """Plans of a task without any path."""
    count = len(task)
    nothing, none = np.full(count, math.nan), np.zeros(count, bool)
    return Plans(
        status=np.full(count, int(status), np.int32),
        points=np.full((count, 0, 3), math.nan),
        counts=np.zeros(count, np.int64),
        **(dict.fromkeys((*NUMBERS, "ratio"), nothing) | {"radius": np.full(count, task.distances.radius)}),
        clearance_at=np.full((count, 0), math.nan),
        exemptions=np.zeros((count, 2)),
        certified=none,
        geodesic=none,
        timings={} if timings is None else timings,
        method=method,
        task=task,
    )
