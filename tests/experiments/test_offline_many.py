"""The thousands at a tiny size: what is solved, certified and proved is counted, and compared with the geodesic."""

from __future__ import annotations

import dataclasses
import json
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import maxjax
from benchmarks.common.problems import problems, seal
from experiments import offline_many
from experiments.offline_many import TINY, cities_of, draw, main, section
from maxjax import VoxelMap
from maxjax.planning.problem.task import Task
from maxjax.solvers.potential import Potential, solve_potential

GRID = maxjax.Grid.centered((0.0, 0.0, 0.0), TINY.shape, 2.0)


def doubted(sigma: jax.Array, goal_index: jax.Array, price: jax.Array | None) -> Potential:
    """The solver's field without its certificate, in a network's place."""
    return dataclasses.replace(solve_potential(sigma, goal_index, price), certified=jnp.bool_(False))


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("many")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(offline_many, "_potential", {"solver": solve_potential, "doubted": doubted}.__getitem__)
        main(dataclasses.replace(TINY, methods=("solver", "doubted"), out=out, workers=1))
    found: dict[str, Any] = json.loads((out / "offline_many.json").read_text())
    return found


@pytest.mark.nightly
def test_solver_solves_what_scipy_calls_solvable(document: dict[str, Any]) -> None:
    solver, doubted = document["rows"]
    assert solver["ok"] == solver["certified"] == solver["solvable"] == TINY.problems - solver["proved_unsolvable"]
    assert solver["over_first"] == 1.0
    assert solver["unsafe"] == 0
    assert solver["measured"] == -(-TINY.problems // TINY.measured)
    # Fast marching between voxel centres is up to a voxel long at either end.
    assert 0.9 < solver["over_geodesic"] < 1.05
    # The same field, the same paths; what counts as certified is what says so.
    assert (doubted["ok"], doubted["over_first"]) == (solver["ok"], 1.0)
    assert doubted["certified"] == 0


@pytest.mark.nightly
def test_a_sealed_problem_is_proved_unsolvable_and_named(document: dict[str, Any]) -> None:
    """Two open problems and a sealed one, over two batches."""
    first, second, *_ = draw(("suburb", 0, GRID, TINY.margin))
    drawn = iter([first, second, (seal(first[0], "goal"), False)])
    with ThreadPool(1) as pool:
        (row,) = offline_many._rows("suburb", drawn, {"solver": solve_potential}, TINY, GRID, pool)
    assert row["problems"] == 3
    assert row["ok"] == row["certified"] == row["solvable"] == 2
    assert row["proved_unsolvable"] == 1
    assert row["failures"] == "NO_VALID_PATH: 1"
    text = section({**document, "rows": [row]})
    assert "| suburb | solver | 3 | 2 | 2 | 2 | 1 |" in text
    assert "\n- suburb, solver: NO_VALID_PATH: 1\n" in text
    assert "Without a path" not in section(document)


def test_as_many_problems_as_asked_lie_in_different_cities() -> None:
    seeds = [seed for _, seed, *_ in cities_of("suburb", dataclasses.replace(TINY, problems=250), GRID)]
    assert len(seeds) == len(set(seeds)) == 25


def test_cities_are_those_of_the_offline_protocol_and_labels_tell_what_is_sealed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    city, other = draw(("suburb", 0, GRID, 8.0)), draw(("suburb", 1, GRID, 8.0))
    for (task, possible), problem in zip(city, problems("suburb", 10, 0, GRID), strict=True):
        np.testing.assert_array_equal(task.starts, problem.starts)
        np.testing.assert_array_equal(task.goals, problem.goals)
        np.testing.assert_array_equal(task.barred, problem.barred)
        assert possible
    assert not np.array_equal(city[0][0].map.occupied, other[0][0].map.occupied)

    def walled(*asked: Any) -> list[Task]:
        """A wall of voxels between west and east, the same for all."""
        tasks = problems(*asked)
        wall = tasks[0].barred.copy()
        wall[25] = True
        return [dataclasses.replace(task, map=VoxelMap.on(task.grid, wall, task.map.ground)) for task in tasks]

    monkeypatch.setattr(offline_many, "problems", walled)
    sealed = draw(("suburb", 0, GRID, 8.0))
    starts, goals = (np.concatenate([getattr(task, name) for task, _ in sealed]) for name in ("starts", "goals"))
    possible = np.array([joins for _, joins in sealed])
    across = (starts[:, 0] < 0) != (goals[:, 0] < 0)
    beside = (np.abs(starts[:, 0]) < 2) | (np.abs(goals[:, 0]) < 2)  # in the wall itself
    np.testing.assert_array_equal(possible[~beside], ~across[~beside])
    assert across.any()


def test_a_network_without_weights_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="paper_large alone: no weights"):
        main(dataclasses.replace(TINY, methods=("paper_large alone",), out=tmp_path))
