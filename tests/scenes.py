"""Maps, cities and outcomes of flights that several test files use."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from maxjax.sim.trials.outcomes import Outcome
from maxjax.sim.worlds.geoms import Geoms, concatenate, ground_plane
from maxjax.sim.worlds.solids import upright_boxes

# One shape for all small maps of the command line, so that the planner compiles once.
SHAPE = (24, 16, 12)


def wall_with_gap() -> np.ndarray:
    """Voxels of 2 m."""
    occupied = np.zeros(SHAPE, bool)
    occupied[12, :, :] = True
    occupied[12, 1:6, 2:10] = False
    return occupied


def gap_file(folder: Path) -> Path:
    """The wall with one gap as a file of voxels."""
    np.savez(folder / "town.npz", occupied=wall_with_gap(), spacing=2.0, origin=np.zeros(3))
    return folder / "town.npz"


def wall_and_tower() -> Geoms:
    """A wall across the straight line from (-24, 1) to (14, -2), and a tower beside the way around it."""
    rows = jnp.array([[-4.0, 0.0, 2.0, 12.0, 0.0, 40.0, 0.1], [8.0, 20.0, 4.0, 4.0, 0.0, 30.0, 0.4]])
    return concatenate([ground_plane(), upright_boxes(rows)])


def house() -> Geoms:
    """One house in the middle of a plain."""
    return concatenate([ground_plane(), upright_boxes(jnp.array([[0.0, 0.0, 9.0, 9.0, 0.0, 30.0, 0.3]]))])


def outcome(trial: int, status: str, **changes: Any) -> Outcome:
    """A flight over 60 m in 20 s, but for what is changed."""
    row = Outcome(
        trial=trial, city=0, status=status, start=[0.0, 0.0, 5.0], goal=[60.0, 0.0, 5.0], distance=60.0, excluded=0,
        flown_length=61.0, duration=20.0, clearance=3.0, planning_iterations=15, failed_plans=0, margins={},
        certified=1.0, command=f"fly {trial}",
    )  # fmt: skip
    return dataclasses.replace(row, **changes)
