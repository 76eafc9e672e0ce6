"""The weights that come with maxjax, at full size, in cities that they never saw."""

from __future__ import annotations

import functools

import jax
import numpy as np
import pytest

from benchmarks.common.problems import problems
from maxjax import Grid, Potential, Status
from maxjax.fields.conductivity import conductivity
from maxjax.fields.price import SCREENING_LENGTH, lattice_price
from maxjax.nn import model as model_module
from maxjax.nn.architecture import CONFIGS
from maxjax.nn.model import MAX_SWEEPS, WEIGHTS, load_model, network_potential, predict_potential, shipped_networks
from maxjax.planning.run.execution import problem_of

pytestmark = pytest.mark.full_speed

GRID = Grid.centered((0.0, 0.0, 0.0), (101, 101, 101), 2.0)
NAMES = shipped_networks()

conducting = jax.jit(conductivity, static_argnames="grid")


def test_the_default_network_comes_with_weights_and_all_are_small() -> None:
    assert "maxjax" in NAMES
    for name in NAMES:
        assert (WEIGHTS / f"{name}.npz").stat().st_size <= 9e6
        model = load_model(name)
        assert model.network == CONFIGS[name]
        assert all(np.isfinite(np.asarray(leaf)).all() for leaf in jax.tree.leaves(model.params))


@pytest.mark.parametrize("name", ["downtown", "suburb"])
def test_a_few_sweeps_certify_the_field_of_the_default_network(name: str) -> None:
    (drawn,) = problems(name, 1, 3, GRID)
    problem = problem_of(drawn)
    assert problem.status == Status.OK
    assert problem.price is not None
    field = jax.jit(network_potential())(
        conducting(problem.blocked, problem.goal_index, grid=GRID),
        problem.goal_index,
        lattice_price(problem.price, SCREENING_LENGTH),
    )
    assert field.certified
    assert field.iterations == 0  # the solver had nothing to do
    assert field.sweeps <= MAX_SWEEPS
    # By the definition, and not by the certificate's own code: every voxel of the component but the goal has a higher
    # neighbour across a face that conducts.
    log_phi = np.pad(np.asarray(field.log_phi), 1, constant_values=-np.inf)
    inner = log_phi[1:-1, 1:-1, 1:-1]
    best = np.max([np.roll(log_phi, step, axis)[1:-1, 1:-1, 1:-1] for axis in range(3) for step in (-1, 1)], axis=0)
    component = np.isfinite(inner)
    assert component.sum() > 1e5
    lower = component & (best <= inner)
    assert np.argwhere(lower).tolist() == [np.asarray(problem.goal_index).tolist()]


def test_alone_its_field_is_smoothed_so_that_less_of_it_holds_up_the_ascent(monkeypatch: pytest.MonkeyPatch) -> None:
    (drawn,) = problems("downtown", 1, 3, GRID)
    problem = problem_of(drawn)
    sigma = conducting(problem.blocked, problem.goal_index, grid=GRID)

    def alone() -> Potential:
        return jax.jit(functools.partial(predict_potential, load_model("maxjax")))(sigma, problem.goal_index)

    smoothed = alone()
    monkeypatch.setattr(model_module, "_SMOOTHING", 0.0)
    as_it_is = alone()
    assert 0 < smoothed.uncertified < as_it_is.uncertified
    joined = np.isfinite(smoothed.log_phi)
    np.testing.assert_array_equal(joined, np.isfinite(as_it_is.log_phi))
    y, z = (-np.asarray(field.log_phi)[joined] for field in (smoothed, as_it_is))
    assert np.abs(y - z).mean() < 0.05 * z.mean()
