"""Sharded equals unsharded. Eight devices need a process of their own: this file is also the program that it runs."""

from __future__ import annotations

import json
import math
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
from maxjax import Grid, Potential, Status, conductivity, solve_potential
from maxjax.fields.geodesic import geodesic
from maxjax.solvers import aggregation
from maxjax.solvers.sharding import city_mesh, shard_sigma

DEVICES = 8
# A slab is a word of the flood's.
SHAPE = (256, 16, 16)
# States of a level that every device relaxes alone; others of this grid have more.
SHARED = 1024
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


def serpentine() -> np.ndarray:
    """A corridor that runs through all slabs and back again, eight times, beside a volume out of reach."""
    free = np.zeros(SHAPE, bool)
    free[:, ::2, 0] = True
    free[-1, 1::4, 0] = free[0, 3::4, 0] = True
    free[:, :, 8:] = True
    return free


def _program(out: Path) -> None:
    """On eight devices: solve sharded and unsharded, and run the benchmark at a tiny size."""
    aggregation._SHARED = SHARED
    sigma, goal = blocks()
    mesh = city_mesh()
    sharded = shard_sigma(sigma, mesh)
    alone = jax.jit(solve_potential)(sigma, goal)
    config = city_scale.Config(shape=(32, 32, 16), devices=(1, 16), repeats=1, out=out)
    found = {
        "devices": jax.device_count(),
        "slabs": [shard.data.shape for shard in sharded.addressable_shards],
        "partitioned": _compared(sharded, goal, alone),
        "unsharded": _summary(alone),
        "rows": city_scale.main(config),
    }
    free = serpentine()
    steps = jax.jit(geodesic)(free, jnp.zeros(3, jnp.int32))
    with jax.set_mesh(mesh):
        found["in slabs"] = _compared(sharded, goal, alone)
        in_slabs = jax.jit(geodesic)(jax.device_put(free, sharded.sharding), jnp.zeros(3, jnp.int32))
    found["longest"] = [int(jnp.max(steps[1])), int(jnp.sum(free))]
    found["steps"] = [bool((np.asarray(a) == np.asarray(b)).all()) for a, b in zip(in_slabs, steps, strict=True)]
    (out / "found.json").write_text(json.dumps(found))


def _compared(sharded: jax.Array, goal: np.ndarray, alone: Potential) -> dict[str, Any]:
    """A sharded solve beside that of one device, and what its program exchanges: kind and number of values."""
    compiled = jax.jit(solve_potential).lower(sharded, goal).compile()
    ours = compiled(sharded, goal)
    phi, expected = np.asarray(ours.phi), np.asarray(alone.phi)
    exchanged = re.findall(r"= \w+\[([\d,]*)\]\S* ([a-z-]+?)(?:-start)?\(", compiled.as_text())
    return {
        "summary": _summary(ours),
        "difference": float(np.max(np.abs(phi - expected) / np.where(expected > 0, expected, 1))),
        "free": [int(np.sum(phi > 0)), int(np.sum(expected > 0))],
        "phi_slabs": ours.phi.sharding.spec == PartitionSpec("slabs", None, None),
        "exchanges": [
            (kind, math.prod(int(n) for n in sizes.split(",") if n))
            for sizes, kind in exchanged
            if kind in (*GATHERING, "collective-permute", "all-reduce")
        ],
    }


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
        "XLA_FLAGS": f"{os.environ.get('XLA_FLAGS', '')} {flags}",
        "JAX_PLATFORMS": "cpu",
        "PYTHONPATH": os.pathsep.join([str(root), *filter(None, [os.environ.get("PYTHONPATH")])]),
    }
    done = subprocess.run([sys.executable, __file__, str(out)], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-4000:]
    return dict(json.loads((out / "found.json").read_text()))


@pytest.mark.parametrize("how", ["partitioned", "in slabs"])
def test_sharded_equals_unsharded(found: dict[str, Any], how: str) -> None:
    assert found["devices"] == DEVICES
    sharded = found[how]
    assert sharded["difference"] <= 1e-5
    assert sharded["summary"] == found["unsharded"]
    assert sharded["summary"][0] == Status.OK
    assert sharded["summary"][3] == 1
    assert sharded["free"][0] == sharded["free"][1] > 0


@pytest.mark.parametrize(("how", "most"), [("partitioned", 0), ("in slabs", SHARED)])
def test_every_device_keeps_to_its_slab(found: dict[str, Any], how: str, most: int) -> None:
    assert found["slabs"] == [[SHAPE[0] // DEVICES, *SHAPE[1:]]] * DEVICES
    assert found[how]["phi_slabs"]
    exchanges = found[how]["exchanges"]
    assert "collective-permute" in {kind for kind, _ in exchanges}
    assert max((size for kind, size in exchanges if kind in GATHERING), default=0) == most


def test_slabs_count_the_same_steps_there_and_back_again(found: dict[str, Any]) -> None:
    assert found["steps"] == [True, True]
    longest, free = found["longest"]
    assert 8 * SHAPE[0] <= longest < free


def test_slabs_spare_exchanges(found: dict[str, Any]) -> None:
    # Each level's relaxations and each step of the flood appear once in a program, however often they are repeated.
    assert len(found["in slabs"]["exchanges"]) < len(found["partitioned"]["exchanges"])


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


def test_slabs_have_to_be_whole_aggregates() -> None:
    mesh = city_mesh(jax.devices()[:1])
    with pytest.raises(ValueError, match=r"multiple of 4 .*given shape \(42, 64, 8\)"):
        shard_sigma(np.ones((42, 64, 8), np.float32), mesh)
    with pytest.raises(ValueError, match=r"given \(4, 4\)"):
        shard_sigma(np.ones((4, 4), np.float32), mesh)
    np.testing.assert_array_equal(shard_sigma(np.ones((44, 64, 8), np.float32), mesh), 1)


if __name__ == "__main__":
    _program(Path(sys.argv[1]))
