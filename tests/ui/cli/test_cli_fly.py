"""`maxjax fly`: what it prints and leaves behind, on flights that take no time; flights have tests of their own."""

from __future__ import annotations

import dataclasses
import inspect
import json
import os
import shlex
import shutil
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.core.status import Status
from maxjax.planning.path.route import Route
from maxjax.planning.problem.problem import Problem
from maxjax.sim.loop.flight import Flight, FlightConfig, FlightLog, World
from maxjax.sim.mapping.rolling_map import empty
from maxjax.sim.movers.among import Flag, Flags
from maxjax.sim.sensors.lidar import Scan
from maxjax.sim.trials import batches as module
from maxjax.sim.trials import cities, replay
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.trials import Trial
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.movers import Movers
from maxjax.sim.worlds.populations import Population
from maxjax.ui.cli import fly_command as flying
from maxjax.ui.cli import progress
from maxjax.ui.cli.fly_command import command_of
from maxjax.ui.cli.viewing_flights import again
from maxjax.ui.figures import campaign_figures as pictures
from maxjax.ui.methods import planner_named
from maxjax.ui.page.trial_folder import open_folder
from tests.scenes import house
from tests.ui.cli.terminal import Terminal

pytest.importorskip("matplotlib")


def fake_fly(
    geoms: Geoms,
    start: jax.Array,
    goal: jax.Array,
    key: jax.Array,
    config: FlightConfig,
    movers: Movers | None = None,
) -> FlightLog:
    """Every fourth trial, about, ends in contact half-way; a flag was up long before."""
    never = jnp.full(len(Flag), -jnp.inf)
    flags = Flags(0.1 * (jnp.arange(len(Flag)) == Flag.NEAR), jnp.float32(0.1), never.at[Flag.NEAR].set(0.5))
    touches = jax.random.uniform(key) < 0.25
    row = jnp.arange(41)
    position = start + (row / 40.0)[:, None] * (goal - start)
    return FlightLog(
        status=jnp.where(touches, Status.IN_CONTACT, Status.OK).astype(jnp.int32),
        position=jnp.where(((row > 20) & touches)[:, None], jnp.nan, position),
        flown_length=jnp.linalg.norm(goal - start),
        duration=jnp.float32(4.0),
        planning_iterations=jnp.int32(4),
        failed_plans=jnp.int32(0),
        clearance=jnp.float32(3.0),
        margin=jnp.full(4, 8.0),
        certified=jnp.int32(4),
        parts=() if movers is None else (flags,),
    )


def fake_fly_all(worlds: World, config: FlightConfig) -> FlightLog:
    """The flights above, a batch of them."""
    logs: FlightLog = jax.vmap(lambda *each: fake_fly(*each[:4], config, each[4]))(
        worlds.geoms, worlds.start, worlds.goal, worlds.key, worlds.movers
    )
    return logs


def fake_draw(name: str, seed: int, indices: Any) -> Trial:
    wanted = np.asarray(indices)
    ends = np.random.default_rng(seed).uniform(-60, 60, (100, 2, 3)).astype(np.float32)[wanted]
    ends[:, :, 2] = 10.0
    return Trial(
        jnp.asarray(ends[:, 0]),
        jnp.asarray(ends[:, 1]),
        jnp.asarray(seed + wanted // 50, jnp.int32),
        jnp.ones(len(wanted), bool),
        jnp.zeros(len(wanted), jnp.int32),
    )


def fake_watch(world: Any, config: FlightConfig) -> Iterator[Flight]:
    """Four planning periods of the flight above."""
    log = fake_fly(world.geoms, world.start, world.goal, world.key, config)
    points = jnp.concatenate([jnp.zeros((5, 3)), jnp.full((1, 3), jnp.nan)])
    for period in range(5):
        known = jnp.arange(41)[:, None] <= 10 * period
        flight = object.__new__(Flight)  # of its parts, those that pictures are made of
        flight.__dict__.update(
            scan=Scan(points, jnp.ones(6), jnp.arange(6) < 5),
            rolling_map=empty(world.start, (9, 9, 5), 2.0),
            path=jnp.broadcast_to(world.goal, (8, 3)).at[0].set(world.start),
            log=dataclasses.replace(log, position=jnp.where(known, log.position, jnp.nan)),
        )
        yield flight


# Compiled once, apart from that of real flights.
fake_part = jax.jit(inspect.unwrap(module._fly_part))


@pytest.fixture
def fly(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Terminal:
    monkeypatch.setattr(module, "_one_by_one", fake_part)
    monkeypatch.setattr(module, "fly_closed_loop", fake_fly)
    monkeypatch.setattr(module, "fly_all_closed_loop", fake_fly_all)
    monkeypatch.setattr(cities, "draw_many", fake_draw)
    monkeypatch.setattr(cities, "_city", lambda name, seed: house())
    monkeypatch.setattr(replay, "watch", fake_watch)
    monkeypatch.setattr(pictures, "make_scene", lambda name, seed: types.SimpleNamespace(geoms=house()))
    return Terminal(capfd, "fly")


def test_json_is_one_object_with_the_summary(fly: Terminal) -> None:
    code, out, err = fly("suburb", "--trials", 8, "--seed", 3, "--batch", 4, "--wind", 2, "--json")
    assert code == 0
    found = json.loads(out)
    assert found["trials"] == 8
    assert 0 < found["success_rate"] < 1
    assert found["collisions"] == len(found["failures"]) == 8 - found["successes"]
    assert set(found["flown_length"]) == set(found["planning_iterations"]) == {"mean", "std"}
    assert found["planning_iterations"] == {"mean": 4.0, "std": 0.0}
    assert found["configuration"]["disturbances"]["wind"] == 2
    assert found["configuration"]["map"] == "suburb"
    for failure in found["failures"]:
        assert failure["status"] == "IN_CONTACT"
        assert failure["command"] == f"maxjax fly suburb --seed 3 --trial {failure['index']} --wind 2"
    assert "8 of 8 trials" in err
    assert f"{found['successes']} arrived" in err


def test_the_table_says_the_same_and_how_to_fly_failures_again(fly: Terminal) -> None:
    _, out, _ = fly("suburb", "--trials", 8, "--seed", 3, "--batch", 4, "--json")
    found = json.loads(out)
    code, text, _ = fly("suburb", "--trials", 8, "--seed", 3, "--batch", 4)
    assert code == 0
    assert f"{found['successes']} of 8" in text
    for failure in found["failures"]:
        assert failure["command"] in text


def test_out_holds_lines_summary_and_picture_and_goes_on_where_it_was(fly: Terminal, tmp_path: Path) -> None:
    whole, broken = tmp_path / "new" / "whole", tmp_path / "broken"
    arguments = ("downtown", "--trials", 8, "--batch", 2, "--json", "--out")
    code, out, _ = fly(*arguments, whole)
    assert code == 0
    assert (whole / "summary.json").read_text() == out
    assert (whole / "flights.png").read_bytes().startswith(b"\x89PNG")
    assert not (whole / "flight.gif").exists()
    rows = (whole / "trials.jsonl").read_text().splitlines(keepends=True)
    assert [json.loads(row)["trial"] for row in rows] == list(range(8))

    assert fly(*arguments, broken)[0] == 0
    (broken / "trials.jsonl").write_text("".join(rows[:5]) + rows[5][:30])
    (broken / "summary.json").unlink()
    code, again, err = fly(*arguments, broken)
    assert (code, again) == (0, out)
    assert "5 of 8" in err or "8 of 8" in err
    for name in ("trials.jsonl", "summary.json", "config.json"):
        assert (broken / name).read_bytes() == (whole / name).read_bytes()
    assert fly(*arguments, broken)[1] == out

    code, _, err = fly("downtown", "--trials", 8, "--wind", 1, "--out", whole)
    assert code == 2
    assert "another campaign" in err


def test_flags_of_movers_are_told(fly: Terminal) -> None:
    arguments = ("suburb", "--trials", 8, "--batch", 4, "--movers", 2, "--mover-speed", 4, "--mover-kind", "encounters")
    code, out, _ = fly(*arguments, "--json")
    assert code == 0
    found = json.loads(out)
    assert found["configuration"]["movers"] == {"count": 2, "speed": 4.0, "kind": "encounters"}
    assert found["movers"]["contacts"] == found["movers"]["contacts_without_a_flag"] > 0
    assert found["movers"]["contacts"] + found["movers"]["contacts_with_walls"] == found["collisions"]
    assert found["movers"]["flagged_share"] == 0.025
    for failure in found["failures"]:
        assert failure["command"].endswith("--movers 2 --mover-speed 4 --mover-kind encounters")
    _, text, _ = fly(*arguments)
    for row in ("contacts with movers", "without a flag before"):
        (line,) = (line for line in text.splitlines() if row in line)
        assert line.split()[-2] == str(found["movers"]["contacts"])
    assert "2.50 %" in text
    assert "NEAR 0.8 s" in text
    assert "flagged" not in fly("suburb", "--trials", 2)[1]


@pytest.mark.large
def test_one_trial_is_filmed(fly: Terminal, tmp_path: Path) -> None:
    _, batch, _ = fly("suburb", "--trials", 8, "--json")
    for trial in (0, json.loads(batch)["failures"][0]["index"]):
        out = tmp_path / str(trial)
        code, text, _ = fly("suburb", "--trial", trial, "--out", out)
        assert code == 0
        assert (out / "flight.gif").read_bytes().startswith(b"GIF89a")
        assert (out / "flight.gif").stat().st_size < 6e6
        assert set(os.listdir(out)) >= {"summary.json", "trials.jsonl", "flights.png", "flight.gif"}
        (row,) = (out / "trials.jsonl").read_text().splitlines()
        _, alone, _ = fly("suburb", "--trial", trial, "--json")
        found = json.loads(alone)
        assert found["trials"] == 1
        assert json.loads(row)["status"] == ("OK" if found["successes"] else "IN_CONTACT")
        assert json.loads(row)["status"] in text


def test_the_time_left_is_that_of_batches_after_the_compiled_one(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = iter((0.0, 1.0, 61.0, 71.0, 3000.0))
    monkeypatch.setattr(progress, "time", types.SimpleNamespace(monotonic=lambda: next(clock)))
    with progress.tally(10) as tell:
        for done, arrived, computed in ((2, 1, 0), (2, 2, 2), (2, 2, 2), (4, 3, 4)):
            tell(done, arrived, computed)
    first, compiled, later, last = capfd.readouterr().err.splitlines()
    assert first == "0 of 10 trials ..."
    assert "4 of 10 trials, 3 arrived (75.0 %), about 3 min 03 s left" in compiled
    assert "6 of 10 trials, 5 arrived (83.3 %), about 20 s left" in later
    assert last == "10 of 10 trials, 8 arrived (80.0 %)"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["venice"], "midtown, downtown, suburb"),
        (["suburb:3"], "midtown, downtown, suburb"),
        (["suburb", "--trials", 0], "--trials: expected at least 1"),
        (["suburb", "--trials", -4], "--trials: expected at least 1"),
        (["suburb", "--trials", "many"], "many"),
        (["suburb", "--trial", -1], "--trial"),
        (["suburb", "--trial", 1, "--trials", 2], "given both"),
        (["suburb", "--batch", 0], "--batch"),
        (["suburb", "--seed", -1], "seed"),
        (["suburb", "--dropout", 1.5], "dropout: expected a number from 0 to 1"),
        (["suburb", "--dropout", -0.5], "dropout"),
        (["suburb", "--wind", -1], "wind"),
        (["suburb", "--noise", "nan"], "noise"),
        (["suburb", "--blackout", -1], "blackout"),
        (["suburb", "--drift", "inf"], "drift"),
        (["suburb", "--dead-sector", 400], "dead"),
        (["suburb", "--reactive", -2], "reactive"),
        (["suburb", "--method", "magic"], "magic"),
        (["suburb", "--movers", 0], "movers: expected 1 to 256, given 0"),
        (["suburb", "--movers", 3, "--mover-speed", 0], "speed of movers: expected above 0"),
        (["suburb", "--movers", 3, "--mover-kind", "bats"], "kind of movers: expected one of drones, birds, cars"),
        (["suburb", "--mover-speed", 3], "--mover-speed: needs --movers"),
        (["suburb", "--start", 0, 0, 5, "--goal", 9, 9, 5, "--movers", 3], "--movers: goes with trials"),
        (["suburb", "--shard", "0/2"], "--shard: expected --out"),
        (["suburb", "--shard", "2/2", "--out", "none"], "shard: expected K/N with K from 0 to N - 1, given 2/2"),
        (["suburb", "--shard", "0/2", "--merge", "--out", "none"], "--shard and --merge: expected one of them"),
        (["suburb", "--merge", "--trial", 3, "--out", "none"], "--merge: goes with --trials"),
        (["suburb", "--merge", "--out", "none"], "expected folders of shares"),
        (["suburb", "--start", 0, 0, 5, "--goal", 9, 9, 5, "--shard", "0/2"], "--shard: goes with trials"),
    ],
)
def test_unusable_arguments_end_with_2_and_a_sentence(fly: Terminal, arguments: list[object], sentence: str) -> None:
    code, out, err = fly(*arguments)
    assert code == 2
    assert not out
    assert sentence in err


def test_shares_are_merged_into_what_one_process_leaves(fly: Terminal, tmp_path: Path) -> None:
    one, out = tmp_path / "one", tmp_path / "out"
    arguments = ("downtown", "--trials", 3, "--seed", 3, "--json", "--out")
    _, expected, _ = fly(*arguments, one)
    for k in range(4):
        code, text, err = fly(*arguments, out, "--shard", f"{k}/4")
        assert code == 0
        # The share of one of four processes is empty, as there are three trials.
        assert (text == "" and "has none to fly" in err) or json.loads(text)["trials"] == 1
    assert not list(out.glob("shards/*/flights.png"))
    code, text, _ = fly(*arguments, out, "--merge")
    assert (code, text) == (0, expected)
    assert (out / "flights.png").read_bytes() == (one / "flights.png").read_bytes()
    shown, ledger = open_folder(out)
    assert (shown, sorted(ledger.outcomes)) == ("downtown", [0, 1, 2])
    shutil.rmtree(out / "shards" / "3-of-4")
    (out / "trials.jsonl").unlink()
    code, text, err = fly(*arguments, out, "--merge")
    assert (code, text) == (1, "")
    assert "1 of 3 trials are missing in 2 shares: 2;" in err


def test_a_folder_that_cannot_be_written_is_found_out_first(fly: Terminal, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code, _, err = fly("suburb", "--trials", 2, "--out", tmp_path / "file" / "below")
    assert code == 2
    assert "cannot be written" in err


def test_a_replay_command_flies_the_same_campaign(fly: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[Campaign] = []

    def note(campaign: Campaign, **_: Any) -> Iterator[Any]:
        given.append(campaign)
        return iter(())

    monkeypatch.setattr(flying, "fly_trials", note)
    config = FlightConfig(
        Disturbances(10.0, 0.2, 0.5, 90.0, 1.0, 1.0, 1.0), planner=planner_named("astar"), snapshot=True, reactive=2.5
    )
    for campaign in (
        Campaign("downtown", 7, range(37, 38), config=config, command=command_of),
        Campaign("suburb", 0, range(5, 6), config=FlightConfig(planner=planner_named("field")), command=command_of),
        Campaign("midtown", 1, range(2, 3), config=config, movers=Population(30, 7.5, "mixed"), command=command_of),
    ):
        assert fly(*shlex.split(command_of(campaign, campaign.trials[0]))[2:], "--json")[0] == 0
        assert given[-1].configuration() == campaign.configuration()
        assert given[-1].config.planner == campaign.config.planner


@dataclasses.dataclass(frozen=True)
class Stranger:
    """A planner that the command line does not know."""

    name: str = "hop"
    batched: bool = True

    def route(self, problem: Problem) -> Route:
        raise AssertionError("it is named, and flies nothing")


@pytest.mark.parametrize(
    ("config", "told"),
    [
        (FlightConfig(planner=Stranger()), "planner"),
        (FlightConfig(planner=Stranger("field")), "planner"),
        (FlightConfig(planner=planner_named("field"), shape=(51, 51, 41), plans=7), "shape, plans"),
        (FlightConfig(planner=planner_named("field"), stages=()), "stages"),
    ],
)
def test_no_command_is_told_that_would_fly_otherwise(config: FlightConfig, told: str) -> None:
    command = command_of(Campaign("suburb", 0, range(1), config=config), 0)
    assert command == f"# flown from Python: no command line flies it again, which cannot give its {told}"
    # Pasted into a shell it does nothing.
    assert shlex.split(command, comments=True) == []
    with pytest.raises(ValueError, match=f"trial 3: it was flown from Python.*its {told}"):
        again(types.SimpleNamespace(trial=3, command=command))  # type: ignore[arg-type]


def test_merged_shares_without_positions_are_told_of(fly: Terminal, tmp_path: Path) -> None:
    arguments = ("suburb", "--trials", 6, "--batch", 2, "--out", tmp_path)
    for index in range(2):
        fly(*arguments, "--shard", f"{index}/2")
    next((tmp_path / "shards" / "1-of-2" / "positions").glob("*.npz")).unlink()
    code, _, err = fly(*arguments, "--merge")
    assert code == 0
    assert "lacks the positions of" in err
