"""Sharded equals unsharded. Eight devices need a process of their own: this file is also the program that it runs."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import PartitionSpec

from benchmarks import city_scale
from maxjax import Grid, Status, conductivity, solve_potential
from maxjax.solvers.sharding import city_mesh, shard_sigma

DEVICES = 8
SHAPE = (64, 32, 32)
# Whole volumes would travel by these; neighbours' layers by collective-permute, numbers by all-reduce.
GATHERING = ("all-gather", "all-to-all", "reduce-scatter")


def blocks(shape: tuple[int, int, int] = SHAPE, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Sigma and a goal at street level among towers that stand on the ground, across the borders of slabs as well."""
    rng = np.random.default_rng(seed)
    occupied = np.zeros(shape, bool)
    occupied[:, :, 0] = True
    for _ in range(40):
        x, y = rng.integers(0, shape[:2])
        width, depth, height = rng.integers(3, 9), rng.integers(3, 9), rng.integers(5, shape[2] - 2)
        occupied[x : x + width, y : y + depth, :height] = True
    streets = np.argwhere(~occupied[:, :, 2])
    goal = np.array([*streets[len(streets) // 2], 2], np.int32)
    return np.asarray(conductivity(jnp.asarray(occupied), jnp.asarray(goal), Grid(shape))), goal


def _program(out: Path) -> None:
    """On eight devices: solve sharded and unsharded, and run the benchmark at a tiny size."""
    sigma, goal = blocks()
    sharded = shard_sigma(sigma, city_mesh())
    solve = jax.jit(solve_potential)
    compiled = solve.lower(sharded, goal).compile()
    ours, alone = compiled(sharded, goal), solve(sigma, goal)
    phi, expected = np.asarray(ours.phi), np.asarray(alone.phi)
    config = city_scale.Config(shape=(32, 32, 16), devices=(1, 16), repeats=1, out=out)
    found = {
        "devices": jax.device_count(),
        "slabs": [shard.data.shape for shard in sharded.addressable_shards],
        "difference": float(np.max(np.abs(phi - expected) / np.where(expected > 0, expected, 1))),
        "free": [int(np.sum(phi > 0)), int(np.sum(expected > 0))],
        "phi_slabs": ours.phi.sharding.spec == PartitionSpec("x", None, None),
        "collectives": sorted(set(re.findall(r"= \S+ ([a-z-]+)\(", compiled.as_text()))),
        "sharded": _summary(ours),
        "unsharded": _summary(alone),
        "rows": city_scale.main(config),
    }
    (out / "found.json").write_text(json.dumps(found))


def _summary(potential: Any) -> list[int]:
    return [int(x) for x in (potential.status, potential.iterations, potential.sweeps, potential.certified)]


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("sharding")
    root = Path(__file__).parents[2]
    # Compiling is nearly all that this costs, and none of what is tested depends on LLVM's optimisations.
    flags = f"--xla_force_host_platform_device_count={DEVICES} --xla_backend_optimization_level=0"
    environment = {
        **os.environ,
        "XLA_FLAGS": flags,
        "JAX_PLATFORMS": "cpu",
        "PYTHONPATH": os.pathsep.join([str(root), *filter(None, [os.environ.get("PYTHONPATH")])]),
    }
    done = subprocess.run([sys.executable, __file__, str(out)], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    return dict(json.loads((out / "found.json").read_text()))


def test_sharded_equals_unsharded(found: dict[str, Any]) -> None:
    assert found["devices"] == DEVICES
    assert found["difference"] <= 1e-5
    assert found["sharded"] == found["unsharded"]
    assert found["sharded"][0] == Status.OK
    assert found["sharded"][3] == 1
    assert found["free"][0] == found["free"][1] > 0


def test_every_device_keeps_to_its_slab(found: dict[str, Any]) -> None:
    assert found["slabs"] == [[SHAPE[0] // DEVICES, *SHAPE[1:]]] * DEVICES
    assert found["phi_slabs"]
    assert "collective-permute" in found["collectives"]
    assert not set(found["collectives"]) & {name + end for name in GATHERING for end in ("", "-start")}


def test_benchmark_solves_its_city_and_says_what_it_left_out(found: dict[str, Any]) -> None:
    one, absent = found["rows"]
    assert [row["devices"] for row in found["rows"]] == [1, 16]
    assert "note" in absent
    assert "median" not in absent
    assert one["certified"]
    assert one["median"] > 0
    assert one["xla_arrays"] > 0
    assert one["speed_up"] == 1


def test_city_is_the_same_whatever_the_windows() -> None:
    tile = np.random.default_rng(1).random((10, 6, 5)) < 0.3
    goal = np.array([12, 7, 3], np.int32)
    tile[5, 4, 3] = False  # where the goal is: tile and volume share their middle
    city = city_scale.City((24, 12, 5), tile, goal)
    everything = city[slice(None), slice(None), slice(None)]
    slabs = [city[slice(x, x + 6), slice(None), slice(None)] for x in range(0, 24, 6)]
    np.testing.assert_array_equal(np.concatenate(slabs), everything)
    expected = conductivity(jnp.asarray(everything == 0), jnp.asarray(goal), Grid((24, 12, 5)))
    np.testing.assert_allclose(everything, expected, rtol=1e-6)
    np.testing.assert_array_equal(everything[7:17, 3:9] == 0, tile)


def test_slabs_have_to_be_whole_blocks() -> None:
    mesh = city_mesh(jax.devices()[:1])
    with pytest.raises(ValueError, match=r"multiple of 4 .*given shape \(42, 64, 8\)"):
        shard_sigma(np.ones((42, 64, 8), np.float32), mesh)
    with pytest.raises(ValueError, match=r"given \(4, 4\)"):
        shard_sigma(np.ones((4, 4), np.float32), mesh)
    np.testing.assert_array_equal(shard_sigma(np.ones((44, 64, 8), np.float32), mesh), 1)


if __name__ == "__main__":
    _program(Path(sys.argv[1]))
