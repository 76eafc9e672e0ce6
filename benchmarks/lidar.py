"""LiDAR ray casting: the fused kernel, MJX and C MuJoCo on the same rays and maps, in one run.

    python -m benchmarks.lidar

Expected on two CPU cores, 32,768 rays, about 200 geoms: fused kernel 5 to 10 ms, C mj_multiRay 50 to 60 ms,
vmapped mjx.ray 200 to 250 ms. Peers at their best setting: mj_multiRay with its cutoff at the sensor's range,
mjx.ray jitted. C MuJoCo runs on one thread, and its `mj_ray` row includes the Python loop around it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float

from benchmarks.common.command import configured
from benchmarks.common.harness import RESULTS, Row, measure, save
from maxjax.sim.sensors.lidar import Lidar, directions, scan
from maxjax.sim.worlds.mjx_model import cast_rays_mjx, mjx_scene
from maxjax.sim.worlds.raycast import cast_rays
from maxjax.sim.worlds.scenes import MAPS, make_scene


@dataclasses.dataclass(frozen=True)
class Config:
    """Settings of the benchmark."""

    maps: tuple[str, ...] = MAPS
    seed: int = 0
    channels: int = 64
    rays: int = 32768
    height: float = 10.0
    """Of the sensor above the ground, in the middle of the map [m]."""
    repeats: int = 30
    slow_repeats: int = 5
    """For the methods that take a quarter of a second or more."""
    out: Path = RESULTS


TINY = Config(maps=("suburb",), channels=32, rays=128, repeats=2, slow_repeats=1)


def main(config: Config) -> list[Row]:
    """Time every method on every map; save and return the rows."""
    rows = [row for name in config.maps for row in _rows(name, config)]
    save("lidar", config, rows, config.out)
    return rows


def _rows(name: str, config: Config) -> list[Row]:
    scene = make_scene(name, config.seed)
    lidar = Lidar(channels=config.channels, rays=config.rays)
    rays = directions(lidar)
    origin = jnp.array([0.0, 0.0, config.height])
    model, data = mjx_scene(scene)
    c_data = mujoco.MjData(scene.model)
    mujoco.mj_kinematics(scene.model, c_data)
    c_origin, c_rays = np.asarray(origin, np.float64), np.asarray(rays, np.float64)

    fused = jax.jit(cast_rays)
    mapped = jax.jit(cast_rays_mjx)
    whole = jax.jit(scan)
    key = jax.random.key(config.seed)

    def multi_ray() -> Float[np.ndarray, " r"]:
        distance, geom = np.empty(len(c_rays)), np.empty(len(c_rays), np.int32)
        mujoco.mj_multiRay(
            *(scene.model, c_data, c_origin, c_rays.ravel(), None, True, -1),
            *(geom, distance, None, len(c_rays), lidar.max_range),
        )
        return np.where(distance < 0.0, np.inf, distance)

    def single_rays() -> Float[np.ndarray, " r"]:
        distance = [mujoco.mj_ray(scene.model, c_data, c_origin, r, None, True, -1, None) for r in c_rays]
        return np.where(np.asarray(distance) < 0.0, np.inf, distance)

    methods: list[tuple[str, Callable[[], object], int]] = [
        ("fused kernel", lambda: fused(scene.geoms, origin, rays), config.repeats),
        (
            "scan: fused kernel, noise, dropout",
            lambda: whole(scene.geoms, lidar, origin, jnp.eye(3), key),
            config.repeats,
        ),
        ("vmapped mjx.ray", lambda: mapped(model, data, origin, rays), config.slow_repeats),
        ("C mj_multiRay", multi_ray, config.repeats),
        ("C mj_ray, Python loop", single_rays, config.slow_repeats),
    ]
    expected = single_rays()
    rows: list[Row] = []
    for method, call, repeats in methods:
        timing = measure(call, repeats)
        rows.append(
            {
                "map": name,
                "method": method,
                "rays": lidar.rays,
                "geoms": len(scene.geoms.type),
                "compile_s": None if method.startswith("C ") else timing.compile_s,
                "median_ms": 1e3 * timing.median_s,
                "min_ms": 1e3 * timing.min_s,
                "max_ms": 1e3 * timing.max_s,
                "n": timing.n,
                # A noisy scan has no exact answer to differ from.
                "rays_off_by_1mm": None if method.startswith("scan") else _off(call(), expected, lidar.max_range),
            }
        )
    return rows


def _off(given: object, expected: Float[np.ndarray, " r"], max_range: float) -> int:
    """Rays that differ from C `mj_ray` within range: in hit or miss, or by more than a millimetre."""
    distance = np.asarray(given, np.float64)
    reach, expected_reach = np.minimum(distance, max_range), np.minimum(expected, max_range)
    return int(np.sum(np.abs(reach - expected_reach) > 1e-3))


if __name__ == "__main__":
    main(configured(TINY))
