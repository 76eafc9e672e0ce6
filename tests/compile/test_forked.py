"""A process that was forked after JAX had run says so at the first use of maxjax; one forked before runs."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

SCRIPT = """
import multiprocessing, os, signal, warnings
warnings.simplefilter("ignore")  # JAX warns of forks
import jax.numpy as jnp
import numpy as np
import maxjax

free = np.zeros((6, 6, 6), bool)
city = maxjax.VoxelMap.of(free, spacing=2.0, origin=(0.0, 0.0, 0.0))
ends = (2.0, 2.0, 2.0), (8.0, 8.0, 8.0)
uses = {
    "plan": lambda: maxjax.plan(city, *ends, planner=maxjax.AStar()),
    "plan_batch": lambda: maxjax.plan_batch(city, np.array(ends), np.array(ends[::-1]), planner=maxjax.AStar()),
    "plan_route": lambda: maxjax.plan_route(city, *ends),
    "conductivity": lambda: maxjax.conductivity(free, np.array([1, 1, 1], np.int32), city.grid),
    "solve_potential": lambda: maxjax.solve_potential(np.ones((6, 6, 6), np.float32), np.array([1, 1, 1])),
    "dilate": lambda: maxjax.dilate(free, 2.0, city.grid),
    "voxelize": lambda: maxjax.voxelize(np.array(ends), city.grid),
    "load_model": lambda: maxjax.load_model("maxjax"),
}

def tried(name):
    try:
        return f"{name} {type(uses[name]()).__name__}"
    except Exception as error:
        return f"{name} {type(error).__name__}: {error}"

def forked(names):
    if pid := os.fork():
        print("ended", os.waitpid(pid, 0)[1], flush=True)
        return
    signal.alarm(30)
    for name in names:
        print(tried(name), flush=True)
    os._exit(0)

forked(["conductivity"])
print(tried("conductivity"), flush=True)
forked(uses)
with multiprocessing.get_context("fork").Pool(1) as pool:
    print("pool", pool.map_async(tried, ["plan"]).get(30)[0], flush=True)
print(tried("voxelize"), flush=True)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_process_forked_after_jax_has_run_says_so() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=120, check=True)
    before, ended, parent, *after, finished, pool, still = done.stdout.splitlines()
    assert before.startswith("conductivity Array")
    assert (ended, finished) == ("ended 0", "ended 0")
    assert parent.startswith("conductivity Array")
    assert still == "voxelize Occupancy"
    assert [line.split()[0] for line in after][:2] == ["plan", "plan_batch"]
    assert len(after) == 8
    for line in (*after, pool):
        assert "RuntimeError: this process was forked from one in which JAX had run" in line
        assert "'spawn'" in line
