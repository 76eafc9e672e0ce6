"""What a camera does at waypoints, in a mission's file and back in what is written of it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

import maxjax
from maxjax.ui.looks import waypoint_table
from maxjax.ui.request_files import waypoints_of

MISSION = """map = "town.npz"
[[waypoint]]
at = [4, 6, 8]
pitch = -90
[[waypoint]]
at = [44, 20, 10]
heading = 90.0
photo = true
photo_every = 7.5
[[waypoint]]
at = [4, 6, 8]
hover = 1.0
"""


def test_keys_are_the_look_and_the_heading_is_the_waypoints(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(MISSION)
    waypoints = maxjax.load_mission(tmp_path / "a.toml").waypoints
    down, east, none = (waypoint.look for waypoint in waypoints)
    assert down == maxjax.Look(pitch=-0.5 * math.pi)
    assert east == maxjax.Look(photo=True, every=7.5)
    assert waypoints[1].heading == 90.0
    assert none is None


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    """As mission.json has it, with None for what is not said."""
    (tmp_path / "a.toml").write_text(MISSION)
    given = maxjax.load_mission(tmp_path / "a.toml").waypoints
    tables = json.loads(json.dumps([waypoint_table(waypoint) for waypoint in given]))
    said = [{"at": t.pop("position"), **{k: v for k, v in t.items() if v is not None}} for t in tables]
    for found, waypoint in zip(waypoints_of(said), given, strict=True):
        assert found.position == waypoint.position
        assert (found.look is None) == (waypoint.look is None)
        if found.look is not None and waypoint.look is not None:
            assert found.look.photo == waypoint.look.photo
            assert found.look.every == waypoint.look.every
            assert found.look.pitch == pytest.approx(waypoint.look.pitch)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("photo = 1", "waypoint 1: photo: expected true or false, given 1"),
        ("pitch = -100", "waypoint 1: Look.pitch"),
        ("heading = true", "waypoint 1: heading: expected a finite number"),
        ("photo_every = -1.0", "waypoint 1: Look.every"),
        ("yaw = 1.0", "expected the keys at, hover, speed, radius, margin, heading"),
    ],
)
def test_keys_that_are_none(tmp_path: Path, line: str, said: str) -> None:
    """The waypoint and the key are named."""
    (tmp_path / "a.toml").write_text(
        f'map = "town.npz"\n[[waypoint]]\nat = [0, 0, 1]\n[[waypoint]]\nat = [9, 0, 1]\n{line}\n'
    )
    with pytest.raises(ValueError, match=said):
        maxjax.load_mission(tmp_path / "a.toml")
