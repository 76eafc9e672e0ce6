"""`maxjax scan`: one simulated LiDAR scan of a city, and the file that `maxjax plan` reads back."""

from __future__ import annotations

import dataclasses
import io
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from maxjax.cli import report
from maxjax.cli.world import build_world, load_scene
from maxjax.core.grid import Grid, Point3
from maxjax.core.serialize import atomic_write
from maxjax.core.status import Status
from maxjax.planning.planner import Stopwatch
from maxjax.sim.lidar import Lidar, Scan, scan
from maxjax.worlds.geoms import Geoms
from maxjax.worlds.scenes import Scene, occupancy

_LIDAR = Lidar()
_ATOM = 0.01  # [m]; a sensor whose surroundings of this size meet no solid is in the open


@dataclasses.dataclass(frozen=True)
class Returns:
    """What a sensor measured.

    Attributes:
        points: returns [m].
        missed: rays without a surface in range.
        dropped: rays whose return was lost.
    """

    points: Float[np.ndarray, "n 3"]
    missed: int
    dropped: int

    @property
    def counts(self) -> dict[str, int]:
        """Rays by outcome."""
        n = len(self.points)
        return {"rays": n + self.missed + self.dropped, "returns": n, "missed": self.missed, "dropped": self.dropped}


def measure(scene: Scene, pose: Point3) -> Returns:
    """One scan from a position, level; its noise is that of the scene's seed.

    Raises:
        ValueError: for a position that is not finite, or inside a solid.
    """
    if not np.isfinite(pose).all():
        raise ValueError(f"--pose: expected three finite coordinates [m], given {pose}")
    if np.abs(pose).max() > 1e6 or occupancy(scene.geoms, Grid((1, 1, 1), _ATOM, pose))[0].any():
        raise ValueError(f"--pose: expected a place in the open above z = 0, given {pose} inside an obstacle")
    found, surfaces = _scan(scene.geoms, jnp.asarray(pose, jnp.float32), jax.random.key(scene.seed))
    hit = np.asarray(found.hit)
    missed = int((~np.asarray(surfaces)).sum())
    return Returns(np.asarray(found.points)[hit], missed, int((~hit).sum()) - missed)


@jax.jit
def _scan(geoms: Geoms, position: Float[Array, "3"], key: PRNGKeyArray) -> tuple[Scan, Bool[Array, " r"]]:
    """The scan, and which rays meet a surface in range before any is dropped."""
    whole = dataclasses.replace(_LIDAR, dropout=0.0)
    attitude = jnp.eye(3)
    # Equal in all but the dropout, so that the compiler casts the rays once.
    return scan(geoms, _LIDAR, position, attitude, key), scan(geoms, whole, position, attitude, key).hit


def run(map: str, pose: Point3, out: Path | None, json: bool) -> int:
    """Scan, show and write; arguments as on the command line. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    report.check_output(out)
    with report.progress(f"Scanning {map}; {report.FIRST_RUN}"):
        scene = load_scene(map)
        found = measure(scene, pose)
    status = Status.OK if len(found.points) else Status.EMPTY_SCAN
    files = []
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        files = [out / "scan.png", out / "scan.npz"]
        for old in files:
            old.unlink(missing_ok=True)
        if status == Status.OK:
            _write(scene, found, pose, *files)
    if json:
        sys.stdout.write(report.dumps({"status": status.name, "map": map, "pose": pose, **found.counts}))
    else:
        rows = {name: str(count) for name, count in found.counts.items()}
        report.show(report.table(f"scan of {map}", {"": {"status": status.name, **rows}}))
        if files and status == Status.OK:
            print(*files, sep="\n")
            print(f"to plan from it: maxjax plan {files[1]} --ground 0 --start X Y Z --goal X Y Z")
    if status == Status.OK:
        return 0
    report.complain(f"{status.name}: {status.advice} Given: pose {pose} m, range {_LIDAR.max_range:g} m.")
    return 1


def _write(scene: Scene, found: Returns, pose: Point3, picture: Path, archive: Path) -> None:
    from maxjax.viz.figures import figure_scan
    from maxjax.viz.style import save_figure

    with report.progress("Drawing"):
        world = build_world(scene, pose, pose, None, None, Stopwatch())
        figure = figure_scan(
            world.occupied & ~world.ground,
            world.file_grid,
            found.points,
            np.asarray(pose),
            title=f"{scene.name}:{scene.seed}",
        )
        save_figure(figure, picture)
    content = io.BytesIO()
    np.savez_compressed(content, points=found.points, position=np.asarray(pose))
    atomic_write(archive, content.getvalue())
