"""A whole city, sharded over devices: 1024 × 1024 × 256 voxels of 2 m are two kilometres by two, 512 m high.

    python -m benchmarks.city_scale                                          # on 1, 2, 4 and 8 GPUs of one host
    python -m benchmarks.city_scale --shape 64 64 32 --devices 1             # a quick look, anywhere
    srun python -m benchmarks.city_scale --devices 16 --distributed          # one process a host

The city is one `downtown` of 128 × 128 voxels, dilated by the margin, again and again; its middle lies in the middle of
the volume, and the goal in the street there. Every device computes the conductivity of its own slab. A row is a number
of devices: time of sigma → φ with its certificate, and its speed-up over the row of one device. `peak_arrays` is the
most that any device held, `xla_arrays` what the compiled program reserves a device for temporaries, both in float32
arrays of the slab's size. Rows that need more devices than there are say so.

Expected: certified, the same cycles in every row.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding
from jax.stages import Compiled
from jaxtyping import Array, Bool, Float, Int32
from scipy import ndimage

import maxjax
from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, measure, save
from maxjax.sim.worlds.scenes import make_scene, occupancy
from maxjax.solvers.sharding import Window, city_mesh, shard_sigma

SPACING = 2.0
# Voxels of the repeated city along x and y: its blocks reach to about 120 m from its middle.
_TILE = 128
# Where the goal should be [m]: just above the street in the middle.
_GOAL = (0.0, 0.0, 9.0)


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings.

    Attributes:
        shape: voxels along x, y, z.
        devices: numbers of devices, a row each.
        margin: [m].
        seed: of the city.
        repeats: timed calls.
        distributed: whether processes on several hosts run this together (`jax.distributed` finds them by itself under
            Slurm, Open MPI or Kubernetes); only rows for all devices are then possible.
        out: where the JSON goes.
    """

    shape: tuple[int, int, int] = (1024, 1024, 256)
    devices: tuple[int, ...] = (1, 2, 4, 8)
    margin: float = 8.0
    seed: int = 0
    repeats: int = 5
    distributed: bool = False
    out: Path = RESULTS


TINY = Config(shape=(64, 64, 32), devices=(1,), repeats=1)


@dataclasses.dataclass(frozen=True)
class City:
    """Conductivity of a repeated tile, computed window by window.

    Attributes:
        shape: voxels along x, y, z.
        tile: voxels that conduct nothing in one city, margin included, over the full height.
        goal_index: voxel of the goal.
    """

    shape: tuple[int, int, int]
    tile: Bool[np.ndarray, "tx ty nz"]
    goal_index: Int32[np.ndarray, " 3"]

    def __getitem__(self, window: Window, /) -> Float[np.ndarray, "mx my mz"]:
        """Sigma in a window; the tile's middle lies in the middle of the volume."""
        voxels = [np.arange(n)[part] for n, part in zip(self.shape, window, strict=True)]
        wrapped = [
            (index - n // 2 + size // 2) % size
            for index, n, size in zip(voxels[:2], self.shape[:2], self.tile.shape[:2], strict=True)
        ]
        blocked = self.tile[np.ix_(*wrapped, voxels[2])]
        corner = np.array([index[0] for index in voxels])
        grid = maxjax.Grid(blocked.shape, SPACING)
        return np.asarray(_conductivity(jnp.asarray(blocked), jnp.asarray(self.goal_index - corner, jnp.int32), grid))


_conductivity = jax.jit(maxjax.conductivity)


def city(config: Config) -> City:
    """The city of these settings: its goal is the open voxel nearest to 9 m above the middle."""
    height = config.shape[2]
    # One layer of ground; beyond the tile's sides the next one begins, whose margin reaches into this one.
    half = (_TILE // 2) * SPACING
    grid = maxjax.Grid((_TILE, _TILE, height), SPACING, (-half, -half, -SPACING / 2))
    occupied, ground = occupancy(make_scene("downtown", config.seed).geoms, grid)
    rim = int(np.ceil(config.margin / SPACING))
    rims = [(rim, rim), (rim, rim), (0, 0)]
    around, below = (np.pad(volume, rims, mode="wrap") for volume in (occupied, ground))
    wide = maxjax.Grid(around.shape, SPACING)
    blocked = np.asarray(maxjax.dilate(jnp.asarray(around), config.margin, wide, jnp.asarray(below)))
    tile = blocked[rim : rim + _TILE, rim : rim + _TILE]

    labels, _ = ndimage.label(~tile)
    free = np.argwhere(labels == 1 + np.argmax(np.bincount(labels.ravel())[1:]))
    away = np.linalg.norm(free * SPACING + np.array(grid.origin) - np.array(_GOAL), axis=1)
    x, y, z = free[np.argmin(away)]
    nx, ny, _ = config.shape
    return City(config.shape, tile, np.array([x + nx // 2 - _TILE // 2, y + ny // 2 - _TILE // 2, z], np.int32))


def sharded(town: City, count: int) -> Float[Array, "nx ny nz"]:
    """The city's sigma on the first so many devices."""
    return shard_sigma(town, city_mesh(jax.devices()[:count]))


def compile_solve(sigma: Float[Array, "nx ny nz"], goal_index: Int32[np.ndarray, " 3"]) -> Compiled:
    """`maxjax.solve_potential` for the slabs of this sigma, which it knows of."""
    assert isinstance(sigma.sharding, NamedSharding)
    mesh = sigma.sharding.mesh
    assert isinstance(mesh, Mesh)
    with jax.set_mesh(mesh):
        return jax.jit(maxjax.solve_potential).lower(sigma, goal_index).compile()


def main(config: Config) -> list[Row]:
    """Solve on every number of devices; save and return the rows."""
    if config.distributed:
        jax.distributed.initialize()
    town = city(config)
    # Slabs grow as devices become fewer, so that a device's peak, which is never reset, is that of its last row.
    rows = [_row(town, count, config) for count in sorted(set(config.devices), reverse=True)][::-1]
    timed = {row["devices"]: row for row in rows if "median" in row}
    if 1 in timed:
        for row in timed.values():
            row["speed_up"] = round(timed[1]["median"] / row["median"], 2)
    if jax.process_index() == 0:
        save("city_scale", config, rows, config.out)
    return list(rows)


def _row(town: City, count: int, config: Config) -> dict[str, Any]:
    row = {"what": f"city: {count} device{'s' * (count > 1)}", "devices": count}
    present = jax.device_count()
    if count > present or (config.distributed and count != present):
        only = "runs on all together" if config.distributed else "present"
        return row | {"note": f"not run: {present} devices {only}"}
    print(f"{count} devices", file=sys.stderr, flush=True)
    sigma = sharded(town, count)
    start = time.perf_counter()
    compiled = compile_solve(sigma, town.goal_index)
    compile_s = time.perf_counter() - start
    solve = functools.partial(compiled, sigma, town.goal_index)
    timing = measure(solve, config.repeats)
    potential = solve()
    voxels = int(np.prod(config.shape))
    slab = 4 * voxels / count
    analysis = compiled.memory_analysis()
    peak = _peak(sigma.sharding.addressable_devices)
    return row | {
        "unit": "ms",
        "median": round(1e3 * timing.median_s, 2),
        "min": round(1e3 * timing.min_s, 2),
        "max": round(1e3 * timing.max_s, 2),
        "n": timing.n,
        "compile_s": round(compile_s, 2),
        "certified": bool(potential.certified),
        "status": maxjax.Status(int(potential.status)).name,
        "cycles": int(potential.iterations),
        "sweeps": int(potential.sweeps),
        "screening_length": round(float(potential.screening_length), 3),
        "mvoxels_per_s": round(voxels / timing.median_s / 1e6, 2),
        "peak_gb": None if peak is None else round(peak / 1e9, 3),
        "peak_arrays": None if peak is None else round(peak / slab, 1),
        "xla_arrays": None if analysis is None else round(analysis.temp_size_in_bytes / slab, 1),
    }


def _peak(devices: Iterable[jax.Device]) -> int | None:
    """Most bytes that any of these devices has held; None where devices do not count (CPU)."""
    counted = [device.memory_stats() for device in devices]
    return max((stats["peak_bytes_in_use"] for stats in counted if stats), default=None)


if __name__ == "__main__":
    main(configured(TINY))
