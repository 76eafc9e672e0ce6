"""Trajectories flown by a stranger: crazyflow's vehicle, dynamics and controller follow our set-points.

crazyflow (MIT, LearnSysLab) simulates small quadrotors in JAX with parameters identified from flights, and steers them
by its own version of the Crazyflie firmware's controller (D. Mellinger and V. Kumar, 2011). It is handed position,
velocity, acceleration and yaw a hundred times a second, and nothing else.

It needs SciPy in a mode that has to be chosen before SciPy is imported: so it flies in a process of its own, which is
this module run as a program, with set-points in one file and positions in another.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

if TYPE_CHECKING:  # the process of crazyflow does not need it
    import maxjax

RATE, STEPS = 100, 5  # set-points a second, and time steps between two
AFTER = 2.0  # seconds in hover at the end
DRONE = "cf21B_500"  # a Crazyflie 2.1 brushless
_ROOT = Path(__file__).parents[2]
_HEIGHT = 50.0  # of the lowest point above crazyflow's floor [m]

Flown = tuple[Float64[np.ndarray, " t"], Float64[np.ndarray, "t 3"], Float64[np.ndarray, "t 3"]]


def follow_setpoints(trajectories: Sequence[maxjax.Trajectory], drone: str = DRONE) -> list[Flown]:
    """Times [s], positions [m] and velocities [m/s] of vehicles that follow trajectories, each from rest at its start.

    Args:
        trajectories: at least one.
        drone: of `crazyflow.drones`.

    Raises:
        RuntimeError: where crazyflow fails, with what it says.
    """
    counts = [int(np.ceil((one.duration + AFTER) * RATE)) + 1 for one in trajectories]
    times = np.arange(max(counts)) / RATE
    shifts = [np.array(one.origin) - [0.0, 0.0, _HEIGHT - one.control[:, 2].min()] for one in trajectories]
    motions = [one.at(times) for one in trajectories]
    commands = np.zeros((len(times), len(trajectories), 16))
    for k, (motion, shift) in enumerate(zip(motions, shifts, strict=True)):
        commands[:, k, :9] = np.hstack([motion.position - shift, motion.velocity, motion.acceleration])
        commands[:, k, 11], commands[:, k, 12] = np.sin(0.5 * motion.yaw), np.cos(0.5 * motion.yaw)
        commands[:, k, 15] = motion.yaw_rate
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "commands.npy", Path(folder) / "flown.npz"
        np.save(given, commands)
        done = subprocess.run(
            [sys.executable, "-m", __name__, str(given), str(found), drone],
            cwd=folder,  # where MuJoCo leaves its log
            env={**os.environ, "SCIPY_ARRAY_API": "1", "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(_ROOT)},
            capture_output=True,
            text=True,
        )
        if done.returncode:
            raise RuntimeError(
                f"crazyflow: expected it to fly, given exit code {done.returncode}: {done.stderr[-500:]}"
            )
        with np.load(found) as flown:
            position, velocity = flown["position"], flown["velocity"]
    return [
        (times[:count], position[:count, k] + shift, velocity[:count, k])
        for k, (count, shift) in enumerate(zip(counts, shifts, strict=True))
    ]


def _fly(commands: Float64[np.ndarray, "t b 16"], drone: str) -> dict[str, Float64[np.ndarray, "t b 3"]]:
    """Positions and velocities at the times of the set-points; in a process of its own."""
    from crazyflow.control import Control
    from crazyflow.drones import Drone
    from crazyflow.sim import Sim

    sim = Sim(commands.shape[1], drone=Drone(drone), control=Control.state, freq=RATE * STEPS, state_freq=RATE)
    states, first = sim.data.states, commands[0][:, None].astype(np.float32)
    sim.data = sim.data.replace(states=states.replace(pos=states.pos * 0.0 + first[..., :3]))
    flown: dict[str, list[np.ndarray]] = {"position": [], "velocity": []}
    for now in commands[:, :, None].astype(np.float32):
        flown["position"].append(np.asarray(sim.data.states.pos[:, 0], np.float64))
        flown["velocity"].append(np.asarray(sim.data.states.vel[:, 0], np.float64))
        sim.state_control(now)
        sim.step(STEPS)
    return {name: np.stack(rows) for name, rows in flown.items()}


if __name__ == "__main__":
    _given, _found, _drone = sys.argv[1:]
    _flown = _fly(np.load(_given), _drone)
    np.savez(_found, position=_flown["position"], velocity=_flown["velocity"])
