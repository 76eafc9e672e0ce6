"""The loop on board: a scan every tenth of a second, and a verified path before the next one.

    python -m experiments.onboard_loop                                        # two cores: 3 minutes, with compiling
    python -m experiments.onboard_loop --scans DIR --start 0 0 5 --goal 40 0 5 --center 20 0 18

Without a folder a vehicle flies through downtown, which it does not know, by what a simulated LiDAR shows it. A folder
holds a file a scan, in the order of their names, in any format of points that maxjax reads (.npz, .ply, .pcd, .las,
.laz). If it holds a `poses.tum` (`time x y z qx qy qz qw`, a line a scan), points are the sensor's: they are turned and
moved into the world, and the vehicle is where its pose says. If not, points are the world's, and the vehicle flies
along what was planned.

Scans are gathered: what one has shown is known to the next. Each cycle is timed from the points to the verified path;
measuring, or reading a file, is not counted.

Expected: a verified path in every cycle, no cycle late after `warmup`.
"""

from __future__ import annotations

import dataclasses
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from benchmarks.common.command import configured
from benchmarks.common.harness import Row, save
from benchmarks.common.markdown import Document, device, table
from maxjax import Distances, Grid, Replanned, Replanner, VoxelMap
from maxjax.core.grid import Index3, Point3
from maxjax.io.kinds.point_cloud import PointCloud
from maxjax.io.reader import READERS, read_map
from maxjax.sim.sensors.level_scan import measure
from maxjax.sim.worlds.scenes import make_scene

RESULTS = Path(__file__).parent / "results"
POSES = "poses.tum"
_ARRIVED = 2.0  # [m]

# Points [m], ENU, and where the vehicle is; None: where the plan has led it.
Scan = tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, " 3"] | None]
# (how many there were, where the vehicle is) ↦ the next one; None: there is none.
ScanAt = Callable[[int, Float64[np.ndarray, " 3"]], Scan | None]


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        scans: folder of scans; None: a simulated city.
        city: seed of the simulated downtown.
        start, goal: [m].
        center: middle of the grid [m].
        shape: of the grid [voxels].
        spacing: of its voxels [m].
        ground: height below which all is ground [m]; None: nothing is.
        radius, margin: to keep [m].
        speed: of the vehicle along its plan [m/s].
        period: from one scan to the next, and the deadline of a plan [s].
        cycles: at most.
        name: of the result file.
        out: where the JSON goes.
    """

    scans: Path | None = None
    city: int = 0
    start: Point3 = (-68.0, 2.0, 6.8)
    goal: Point3 = (4.0, 6.0, 6.5)
    center: Point3 = (-32.0, 4.0, 38.0)
    shape: Index3 = (101, 101, 41)
    spacing: float = 2.0
    ground: float | None = 0.0
    radius: float = 1.0
    margin: float = 8.0
    speed: float = 8.0
    period: float = 0.1
    cycles: int = 300
    name: str = "onboard_loop"
    out: Path = RESULTS


TINY = Config(cycles=2)


def main(config: Config) -> list[Row]:
    """Fly the loop; save and return its row."""
    grid = Grid.centered(config.center, config.shape, config.spacing)
    replanner = Replanner(grid, distances=Distances(config.radius, config.margin))
    began = time.perf_counter()
    replanner.warmup()
    warm = time.perf_counter() - began
    scan_at = _simulated(config.city) if config.scans is None else _read(config.scans)
    where, known = np.array(config.start), _floor(grid, config.ground)
    found: list[Replanned] = []
    while len(found) < config.cycles and (scan := scan_at(len(found), where)) is not None:
        points, seen_at = scan
        where = where if seen_at is None else seen_at
        found.append(replanner.replan(points, where, config.goal, config.period, known))
        known, plan = found[-1].map, found[-1].plan
        if seen_at is None and plan is not None:
            where = along(plan.path, config.speed * config.period)
        if np.linalg.norm(where - config.goal) <= _ARRIVED:
            break
    rows = [_figures(found, warm, float(np.linalg.norm(where - config.goal)))]
    save(config.name, config, rows, config.out)
    return rows


def _floor(grid: Grid, height: float | None) -> VoxelMap:
    """What is known before the first scan: the ground."""
    middles = grid.origin[2] + grid.spacing * np.arange(grid.shape[2])
    ground = np.broadcast_to(middles < (-np.inf if height is None else height), grid.shape)
    return VoxelMap.on(grid, ground, ground)


def along(path: Float64[np.ndarray, "t 3"], distance: float) -> Float64[np.ndarray, " 3"]:
    """The place on a path so far from its start, or its end."""
    edges = np.linalg.norm(np.diff(path, axis=0), axis=1)
    passed = np.concatenate([[0.0], np.cumsum(edges)])
    return np.array([np.interp(distance, passed, path[:, axis]) for axis in range(3)])


def _simulated(city: int) -> ScanAt:
    """What the simulated sensor of a vehicle in a city measures."""
    scene = make_scene("downtown", city)

    def scan_at(_: int, where: Float64[np.ndarray, " 3"]) -> Scan:
        x, y, z = where.tolist()
        return measure(scene, (x, y, z)).points.astype(np.float64), None

    return scan_at


def _read(folder: Path) -> ScanAt:
    """The scans of a folder.

    Raises:
        ValueError: if there are none, or not as many poses as scans.
    """
    files = sorted(file for file in folder.iterdir() if file.suffix.lower() in READERS)
    poses = poses_of(folder / POSES) if (folder / POSES).exists() else None
    if not files or (poses is not None and len(poses) != len(files)):
        raise ValueError(f"{folder}: expected scans, and a line of {POSES} for each, found {len(files)} scans")

    def scan_at(k: int, _: Float64[np.ndarray, " 3"]) -> Scan | None:
        if k == len(files):
            return None
        cloud = read_map(files[k])
        if not isinstance(cloud, PointCloud):
            raise ValueError(f"{files[k]}: expected points, found voxels or a mesh")
        points = cloud.points.astype(np.float64) + cloud.offset
        if poses is None:
            return points, None
        missing = (points == 0).all(axis=1)  # as sensors write a beam without a return
        position, turn = poses[k]
        return np.where(missing[:, None], np.nan, points @ turn.T + position), position

    return scan_at


def poses_of(file: Path) -> list[tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"]]]:
    """Position [m] and rotation of each line of a TUM file.

    Raises:
        ValueError: unless each line holds eight numbers, whose last four are no zero quaternion.
    """
    rows = np.loadtxt(file, ndmin=2)
    if rows.shape[1] != 8 or not np.isfinite(rows).all() or not (np.linalg.norm(rows[:, 4:], axis=1) > 0).all():
        raise ValueError(f"{file}: expected lines of time x y z qx qy qz qw, given {rows.shape[1]} numbers a line")
    return [(row[1:4], Rotation.from_quat(row[4:]).as_matrix()) for row in rows]


def _figures(found: list[Replanned], warm: float, left: float) -> Row:
    taken = 1e3 * np.array([one.seconds for one in found])
    failed = Counter(one.status.name for one in found if one.plan is None or one.age > 0)
    return {
        "cycles": len(found),
        "new": sum(one.plan is not None and one.age == 0 for one in found),
        "last plan": sum(one.plan is not None and one.age > 0 for one in found),
        "no plan": sum(one.plan is None for one in found),
        "why": ", ".join(f"{name} {count}" for name, count in failed.items()) or None,
        "late": sum(one.late for one in found),
        "median_ms": round(float(np.median(taken)), 2),
        "p99_ms": round(float(np.percentile(taken, 99)), 2),
        "worst_ms": round(float(taken.max()), 2),
        "warmup_s": round(warm, 1),
        "left_m": round(left, 2),
    }


def section(document: Document) -> str:
    """RESULTS.md: what a cycle takes."""
    (row,), config = document["rows"], document["config"]
    shape = " x ".join(map(str, config["shape"]))
    lines = [[str(row[name]) for name in ("cycles", "new", "last plan", "no plan", "late")]]
    lines[0] += [f"{row[name]:.1f}" for name in ("median_ms", "p99_ms", "worst_ms")]
    return (
        f"### The loop on board ({device(document)})\n\n"
        f"`maxjax.Replanner` in {shape} voxels of {config['spacing']:g} m, a simulated scan every "
        f"{config['period']:g} s on the way\nthrough an unknown downtown; from the points to the "
        "verified path, nothing compiled after `warmup`.\n\n"
        + table(["cycles", "new plans", "last plan", "none", "late", "median [ms]", "99 %", "worst"], lines)
    )


if __name__ == "__main__":
    main(configured(TINY))
