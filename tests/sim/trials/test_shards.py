"""Campaigns in shares: whatever processes fly them, and whoever is killed, the merged folder is that of one process."""

from __future__ import annotations

import functools
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from maxjax.sim.trials import batches as module
from maxjax.sim.trials import cities
from maxjax.sim.trials import ledger as bookkeeping
from maxjax.sim.trials.batches import fly_trials
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.ledger import Ledger
from maxjax.sim.trials.shards import Shard, merge
from maxjax.sim.worlds.geoms import ground_plane
from maxjax.ui.cli.fly_command import runs
from tests.sim.trials.test_execution import BAD_DRAW, CALM, environment, fake_draw, fake_fly, flown, quick, windy  # noqa: F401

TRIALS = 11
WHOLE = Campaign("suburb", 0, range(TRIALS), config=windy(2.0))


def fly_shard(shard: Shard, out: Path, campaign: Campaign = WHOLE, **options: Any) -> None:
    share = Campaign(campaign.map, campaign.seed, shard.share(campaign.trials), config=campaign.config)
    flown(share, folder=shard.folder(out), **options)


def contents(folder: Path) -> dict[str, bytes]:
    """All that a campaign's folder has to hold, whoever flew it; times depend on the clock."""
    found = [path for path in folder.iterdir() if path.is_file()] + list((folder / bookkeeping.POSITIONS).iterdir())
    return {path.name: path.read_bytes() for path in found if path.name != bookkeeping.TIMES}


@pytest.mark.parametrize(("trials", "count"), [(1, 1), (11, 4), (100, 7), (3, 8), (10_000, 64)])
def test_shares_are_the_trials_each_once_and_of_nearly_one_size(trials: int, count: int) -> None:
    shares = [Shard(index, count).share(range(5, 5 + trials)) for index in range(count)]
    assert [trial for share in shares for trial in share] == list(range(5, 5 + trials))
    assert max(map(len, shares)) - min(map(len, shares)) <= 1
    assert Shard.of(f"{count - 1}/{count}") == Shard(count - 1, count)


@pytest.mark.parametrize("text", ["8/8", "-1/8", "0/0", "1", "1/", "1/2/3", "1.5/2", "9999999999/9999999999", ""])
def test_no_shard_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="expected K/N with K from 0 to N - 1"):
        Shard.of(text)


def test_runs_of_indices_as_text() -> None:
    assert runs([3, 4, 5, 9, 11, 12]) == "3 to 5, 9, 11 to 12"
    assert runs(range(0, 20, 2)) == "0, 2, 4, 6, 8, and others"


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("count", [1, 4])
def test_merged_shares_are_the_folder_of_one_process(tmp_path: Path, count: int) -> None:
    one, out = tmp_path / "one", tmp_path / "out"
    flown(WHOLE, batch=1, folder=one)
    for index in reversed(range(count)):
        fly_shard(Shard(index, count), out, batch=1)
    merged = merge(WHOLE, out)
    assert (merged.shards, merged.missing, merged.doubled) == (count, (), 0)
    assert contents(out) == contents(one)
    assert {time["first"] for time in Ledger.read(out).times()} == {time["first"] for time in Ledger.read(one).times()}
    # Once more changes nothing, and the folder is one that flights go on in: none is missing.
    assert merge(WHOLE, out) == merged
    assert flown(WHOLE, folder=out) == flown(WHOLE, folder=one)
    assert contents(out) == contents(one)


@pytest.mark.usefixtures("quick")
def test_missing_trials_are_told_and_nothing_is_written(tmp_path: Path) -> None:
    for index in (0, 1, 3):
        fly_shard(Shard(index, 4), tmp_path)
    rows = Shard(3, 4).folder(tmp_path) / bookkeeping.ROWS
    rows.write_bytes(rows.read_bytes()[:-5])  # a process that is writing, or was killed
    before = rows.read_bytes()
    merged = merge(WHOLE, tmp_path)
    assert merged.missing == (*Shard(2, 4).share(WHOLE.trials), TRIALS - 1)
    assert os.listdir(tmp_path) == ["shards"]
    assert rows.read_bytes() == before


@pytest.mark.usefixtures("quick")
def test_doubled_trials_are_counted_and_kept_once(tmp_path: Path) -> None:
    one, out = tmp_path / "one", tmp_path / "out"
    flown(WHOLE, batch=3, folder=one)
    for shard in (Shard(0, 2), Shard(1, 2), Shard(1, 4)):
        fly_shard(shard, out, batch=3)
    merged = merge(WHOLE, out)
    assert merged.doubled == len(Shard(1, 4).share(WHOLE.trials))
    assert (out / bookkeeping.ROWS).read_bytes() == (one / bookkeeping.ROWS).read_bytes()
    found, expected = Ledger.read(out).positions(), Ledger.read(one).positions()
    assert sorted(found) == sorted(expected) == [trial for trial in range(TRIALS) if trial != BAD_DRAW]
    for trial, position in expected.items():
        np.testing.assert_array_equal(found[trial], position)


def change(file: Path, edit: Callable[[dict[str, Any]], None]) -> None:
    content = json.loads(file.read_text().splitlines()[0] if file.suffix == ".jsonl" else file.read_text())
    edit(content)
    rest = file.read_text().splitlines()[1:] if file.suffix == ".jsonl" else []
    file.write_text("\n".join([json.dumps(content), *rest]) + "\n")


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize(
    ("file", "edit", "sentence"),
    [
        (bookkeeping.CONFIG, lambda c: c["campaign"].update(seed=5), "another campaign: seed is 5 there, 0 here"),
        (bookkeeping.CONFIG, lambda c: c["campaign"].update(method="astar"), "another campaign: method"),
        (bookkeeping.CONFIG, lambda c: c["flown_by"][0].update(sources="0"), "other sources or versions than .*0-of-2"),
        (bookkeeping.CONFIG, lambda c: c["flown_by"][0]["versions"].update(jax="1"), "other sources or versions"),
        (bookkeeping.CONFIG, lambda c: c.update(flown_by=[]), "other sources or versions"),
        (bookkeeping.ROWS, lambda row: row.update(status="OUT_OF_PLANS", trial=0), "trial 0 ended otherwise than"),
        (bookkeeping.ROWS, lambda row: row.update(trial=77), "trial 77, which is not of this campaign"),
    ],
)
def test_shares_that_do_not_belong_together_are_refused(
    tmp_path: Path, file: str, edit: Callable[[dict[str, Any]], None], sentence: str
) -> None:
    for index in range(2):
        fly_shard(Shard(index, 2), tmp_path)
    change(Shard(1, 2).folder(tmp_path) / file, edit)
    with pytest.raises(ValueError, match=sentence):
        merge(WHOLE, tmp_path)
    assert os.listdir(tmp_path) == ["shards"]


@pytest.mark.usefixtures("quick")
def test_what_the_folder_holds_already_has_to_agree(tmp_path: Path) -> None:
    flown(WHOLE, folder=tmp_path)
    with pytest.raises(ValueError, match="found none"):
        merge(WHOLE, tmp_path)
    fly_shard(Shard(0, 2), tmp_path)
    assert merge(WHOLE, tmp_path).missing == ()
    change(tmp_path / bookkeeping.CONFIG, lambda content: content["flown_by"][0].update(sources="0"))
    with pytest.raises(ValueError, match="other sources"):
        merge(WHOLE, tmp_path)


@pytest.mark.usefixtures("quick")
def test_two_processes_do_not_fly_into_one_folder(tmp_path: Path) -> None:
    flying = fly_trials(WHOLE, batch=1, folder=tmp_path)
    next(flying)
    with pytest.raises(ValueError, match="another process flies into it"):
        next(fly_trials(WHOLE, batch=1, folder=tmp_path))
    flying.close()
    assert len(flown(WHOLE, batch=1, folder=tmp_path)) == TRIALS


# --- Processes. ---

COMMAND = ("fly", "suburb", "--trials", str(TRIALS), "--batch", "1", "--wind", "2")


def _maxjax(stuck: int) -> int:
    """The command line with flights that take no time, but for the one that never ends."""
    from maxjax.ui.cli import main

    def slow(real: Callable[..., Any], campaign: Campaign, drawn: Any, rows: Any, *rest: Any) -> Any:
        while campaign.trials[rows[0]] == stuck:
            time.sleep(0.1)
        return real(campaign, drawn, rows, *rest)

    module.fly_batch = functools.partial(slow, module.fly_batch)
    module.fly_closed_loop, cities.draw_many = fake_fly, fake_draw
    cities._city = lambda name, seed: ground_plane()
    module._one_by_one = module._fly_part
    return main()


def start(*arguments: object, stuck: int = -1, **variables: str) -> subprocess.Popen[str]:
    command = [sys.executable, __file__, str(stuck), *COMMAND, *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen(command, env={**environment(), **variables}, text=True, **pipes)


def ended(process: subprocess.Popen[str], code: int = 0) -> tuple[str, str]:
    out, err = process.communicate(timeout=120)
    assert process.returncode == code, err
    return out, err


@pytest.mark.large
def test_four_processes_one_of_them_killed_and_started_again(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    one, out = tmp_path / "one", tmp_path / "out"
    share = Shard(2, 4).share(range(TRIALS))
    stuck = share[-1]
    shards = [start("--shard", f"{k}/4", "--out", out, stuck=stuck if k == 2 else -1) for k in range(4)]
    alone = start("--out", one)
    for k in (0, 1, 3):
        ended(shards[k])
    rows = Shard(2, 4).folder(out) / bookkeeping.ROWS
    limit = time.monotonic() + 60.0
    while not rows.exists() or rows.read_bytes().count(b"\n") < len(share) - 1:
        assert shards[2].poll() is None
        assert time.monotonic() < limit
        time.sleep(0.05)
    shards[2].kill()
    shards[2].communicate()
    ended(alone)

    _, err = ended(start("--merge", "--out", out), code=1)
    assert re.search(rf"1 of {TRIALS} trials are missing in 4 shares: {stuck};", err)
    assert os.listdir(out) == ["shards"]
    ended(start("--shard", "2/4", "--out", out))
    text, _ = ended(start("--merge", "--out", out, "--json"))
    assert json.loads(text) == json.loads((one / "summary.json").read_text())
    assert contents(out) == contents(one)


@pytest.mark.large
def test_the_processes_of_a_job_merge_by_themselves(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    one, out = tmp_path / "one", tmp_path / "out"
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{free.getsockname()[1]}"
    variables = {"JAX_COORDINATOR_ADDRESS": address, "JAX_NUM_PROCESSES": "2"}
    job = [start("--distributed", "--out", out, "--json", **variables, JAX_PROCESS_ID=str(k)) for k in range(2)]
    texts = [ended(process)[0] for process in job]
    ended(start("--out", one))
    assert texts == [(one / "summary.json").read_text(), ""]
    assert contents(out) == contents(one)
    shutil.rmtree(out)
    _, err = ended(start("--distributed", "--out", out), code=2)
    assert "expected a job of Slurm, Kubernetes or Open MPI, or JAX_COORDINATOR_ADDRESS" in err


if __name__ == "__main__":
    stuck = int(sys.argv.pop(1))
    sys.exit(_maxjax(stuck))
