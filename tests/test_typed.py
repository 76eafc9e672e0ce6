"""Programs of users are checked against the types of the installed package."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import maxjax
from tests.conftest import COMPILED

RIGHT = """
import numpy as np

import maxjax

city = maxjax.VoxelMap.of(np.zeros((8, 8, 8), bool), spacing=2.0, origin=(0.0, 0.0, 0.0))
ends = (2.0, 2.0, 2.0), (9.0, 9.0, 9.0)
plan: maxjax.Plan = maxjax.plan(city, *ends, planner=maxjax.AStar(), distances=maxjax.Distances(1.0, 4.0))
if plan.status == maxjax.Status.OK:
    length: float = plan.length
    flight: maxjax.Trajectory = maxjax.trajectory(plan, maxjax.FlightLimits())
many: maxjax.Plans = maxjax.plan_batch(city, np.ones((3, 3)), np.ones((3, 3)))
one: maxjax.Plan = many[0]
"""
WRONG = {
    "maxjax.plan(city, ends[0])": "call-arg",
    'maxjax.plan("city", *ends)': "arg-type",
    "maxjax.plan(city, *ends, planner=3)": "arg-type",
    "text: str = plan.length": "assignment",
    "maxjax.nothing": "attr-defined",
    "plan.nothing": "attr-defined",
}


@pytest.mark.large
def test_a_users_program_is_checked_by_mypy(tmp_path: Path) -> None:
    pytest.importorskip("mypy", reason="no mypy: pip install mypy")
    program = tmp_path / "program.py"
    program.write_text(RIGHT + "\n".join(WRONG) + "\n")
    # As a package that is found on the path of Python: mypy reads its types only if it holds py.typed.
    where = {"PYTHONPATH": str(Path(maxjax.__file__).parents[1]), "PATH": os.environ.get("PATH", "")}
    cache = COMPILED.parent / "mypy"
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", f"--cache-dir={cache}", program.name]
    done = subprocess.run(command, cwd=tmp_path, env=where, capture_output=True, text=True, timeout=300)
    found = [(int(line.split(":")[1]), line.rsplit("[")[-1].rstrip("]")) for line in done.stdout.splitlines()]
    first = RIGHT.count("\n") + 1
    assert found == list(enumerate(WRONG.values(), first)), done.stdout + done.stderr
