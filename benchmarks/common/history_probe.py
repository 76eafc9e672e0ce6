"""Times of one commit's maxjax over those of a peer that never changes, printed as JSON; run by `benchmarks.history`.

    ratio = least time of a figure / least time of the peer, which take turns

Times are those of the processor, on one core, so that what else a machine does changes little. The peer is SciPy: six
steps of conjugate gradients on a Laplacian of 64³. This file imports no other of the repository, and calls public names
of all times: with maps that are arrays, and from VoxelMap on. What a commit has not, or calls another way, is None.
"""

from __future__ import annotations

import functools
import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

Find = Callable[[], Any]

_START, _GOAL = (6.0, 6.0, 30.0), (122.0, 122.0, 26.0)


def main(quarter: str, repeats: int) -> dict[str, float | None]:
    """The figures of the maxjax that this process imports.

    Args:
        quarter: a map's file.
        repeats: of each figure; what is only done once a process is timed once.
    """
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    peer = _peer()
    told: dict[str, float | None] = {"peer [ms]": 1e3 * min(spent(peer) for _ in range(repeats))}
    told["import"] = _over(peer, lambda: spent(_import), repeats)
    calls = _calls(quarter)
    plan = calls["plan"]
    told["first plan"] = _over(peer, lambda: spent(plan), 1)
    told["string pulling"] = _over(peer, lambda: _pulling(plan), repeats)
    for name, call in calls.items():
        time_of = functools.partial(spent, call)
        _over(peer, time_of, 1)  # compiles
        told[name] = _over(peer, time_of, repeats)
    return told


def _import() -> None:
    subprocess.run([sys.executable, "-c", "import maxjax; maxjax.plan"], check=True)


def _pulling(plan: Find) -> float:
    """The share of a plan's time in which its path is pulled taut, of the time of processors."""
    found: list[Any] = []
    seconds = spent(lambda: found.append(plan()))
    (timings,) = (one.timings for one in found)
    return float(seconds * timings["tighten"] / timings["total"])


def _peer() -> Find:
    n = 64
    line: Any = scipy.sparse.diags_array([-1.0, 2.01, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    one: Any = scipy.sparse.eye_array(n)
    kron: Any = scipy.sparse.kron
    matrix = (kron(kron(line, one), one) + kron(kron(one, line), one) + kron(one, kron(one, line))).tocsr()
    right = np.random.default_rng(0).standard_normal(n**3)
    return lambda: scipy.sparse.linalg.cg(matrix, right, rtol=0.0, maxiter=6)


def spent(call: Find) -> float:
    """Seconds of processors, of all threads and of processes that have ended."""
    before = _cpu()
    call()
    return _cpu() - before


def _cpu() -> float:
    own, ended = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + ended.ru_utime + ended.ru_stime


def _over(peer: Find, time_of: Callable[[], float], repeats: int) -> float | None:
    try:
        pairs = [(time_of(), spent(peer)) for _ in range(repeats)]
    except Exception as error:  # whatever another time did not know
        print(f"{type(error).__name__}: {str(error)[:200]}", file=sys.stderr)
        return None
    return min(own for own, _ in pairs) / min(other for _, other in pairs)


def _calls(quarter: str) -> dict[str, Find]:
    """What is timed, by its name."""
    import jax
    import jax.numpy as jnp

    import maxjax

    town, ground = _town((64, 64, 32))
    cube = jnp.asarray(_town((64, 64, 64))[0])
    grid: Any = maxjax.Grid((64, 64, 64), 2.0, (0.0, 0.0, 0.0))
    goal = jnp.asarray((57, 55, 40), jnp.int32)
    points = np.random.default_rng(0).uniform(0.0, 120.0, (100_000, 3)).astype(np.float32)
    ends = np.array([(x, y, 30.0) for x in (8.0, 16.0, 24.0, 32.0) for y in (8.0, 12.0)])
    mx: Any = maxjax  # of any time
    if hasattr(mx, "VoxelMap"):
        where = mx.VoxelMap.of(town, spacing=2.0, origin=(0.0, 0.0, 0.0), ground=ground)
        given: tuple[Any, ...] = ()
        words: dict[str, Any] = {}
        astar: dict[str, Any] = {"planner": mx.AStar()} if hasattr(mx, "AStar") else {}
    else:
        where, given = town, (mx.Grid(town.shape, 2.0, (0.0, 0.0, 0.0)),)
        words, astar = {"ground": ground}, {"method": "astar"}

    def plan(**more: Any) -> Any:
        found = mx.plan(where, _START, _GOAL, *given, **words, **more)
        if int(found.status) != 0:
            raise ValueError(f"no path: {found.status!r}")
        return found

    def verified() -> Any:
        path = _detour()
        return mx.verify(path, where, radius=1.0) if not given else mx.verify(path, town, town, *given)

    def solved() -> Any:
        return jax.block_until_ready(mx.solve_potential(mx.conductivity(cube, goal, grid), goal))

    return {
        "plan": plan,
        "A*": lambda: plan(**astar),
        "batch of 8": lambda: mx.plan_batch(where, ends, np.tile(_GOAL, (8, 1)), *given, **words),
        "potential": solved,
        "verifier": verified,
        "dilation": lambda: jax.block_until_ready(mx.dilate(cube, 8.0, grid)),
        "points to voxels": lambda: jax.block_until_ready(mx.voxelize(points, grid).occupied),
        "map of the quarter": lambda: mx.load_map(quarter),
    }


def _town(shape: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Blocks of a city with streets of 12 m, and its ground; voxels of 2 m."""
    random, occupied = np.random.default_rng(0), np.zeros(shape, bool)
    ground = occupied.copy()
    ground[:, :, 0] = True
    for i in range(8, shape[0] - 10, 14):
        for j in range(8, shape[1] - 10, 14):
            occupied[i : i + 8, j : j + 8, 1 : random.integers(8, 26)] = True
    return occupied | ground, ground


def _detour() -> np.ndarray:
    """A path around the town."""
    return np.array([(4.0, 4.0, 30.0), (4.0, 122.0, 30.0), (122.0, 122.0, 40.0), (122.0, 4.0, 50.0)])


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], int(sys.argv[2]))))
