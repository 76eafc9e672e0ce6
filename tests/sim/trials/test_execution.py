"""The execution of campaigns. Its bookkeeping is tested on a flight that takes no time; what needs a process of its own
(real flights on two devices, an interrupt) is a program at the end of this file."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.errors import JaxRuntimeError

from maxjax.core.status import Status
from maxjax.sim.loop import flight, replan
from maxjax.sim.loop.flight import FlightConfig, FlightLog, World, take_off, watch
from maxjax.sim.movers.among import Flag, Flags
from maxjax.sim.movers.avoidance import Avoidance
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.trials import batch_size, cities
from maxjax.sim.trials import batches as module
from maxjax.sim.trials import campaign as campaign_module
from maxjax.sim.trials import ledger as bookkeeping
from maxjax.sim.trials.batches import fly_trials, world_of
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.outcomes import INVALID_DRAW, Outcome, summarise
from maxjax.sim.trials.trials import Trial
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.vehicle.quadrotor import Vehicle
from maxjax.sim.worlds.geoms import Geoms, concatenate, ground_plane
from maxjax.sim.worlds.movers import Movers, straight
from maxjax.sim.worlds.populations import Population
from maxjax.sim.worlds.solids import upright_boxes
from maxjax.ui.methods import planner_named
from tests.short_programs import shorten

# --- The bookkeeping, on flights along the straight line; some of them end badly. ---

BAD_DRAW = 5
PLANNER = planner_named("field")
CALM = FlightConfig(planner=PLANNER)


def windy(speed: float) -> FlightConfig:
    return FlightConfig(Disturbances(wind=speed), planner=PLANNER)


def fake_fly(geoms: Geoms, start: jax.Array, goal: jax.Array, key: jax.Array, config: FlightConfig) -> FlightLog:
    chance, noise = jax.random.uniform(key), jax.random.normal(jax.random.fold_in(key, 1), (20, 3))
    along = jnp.linspace(0.0, 1.0, 20)[:, None]
    position = start + along * (goal - start) + 0.1 * noise
    status = jnp.where(chance < 0.2, Status.IN_CONTACT, jnp.where(chance < 0.3, Status.OUT_OF_PLANS, Status.OK))
    steps = (5 + 20 * chance).astype(jnp.int32)
    row = jnp.arange(20)
    return FlightLog(
        status=status.astype(jnp.int32),
        position=jnp.where((row <= steps)[:, None], position, jnp.nan),
        flown_length=jnp.linalg.norm(goal - start) * (1 + chance),
        duration=0.1 * steps + config.disturbances.wind,
        planning_iterations=steps,
        failed_plans=jnp.int32(1),
        clearance=geoms.size[0, 2] + chance,
        margin=jnp.where(row < steps, 8.0 - 2.0 * (row % 2), jnp.nan),
        certified=(steps - 1).astype(jnp.int32),
    )


def fake_fly_all(worlds: World, config: FlightConfig, fly: Any = fake_fly) -> FlightLog:
    one = functools.partial(fly, config=config)
    return jax.vmap(one)(worlds.geoms, worlds.start, worlds.goal, worlds.key)


def fake_draw(name: str, seed: int, indices: range) -> Trial:
    wanted = np.asarray(indices)
    points = np.random.default_rng(seed).uniform(-50, 50, (1000, 2, 3)).astype(np.float32)[wanted]
    return Trial(
        jnp.asarray(points[:, 0]),
        jnp.asarray(points[:, 1]),
        jnp.asarray(seed + wanted // 3, jnp.int32),
        jnp.asarray(wanted != BAD_DRAW),
        jnp.asarray(wanted % 2, jnp.int32),
    )


# Compiled once for all tests, apart from the program of real flights.
fake_part = jax.jit(inspect.unwrap(module._fly_part))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_one_by_one", fake_part)
    monkeypatch.setattr(module, "fly_closed_loop", fake_fly)
    monkeypatch.setattr(module, "fly_all_closed_loop", fake_fly_all)
    monkeypatch.setattr(cities, "draw_many", fake_draw)
    monkeypatch.setattr(cities, "_city", lambda name, seed: ground_plane())


def flown(campaign: Campaign, **options: Any) -> list[Outcome]:
    return [outcome for some in fly_trials(campaign, **options) for outcome in some]


def files(folder: Path) -> dict[str, bytes]:
    """What has to be the same whatever happened on the way."""
    found = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    del found["times.json"]
    return found


@pytest.mark.usefixtures("quick")
def test_a_trial_alone_equals_the_same_in_a_batch() -> None:
    together = {outcome.trial: outcome for outcome in flown(Campaign("suburb", 3, range(10), config=CALM), batch=4)}
    assert sorted(together) == list(range(10))
    for trial in (0, 7, 9):
        (alone,) = flown(Campaign("suburb", 3, range(trial, trial + 1), config=CALM))
        assert alone == together[trial]
    assert len({outcome.duration for outcome in together.values()}) > 3


def test_on_a_cpu_each_flight_is_watched_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that one program serves batches of any size, and films."""
    watched: list[World] = []

    def fake_watch(world: World, config: FlightConfig) -> Iterator[Any]:
        watched.append(world)
        log = fake_fly(world.geoms, world.start, world.goal, world.key, config)
        yield SimpleNamespace(log=dataclasses.replace(log, planning_iterations=jnp.int32(0)))
        yield SimpleNamespace(log=log)

    monkeypatch.setattr(module, "watch", fake_watch)
    geoms = jax.tree.map(lambda x: jnp.stack([x] * 3), ground_plane())
    points, keys = jnp.arange(18.0).reshape(2, 3, 3), jax.vmap(jax.random.key)(jnp.arange(3))
    config = windy(2.0)
    found = module._fly_split((geoms, *points, keys), config, jax.devices()[:1])
    expected = jax.vmap(fake_fly, in_axes=(0, 0, 0, 0, None))(geoms, *points, keys, config)
    assert set(found) == {field.name for field in dataclasses.fields(FlightLog)} - {"parts"}
    for name, values in found.items():
        np.testing.assert_allclose(values, getattr(expected, name), rtol=1e-5)
    assert [world.disturbances for world in watched] == [config.disturbances] * 3


@pytest.mark.usefixtures("quick")
def test_another_map_or_seed_is_another_campaign() -> None:
    (one,), (two,), (three,) = (
        flown(Campaign(*which, config=CALM)) for which in (("suburb", 0), ("downtown", 0), ("suburb", 1))
    )
    assert len({one.flown_length, two.flown_length, three.flown_length}) == 3


@pytest.mark.usefixtures("quick")
def test_a_trial_without_ends_is_reported_and_not_flown() -> None:
    campaign = Campaign("suburb", 0, range(7), config=CALM)
    outcomes = {outcome.trial: outcome for outcome in flown(campaign, batch=2)}
    assert outcomes[BAD_DRAW].status == INVALID_DRAW
    assert outcomes[BAD_DRAW].start is None
    assert outcomes[BAD_DRAW].excluded == 1
    summary = summarise(list(outcomes.values()))
    assert (summary["trials"], summary["flown"], summary["invalid_draws"]) == (7, 6, 1)
    assert BAD_DRAW not in [failure["index"] for failure in summary["failures"]]
    (only,) = flown(Campaign("suburb", 0, range(BAD_DRAW, BAD_DRAW + 1), config=CALM))
    assert only == outcomes[BAD_DRAW]
    assert summarise([only])["success_rate"] is None


@pytest.mark.usefixtures("quick")
def test_the_summary_is_that_of_its_outcomes() -> None:
    campaign = Campaign("suburb", 0, range(30), config=CALM)
    outcomes = flown(campaign, batch=8)
    found = summarise(outcomes[::-1])
    arrived = [outcome for outcome in outcomes if outcome.status == "OK"]
    bad = [outcome for outcome in outcomes if outcome.status not in ("OK", INVALID_DRAW)]
    assert len(bad) > 2
    assert found["success_rate"] == len(arrived) / 29
    assert found["collisions"] == sum(outcome.status == "IN_CONTACT" for outcome in outcomes)
    for name in ("flown_length", "planning_iterations"):
        values = np.array([getattr(outcome, name) for outcome in arrived])
        np.testing.assert_allclose([found[name]["mean"], found[name]["std"]], [values.mean(), values.std()], atol=1e-4)
    assert [failure["index"] for failure in found["failures"]] == sorted(outcome.trial for outcome in bad)
    near = np.array([outcome.clearance for outcome in outcomes if outcome.status != INVALID_DRAW])
    nearest = found["clearance"]
    np.testing.assert_allclose(
        [nearest["least"], nearest["mean"], nearest["std"]], [near.min(), near.mean(), near.std()], atol=1e-4
    )
    ratio = [outcome.flown_length / np.linalg.norm(np.subtract(outcome.start, outcome.goal)) for outcome in arrived]
    np.testing.assert_allclose(found["detour"]["p95"], np.percentile(ratio, 95), atol=1e-3)
    for outcome in arrived:
        assert outcome.certified == 1.0
        assert sum(outcome.margins.values()) == min(outcome.planning_iterations, 20)
    json.dumps(found, allow_nan=False)


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("lines", [0, 1, 4, 6, 9])
@pytest.mark.parametrize("torn", [b"", b'{"trial": 7, "ci'])
def test_killed_and_resumed_leaves_the_same_files(tmp_path: Path, lines: int, torn: bytes) -> None:
    campaign = Campaign("suburb", 0, range(10), config=windy(3.0))
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    expected = flown(campaign, batch=4, folder=whole)
    shutil.copytree(whole, broken)
    rows = (broken / bookkeeping.ROWS).read_bytes().splitlines(keepends=True)
    (broken / bookkeeping.ROWS).write_bytes(b"".join(rows[:lines]) + torn)
    again = flown(campaign, folder=broken)
    assert files(broken) == files(whole)
    assert summarise(again) == summarise(expected)


@pytest.mark.usefixtures("quick")
def test_lost_positions_are_noticed_and_flown_again(tmp_path: Path) -> None:
    campaign = Campaign("suburb", 0, range(10), config=windy(3.0))
    said: list[str] = []
    flown(campaign, batch=4, folder=tmp_path, warn=said.append)
    whole = files(tmp_path)
    (tmp_path / bookkeeping.POSITIONS / "000004.npz").unlink()
    assert not said
    flown(campaign, folder=tmp_path, warn=said.append)
    (sentence,) = said
    assert "lacks the positions of 4 trials that flew, the first of them 4;" in sentence
    rows = (tmp_path / bookkeeping.ROWS).read_text().splitlines(keepends=True)
    lost = [row for row in rows if json.loads(row)["trial"] in (4, 6, 7, 8)]
    (tmp_path / bookkeeping.ROWS).write_text("".join(row for row in rows if row not in lost))
    flown(campaign, folder=tmp_path, warn=said.append)
    assert files(tmp_path)["positions/000004.npz"] == whole["positions/000004.npz"]
    assert len(said) == 1


@pytest.mark.usefixtures("quick")
def test_outcomes_of_other_sources_are_told_of_when_others_join_them(tmp_path: Path) -> None:
    campaign = Campaign("suburb", 0, range(6), config=windy(3.0))
    said: list[str] = []
    flown(campaign, batch=3, folder=tmp_path)
    flown(campaign, folder=tmp_path, warn=said.append)
    assert not said
    config = json.loads((tmp_path / bookkeeping.CONFIG).read_text())
    config["flown_by"][0]["sources"] = "0"
    (tmp_path / bookkeeping.CONFIG).write_text(json.dumps(config))
    rows = (tmp_path / bookkeeping.ROWS).read_text().splitlines(keepends=True)
    (tmp_path / bookkeeping.ROWS).write_text("".join(rows[:3]))
    flown(campaign, folder=tmp_path, warn=said.append)
    (sentence,) = said
    assert "of its 3 outcomes some were flown by other sources or versions (1 others)" in sentence
    assert len(json.loads((tmp_path / bookkeeping.CONFIG).read_text())["flown_by"]) == 2


@pytest.mark.usefixtures("quick")
def test_each_batch_is_on_the_disk_when_it_is_yielded(tmp_path: Path) -> None:
    campaign = Campaign("suburb", 0, range(9), config=CALM)
    run = fly_trials(campaign, batch=3, folder=tmp_path)
    yielded = [*next(run), *next(run)]
    run.close()
    kept = campaign.ledger(tmp_path)
    assert list(kept.outcomes.values()) == yielded
    assert sorted(kept.positions()) == sorted(outcome.trial for outcome in yielded if outcome.flown)
    np.testing.assert_allclose(kept.positions()[0][0], yielded[1].start, atol=0.5)
    fresh = flown(campaign, folder=tmp_path)
    assert sorted(outcome.trial for outcome in fresh) == list(range(9))


@pytest.mark.usefixtures("quick")
def test_a_folder_holds_one_campaign(tmp_path: Path) -> None:
    flown(Campaign("suburb", 0, range(2), config=CALM), folder=tmp_path)
    with pytest.raises(ValueError, match=r"another campaign: seed was 0 there, is 1 here"):
        flown(Campaign("suburb", 1, range(2), config=CALM), folder=tmp_path)
    with pytest.raises(ValueError, match=r"disturbances was .*choose another folder"):
        flown(Campaign("suburb", 0, range(2), config=windy(1.0)), folder=tmp_path)
    rows = tmp_path / bookkeeping.ROWS
    rows.write_text("nonsense\n" + rows.read_text())
    with pytest.raises(ValueError, match="line 1 is no outcome"):
        flown(Campaign("suburb", 0, range(2), config=CALM), folder=tmp_path)
    (tmp_path / bookkeeping.CONFIG).unlink()
    with pytest.raises(ValueError, match=r"no config\.json"):
        flown(Campaign("suburb", 0, range(2), config=CALM), folder=tmp_path)


@pytest.mark.usefixtures("quick")
def test_what_fills_up_a_batch_has_ended_before_it_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    campaign, real = Campaign("suburb", 0, range(2), config=CALM), module._fly_split
    starts: list[np.ndarray] = []

    def split(batch: Any, *others: Any) -> dict[str, np.ndarray]:
        starts.append(np.asarray(batch[1]))
        return real(batch, *others)

    monkeypatch.setattr(module, "_fly_split", split)
    logs = module.fly_batch(campaign, module.draw_trials(campaign), [0, 1], 4, jax.devices()[:1])
    assert all(len(values) == 2 for values in logs.values())
    (start,) = starts
    assert np.isfinite(start[:2]).all()
    assert np.isnan(start[2:]).all()
    world = world_of(campaign, module.draw_trials(campaign), 0)
    assert take_off(dataclasses.replace(world, start=jnp.asarray(start[2])), campaign.flight).done
    fit = dataclasses.replace(world, start=jnp.array([0.0, 0.0, 5.0]), goal=jnp.array([20.0, 0.0, 5.0]))
    assert not take_off(fit, campaign.flight).done


@pytest.mark.usefixtures("quick")
def test_a_batch_that_does_not_fit_is_halved_until_it_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign, most, real = Campaign("suburb", 0, range(9), config=CALM), 2, module.fly_batch
    expected = flown(campaign, batch=2)

    def small(campaign: Campaign, drawn: Any, rows: Any, size: int, devices: Any) -> dict[str, np.ndarray]:
        if size > most:
            raise JaxRuntimeError("RESOURCE_EXHAUSTED: Out of memory while trying to allocate 9 bytes.\nAnd so on.")
        return real(campaign, drawn, rows, size, devices)

    monkeypatch.setattr(module, "fly_batch", small)
    warnings: list[str] = []
    assert flown(campaign, batch=8, folder=tmp_path, warn=warnings.append) == expected
    assert [("8 flights" in one, "with 4" in one) for one in warnings] == [(True, True), (False, False)]
    assert all("does not fit" in one and "\n" not in one for one in warnings)
    assert campaign.ledger(tmp_path).batch == 2
    most = 0
    with pytest.raises(MemoryError, match="one flight does not fit"):
        flown(campaign, batch=8)


@pytest.mark.usefixtures("quick")
def test_a_batch_beyond_the_computers_memory_is_split_before_it_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batch_size, "free_memory", lambda device: 1e9 + 3 * 19.5e6 + 1)
    warnings: list[str] = []
    assert len(flown(Campaign("suburb", 0, range(5), config=CALM), batch=8, warn=warnings.append)) == 5
    assert "going on with 2" in warnings[-1]


@pytest.mark.parametrize(("free", "flights"), [(1e9, 0), (1e9 + 19.5e6, 1), (1e9 + 512 * 19.5e6, 512), (80e9, 46522)])
def test_memory_holds_many_flights_of_which_some_are_computed_at_a_time(free: float, flights: int) -> None:
    assert batch_size._fitting(free - 1e9 + 1, 101**3) == flights


# --- Movers. ---

HORIZON = 2.2  # of motions by default [s]


def fake_fly_among(
    geoms: Geoms, start: jax.Array, goal: jax.Array, key: jax.Array, config: FlightConfig, movers: Movers
) -> FlightLog:
    """As above, with a figure of its movers, and a flag a moment, one or four seconds before the end."""
    log = fake_fly(geoms, start, goal, key, config)
    assert config.has(Avoidance)
    last = jnp.full(len(Flag), -jnp.inf)
    ago = jnp.array([0.05, 1.0, 4.0, 4.0])[jax.random.randint(jax.random.fold_in(key, 2), (), 0, 4)]
    flags = Flags(jnp.arange(len(Flag)) / 10.0, 0.25 * log.duration, last.at[Flag.NEAR].set(log.duration - ago))
    touches = jnp.where(jax.random.uniform(key) < 0.6, Status.IN_CONTACT, Status.OK).astype(jnp.int32)
    return dataclasses.replace(log, status=touches, clearance=jnp.sum(movers.knots), parts=(flags,))


@pytest.fixture
def among(monkeypatch: pytest.MonkeyPatch, quick: None) -> None:
    def one_by_one(geoms: Any, start: Any, goal: Any, key: Any, config: FlightConfig, movers: Any) -> Any:
        return jax.vmap(lambda *each: fake_fly_among(*each[:4], config, each[4]))(geoms, start, goal, key, movers)

    monkeypatch.setattr(module, "_one_by_one", one_by_one)


@pytest.mark.usefixtures("among")
def test_movers_of_a_trial_depend_on_no_other_and_flags_reach_the_ledger(tmp_path: Path) -> None:
    campaign = Campaign("suburb", 0, range(10), config=CALM, movers=Population(3, 5.0, "encounters"))
    together = {outcome.trial: outcome for outcome in flown(campaign, batch=4, folder=tmp_path)}
    (alone,) = flown(dataclasses.replace(campaign, trials=range(7, 8)))
    assert alone == together[7]
    assert alone.clearance is not None
    world = module.world_of(campaign, module.draw_trials(campaign), 7)
    assert world.movers is not None
    np.testing.assert_allclose(alone.clearance, float(jnp.sum(world.movers.knots)), atol=2e-3)
    assert len({outcome.clearance for outcome in together.values()}) > 7

    kept = campaign.ledger(tmp_path).outcomes
    assert kept == together
    flown_ones = [outcome for outcome in kept.values() if outcome.flown]
    for outcome in flown_ones:
        assert outcome.flagged == {"BOUND": 0.0, "NEAR": 0.1, "DRIFTED": 0.2, "TRAPPED": 0.3, "CROWDED": 0.4}
        assert outcome.flagged_share == 0.25
        # Where both ends are too near to one another, no mover meets the way without being near an end.
        assert (outcome.hidden_movers == 3) == (outcome.clearance == -3000.0)
        assert (outcome.flagged_before is None) == (outcome.status != "IN_CONTACT")
    touched = {outcome.trial: outcome.touched for outcome in flown_ones if outcome.status == "IN_CONTACT"}
    ends = {trial: line[-1, 2] for trial, line in campaign.ledger(tmp_path).positions().items() if trial in touched}
    assert touched == {trial: "wall" if height <= CALM.radius else "mover" for trial, height in ends.items()}
    contacts = [outcome for outcome in flown_ones if outcome.touched == "mover"]
    unexplained = [outcome for outcome in contacts if not outcome.flagged_before]
    assert 0 < len(unexplained) < len(contacts)
    silent = [outcome for outcome in contacts if not outcome.flagged_at_contact]
    assert {outcome.trial for outcome in unexplained} < {outcome.trial for outcome in silent}
    found = summarise(list(kept.values()))["movers"]
    assert found["contacts_without_a_flag_at_the_moment"] == len(silent)
    before = [dataclasses.replace(outcome, flagged_at_contact=None) for outcome in kept.values()]
    assert summarise(before)["movers"]["contacts_without_a_flag_at_the_moment"] is None  # lines of older campaigns
    assert (found["contacts"], found["contacts_without_a_flag"]) == (len(contacts), len(unexplained))
    assert found["flagged_share"] == pytest.approx(0.25, abs=1e-4)
    assert found["flagged_seconds"]["NEAR"] == pytest.approx(0.1 * len(flown_ones))
    with pytest.raises(ValueError, match="another campaign: moving was"):
        dataclasses.replace(campaign, movers=Population(3, 6.0, "encounters")).ledger(tmp_path)
    with pytest.raises(ValueError, match="another campaign: movers was"):
        dataclasses.replace(campaign, movers=Population(4, 5.0, "encounters")).ledger(tmp_path)


@pytest.mark.parametrize(
    ("ago", "at_once", "before"),
    [(0.01, True, True), (0.1, True, True), (0.11, False, True), (1.99, False, True), (2.1, False, False)],
)
def test_a_flag_at_a_contact_is_one_of_the_look_before_it(ago: float, at_once: bool, before: bool) -> None:
    """The last look is at most 0.1 s before; its flags stay up until the next one."""
    campaign = Campaign("suburb", 0, range(1), config=CALM, movers=Population(3, 5.0, "encounters"))
    duration, last = np.float32(12.34), np.full(len(Flag), -np.inf, np.float32)
    last[Flag.TRAPPED] = duration - np.float32(ago)
    log = {"flags.seconds": np.zeros(len(Flag)), "flags.any_seconds": np.float32(0.1), "flags.last": last,
           "duration": duration, "status": np.int32(Status.IN_CONTACT), "to_walls": np.float32(9.0)}  # fmt: skip
    told = campaign_module._flags_of(campaign, log)
    assert (told["touched"], told["flagged_at_contact"], told["flagged_before"]) == ("mover", at_once, before)
    assert campaign_module._flags_of(campaign, log | {"status": np.int32(Status.OK)})["flagged_at_contact"] is None


def test_walls_that_are_touched_are_no_movers() -> None:
    """Three flights that ended over a plain: on the ground, in the air, before their first step."""
    position = np.full((3, 4, 3), np.nan, np.float32)
    position[0, :3], position[1, :4], position[2, :1] = [0.0, 0.0, 9.0], [1.0, 2.0, 7.0], [3.0, 0.0, 5.0]
    position[0, 2] = 0.0, 0.0, 0.5
    geoms = jax.tree.map(lambda x: jnp.stack([x] * 3), ground_plane())
    still = straight(ground_plane(), jnp.array([[0.0, 0.0, -1000.0]]), jnp.zeros((1, 3)))
    found = module.beside_movers({"position": position}, geoms, jax.tree.map(lambda x: jnp.stack([x] * 3), still))
    np.testing.assert_allclose(found["to_walls"], [0.5, 7.0, 5.0])
    np.testing.assert_array_equal(found["hidden"], [1, 1, 1])
    campaign = Campaign("suburb", 0, range(3), config=CALM, movers=Population(1))
    never = np.full((3, len(Flag)), -np.inf)
    logs = {
        **found, "position": position, "status": np.full(3, Status.IN_CONTACT), "duration": np.array([0.2, 0.3, 0.0]),
        "flags.seconds": 0.0 * np.isfinite(never), "flags.any_seconds": np.zeros(3), "flags.last": never,
        **{name: np.zeros(3, int) for name in ("planning_iterations", "failed_plans", "certified")},
        **{name: np.ones(3) for name in ("flown_length", "clearance")}, "margin": np.full((3, 1), np.nan),
    }  # fmt: skip
    drawn = {
        "start": position[:, 0], "goal": position[:, 0], "city": np.zeros(3, int), "excluded": np.zeros(3, int)
    }  # fmt: skip
    outcomes = [module.outcome_of(campaign, drawn, row, logs, row) for row in range(3)]
    assert [outcome.touched for outcome in outcomes] == ["wall", "mover", "mover"]
    told = summarise(outcomes)["movers"]
    assert (told["contacts"], told["contacts_without_a_flag"], told["contacts_with_walls"]) == (2, 2, 1)


@pytest.mark.usefixtures("quick")
def test_lines_without_movers_are_as_before(tmp_path: Path) -> None:
    campaign = Campaign("suburb", 0, range(3), config=CALM)
    outcomes = flown(campaign, folder=tmp_path)
    (first, *_) = (tmp_path / bookkeeping.ROWS).read_text().splitlines()
    assert list(json.loads(first))[-1] == "command"
    assert "movers" not in summarise(outcomes)


def test_no_batch_is_refused() -> None:
    with pytest.raises(ValueError, match="batch"):
        next(fly_trials(Campaign("suburb", config=CALM), batch=0))


# --- Real flights, in a process of their own. ---

# Coarse steps of physics and long periods: nearly all that such a flight costs is planning.
TINY = FlightConfig(
    planner=planner_named("astar"),
    shape=(25, 25, 11),
    spacing=4.0,
    lidar=Lidar(rays=4096, channels=32),
    vehicle=Vehicle(timestep=0.02),
    plans=40,
    period=2.0,
)
FAR_BELOW = -500.0
CASES = ("good", "start in a box", "goal in a box", "goal outside", "same", "empty scan", "maybe NaN", "way back")
EXPECTED = {
    "good": Status.OK,
    "start in a box": Status.START_OCCUPIED,
    "goal in a box": Status.GOAL_OCCUPIED,
    "goal outside": Status.GOAL_OUTSIDE_MAP,
    "same": Status.START_EQUALS_GOAL,
    "empty scan": Status.EMPTY_SCAN,
    "maybe NaN": Status.NONFINITE_INPUT,
    "way back": Status.OK,
}


def town() -> Geoms:
    rows = jnp.array([[0.0, 0.0, 4.0, 8.0, 0.0, 30.0, 0.2], [20.0, 22.0, 5.0, 5.0, 0.0, 25.0, 0.0]])
    return concatenate([ground_plane(), upright_boxes(rows)])


def cases(odd: tuple[float, float, float]) -> tuple[Geoms, jax.Array, jax.Array, jax.Array]:
    here, beyond, inside = (-22.0, 1.0, 8.0), (22.0, -1.0, 9.0), (0.0, 0.0, 5.0)
    ends = [
        (here, beyond),
        (inside, beyond),
        (here, inside),
        (here, (80.0, 0.0, 8.0)),
        (here, (-21.0, 1.0, 8.0)),
        (here, beyond),
        (odd, beyond),
        (beyond, here),
    ]
    city = town()
    hollow = dataclasses.replace(city, position=city.position.at[:, 2].add(FAR_BELOW))
    geoms = jax.tree.map(lambda *x: jnp.stack(x), *[hollow if case == "empty scan" else city for case in CASES])
    keys = jax.vmap(jax.random.key)(jnp.arange(len(CASES)))
    return geoms, *(jnp.array(points) for points in zip(*ends, strict=True)), keys


def settle(going: Any, step: Any, data: Any, state: Any, *, at_once: int) -> Any:
    """What `compile.batching.settle` means; it has tests of its own, and twice as much to compile under `vmap`."""
    return jax.lax.while_loop(lambda state: going(data, state), lambda state: step(data, state), state)


def settle_batch(going: Any, step: Any, data: Any, state: Any, *, at_once: int) -> Any:
    return jax.vmap(functools.partial(settle, going, step, at_once=at_once))(data, state)


def _real_flights(out: Path) -> None:
    """All cases on two devices, with and without a NaN, and one flight watched from the host.

    Without returns a flight ends after five plans: nobody needs to wait for twenty.
    """
    shorten()
    flight.settle, flight.settle_batch, replan._FAILURES = settle, settle_batch, 5
    module._one_by_one = module._fly_part  # as an accelerator flies them
    nan = float("nan")
    logs = {
        name: module._fly_split(cases(start), TINY, jax.devices())
        for name, start in (("nan", (-22.0, nan, 8.0)), ("fine", (-22.0, 3.0, 8.0)))
    }
    world = jax.tree.map(lambda x: x[0], cases((-22.0, 3.0, 8.0)))
    watched = list(watch(World(*world, TINY.disturbances), TINY))
    module.fly_closed_loop, module.fly_all_closed_loop = fake_fly, fake_fly_all
    cities.draw_many, cities._city = fake_draw, lambda name, seed: ground_plane()
    module._one_by_one = fake_part
    campaign = Campaign("suburb", 0, range(9), config=CALM)
    two, one = (flown(campaign, batch=3, devices=devices) for devices in (jax.devices(), jax.devices()[:1]))
    np.savez(
        out / "found.npz",
        devices=jax.device_count(),
        periods=len(watched) - 1,
        campaigns_agree=sorted(map(str, two)) == sorted(map(str, one)),
        alone=watched[-1].log.position,
        alone_status=watched[-1].log.status,
        **{f"{name}_{field}": values for name, log in logs.items() for field, values in log.items()},
    )


def environment(flags: str = "") -> dict[str, str]:
    """Of a process that runs this file, compiled as here (tests/conftest.py)."""
    root = Path(__file__).parents[3]
    paths = [str(root), *filter(None, [os.environ.get("PYTHONPATH")])]
    flags = " ".join(filter(None, [os.environ.get("XLA_FLAGS"), flags]))
    return {**os.environ, "XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu", "PYTHONPATH": os.pathsep.join(paths)}


def fly_elsewhere(out: Path) -> dict[str, np.ndarray]:
    """What `_real_flights` finds on two devices."""
    # Compiling is nearly all that this costs, and none of what is tested depends on LLVM's optimisations.
    flags = environment("--xla_force_host_platform_device_count=2 --xla_backend_optimization_level=0")
    command = [sys.executable, __file__, "real flights", str(out)]
    done = subprocess.run(command, env=flags, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    with np.load(out / "found.npz") as archive:
        return dict(archive)


@pytest.mark.large
def test_real_flights_in_a_batch_on_two_devices(tmp_path: Path) -> None:
    # One test, since several would each start the process anew where tests run in parallel.
    found = fly_elsewhere(tmp_path)
    assert found["devices"] == 2
    assert found["campaigns_agree"]

    # Bad ends and missing scans have statuses of their own, and nothing is planned between bad ends.
    assert {case: Status(code) for case, code in zip(CASES, found["nan_status"], strict=True)} == EXPECTED
    for case, iterations in zip(CASES, found["nan_planning_iterations"], strict=True):
        assert (iterations > 1) == (case in ("good", "empty scan", "way back"))

    # A NaN touches no other flight.
    odd = CASES.index("maybe NaN")
    others = [place for place in range(len(CASES)) if place != odd]
    for field in dataclasses.fields(FlightLog):
        if field.name == "parts":  # of flights among movers, and with faults
            continue
        with_nan, without = found[f"nan_{field.name}"], found[f"fine_{field.name}"]
        np.testing.assert_array_equal(with_nan[others], without[others])
    assert found["fine_planning_iterations"][odd] > 1

    # A flight that is stepped from the host equals itself in the batch, but for the rounding of two programs. Where two
    # plans are of one length, as here after five seconds, that may decide between them: then lengths are equal.
    assert found["alone_status"] == Status.OK
    assert found["periods"] > 5
    np.testing.assert_allclose(found["alone"][:50], found["fine_position"][0][:50], atol=0.02)
    steps = np.linalg.norm(np.diff(found["alone"], axis=0), axis=1)
    ahead = np.linalg.norm(np.diff(found["fine_position"][0], axis=0), axis=1)
    np.testing.assert_allclose(np.nansum(steps), np.nansum(ahead), rtol=2e-3)


# --- An interrupt, in a process of its own. ---

SLOW = Campaign("suburb", 0, range(10), config=CALM)


def _interrupted(folder: Path) -> None:
    """Batches of which the second takes minutes, all in the program that the first one compiled."""
    signal.signal(signal.SIGINT, signal.default_int_handler)

    def slow_fly(geoms: Geoms, start: jax.Array, goal: jax.Array, key: jax.Array, config: FlightConfig) -> FlightLog:
        log = fake_fly(geoms, start, goal, key, config)
        turns = jnp.where(jnp.all(start == fake_draw("suburb", 0, range(10)).start[6]), 2**31 - 1, 1)
        # Neither zero nor known to be one, so that no turn can be left out.
        turned = jax.lax.fori_loop(0, turns, lambda _, x: jnp.cos(x), log.flown_length)
        return dataclasses.replace(log, flown_length=log.flown_length + jnp.where(turned > 2.0, 1.0, 0.0))

    module.fly_closed_loop = slow_fly
    module.fly_all_closed_loop = functools.partial(fake_fly_all, fly=slow_fly)
    cities.draw_many, cities._city = fake_draw, lambda name, seed: ground_plane()
    module._one_by_one = module._fly_part
    try:
        for some in fly_trials(SLOW, batch=4, folder=folder):
            print(len(some), flush=True)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
        os._exit(130)


@pytest.mark.large
@pytest.mark.usefixtures("quick")
def test_an_interrupt_ends_a_running_batch_and_the_folder_goes_on(tmp_path: Path) -> None:
    folder, whole = tmp_path / "interrupted", tmp_path / "whole"
    command = [sys.executable, __file__, "interrupted", str(folder)]
    with subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert [process.stdout.readline() for _ in range(2)] == ["1\n", "4\n"]  # the trial without ends, a batch
        time.sleep(1.0)
        assert process.poll() is None
        sent = time.monotonic()
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read()
        assert process.wait() == 130
        assert time.monotonic() - sent < 2.0
    assert rest == "interrupted\n"
    lines = (folder / bookkeeping.ROWS).read_bytes()
    assert lines.endswith(b"\n")
    assert [json.loads(line)["trial"] for line in lines.splitlines()] == [BAD_DRAW, 0, 1, 2, 3]
    flown(SLOW, folder=folder)
    flown(SLOW, batch=4, folder=whole)
    assert files(folder) == files(whole)


if __name__ == "__main__":
    {"real flights": _real_flights, "interrupted": _interrupted}[sys.argv[1]](Path(sys.argv[2]))
