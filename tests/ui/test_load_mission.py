"""A mission's file in Python: its map, its waypoints and its options suffice for the public calls."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import maxjax

MISSION = """map = "town.npz"
radius = 1.5
spacing = 2.0
return_to_start = true

[[waypoint]]
at = [4, 6, 8]

[[waypoint]]
at = [44, 20, 10]
hover = 3.0
"""


def test_a_missions_file_is_planned_by_public_calls(tmp_path: Path) -> None:
    occupied = np.zeros((24, 16, 12), bool)
    occupied[10:13, :12, :9] = True
    np.savez(tmp_path / "town.npz", occupied=occupied, spacing=2.0, origin=np.zeros(3))
    (tmp_path / "round.toml").write_text(MISSION)
    asked = maxjax.load_mission(str(tmp_path / "round.toml"))
    city = maxjax.load_map(asked.map, ground=asked.ground)
    found = maxjax.plan_mission(city, asked.stops, distances=asked.distances, planner=maxjax.AStar())
    assert found.status == maxjax.Status.OK
    assert len(found.legs) == 2
    np.testing.assert_allclose(found.path[[0, -1]], [[4, 6, 8]] * 2, atol=1e-6)
    assert found.waypoints[1].hover == 3.0
    assert all(leg.radius == 1.5 for leg in found.legs)


def test_a_plan_as_a_dictionary_is_json(tmp_path: Path) -> None:
    city = maxjax.VoxelMap.of(np.zeros((24, 16, 12), bool), spacing=2.0, origin=(1.0, 1.0, 1.0))
    plan = maxjax.plan(city, (4.0, 6.0, 8.0), (40.0, 20.0, 10.0), planner=maxjax.AStar())
    told = json.loads(json.dumps(plan.to_dict()))
    assert told["status"] == "OK"
    np.testing.assert_allclose(told["path"], plan.path, atol=1e-6)
    assert told["length"] == pytest.approx(plan.length)
    assert (told["method"], told["certified"], told["radius"]) == (plan.method, plan.certified, plan.radius)


def test_a_missions_file_has_every_limit(tmp_path: Path) -> None:
    file, ends = tmp_path / "a.toml", "[[waypoint]]\nat = [4, 6, 8]\n[[waypoint]]\nat = [44, 20, 10]\nspeed = 9.0\n"
    given = {"acceleration": 2.5, "jerk": 3.0, "ascent": 2.0, "descent": 1.0, "near": 1.5, "deviation": 0.5}
    keys = "".join(f"{name} = {value}\n" for name, value in given.items())
    file.write_text(f'map = "town.npz"\nspeed = 7.0\nyaw_rate = 45.0\n{keys}{ends}')
    assert maxjax.load_mission(file).limits == maxjax.FlightLimits(speed=9.0, yaw_rate=np.radians(45.0), **given)
    file.write_text(f'map = "town.npz"\nspeed = 7.0\n{ends}')
    assert maxjax.load_mission(file).limits == maxjax.FlightLimits(speed=9.0)
    file.write_text(f'map = "town.npz"\nspeed = 7.0\nautopilot = "arducopter"\njerk = 3.5\n{ends}')
    limits = maxjax.load_mission(file).limits
    assert (limits.speed, limits.acceleration, limits.jerk, limits.ascent) == (9.0, 2.0, 3.5, 2.5)
    file.write_text(f'map = "town.npz"\nacceleration = -1.0\n{ends}')
    with pytest.raises(ValueError, match=r"FlightLimits.acceleration: expected a positive finite number, given -1\.0"):
        maxjax.load_mission(file).limits  # noqa: B018 (raises)
