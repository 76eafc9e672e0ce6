"""Ctrl-C: every command ends with one sentence and code 130, and leaves whole files, whatever it was doing."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

SENTENCE = "maxjax: interrupted; all files are whole. `fly --out` and `train` go on from there when run again."
# A test runner in the background of a shell ignores interrupts, and its children would inherit that.
HEED = "import os, signal, sys; signal.signal(signal.SIGINT, signal.SIG_DFL); os.execv(sys.executable, sys.argv[1:])"
LIMIT = 20.0  # [s]


@dataclasses.dataclass(frozen=True)
class Ended:
    """A process that was interrupted: its exit code, what it wrote, and how long it took to end [s]."""

    code: int
    out: str
    lines: list[str]
    seconds: float


def environment(*, cached: bool) -> dict[str, str]:
    """Environment of a process that finds the modules of this one, and compiled programs if asked to.

    Compiled as for users: others take as long for it as theirs, and to draw trials takes longer than to compile it.
    """
    found = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "JAX_DISABLE_MOST_OPTIMIZATIONS": "0"}
    return found if cached else {**found, "JAX_COMPILATION_CACHE_DIR": ""}


def interrupt(
    arguments: Sequence[object], ready: Callable[[str], bool], wait: float = 0.0, *, cached: bool = False
) -> Ended:
    """Send SIGINT to a Python process some time after the first line on stderr that `ready` accepts."""
    command = [sys.executable, "-c", HEED, sys.executable, *map(str, arguments)]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, **pipes, text=True, env=environment(cached=cached)) as process:
        assert process.stderr is not None
        lines = []
        for line in process.stderr:
            lines.append(line)
            if ready(line):
                break
        else:
            pytest.fail("ended before it was interrupted: " + "".join(lines))
        time.sleep(wait)
        before = time.perf_counter()
        process.send_signal(signal.SIGINT)
        try:
            out, rest = process.communicate(timeout=LIMIT)
        except subprocess.TimeoutExpired:
            process.kill()
            pytest.fail(f"did not end within {LIMIT:g} s of the interrupt")
        seconds = time.perf_counter() - before
    lines = [line for line in "".join([*lines, rest]).splitlines() if not line.startswith("import time:")]
    return Ended(process.returncode, out, lines, seconds)


def assert_ended_by(ended: Ended) -> None:
    """Code 130 and one sentence behind the lines of progress; how long it took is printed, as machines differ."""
    print(f"ended {ended.seconds:.2f} s after the interrupt")
    assert ended.code == 130
    assert ended.out == ""
    known = re.compile(r".* \.\.\.|\d+ of \d+ trials, .* left")
    progress = [line for line in ended.lines[:-1] if known.fullmatch(line)]
    assert ended.lines == [*progress, SENTENCE]


@pytest.fixture
def town(tmp_path: Path) -> Path:
    occupied = np.zeros((40, 40, 20), bool)
    occupied[18:22, :30] = True
    np.savez(tmp_path / "town.npz", occupied=occupied, spacing=2.0)
    return tmp_path / "town.npz"


@pytest.mark.parametrize("module", ["numpy", "jax._src"])
def test_during_imports(module: str) -> None:
    ended = interrupt(["-X", "importtime", "-m", "maxjax", "check"], lambda line: module in line)
    assert_ended_by(ended)


@pytest.mark.parametrize(
    "wait", [pytest.param(0.5, marks=pytest.mark.nightly), 2.0, pytest.param(4.0, marks=pytest.mark.nightly)]
)
def test_during_the_compilation_of_a_plan(town: Path, tmp_path: Path, wait: float) -> None:
    out = tmp_path / "out"
    ends = ["--start", 10, 20, 10, "--goal", 70, 20, 10]
    ended = interrupt(["-m", "maxjax", "plan", town, *ends, "--out", out], lambda line: "Planning" in line, wait)
    assert_ended_by(ended)
    assert not out.exists()


def test_during_a_scan(tmp_path: Path) -> None:
    out = tmp_path / "out"
    scan = ["-m", "maxjax", "scan", "downtown:0", "--pose", 0, 0, 5, "--out", out]
    assert_ended_by(interrupt(scan, lambda line: "Scanning" in line))  # a scan takes less than a second
    assert not out.exists()


# The real command with short flights; from the second trial on, on request, they are a device program that never ends.
FLY = """
import sys
import jax
import jax.numpy as jnp
from maxjax.sim.trials import campaign, batches as execution
from maxjax.ui.cli import main
from maxjax.core.status import Status
from maxjax.ui.methods import planner_named
from maxjax.sim.loop.flight import FlightConfig
from maxjax.sim.loop.flight import FlightLog

def fly(geoms, start, goal, key, config):
    first = jnp.all(jax.random.key_data(key) == jax.random.key_data(jax.random.fold_in(campaign_key, 0)))
    turns = jnp.where(first | (not ENDLESS), 1, 2**31 - 2)
    _, spun = jax.lax.while_loop(
        lambda c: c[0] < turns, lambda c: (c[0] + 1, jnp.sin(c[1])), (0, jnp.ones((200, 200)))
    )
    along = jnp.linspace(0.0, 1.0, 41)[:, None]
    return FlightLog(
        status=jnp.where(jnp.isnan(spun.sum()), 1, jnp.int32(Status.OK)),
        position=start + along * (goal - start),
        flown_length=jnp.linalg.norm(goal - start),
        duration=jnp.float32(4.0),
        planning_iterations=jnp.int32(4),
        failed_plans=jnp.int32(0),
        clearance=jnp.float32(3.0),
        margin=jnp.full(4, 8.0),
        certified=jnp.int32(4),
    )

campaign_key = campaign.Campaign("suburb", config=FlightConfig(planner=planner_named("field"))).key
execution.fly_closed_loop, execution._one_by_one = fly, execution._fly_part
sys.exit(main())
"""


def test_during_a_flight_after_the_first_outcome_and_the_campaign_goes_on(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    out, whole = tmp_path / "out", tmp_path / "whole"
    arguments = ["fly", "suburb", "--trials", 3, "--batch", 1, "--out"]
    (tmp_path / "endless.py").write_text(FLY.replace("ENDLESS", "True"))
    (tmp_path / "short.py").write_text(FLY.replace("ENDLESS", "False"))
    rows = out / "trials.jsonl"

    def flown(_: str) -> bool:
        while not rows.exists():
            time.sleep(0.05)
        return True

    ended = interrupt([tmp_path / "endless.py", *arguments, out], flown, 1.0, cached=True)
    assert_ended_by(ended)
    assert sorted(os.listdir(out)) == ["config.json", "lock", "positions", "times.json", "trials.jsonl"]
    assert [json.loads(line)["trial"] for line in rows.read_text().splitlines()] == [0]
    for name in ("config.json", "times.json"):
        json.loads((out / name).read_text())
    assert [file.suffix for file in (out / "positions").iterdir()] == [".npz"]

    for folder in (out, whole):
        command = [sys.executable, tmp_path / "short.py", *map(str, arguments), folder]
        subprocess.run(command, check=True, capture_output=True, env=environment(cached=True))
    for name in ("trials.jsonl", "summary.json"):
        assert (out / name).read_bytes() == (whole / name).read_bytes()


def test_files_being_written_are_finished_or_removed(tmp_path: Path) -> None:
    script = (
        "import os, sys, time\n"
        "from pathlib import Path\n"
        "from maxjax.core.interruption import end_on_interrupt\n"
        "from maxjax.core.serialization import atomic_write\n"
        "sync = os.fsync\n"
        "def slow(descriptor):\n"
        "    print('writing ...', file=sys.stderr, flush=True)\n"
        "    time.sleep(float(sys.argv[2]))\n"
        "    sync(descriptor)\n"
        f"end_on_interrupt({SENTENCE!r})\n"
        "os.fsync = slow\n"
        "atomic_write(Path(sys.argv[1]), 'new')\n"
        "time.sleep(60)\n"
    )
    file = tmp_path / "file"
    for seconds, content in ((0.5, "new"), (60.0, "old")):
        file.write_text("old")
        ended = interrupt(["-c", script, file, seconds], lambda line: line == "writing ...\n")
        assert_ended_by(ended)
        assert os.listdir(tmp_path) == [file.name]
        assert file.read_text() == content


def test_ignored_interrupts_stay_ignored() -> None:
    script = (
        "import os, signal, time\n"
        "from maxjax.core.interruption import end_on_interrupt\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "end_on_interrupt('ended')\n"
        "os.kill(os.getpid(), signal.SIGINT)\n"
        "time.sleep(0.3)\n"
        "print('finished')\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=environment(cached=True))
    assert (done.returncode, done.stdout, done.stderr) == (0, "finished\n", "")


def test_on_a_terminal_the_progress_bar_is_erased_and_the_cursor_comes_back() -> None:
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    command = [
        sys.executable,
        "-c",
        HEED,
        sys.executable,
        "-m",
        "maxjax",
        "scan",
        "downtown:0",
        "--pose",
        "0",
        "0",
        "5",
    ]
    given = {**environment(cached=False), "TERM": "xterm"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, env=given) as process:
        os.close(theirs)
        shown = b""
        while b"Scanning" not in shown:
            shown += os.read(ours, 4096)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=LIMIT) == 130
    with contextlib.suppress(OSError):  # how Linux tells that the other side is closed
        while part := os.read(ours, 4096):
            shown += part
    os.close(ours)
    assert shown.decode().endswith(f"\r\x1b[2K\x1b[?25h{SENTENCE}\r\n")
