"""`maxjax inspect` and `maxjax survey`: photos, flights and files of a house in a file, or one sentence."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maxjax.ui.cli import main


@pytest.fixture
def house(tmp_path: Path) -> str:
    """A house of 8 by 6 m, 7 m high, and a lower one beside it, in Dutch coordinates."""

    def feature(x: float, y: float, u: float, v: float, height: float, name: str) -> dict[str, Any]:
        ring = [[x, y], [u, y], [u, v], [x, v], [x, y]]
        own = {"height": height, "building": "yes", "id": name}
        return {
            "type": "Feature",
            "id": name,
            "properties": own,
            "geometry": {"type": "Polygon", "coordinates": [ring]},
        }

    east, north = 84_000.0, 446_000.0
    features = [
        feature(east, north, east + 8.0, north + 6.0, 7.0, "a"),
        feature(east + 14.0, north, east + 19.0, north + 6.0, 4.0, "b"),
    ]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::28992"}}
    file = tmp_path / "house.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    return str(file)


SPARE = (
    "--ground",
    "0",
    "--height-of-zero",
    "0",
    "--distance",
    "6",
    "--overlap",
    "0.5",
    "0",
    "--spacing",
    "1",
    "--radius",
    "1",
)


def test_a_house_is_inspected_drawn_and_written(house: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    out, plan = tmp_path / "out", tmp_path / "way.plan"
    where = ["--at", "84004", "446003", "--accuracy", "0.2"]
    assert main(["inspect", house, *where, *SPARE, "--json", "--out", str(out), "--export", str(plan)]) == 0
    told = capsys.readouterr()
    assert "way.plan: as flown" in told.err
    assert " photos: " in told.err
    content = json.loads(told.out)
    assert content == json.loads((out / "inspection.json").read_text())
    assert (out / "inspection.png").stat().st_size > 10_000
    assert content["status"] == "OK"
    assert content["coverage"]["share"] > 0.95
    assert content["coverage"]["wanted"] == 2
    photos = np.array([photo["position"] for photo in content["photos"]])
    inside = (photos >= [84000.0, 446000.0, 0.0]) & (photos <= [84008.0, 446006.0, 7.0])
    assert not inside.all(axis=1).any()
    items = json.loads(plan.read_text())["mission"]["items"]
    assert sum(item["command"] == 195 for item in items) >= 1


def test_several_flights_are_numbered_files(house: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No flight longer than is allowed."""
    where = ["--at", "84004", "446003", "--longest", "90", "--export", str(tmp_path / "way_ned.csv")]
    assert main(["inspect", house, *where, *SPARE, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    count = len(content["flights"])
    assert count > 1
    assert sorted(file.name for file in tmp_path.glob("way*")) == [f"way_{k}_ned.csv" for k in range(1, count + 1)]


def test_a_battery_counts_and_what_it_does_not_last_for_is_not_written(
    house: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Energy stands beside each flight and in the file; a battery that is too small says how much is missing."""
    where = ["inspect", house, "--at", "84004", "446003", *SPARE, "--airframe", "mavic_3_enterprise"]
    file = ["--reserve", "0.25", "--export", str(tmp_path / "way_ned.csv")]
    assert main([*where, *file, "--battery", "77", "--json"]) == 0
    (flight,) = json.loads(capsys.readouterr().out)["flights"]
    energy = flight["energy"]
    assert energy["charge"] == pytest.approx(1.0 - energy["needed"] / 77.0)
    # Near 100 W for as long as it flies, and for the take-off and the landing.
    assert 60.0 < (energy["needed"] - energy["takeoff"] - energy["landing"]) * 3600.0 / flight["duration"] < 200.0
    (tmp_path / "way_ned.csv").unlink()
    assert main([*where, *file, "--battery", "2", "--longest", "900"]) == 1
    told = capsys.readouterr()
    assert "Flight 1: the flight takes" in told.err
    assert "the battery has 1.5 Wh above its reserve" in told.err
    assert "CANNOT_RETURN" in told.out
    assert not (tmp_path / "way_ned.csv").exists()
    # Without a longest flight the work is shared among flights that it lasts for.
    assert main([*where, "--battery", "5", "--reserve", "0.25", "--json"]) == 0
    flights = json.loads(capsys.readouterr().out)["flights"]
    assert len(flights) > 1
    assert all(flight["energy"]["needed"] <= 0.75 * 5.0 for flight in flights)


def test_an_area_is_surveyed(house: str, capsys: pytest.CaptureFixture[str]) -> None:
    area = ["--area", "83990", "445990", "84030", "445990", "84030", "446020", "83990", "446020"]
    options = ["--ground", "0", "--distance", "30", "--overlap", "0.5", "0.3", "--turn", "0"]
    assert main(["survey", house, *area, *options, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["status"] == "OK"
    assert content["coverage"]["share"] > 0.9
    assert {round(photo["pitch"]) for photo in content["photos"]} == {-90}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--building", "c"), "target: expected a building"),
        ((), "expected one of --building, --at, --box, --outline, given none"),
        (("--building", "a", "--at", "84004", "446003"), "given --building and --at"),
        (("--at", "84004", "446003", "--overlap", "1", "0"), "overlap: expected two shares"),
        (("--at", "84004", "446003", "--distance", "0.5"), "distance: expected more than the radius"),
        (("--at", "84004", "446003", "--camera", "Brownie"), "camera"),
        (("--outline", "0", "1", "2"), "--outline: expected x and y of 3 corners at least, given 3 numbers"),
    ],
)
def test_what_cannot_be_inspected_is_one_sentence(
    house: str, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    assert main(["inspect", house, *SPARE, *words]) == 2
    captured = capsys.readouterr()
    assert said in captured.err.splitlines()[-1]
    assert not captured.out


def test_a_simulated_city_has_places_and_no_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", "suburb:0", "--building", "a"]) == 2
    assert "suburb:0 has no names; give --at, --box or --outline" in capsys.readouterr().err
