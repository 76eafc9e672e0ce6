"""`maxjax check`: is this installation sound?

A small potential is solved and certified. With a wall across the grid that leaves one gap, the certificate and the
residual fail together with the compiler, the device or the arithmetic.
"""

from __future__ import annotations

import functools
import importlib.util
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

from maxjax.compile.lowering import target
from maxjax.core.grid import Grid
from maxjax.core.provenance import device, versions
from maxjax.core.status import Status
from maxjax.fields.conductivity import conductivity
from maxjax.solvers.potential import solve_potential
from maxjax.solvers.screened import Screened
from maxjax.ui.cli import report
from maxjax.ui.cli.options import CheckOptions
from maxjax.ui.cli.progress import progress

_GRID = Grid((21, 21, 21), 2.0, (0.0, 0.0, 0.0))
_RESIDUAL = 1e-3  # tighter than the default, which stops where directions are right
_EXTRAS = {"matplotlib": "viz", "laspy": "las", "lazrs": "las"}
_MISCOMPILES = ("0.10.2",)


def run_check(_: CheckOptions) -> int:
    """Print versions, device and a tiny solve; 0 if all is good, else 1 with what is wrong."""
    found = versions()
    rows = dict(found)
    for module, extra in _EXTRAS.items():
        installed = importlib.util.find_spec(module) is not None
        rows[module] = "installed" if installed else f"missing; if needed: pip install 'maxjax[{extra}]'"
    rows |= {"devices": device(), "backend": target()}
    wrong = []
    if found["jax"] in _MISCOMPILES:
        wrong.append(f"jax {found['jax']} miscompiles on CPU: pip install 'jax>=0.10,!=0.10.2'")
    if found["mujoco"] != found["mujoco-mjx"]:
        wrong.append(f"mujoco {found['mujoco']} does not match mujoco-mjx {found['mujoco-mjx']}: install one version")

    occupied = np.zeros(_GRID.shape, bool)
    occupied[10], occupied[10, 15:17, 15:17] = True, False
    goal = jnp.array([3, 4, 5], jnp.int32)
    started = time.perf_counter()
    with progress("Solving a small potential"):
        solve = jax.jit(functools.partial(solve_potential, solver=Screened(tolerance=_RESIDUAL)))
        potential = solve(conductivity(jnp.asarray(occupied), goal, _GRID), goal)
        status, residual = Status(int(potential.status)), float(potential.residual)
    rows |= {
        "solve": f"{status.name}, {int(potential.iterations)} iterations, {int(potential.sweeps)} sweeps",
        "residual": f"{residual:.1e}",
        "certificate": f"{int(potential.uncertified)} voxels without a higher neighbour",
        "time with compilation": f"{time.perf_counter() - started:.1f} s",
    }
    if status != Status.OK or not bool(potential.certified):
        wrong.append(f"the solve ended as {status.name}: {status.advice}")
    if not residual <= _RESIDUAL:
        wrong.append(f"the residual is {residual:.1e}, expected at most {_RESIDUAL:.0e}")
    report.show(report.table("maxjax check", {"": rows}))
    for sentence in wrong:
        print(f"maxjax: wrong: {sentence}", file=sys.stderr)
    if not wrong:
        print("all good")
    return 1 if wrong else 0
