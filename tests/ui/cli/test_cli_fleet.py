"""`maxjax fly --fleet`: what it prints and leaves behind, of a fleet that takes no time."""

from __future__ import annotations

import json
import types
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.core.status import Status
from maxjax.sim.loop.flight import FlightConfig, FlightLog, World
from maxjax.sim.movers.among import Flag, Flags
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.swarm.swarm_flight import SwarmLog
from maxjax.sim.swarm.together import Together
from maxjax.sim.trials import swarm_trials as drawing
from maxjax.sim.trials.swaps import Swaps, antipodal
from maxjax.ui.cli import fleet_command as fleets
from maxjax.ui.figures import campaign_figures as pictures
from tests.scenes import house
from tests.ui.cli.terminal import Terminal

pytest.importorskip("matplotlib")


def swaps(name: str, seed: int, count: int) -> Swaps:
    del name, seed
    ends = antipodal(count, 40.0, sphere=False)
    above = np.array([0.0, 0.0, 10.0])
    return Swaps(ends.start + above, ends.goal + above)


def flown(worlds: World, config: FlightConfig, together: Together) -> SwarmLog:
    """Vehicles 1 and 2 touch half-way, the last one rests at its start for half a minute, the others arrive."""
    assert together.delay == 0.2
    assert config.extension(Avoidance).choice == together.motions()
    count = len(worlds.start)
    share = jnp.linspace(0.0, 1.0, 301)[:, None]
    position = worlds.start[:, None] + share * (worlds.goal - worlds.start)[:, None]
    position = position.at[1:3, 150:].set(jnp.nan).at[-1].set(worlds.start[-1])
    status = jnp.zeros(count, jnp.int32).at[1:3].set(Status.IN_CONTACT).at[-1].set(Status.OUT_OF_PLANS)
    some, none = jnp.ones(count), jnp.zeros(count, jnp.int32)
    flags = Flags(jnp.zeros((count, len(Flag))), 0.0 * some, jnp.full((count, len(Flag)), -jnp.inf))
    log = FlightLog(status, position, 80.0 * some, 30.0 * some, none, none, 3.0 * some, some[:, None], none,
                    parts=(flags,))  # fmt: skip
    touched = jnp.full(count, -1).at[1].set(2).at[2].set(1)
    return SwarmLog(log, some.at[1:3].set(-0.01), touched, none + 9, none + 1)


@pytest.fixture
def fly(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Terminal:
    monkeypatch.setattr(fleets, "fly_swarm_in_stages", flown)
    monkeypatch.setattr(drawing, "city_swaps", swaps)
    for module in (drawing, pictures):
        monkeypatch.setattr(module, "make_scene", lambda name, seed: types.SimpleNamespace(geoms=house()))
    return Terminal(capfd, "fly")


def test_json_tells_what_became_of_every_vehicle(fly: Terminal) -> None:
    code, out, _ = fly("downtown", "--fleet", 6, "--delay", 0.2, "--json")
    assert code == 0
    content = json.loads(out)
    assert content["statuses"] == {"IN_CONTACT": 2, "OK": 3, "OUT_OF_PLANS": 1}
    assert (content["arrived"], content["contacts"], content["contacts_with_others"]) == (3, 2, 0)
    assert content["deadlocked"] == 1
    assert content["dropped_share"] == 0.1
    assert [vehicle["touched"] for vehicle in content["vehicles"]] == [None, 2, 1, None, None, None]
    first, second = content["vehicles"][:2]
    np.testing.assert_allclose(first["start"], second["goal"])


def test_the_table_names_who_did_not_arrive_and_the_folder_holds_picture_and_figures(
    fly: Terminal, tmp_path: Path
) -> None:
    code, out, _ = fly("downtown", "--fleet", 6, "--delay", 0.2, "--out", tmp_path / "flown")
    assert code == 0
    assert "IN_CONTACT 2, OK 3, OUT_OF_PLANS 1" in out
    assert "vehicle 1: IN_CONTACT with vehicle 2 after 30.0 s" in out
    assert "vehicle 5: OUT_OF_PLANS after 30.0 s" in out
    assert sorted(file.name for file in (tmp_path / "flown").iterdir()) == ["fleet.json", "flights.png"]
    assert json.loads((tmp_path / "flown" / "fleet.json").read_text())["fleet"] == 6


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["venice", "--fleet", 4], "map: expected one of midtown, downtown, suburb"),
        (["downtown", "--fleet", 1], "fleet: expected 2 vehicles or more, given 1"),
        (["downtown", "--fleet", 4, "--delay", -1], "delay: expected a finite number of seconds"),
        (["downtown", "--fleet", 4, "--trials", 3], "--trials: goes with trials of one vehicle"),
        (["downtown", "--fleet", 4, "--wind", -1], "wind: expected a number"),
        (["downtown", "--fleet", 4, "--seed", -1], "seed: expected 0 to"),
        (["downtown", "--delay", 0.1], "--delay: needs --fleet"),
        (["downtown", "--start", 0, 0, 5, "--goal", 9, 9, 5, "--fleet", 3], "--fleet: goes with trials"),
    ],
)
def test_unusable_fleets_end_with_2_and_a_sentence(
    capfd: pytest.CaptureFixture[str], arguments: list[object], sentence: str
) -> None:
    code, out, err = Terminal(capfd, "fly")(*arguments)
    assert code == 2
    assert not out
    assert sentence in err
