"""A `.plan` of QGroundControl as the waypoints of a mission: where its places lie, and each leg planned anew."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

import maxjax
from maxjax.core.grid import Grid
from maxjax.core.terrain import Terrain
from maxjax.io.geo.earth import Projected, TangentPlane
from maxjax.io.geo.vertical_zero import VerticalZero
from maxjax.io.places import points_at
from maxjax.ui.cli import main
from maxjax.ui.cli.load_request import load_request
from maxjax.ui.plan_waypoints import read_plan_waypoints
from maxjax.ui.request_files import load_mission
from tests.planners import bare_plan

QUARTER = Path("docs/samples/quarter.geojson").absolute()
HOME = [47.0, 7.999, 470.0]


def item(command: int, *params: float | None, frame: int = 3) -> dict[str, Any]:
    seven = [*params, *[0.0] * (7 - len(params))]
    return {"type": "SimpleItem", "command": command, "frame": frame, "params": seven, "autoContinue": True}


def place(north: float, east: float, height: float, hold: float = 0.0, frame: int = 3) -> dict[str, Any]:
    return item(16, hold, 0.0, 0.0, None, north, east, height, frame=frame)


def saved(folder: Path, *items: Any, **mission: Any) -> Path:
    content = {"fileType": "Plan", "mission": {"plannedHomePosition": HOME, "items": list(items), **mission}}
    (folder / "way.plan").write_text(json.dumps(content))
    return folder / "way.plan"


def test_places_hovers_and_speeds_are_those_of_the_items(tmp_path: Path) -> None:
    survey = {"Items": [place(47.003, 8.0, 30.0), item(206, 5.0, frame=2), place(47.004, 8.0, 30.0)]}
    file = saved(
        tmp_path,
        item(22, 0.0, 0.0, 0.0, None, 0.0, 0.0, 12.0),
        item(178, 1.0, 7.5, -1.0, frame=2),
        place(47.001, 8.0, 20.0, hold=3.0),
        item(19, 30.0, 0.0, 0.0, None, 47.002, 8.0, 25.0),
        item(178, 1.0, 2.5, -1.0, frame=2),
        item(178, 2.0, 9.0, -1.0, frame=2),  # of climbs
        item(203, frame=2),
        {"type": "ComplexItem", "complexItemType": "survey", "TransectStyleComplexItem": survey},
        {"type": "ComplexItem", "complexItemType": "StructureScan"},
        item(21, 0.0, 0.0, 0.0, None, 47.005, 8.001, 0.0),
    )
    found = read_plan_waypoints(file)
    assert [(*stop.position, stop.hover, stop.speed) for stop in found.waypoints] == [
        (47.0, 7.999, 12.0, None, None),
        (47.001, 8.0, 20.0, 3.0, 7.5),
        (47.002, 8.0, 25.0, 30.0, 7.5),
        (47.003, 8.0, 30.0, None, 2.5),
        (47.004, 8.0, 30.0, None, 2.5),
        (47.005, 8.001, 30.0, None, 2.5),
    ]
    assert (found.frame, found.lands) == ("home", True)
    (note,) = found.notes
    assert note.endswith("left out: 1 × StructureScan, 1 × command 203, 1 × command 206")


def test_without_a_take_off_it_begins_above_home(tmp_path: Path) -> None:
    found = read_plan_waypoints(saved(tmp_path, place(47.001, 8.0, 20.0), place(47.001, 8.0, 20.0, hold=4.0)))
    assert [(*stop.position, stop.hover) for stop in found.waypoints] == [
        (47.0, 7.999, 20.0, None), (47.001, 8.0, 20.0, 4.0),
    ]  # fmt: skip
    for frame, name in ((0, "amsl"), (10, "agl")):
        two = [place(47.001, 8.0, 490.0, frame=frame), place(47.002, 8.0, 495.0, frame=frame)]
        found = read_plan_waypoints(saved(tmp_path, *two))
        assert (found.frame, len(found.waypoints), found.waypoints[0].position) == (name, 2, (47.001, 8.0, 490.0))


def test_heights_count_from_the_ground_at_home() -> None:
    """On ground that rises by a metre for ten; east and north by PROJ's UTM."""
    earth = Projected("EPSG:32632", VerticalZero(400.0))
    x, y = pyproj.Transformer.from_crs(4326, 32632, always_xy=True).transform([8.0, 8.001], [47.0, 47.0005])
    grid = Grid((40, 40, 10), 10.0, (x[0] - 200.0, y[0] - 200.0, 0.0))
    terrain = Terrain(np.arange(40.0)[:, None] * np.ones(40), grid)
    ground = terrain.at(x[0], y[0])
    found = points_at([(47.0, 8.0, 30.0), (47.0005, 8.001, 35.0)], "home", earth, terrain)
    np.testing.assert_allclose(found, [[x[0], y[0], ground + 30.0], [x[1], y[1], ground + 35.0]], atol=1e-3)
    assert terrain.at(x[1], y[1]) > ground + 5.0  # where heights above ground would lead higher
    plane = TangentPlane(47.0, 8.0, 400.0)
    flat = Terrain.flat(2.0, Grid((40, 40, 10), 50.0, (-1000.0, -1000.0, 0.0)))
    found = points_at([(47.0, 8.0, 30.0), (47.005, 8.0, 30.0)], "home", plane, flat)
    _, _, away = pyproj.Geod(ellps="WGS84").inv(8.0, 47.0, 8.0, 47.005)
    away *= 1.0 + 432.0 / 6.37e6  # 432 m up
    # The plane leaves the Earth: a level way sinks below it.
    np.testing.assert_allclose(found, [[0.0, 0.0, 32.0], [0.0, away, 32.0 - away**2 / 2 / 6.37e6]], atol=0.01)


@pytest.mark.parametrize(
    ("items", "said"),
    [
        ([place(47.0, 8.0, 20.0), place(47.1, 8.0, 20.0, frame=0)], "expected places in one frame"),
        ([place(47.0, 8.0, 20.0, frame=1), place(47.1, 8.0, 20.0, frame=1)], "given frame 1"),
        ([item(178, 1.0, 5.0)], "given no place"),
        ([place(47.0, 8.0, 20.0, frame=0)], "expected two places or more, given 1"),
        ([place(47.0, 8.0, 20.0), item(21), place(47.1, 8.0, 20.0)], "expected nothing after the landing"),
        ([place(47.0, 8.0, 20.0), item(22)], "expected a take-off first"),
        ([{"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 1]}], "params: expected 7 numbers"),
        ([{"type": "SimpleItem", "command": 16, "frame": 3, "params": ["a"] * 7}], "params: expected 7 numbers"),
        ([place(47.0, 8.0, 10**400)], "params: expected 7 numbers"),
        ([{"type": "Else"}], "expected items of the type SimpleItem or ComplexItem"),
        ([7], "expected items of the type SimpleItem or ComplexItem"),
    ],
)
def test_what_cannot_be_flown_is_refused(tmp_path: Path, items: list[Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        read_plan_waypoints(saved(tmp_path, *items))


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"mission": 1}', '{"mission": {"items": [], "x": NaN}}'])
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "way.plan").write_text(text)
    with pytest.raises(ValueError, match=r"way\.plan: "):
        read_plan_waypoints(tmp_path / "way.plan")
    with pytest.raises(ValueError, match="plannedHomePosition: expected 2 numbers"):
        read_plan_waypoints(saved(tmp_path, place(47.0, 8.0, 20.0), plannedHomePosition=None))


def toml(folder: Path, *lines: str) -> Path:
    text = "\n".join([f'map = "{QUARTER}"', 'method = "astar"', 'waypoint = "way.plan"', *lines])
    (folder / "way.toml").write_text(text)
    return folder / "way.toml"


def test_what_was_exported_leads_to_the_same_places(tmp_path: Path) -> None:
    city = maxjax.load_map(QUARTER)
    path = np.array([[-48.0, 0.0, 42.1], [0.0, 0.0, 42.1], [20.0, 0.0, 60.0]])
    found = maxjax.verify(path, city, radius=1.0)
    known = {"length": found.length, "clearance": found.clearance, "clearance_at": found.clearance_at}
    maxjax.export(tmp_path / "way.plan", bare_plan(city, path, maxjax.Distances(1.0, 1.0), **known))
    request = load_mission(toml(tmp_path))
    assert (request.frame, request.notes) == ("home", ())
    np.testing.assert_allclose(load_request(request).stops, path, atol=1e-3)
    with pytest.raises(ValueError, match=r"frame: expected none beside waypoint = 'way\.plan'"):
        load_mission(toml(tmp_path, 'frame = "agl"'))


def test_each_leg_is_planned_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The straight way leads through buildings."""
    city, ends = maxjax.load_map(QUARTER), np.array([[-75.0, 22.0, 5.0], [55.0, -20.0, 5.0]])
    assert city.earth is not None
    (north, east, _), (south, far, _) = city.earth.geodetic(ends).tolist()
    items = [place(north, east, 5.0), place(south, far, 5.0), item(206, frame=2), item(21)]
    saved(tmp_path, *items, plannedHomePosition=[north, east, 0.0])
    straight = maxjax.verify(ends, city, radius=1.0)
    assert not straight.ok
    assert (
        main(["mission", str(toml(tmp_path)), "--out", str(tmp_path / "out"), "--export", str(tmp_path / "b.kmz")]) == 0
    )
    said = capsys.readouterr().err
    assert "Note: way.plan: what is not a place" in said
    assert "1 × command 206" in said
    assert (tmp_path / "b.kmz").exists()
    written = json.loads((tmp_path / "out" / "mission.json").read_text())
    assert "notes" not in written["configuration"]
    np.testing.assert_allclose([w[:2] for w in written["waypoints"]], ends[:, :2], atol=1e-3)
    assert written["clearance"] >= 1.0
