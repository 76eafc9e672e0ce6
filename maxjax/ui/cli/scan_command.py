"""`maxjax scan`: one simulated LiDAR scan of a city, and the file that `maxjax plan` reads back."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import numpy as np

from maxjax.core.files import atomic_write
from maxjax.core.grid import Point3
from maxjax.core.status import Status
from maxjax.sim.sensors.level_scan import LIDAR, Returns, measure
from maxjax.sim.worlds.scenes import Scene
from maxjax.ui.cli import report
from maxjax.ui.cli.map_task import city_task, load_scene
from maxjax.ui.cli.options import ScanOptions
from maxjax.ui.cli.progress import progress


def run_scan(options: ScanOptions) -> int:
    """Scan, show and write. Returns the exit code.

    Raises:
        ValueError, OSError, ImportError: for arguments or files that cannot be used.
    """
    map, pose, out = options.map, options.pose, options.out
    report.check_output(out)
    with progress(f"Scanning {map}"):
        scene = load_scene(map)
        try:
            found = measure(scene, pose)
        except ValueError as error:
            raise ValueError(f"--pose: {str(error).removeprefix('position: ')}") from error
    status = Status.OK if len(found.points) else Status.EMPTY_SCAN
    files = []
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        files = [out / "scan.png", out / "scan.npz"]
        for old in files:
            old.unlink(missing_ok=True)
        if status == Status.OK:
            _write(scene, found, pose, *files)
    if options.json:
        sys.stdout.write(report.dumps({"status": status.name, "map": map, "pose": pose, **found.counts}))
    else:
        rows = {name: str(count) for name, count in found.counts.items()}
        report.show(report.table(f"scan of {map}", {"": {"status": status.name, **rows}}))
        if files and status == Status.OK:
            print(*files, sep="\n")
            print(f"to plan from it: maxjax plan {files[1]} --ground 0 --start X Y Z --goal X Y Z")
    if status == Status.OK:
        return 0
    report.complain(f"{status.name}: {status.advice} Given: pose {pose} m, range {LIDAR.max_range:g} m.")
    return 1


def _write(scene: Scene, found: Returns, pose: Point3, picture: Path, archive: Path) -> None:
    from maxjax.ui.figures.figures import figure_scan
    from maxjax.ui.figures.style import save_figure

    with progress("Drawing"):
        city = city_task(scene, pose, pose).map
        title = f"{scene.name}:{scene.seed}"
        figure = figure_scan(city, found.points, np.asarray(pose), title=title)
        save_figure(figure, picture)
    content = io.BytesIO()
    np.savez_compressed(content, points=found.points, position=np.asarray(pose))
    atomic_write(archive, content.getvalue())
