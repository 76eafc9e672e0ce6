"""With JAX_ENABLE_X64=1 plans agree with those in float32. The flag needs a process: this file is its program, too."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import maxjax
from tests.short_programs import shorten

GRID = maxjax.Grid((24, 22, 20), 2.0, (0.0, 0.0, 0.0))
START, GOALS = (4.0, 4.0, 8.0), [(40.0, 6.0, 8.0), (38.0, 38.0, 30.0)]


def _plans() -> list[dict[str, Any]]:
    """One plan, and a batch of two, in a map with a wall on the ground."""
    occupied = np.zeros(GRID.shape, bool)
    occupied[10:12, :14, :], occupied[:, :, 0] = True, True
    one = maxjax.plan(maxjax.VoxelMap.on(GRID, occupied), START, GOALS[0], distances=maxjax.Distances(margin=2.0))
    both = np.stack([occupied] * 2)
    many = maxjax.plan_batch(
        maxjax.VoxelMap.on(GRID, both), np.array([START] * 2), np.array(GOALS), distances=maxjax.Distances(margin=2.0)
    )
    return [{"status": int(plan.status), "path": np.asarray(plan.path).tolist()} for plan in (one, *many)]


@pytest.mark.large
def test_plans_agree_with_those_in_float32() -> None:
    root = Path(__file__).parents[1]
    path = os.pathsep.join([str(root), *filter(None, [os.environ.get("PYTHONPATH")])])
    # Compiled without LLVM's optimisations, as here (tests/conftest.py).
    flags = {"JAX_ENABLE_X64": "1", "JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
    environment = {**os.environ, **flags, "PYTHONPATH": path}
    done = subprocess.run([sys.executable, __file__], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    for wide, single in zip(json.loads(done.stdout), _plans(), strict=True):
        assert wide["status"] == single["status"] == maxjax.Status.OK
        np.testing.assert_allclose(wide["path"], single["path"], atol=1e-2)


if __name__ == "__main__":
    shorten()
    print(json.dumps(_plans()))
