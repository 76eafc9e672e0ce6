"""Trained networks: their files are checked, and what they predict fills the solver's slot."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Distances, Network, Status, VoxelMap, conductivity, plan, plan_batch, solve_potential
from maxjax.nn import model as module
from maxjax.nn.architecture import CONFIGS
from maxjax.nn.autoencoder import init_params
from maxjax.nn.model import Model, load_model, network_potential, predict_potential, save_model
from maxjax.planning.run.stages import PotentialLike
from maxjax.ui.methods import planner_named
from tests.nn.scenes import GRID, MINI, Boxes


@pytest.fixture(autouse=True)
def _mini(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CONFIGS, "mini", MINI)
    load_model.cache_clear()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mini.npz"
    save_model(path, "mini", init_params(jax.random.key(0), MINI), metadata={"note": "untrained"})
    return path


@pytest.fixture
def model(file: Path) -> Model:
    return load_model("mini", file)


def scene(seed: int) -> tuple[jax.Array, jax.Array, jax.Array]:
    blocked, price, goal = Boxes()(jax.random.key(seed))
    return conductivity(blocked, goal, GRID), goal, price


def test_weights_come_back_in_half_precision_with_their_metadata(file: Path, model: Model) -> None:
    assert model.metadata["note"] == "untrained"
    assert load_model("mini", file) is model
    head = init_params(jax.random.key(0), MINI)["head"]["kernel"]
    np.testing.assert_array_equal(model.params["head"]["kernel"], np.asarray(head).astype(np.float16))


def test_weights_that_are_first_asked_for_within_a_trace_are_numbers(file: Path) -> None:
    """They are kept: a tracer among them would fail everywhere else."""
    total = jax.jit(lambda: sum(jnp.sum(w) for w in jax.tree.leaves(load_model("mini", file).params)))()
    leaves = jax.tree.leaves(load_model("mini", file).params)
    np.testing.assert_allclose(total, sum(float(np.asarray(w, np.float64).sum()) for w in leaves), rtol=1e-5, atol=1e-3)


def test_bad_files_and_names_are_refused(file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match=r"expected one of paper, .*given 'papier'"):
        load_model("papier")
    with pytest.raises(ValueError, match="no weights of 'mini'"):
        load_model("mini")
    with pytest.raises(ValueError, match=r"missing\.npz: cannot be read"):
        load_model("mini", tmp_path / "missing.npz")
    content = file.read_bytes()
    cut, flipped = tmp_path / "cut.npz", tmp_path / "flipped.npz"
    cut.write_bytes(content[: len(content) // 2])
    changed = bytearray(content)
    changed[len(content) // 2] ^= 4
    flipped.write_bytes(changed)
    for path in (cut, flipped):
        with pytest.raises(ValueError, match=path.name):
            load_model("mini", path)
    with pytest.raises(ValueError, match="expected weights of tiny"):
        load_model("tiny", file)
    with pytest.raises(ValueError, match="finite weights"):
        save_model(tmp_path / "nan.npz", "mini", {"w": jnp.float32(1e30)})


@pytest.mark.large
def test_the_prediction_fills_the_slot_and_sweeps_certify_it(model: Model) -> None:
    solve = jax.jit(solve_potential)
    alone = jax.jit(functools.partial(predict_potential, model))
    swept = jax.jit(functools.partial(predict_potential, model, max_sweeps=400))
    for seed in range(3):
        given = scene(seed)
        goal = given[1]
        first, field, exact = alone(*given), swept(*given), solve(*given)
        assert isinstance(first, PotentialLike)
        assert first.sweeps == 0
        for found in (first, field):
            assert found.status == Status.OK
            assert found.phi[tuple(goal)] == 1
            np.testing.assert_array_equal(found.phi > 0, exact.phi > 0)
            np.testing.assert_allclose(found.screening_length, exact.screening_length)
        assert first.certified == (first.uncertified == 0)
        assert field.certified
        assert field.iterations == 0


def test_where_sweeps_do_not_suffice_the_solver_takes_over(model: Model) -> None:
    params = jax.tree.map(lambda w: w, model.params)
    params["head"] = {**params["head"], "kernel": params["head"]["kernel"] + 3.0}
    wild = Model("mini", MINI, params, "direct", {})
    found = jax.jit(functools.partial(predict_potential, wild, max_sweeps=4))(*scene(1))
    assert found.certified
    assert found.status == Status.OK
    assert found.iterations > 0


def test_bad_inputs_are_statuses_or_errors(model: Model) -> None:
    sigma, goal, _ = scene(0)
    run = jax.jit(functools.partial(predict_potential, model))
    for given, where, status in (
        (sigma.at[1, 2, 3].set(jnp.nan), goal, Status.NONFINITE_INPUT),
        (sigma, jnp.array([99, 0, 0], jnp.int32), Status.GOAL_OUTSIDE_MAP),
        (jnp.zeros_like(sigma), goal, Status.GOAL_OCCUPIED),
    ):
        found = run(given, where)
        assert found.status == status
        assert not found.certified
        assert np.isfinite(found.phi).all()
    # Without the run-time checks of annotations, which would speak first.
    plain = inspect.unwrap(predict_potential)
    with pytest.raises(ValueError, match="sigma: expected float32 or float64"):
        plain(model, sigma[0], goal)
    with pytest.raises(ValueError, match="goal_index: expected integer"):
        plain(model, sigma, goal.astype(jnp.float32))


def test_a_batch_is_its_scenes(model: Model) -> None:
    given = [scene(seed) for seed in range(3)]
    run = functools.partial(predict_potential, model)
    batch = jax.jit(jax.vmap(run))(*map(jnp.stack, zip(*given, strict=True)))
    for i in range(3):
        np.testing.assert_allclose(batch.log_phi[i], jax.jit(run)(*given[i]).log_phi, rtol=1e-4)


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder in the place of the shipped weights, and a small network in that of the default one."""
    monkeypatch.setattr(module, "WEIGHTS", tmp_path)
    monkeypatch.setitem(CONFIGS, "maxjax", MINI)
    network_potential.cache_clear()
    yield tmp_path
    network_potential.cache_clear()
    load_model.cache_clear()


@pytest.mark.large
def test_plans_by_network_are_certified_and_hardly_longer_than_the_way_around(shipped: Path) -> None:
    save_model(shipped / "maxjax.npz", "maxjax", init_params(jax.random.key(0), MINI))
    occupied = np.zeros(GRID.shape, bool)
    occupied[5:7, :9] = True
    start, goal = [2.0, 2.0, 10.0], [20.0, 3.0, 8.0]
    ours = plan(
        VoxelMap.on(GRID, occupied), start, goal, planner=Network(), distances=Distances(radius=0.0, margin=0.0)
    )
    assert ours.status is Status.OK
    assert ours.method == "network"
    assert ours.certified
    # Around two edges of the wall, at (9, 17) and (13, 17) m.
    shortest = math.hypot(7, 15) + 4 + math.hypot(7, 14)
    assert shortest < ours.length < 1.1 * shortest
    (batched,) = plan_batch(
        VoxelMap.on(GRID, occupied),
        np.array([start]),
        np.array([goal]),
        planner=Network(),
        distances=Distances(radius=0.0, margin=0.0),
    )
    assert batched.status is Status.OK
    assert batched.certified


def test_a_plan_by_network_without_weights_says_what_is_missing(shipped: Path) -> None:
    with pytest.raises(ValueError, match="no weights of 'maxjax'"):
        plan(VoxelMap.on(GRID, np.zeros(GRID.shape, bool)), [1.0, 1.0, 1.0], [9.0, 9.0, 9.0], planner=Network())
    with pytest.raises(ValueError, match="no weights of 'maxjax'"):
        planner_named("network")
