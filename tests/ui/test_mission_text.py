"""Missions as TOML: read back, they are the same requests."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import maxjax
from maxjax import Waypoint
from maxjax.ui.mission_text import mission_text
from maxjax.ui.request import Request

NUMBERS = st.floats(-1e7, 1e7, allow_nan=False).map(lambda x: x + 0.0)
PLACES = st.tuples(NUMBERS, NUMBERS, NUMBERS)
OF_LEG: dict[str, Any] = {
    "hover": st.none() | st.floats(0.0, 3600.0),
    "speed": st.none() | st.floats(0.1, 20.0),
    "radius": st.none() | st.floats(0.0, 5.0),
    "margin": st.none() | st.floats(5.0, 20.0),
}
AIMS = st.one_of(
    st.just({}),
    st.builds(lambda x: {"heading": x}, st.floats(-360.0, 360.0)),
    st.builds(lambda p: {"look_at": p}, PLACES),
)
WAYPOINTS = st.builds(
    lambda at, leg, aim, others: Waypoint(at, **leg, **aim, alternatives=tuple(others)),
    PLACES,
    st.fixed_dictionaries(OF_LEG),
    AIMS,
    st.lists(PLACES, max_size=2),
)
OPTIONS = st.fixed_dictionaries(
    {},
    optional={
        "speed": st.floats(0.5, 20.0),
        "radius": st.floats(0.0, 3.0),
        "frame": st.sampled_from(["map", "local-agl", "agl", "home", "amsl"]),
        "method": st.sampled_from(["field", "astar"]),
        "price": st.just("speed:2.5"),
        "ground": NUMBERS,
        "place": PLACES,
        "drop_class": st.just((7, 18)),
        "only": st.just(("building", 'a "quoted" \\ name\x7f\n')),
        "bounds": st.tuples(*[NUMBERS] * 6),
        "autopilot": st.sampled_from(["px4", "arducopter"]),
        "takeoff_and_landing": st.booleans(),
        "yaw_rate": st.floats(1.0, 90.0),
        "return_to_start": st.booleans(),
        "landing_radius": st.floats(0.5, 5.0),
        "airframe": st.just("iris_plus"),
        "battery": st.floats(10.0, 500.0),
        "reserve": st.floats(0.05, 0.5),
        "payload": st.floats(0.0, 1.0),
        "wind": st.tuples(st.floats(0.0, 9.0), st.floats(0.0, 360.0)),
    },
)


@settings(max_examples=80, deadline=None)
@given(start=PLACES, others=st.lists(WAYPOINTS, min_size=1, max_size=4), options=OPTIONS)
def test_a_mission_read_back_is_the_request(
    tmp_path_factory: pytest.TempPathFactory, start: Any, others: list[Waypoint], options: dict[str, Any]
) -> None:
    asked = Request(map="downtown:0", waypoints=(Waypoint(start, hover=2.0), *others), **options)
    file = tmp_path_factory.mktemp("mission") / "a.toml"
    file.write_text(mission_text(asked), encoding="utf-8")
    assert maxjax.load_mission(file) == asked


def test_defaults_are_left_out_and_a_map_lies_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "town.npz").touch()
    asked = Request.between(str(tmp_path / "town.npz"), (0.0, 0.0, 5.0), (9.0, 0.0, 5.0))
    said = tomllib.loads(mission_text(asked))
    assert said == {"map": "town.npz", "waypoint": [{"at": [0.0, 0.0, 5.0]}, {"at": [9.0, 0.0, 5.0]}]}
    (tmp_path / "a.toml").write_text(mission_text(asked))
    assert maxjax.load_mission(tmp_path / "a.toml") == asked


def test_a_mission_without_waypoints_is_refused() -> None:
    asked = Request.between("downtown:0", (0.0, 0.0, 5.0))
    with pytest.raises(ValueError, match="expected two at least"):
        mission_text(dataclasses.replace(asked))
