"""XLA's false alarm is left out of standard error, and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from maxjax.compile.false_alarm import without_false_alarm

ALARM = b"E0000 00:00:1 1 cpu_aot_loader.cc:210] Loading XLA:CPU AOT result. Target machine feature ...\n"


def test_only_the_loaders_lines_are_left_out(capfd: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        os.write(2, ALARM)
        print("a warning", file=sys.stderr, flush=True)
        os.write(2, ALARM + b"the last line")
        raise ValueError("as it is")

    with pytest.raises(ValueError, match="as it is"), without_false_alarm():
        fail()
    os.write(2, b", and after it\n")
    assert capfd.readouterr().err == "a warning\nthe last line, and after it\n"


def test_maxjax_sets_nothing_in_the_environment_and_shows_public_names_alone() -> None:
    code = "import os; before = dict(os.environ); import maxjax; assert dict(os.environ) == before; print(*dir(maxjax))"
    told = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    import maxjax

    assert {name for name in told if not name.startswith("_")} == set(maxjax.__all__)
