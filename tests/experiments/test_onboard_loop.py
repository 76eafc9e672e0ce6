"""The loop on board over a folder of scans, with poses and without."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from experiments import onboard_loop
from experiments.onboard_loop import Config, along, main, poses_of

SMALL = Config(
    start=(4.0, 18.0, 11.0),
    goal=(38.0, 18.0, 11.0),
    center=(21.0, 19.0, 11.0),
    shape=(22, 20, 12),
    margin=4.0,
    ground=None,
    speed=80.0,
    period=60.0,
)


def house() -> np.ndarray:
    """Points on a house between start and goal."""
    grid = np.meshgrid(np.arange(18.0, 25.0), np.arange(12.0, 25.0), np.arange(0.0, 20.0), indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, 3)


def judged(folder: Path, tmp_path: Path, **changes: float) -> dict[str, object]:
    (row,) = main(dataclasses.replace(SMALL, scans=folder, out=tmp_path / "out", **changes))
    document = json.loads((tmp_path / "out" / "onboard_loop.json").read_text())
    assert "| 3 " in onboard_loop.section(document) or row["cycles"] != 3
    return dict(row)


@pytest.mark.nightly
def test_scans_of_the_sensor_are_brought_into_the_world(tmp_path: Path) -> None:
    folder, lines = tmp_path / "scans", []
    folder.mkdir()
    for k in range(3):
        where, turn = np.array([4.0 + 2.0 * k, 18.0, 11.0]), Rotation.from_euler("z", 30 * k, degrees=True)
        np.savez(folder / f"{k}.npz", points=np.vstack([turn.inv().apply(house() - where), np.zeros((2, 3))]))
        lines.append(" ".join(map(str, [0.1 * k, *where, *turn.as_quat()])))
    (folder / "poses.tum").write_text("# time x y z qx qy qz qw\n" + "\n".join(lines) + "\n")
    row = judged(folder, tmp_path)
    assert (row["cycles"], row["new"], row["no plan"], row["late"]) == (3, 3, 0, 0)
    assert row["left_m"] == pytest.approx(30.0)  # the last pose, whatever was planned
    (folder / "poses.tum").write_text(lines[0])
    with pytest.raises(ValueError, match=r"a line of poses\.tum for each, found 3 scans"):
        judged(folder, tmp_path)
    (folder / "poses.tum").write_text("0 1 2 3\n")
    with pytest.raises(ValueError, match="expected lines of time x y z qx qy qz qw, given 4"):
        poses_of(folder / "poses.tum")


@pytest.mark.nightly
def test_without_poses_the_vehicle_flies_along_its_plans_until_it_is_there(tmp_path: Path) -> None:
    folder = tmp_path / "scans"
    folder.mkdir()
    for k in range(9):
        np.savez(folder / f"{k}.npz", points=house())
    row = judged(folder, tmp_path, speed=0.2)  # 12 m a period
    assert row["left_m"] <= 2.0  # type: ignore[operator]
    assert 4 <= row["cycles"] <= 6  # type: ignore[operator]


def test_along_a_path() -> None:
    path = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0]])
    np.testing.assert_allclose([along(path, s) for s in (0, 2, 5, 99)], [[0, 0, 0], [2, 0, 0], [3, 2, 0], [3, 4, 0]])
