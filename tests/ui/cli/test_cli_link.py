"""`maxjax fly MISSION --autopilot URL`: what it refuses, prints and leaves behind; flights have tests of their own."""

from __future__ import annotations

import json
import os
import signal
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pymavlink", reason="needs pymavlink (extra dev)")

from benchmarks.common.link_course import EARTH, GROUND, PATH, trajectory
from maxjax.core.interruption import ending_by
from maxjax.link.flight_log import Look
from maxjax.link.flight_task import Company, FlightTask
from maxjax.link.session import LinkFlight
from maxjax.ui.cli import link_command as command
from maxjax.ui.cli import main

pytest.importorskip("matplotlib")

ADDRESS = "udp://127.0.0.1:14550"


def looks(remark: str = "") -> tuple[Look, ...]:
    points = [PATH[0] + [k, 0.2 * k, 0.0] for k in range(4)]
    return tuple(
        Look(0.05 * k, "follow", "GUIDED", True, point, PATH[0] + [k, 0.0, 0.0], 1.0, 7.0, 80, remark)
        for k, point in enumerate(points)
    )


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> tuple[list[FlightTask], list[LinkFlight]]:
    """Tasks that were flown, and how the next one ends; planning takes no time."""
    tasks, ends = list[FlightTask](), [LinkFlight(looks())]

    async def fly(task: FlightTask, company: Company) -> LinkFlight:
        tasks.append(task)
        company.tell("follows")
        (task.out / "flight.csv").write_text("rows")
        return ends[0]

    given = types.SimpleNamespace(
        earth=EARTH,
        terrain=types.SimpleNamespace(at=lambda *_: GROUND),
        task=types.SimpleNamespace(starts=PATH[:1]),
    )
    monkeypatch.setattr(command, "fly_task", fly)
    monkeypatch.setattr(command.mission, "plan_request", lambda _: (trajectory().plan, given))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "way.toml").write_text(
        'map = "downtown:0"\n[[waypoint]]\nat = [0, 0, 5]\n[[waypoint]]\nat = [9, 0, 5]\n'
    )
    return tasks, ends


def test_it_flies_writes_and_says(
    flown: tuple[list[FlightTask], list[LinkFlight]], capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["fly", "way.toml", "--autopilot", ADDRESS, "--setpoints", "--arm", "--tolerance", "1.5", "--out", "out"]
    assert main(words) == 0
    (task,) = flown[0]
    assert (task.arm, task.setpoints, task.tolerance, task.system, task.address) == (True, True, 1.5, 1, ADDRESS)
    content = json.loads(Path("out/flight.json").read_text())
    assert content["ended"]
    assert content["error_greatest"] == pytest.approx(0.6)
    assert Path("out/flight.png").stat().st_size > 10_000
    assert "The vehicle flew to its goal." in capsys.readouterr().out


def test_nothing_is_armed_by_default_and_the_log_has_a_folder(
    flown: tuple[list[FlightTask], list[LinkFlight]], capsys: pytest.CaptureFixture[str]
) -> None:
    flown[1][0] = LinkFlight(())
    assert main(["fly", "way.toml", "--autopilot", ADDRESS]) == 0
    assert not flown[0][0].arm
    assert {file.name for file in Path("maxjax-flight").iterdir()} == {"flight.csv", "flight.json"}
    assert "nothing was armed; --arm flies it" in capsys.readouterr().out


@pytest.mark.parametrize(("interrupted", "code"), [(False, 1), (True, 130)])
def test_what_ended_it_goes_to_stderr(
    flown: tuple[list[FlightTask], list[LinkFlight]], capsys: pytest.CaptureFixture[str], interrupted: bool, code: int
) -> None:
    flown[1][0] = LinkFlight(looks("telemetry: lost"), "telemetry: lost", interrupted)
    assert main(["fly", "way.toml", "--autopilot", ADDRESS, "--arm", "--json"]) == code
    told = capsys.readouterr()
    assert "telemetry: lost" in told.err
    assert json.loads(told.out)["message"] == "telemetry: lost"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["way.toml", "--arm"], "--arm: needs --autopilot"),
        (["downtown", "--tolerance", "2"], "--tolerance: needs --autopilot"),
        (["way.toml", "--autopilot", "arducopter"], "--autopilot: expected udp://127.0.0.1:14550"),
        (["downtown", "--autopilot", ADDRESS], "expected a mission's TOML file to fly, given downtown"),
        (["way.toml", "--autopilot", ADDRESS, "--wind", "3"], "--wind: does nothing with --autopilot"),
        (["way.toml", "--autopilot", ADDRESS, "--system", "0"], "--system: expected a MAVLink system, 1 to 255"),
        (["way.toml", "--autopilot", ADDRESS, "--trials", "3"], "--trials: does nothing with --autopilot"),
    ],
)
def test_options_that_do_nothing_are_refused(
    flown: tuple[list[FlightTask], list[LinkFlight]],
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    assert main(["fly", *words]) == 2
    assert said in capsys.readouterr().err
    assert flown[0] == []


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="needs the signals of Unix")
def test_signals_end_a_flight_by_an_action_and_keep_their_meaning_afterwards() -> None:
    heard: list[Any] = []
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    with ending_by(lambda: heard.append(1)):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(os.getpid(), number)
    assert np.sum(heard) == 3
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before
