"""Derivatives of the differentiable experiments against central differences, and each experiment at a small size."""

from __future__ import annotations

import dataclasses
import functools
import math
from pathlib import Path
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.common.harness import Row
from experiments.differentiable import demonstrations, design, inverse, learning, priced, sensitivity
from experiments.differentiable import gate as gate_module
from experiments.differentiable.field import table
from tests.references import random_blocks

SHAPE = (10, 11, 9)
STEP = 1e-4


def blocked_scene() -> np.ndarray:
    blocked = random_blocks(np.random.default_rng(5), SHAPE, 6, 3)
    blocked[:2, :2] = blocked[-2:, -2:] = False
    return blocked


BLOCKED = blocked_scene()
GOAL, START = np.array([0, 0, 1], np.int32), np.array([9, 10, 7], np.int32)


def double(x: object) -> jax.Array:
    return jnp.asarray(x, jnp.float64)


def differences(function: object, at: np.ndarray) -> np.ndarray:
    """Central differences along every axis of `at`."""
    steps = STEP * np.eye(len(at))
    return np.array([(function(double(at + s)) - function(double(at - s))) / (2 * STEP) for s in steps])  # type: ignore[operator]


def test_the_sensitivity_is_the_derivative_by_the_logarithm_of_every_conductivity() -> None:
    rng = np.random.default_rng(6)
    sigma = np.where(BLOCKED, 0, 10 ** rng.uniform(0, 1, SHAPE))
    with jax.enable_x64(True):

        def look(logarithm: np.ndarray) -> tuple[jax.Array, jax.Array]:
            changed = double(sigma * np.exp(logarithm))
            return sensitivity.lengthening(changed, jnp.asarray(GOAL), jnp.asarray(START), double(2.0))

        slope = np.asarray(look(np.zeros(SHAPE))[1])
        for direction in rng.normal(size=(3, *SHAPE)):
            expected = (look(STEP * direction)[0] - look(-STEP * direction)[0]) / (2 * STEP)
            assert (slope * direction).sum() == pytest.approx(float(expected), rel=1e-5)
        # Only the shape of σ counts.
        assert abs(slope.sum()) < 1e-7 * np.abs(slope).sum()


def test_the_gradient_by_the_gate_equals_central_differences() -> None:
    with jax.enable_x64(True):
        wall = np.zeros(SHAPE)
        wall[5] = 1
        works = gate_module.Works(
            double(~BLOCKED),
            double(wall),
            jnp.asarray(GOAL),
            jnp.asarray([START, START - 1]),
            double(2.0),
            double(1e-6),
        )
        objective = functools.partial(gate_module.mean_length, works=works, half=1.0)
        gate = np.array([4.3, 3.7])
        np.testing.assert_allclose(jax.grad(objective)(double(gate)), differences(objective, gate), rtol=1e-5)


def test_the_jacobian_of_the_probes_equals_central_differences() -> None:
    with jax.enable_x64(True):
        probes = jnp.asarray([START, [8, 1, 2], [1, 9, 3]], jnp.int32)
        site = inverse.Site(double(np.ones(SHAPE)), jnp.asarray(GOAL), double(6.0), double(2.0))
        theta = np.array([4.8, 5.1, math.log(2.2), math.log(1.6), 0.3])
        value, slope = inverse.linearized(double(theta), site, probes)
        read = functools.partial(inverse.predicted, site=site, probes=probes)
        np.testing.assert_allclose(value, read(double(theta)), rtol=1e-9)
        np.testing.assert_allclose(slope.T, differences(read, theta), rtol=1e-4, atol=1e-7)


def test_the_jacobian_of_the_bearings_equals_central_differences() -> None:
    with jax.enable_x64(True):
        free = ~BLOCKED
        height = np.broadcast_to(np.arange(SHAPE[2]) / 5.0, SHAPE)
        distance = 1 + np.random.default_rng(7).uniform(0, 4, SHAPE)
        town = priced.Town(jnp.asarray(free), double(distance), double(height))
        at = jnp.asarray(np.argwhere(free)[5::60], jnp.int32)
        read = functools.partial(priced.bearings, town=town, goal=jnp.asarray(GOAL), length=double(2.5), voxels=at)
        theta = np.log([2.0, 1.5, 0.3])
        value, slope = priced.linearized(double(theta), town, jnp.asarray(GOAL), double(2.5), at)
        read = jax.jit(read)
        np.testing.assert_allclose(value, read(double(theta)), rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(np.moveaxis(slope, -1, 0), differences(read, theta), rtol=1e-4, atol=1e-5)


def test_the_demonstrator_takes_the_cheapest_way() -> None:
    """A wall of price with one cheap voxel, and a free map: the path goes through it, and straight."""
    n = np.ones((9, 9, 3))
    n[4] = 100.0
    n[4, 6, 1] = 1.0
    free = np.ones(n.shape, bool)
    (path,) = demonstrations.demonstrate(free, n, np.array([0, 4, 1]), np.array([[8, 4, 1]]))
    assert [4.0, 6.0, 1.0] in path.tolist()
    (path,) = demonstrations.demonstrate(free, np.ones(n.shape), np.array([0, 4, 1]), np.array([[8, 4, 1]]))
    np.testing.assert_array_equal(path, [[x, 4, 1] for x in range(8, -1, -1)])


def run(module: ModuleType, folder: Path) -> tuple[list[Row], str]:
    """Rows and section of a module at its small size; the figure exists, and is no larger than allowed."""
    config = dataclasses.replace(module.TINY, out=folder, figures=folder)
    rows = module.main(config)
    (image,) = folder.glob(f"{module.NAME}.png")
    assert 0 < image.stat().st_size < 250_000
    settings = {k: v for k, v in dataclasses.asdict(config).items() if not isinstance(v, Path)}
    return rows, module.section({"rows": rows, "config": settings})


@pytest.mark.nightly
def test_an_obstacle_on_the_way_costs_more_than_one_elsewhere(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    rows, text = run(sensitivity, tmp_path)
    strongest, *_, drawn, _ = rows
    assert strongest["field_change_m"] > drawn["field_change_m"]
    assert str(rows[-1]["path_m"]) in text


@pytest.mark.nightly
def test_a_gate_is_found_that_is_no_worse_than_where_the_search_began(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    rows, text = run(design, tmp_path)
    gates = {row["gate"]: row for row in rows}
    assert gates["from there, optimised"]["mean_length_m"] <= 1.05 * gates["brute force, best"]["mean_length_m"]
    assert "brute force" in text


@pytest.mark.nightly
def test_probes_find_more_of_the_building_than_the_guess(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    (guess, found), text = run(inverse, tmp_path)
    assert found["iou_mean"] > guess["iou_mean"]
    assert f"{found['iou_mean']:g}" in text


@pytest.mark.nightly
def test_learning_lowers_the_loss_and_every_path_arrives(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    rows, text = run(learning, tmp_path)
    named = {row["what"]: row for row in rows}
    assert named["training loss"]["found"] < named["training loss"]["guess"]
    assert named["learnt"]["arrived"] == named["learnt"]["problems"]
    assert named["learnt"]["fields_certified"] == 1
    assert "demonstrator" in text


def test_a_table_has_a_line_a_row_and_tells_nothing_from_zero() -> None:
    text = table({"a": "A", "b": "B"}, [{"a": 0.0, "b": None}, {"a": "x"}])
    assert text.splitlines() == ["| A | B |", "| --- | --- |", "| 0 | – |", "| x | – |"]
