"""Missions with a battery on the command line: charge leg by leg, flights that land at home, what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maxjax.ui.cli import main
from tests.scenes import gap_file

HOME, FIRST, SECOND = "[6, 16, 10]", "[40, 8, 12]", "[40, 20, 12]"
SUPPLY = 'airframe = "mavic_3_enterprise"\nreserve = 0.25\nwind = [4.0, 270.0]\n'


@pytest.fixture
def town(tmp_path: Path) -> Path:
    return gap_file(tmp_path)


def written(town: Path, battery: str, supply: str = SUPPLY) -> str:
    """Two places, a minute's hover at each, and back."""
    file = town.parent / "round.toml"
    places = "".join(f"[[waypoint]]\nat = {at}\nhover = 60.0\n" for at in (FIRST, SECOND))
    file.write_text(
        f'map = "town.npz"\nmethod = "astar"\nground = 2\nreturn_to_start = true\nspeed = 6.0\n{battery}{supply}\n'
        f"[[waypoint]]\nat = {HOME}\n{places}"
    )
    return str(file)


def told(capsys: pytest.CaptureFixture[str]) -> Any:
    return json.loads(capsys.readouterr().out)


def test_charge_stands_beside_each_leg_and_fits_80_columns(
    town: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    file = written(town, "battery = 77.0\n")
    assert main(["mission", file, "--json"]) == 0
    content = told(capsys)
    energy, legs = content["energy"], content["legs"]
    assert energy["status"] == "OK"
    assert energy["usable"] == pytest.approx(0.75 * 77.0)
    assert energy["needed"] == pytest.approx(sum(leg["energy"] for leg in legs) + energy["takeoff"] + energy["landing"])
    assert [leg["charge"] for leg in legs] == sorted((leg["charge"] for leg in legs), reverse=True)
    assert legs[-1]["charge"] == pytest.approx(1.0 - energy["needed"] / 77.0) == pytest.approx(energy["charge"])
    assert energy["takeoff"] > 0.0
    assert main(["mission", file]) == 0
    shown = capsys.readouterr().out
    assert all(len(line) <= 80 for line in shown.splitlines())
    assert "…" not in shown
    assert "[Wh]" in shown
    (whole,) = (line for line in shown.splitlines() if " all " in line)
    assert f" {energy['needed']:.1f} " in whole
    assert f" {100.0 * energy['charge']:.0f} " in whole


def test_what_a_battery_does_not_last_for_is_flown_in_flights(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    out, exported = tmp_path / "out", tmp_path / "way_ned.csv"
    file = written(town, "battery = 5.0\n")
    assert main(["mission", file, "--json", "--out", str(out), "--export", str(exported)]) == 0
    captured = capsys.readouterr()
    assert "Wh above its reserve; beyond (" in captured.err
    assert "it is split into flights." in captured.err
    content = json.loads(captured.out)
    assert content["status"] == "OK"
    flights = content["flights"]
    assert [flight["waypoints"] for flight in flights] == [
        [json.loads(HOME), json.loads(place), json.loads(HOME)] for place in (FIRST, SECOND)
    ]
    for k, flight in enumerate(flights, 1):
        assert flight["status"] == flight["energy"]["status"] == "OK"
        assert flight["energy"]["charge"] >= 0.25
        assert [leg["speed"] for leg in flight["legs"]] == [6.0, 6.0]  # that of the way home, too
        assert flight == json.loads((out / f"flight_{k}" / "mission.json").read_text())
        assert (out / f"flight_{k}" / "mission.png").exists()
        rows = np.loadtxt(tmp_path / f"way_{k}_ned.csv", delimiter=",", skiprows=1)
        assert rows[-1, 0] == pytest.approx(flight["duration"], abs=1e-5)
    assert not exported.exists()
    assert main(["mission", file]) == 0
    shown = capsys.readouterr().out
    assert "round.toml" not in shown
    assert "town.npz, flight 2 of 2" in shown


def test_a_place_that_no_battery_of_this_size_reaches_is_a_sentence_and_nothing_is_written(
    town: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["mission", written(town, "battery = 3.0\n"), "--out", str(out), "--json"]) == 1
    captured = capsys.readouterr()
    assert "CANNOT_RETURN: to (40, 8, 12) and back: the flight takes " in captured.err
    assert "the battery has 2.2 Wh above its reserve" in captured.err
    assert captured.err.rstrip().endswith("Nothing was written.")
    assert json.loads(captured.out)["status"] == "CANNOT_RETURN"
    assert not out.exists()


@pytest.mark.parametrize(
    ("battery", "supply", "sentence"),
    [
        ("battery = 77.0\n", 'airframe = "mavic_3_enterprise"\n', "given no --reserve; there is no default"),
        ("", "wind = [3.0, 90.0]\n", "given no --airframe and no --battery and no --reserve"),
        ("battery = 77.0\n", 'airframe = "kite"\nreserve = 0.2\n', "airframe: expected one of iris_plus, matrice_100,"),
        ("battery = 77.0\n", SUPPLY.replace("0.25", "1.0"), "reserve: expected a share above 0, below 1, given 1:"),
        ("battery = 0.0\n", SUPPLY, "battery: expected a capacity above 0 Wh, given 0"),
        ("battery = 77.0\n", SUPPLY.replace("4.0", "25.0"), "wind: expected less than the 21 m/s that DJI Mavic 3"),
        ("battery = 77.0\n", SUPPLY + "payload = -0.5\n", "payload: expected a mass from 0 kg on, given -0.5"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_a_sentence(
    town: Path, capsys: pytest.CaptureFixture[str], battery: str, supply: str, sentence: str
) -> None:
    assert main(["mission", written(town, battery, supply)]) == 2
    assert sentence in capsys.readouterr().err


def test_options_are_the_same_keys_and_a_path_of_one_leg_has_them_too(
    town: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ends = ["--start", "6", "16", "10", "--goal", "40", "20", "12", "--method", "astar", "--ground", "2"]
    given = ["--airframe", "matrice_100", "--battery", "129.96", "--reserve", "0.2", "--wind", "5", "180"]
    assert main(["plan", str(town), *ends, *given, "--payload", "0.5", "--json"]) == 0
    content = told(capsys)
    assert content["energy"]["mass"] == pytest.approx(2.931)
    assert len(content["legs"]) == 1
    assert content["configuration"]["wind"] == [5.0, 180.0]
