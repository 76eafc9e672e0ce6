"""`maxjax fly FILE`: campaigns and closed loops in a city of one's own, on flights that take no time."""

from __future__ import annotations

import json
import shlex
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maxjax.sim.trials import batches as module
from maxjax.sim.trials import replay
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.given_city import GivenCity
from maxjax.sim.trials.outcomes import Outcome
from maxjax.ui.cli import fly_command as flying
from maxjax.ui.cli.viewing_flights import again, caption, where_flown
from maxjax.ui.methods import planner_named
from maxjax.ui.page.trial_folder import city_of, film_of, open_folder
from tests.sim.trials.test_given_city import HOUSES, quarter
from tests.ui.cli.terminal import Terminal
from tests.ui.cli.test_cli_fly import fake_fly, fake_fly_all, fake_part, fake_watch

pytest.importorskip("matplotlib")

ENDS = ("--start", 30, 0, 8, "--goal", -30, 6, 9)


@pytest.fixture
def fly(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Terminal:
    """In a folder with the map; ends, solids and movers are real."""
    monkeypatch.setattr(module, "_one_by_one", fake_part)
    monkeypatch.setattr(module, "fly_closed_loop", fake_fly)
    monkeypatch.setattr(module, "fly_all_closed_loop", fake_fly_all)
    monkeypatch.setattr(replay, "watch", fake_watch)
    quarter(tmp_path)
    monkeypatch.chdir(tmp_path)
    return Terminal(capfd, "fly")


def outcomes_of(folder: Path) -> list[Outcome]:
    return [Outcome.of(json.loads(line)) for line in (folder / "trials.jsonl").read_text().splitlines()]


def test_a_campaign_is_resumed_merged_and_told_as_in_simulated_cities(fly: Terminal, tmp_path: Path) -> None:
    whole, broken, shared = tmp_path / "whole", tmp_path / "broken", tmp_path / "shared"
    arguments = ("quarter.geojson", "--trials", 6, "--seed", 3, "--json", "--out")
    code, out, err = fly(*arguments, whole)
    assert code == 0
    assert "Note: quarter.geojson: the ground is taken from the floors of the buildings." in err
    told = json.loads(out)
    assert told["trials"] == 6
    assert told["configuration"]["map"] == "quarter.geojson"
    assert set(told["configuration"]["city"]) == {"file", "voxels", "origin"}
    assert (whole / "flights.png").read_bytes().startswith(b"\x89PNG")
    assert fly(*arguments, broken)[0] == 0
    rows = (broken / "trials.jsonl").read_text().splitlines(keepends=True)
    (broken / "trials.jsonl").write_text("".join(rows[:3]))
    assert fly(*arguments, broken)[1] == out
    for k in range(2):
        assert fly(*arguments, shared, "--shard", f"{k}/2")[0] == 0
    assert fly(*arguments, shared, "--merge")[1] == out
    for folder in (broken, shared):
        for name in ("trials.jsonl", "summary.json", "flights.png"):
            assert (folder / name).read_bytes() == (whole / name).read_bytes()
    _, text, _ = fly("quarter.geojson", "--trials", 6, "--seed", 3, "--out", whole)
    assert "quarter.geojson, seed 3, method field" in text

    quarter(tmp_path, HOUSES[:3])
    code, _, err = fly(*arguments, whole)
    assert code == 2
    assert "holds another campaign: city was" in err
    code, _, err = fly(*arguments, shared, "--merge")
    assert code == 2
    assert "a share of another campaign: city is" in err


def test_the_command_of_a_trial_flies_it_again(fly: Terminal, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    how = ("--spacing", 1.5, "--bounds", -70, -70, -2, 80, 60, 45, "--only", "building", "--wind", 2)
    assert fly("quarter.geojson", "--trials", 3, "--seed", 8, *how, "--out", "out")[0] == 0
    last = outcomes_of(tmp_path / "out")[-1]
    read = "--spacing 1.5 --bounds -70 -70 -2 80 60 45 --only building"
    expected = f"maxjax fly quarter.geojson {read} --seed 8 --trial 2 --wind 2"
    assert last.command == expected
    assert fly(*shlex.split(expected)[2:], "--out", "alone")[0] == 0
    assert (tmp_path / "alone" / "flight.gif").read_bytes().startswith(b"GIF89a")
    (alone,) = outcomes_of(tmp_path / "alone")
    assert (alone.trial, alone.start, alone.goal, alone.command) == (2, last.start, last.goal, last.command)
    # What a page flies again has the same world.
    given: list[Any] = []
    monkeypatch.setattr("maxjax.ui.cli.viewing_flights.watch", lambda world, config: given.append(world) or iter(()))
    name, ledger = open_folder(tmp_path / "out")
    where = where_flown(name, ledger)
    assert isinstance(where, GivenCity)
    again(last, where)
    np.testing.assert_array_equal(np.asarray(given[0].start), np.float32(last.start))
    assert given[0].geoms.position.shape == (where.slots + 1, 3)


def test_a_folder_is_viewed_with_the_file_that_it_was_flown_in(fly: Terminal, tmp_path: Path) -> None:
    assert fly("quarter.geojson", "--trials", 2, "--out", "out")[0] == 0
    name, ledger = open_folder(tmp_path / "out")
    where = where_flown(name, ledger)
    outcome = ledger.outcomes[1]
    city = city_of(where, outcome.city)
    assert caption(where, outcome).startswith("quarter.geojson, trial 1: ")
    assert city.grid.lower[2] == 0.0
    # The film's line is over the houses: nowhere in an occupied voxel of the page's map.
    line = ledger.positions()[1]
    index = np.floor((line - np.array(city.grid.lower)) / city.grid.spacing).astype(int)
    ends = index[[0, -1]]
    assert not city.occupied[tuple(ends.T)].any()
    assert film_of(outcome, line, city).duration > 0.0
    quarter(tmp_path, HOUSES[:2])
    with pytest.raises(ValueError, match=r"was flown in another quarter\.geojson than the one that is there now"):
        where_flown(name, ledger)
    (tmp_path / "quarter.geojson").unlink()
    with pytest.raises(ValueError, match="the path is the one that maxjax fly was given"):
        where_flown(name, ledger)


def test_given_ends_among_movers_are_one_flight(fly: Terminal, tmp_path: Path) -> None:
    among = ("--movers", 2, "--mover-speed", 4, "--mover-kind", "encounters")
    codes = {}
    for seed in range(9):
        if len(codes) == 2:
            break
        code, out, err = fly("quarter.geojson", *ENDS, *among, "--seed", seed, "--json", "--out", f"out{seed}")
        told = json.loads(out)
        codes[told["statuses"].popitem()[0]] = code
        assert ("IN_CONTACT: The vehicle touched" in err) == (code == 1)
        (outcome,) = outcomes_of(tmp_path / f"out{seed}")
        origin = np.array(told["configuration"]["city"]["origin"])
        np.testing.assert_allclose(np.array([outcome.start, outcome.goal]) + origin, [[30, 0, 8], [-30, 6, 9]])
        assert told["configuration"]["city"]["start"] == outcome.start
        assert outcome.command == (
            f"maxjax fly quarter.geojson --start 30 0 8 --goal -30 6 9 --seed {seed} "
            "--movers 2 --mover-speed 4 --mover-kind encounters"
        )
        assert set(outcome.flagged or {}) >= {"TRAPPED", "BOUND"}
    assert codes == {"OK": 0, "IN_CONTACT": 1}


def test_movers_without_any_free_way_are_counted(fly: Terminal, tmp_path: Path) -> None:
    """A jib of 12 m and more has no room in a shaft of 15 m, and all around is solid as far as movers are drawn."""
    occupied = np.ones((51, 51, 20), bool)
    occupied[24:27, 24:27] = False
    np.savez(tmp_path / "shaft.npz", occupied=occupied, spacing=5.0, origin=np.array([2.5, 2.5, 2.5]))
    ends = ("--start", 125, 125, 4, "--goal", 130, 130, 50)
    code, out, _ = fly("shaft.npz", *ends, "--movers", 1, "--mover-kind", "cranes", "--mover-speed", 3, "--json")
    assert code in (0, 1)
    assert json.loads(out)["movers"]["hidden"] == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("quarter.geojson", *ENDS, "--movers", 2, "--trials", 3), "--trials: goes with ends that are drawn"),
        (("quarter.geojson", *ENDS, "--movers", 2, "--trial", 3), "--trial: goes with ends that are drawn"),
        (("quarter.geojson", *ENDS, "--trials", 3), "--trials: goes with trials, not with --start and --goal"),
        (("quarter.geojson", "--start", 0, 0, 5, "--movers", 3), "--start and --goal: expected both or none"),
        (
            ("quarter.geojson", *ENDS, "--movers", 2, "--margin", 2),
            "--margin: needs --start and --goal, a map to fly in and no",
        ),
        (("quarter.geojson", "--trials", 2, "--radius", 2), "--radius: needs --start and --goal"),
        (
            ("quarter.geojson", "--trials", 2, "--fleet", 4),
            "--fleet: flies in midtown, downtown, suburb, given the file",
        ),
        (("quarter.geojson", "--trials", 2, "--spacing", -1), "spacing: expected metres"),
        (("quarter.geojson", "--trials", 2, "--spacing", 0.1), "give --bounds, or a --spacing of"),
        (("quarter.geojson", "--mover-speed", 3), "--mover-speed: needs --movers"),
        (
            ("quarter.geojson", "--start", 900, 0, 5, "--goal", 0, 0, 9, "--movers", 2),
            "--goal: expected one within 100 m",
        ),
        (
            ("quarter.geojson", *ENDS, "--bounds", 0, -60, 0, 90, 60, 40, "--movers", 2),
            "goal: expected a place in the map",
        ),
        (("none.geojson", "--trials", 2), "No such file"),
        (("empty.geojson", "--trials", 2), "empty.geojson"),
        (("suburb", "--spacing", 2), "--spacing: reads a file, and a simulated city is none"),
        (("suburb", "--unit", "ft"), "--unit: reads a file"),
        (("quarter.geojson", "--method", "nowhere_at_all:Mine"), "expected a module nowhere_at_all, found none"),
        (("suburb", "--method", "json:Mine"), "expected Mine in json, found no planner there"),
    ],
)
def test_what_cannot_be_flown_is_told(
    fly: Terminal, tmp_path: Path, arguments: tuple[object, ...], sentence: str
) -> None:
    (tmp_path / "empty.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    code, out, err = fly(*arguments, "--out", "out")
    assert (code, out) == (2, "")
    assert sentence in err
    assert not (tmp_path / "out").exists()


OWN = """
import dataclasses, jax.numpy as jnp, maxjax

@dataclasses.dataclass(frozen=True)
class OverTheRoofs:
    level: float = 20.0
    name: str = "over the roofs"
    batched: bool = True

    def route(self, problem):
        up, down = (end.at[2].set(self.level) for end in (problem.start, problem.goal))
        path = jnp.stack([problem.start, up, down, problem.goal])
        return maxjax.Route(path, problem.status, certified=jnp.array(False))
"""


def test_a_planner_of_ones_own_flies_and_its_command_flies_it_again(
    fly: Terminal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[Campaign] = []
    real = flying.fly_trials
    monkeypatch.setattr(flying, "fly_trials", lambda campaign, **how: given.append(campaign) or real(campaign, **how))
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "own_roofs.py").write_text(OWN)
    for place in ("quarter.geojson", "suburb"):
        out = tmp_path / place.partition(".")[0]
        assert fly(place, "--trials", 2, "--method", "own_roofs:OverTheRoofs", "--out", out)[0] == 0
        first = outcomes_of(out)[0]
        assert first.command == f"maxjax fly {place} --seed 0 --trial 0 --method own_roofs:OverTheRoofs"
        assert json.loads((out / "config.json").read_text())["campaign"]["method"] == "over the roofs"
        assert given[-1].config.planner == planner_named("own_roofs:OverTheRoofs")


@pytest.mark.large
def test_a_planner_of_ones_own_plans(
    capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    quarter(tmp_path)
    (tmp_path / "own_plans.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    plan = Terminal(capfd, "plan")
    code, out, _ = plan("quarter.geojson", *ENDS, "--method", "own_plans:OverTheRoofs", "--json", "--out", "plan")
    told = json.loads(out)
    assert (code, told["status"], told["method"]) == (0, "OK", "over the roofs")
    assert told["length"] > 60.0
    code, out, _ = plan("quarter.geojson", *ENDS, "--method", "own_plans:OverTheRoofs")
    assert code == 0
    assert "over the roofs" in out
