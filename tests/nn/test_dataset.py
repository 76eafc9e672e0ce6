"""Scenes are functions of their keys, labelled by the solver, and kept in files that are checked."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax import Screened, Status, conductivity, solve_potential
from maxjax.nn.dataset import Chunks, Scenes, generate, usable
from tests.nn.scenes import GRID, Boxes

KEY = jax.random.key(3)


def same(a: Scenes, b: Scenes) -> bool:
    return all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))


@pytest.fixture(scope="module")
def scenes() -> Scenes:
    return generate(Boxes(), KEY, 5, GRID, Chunks(4))


def test_a_scene_is_its_key_whatever_the_count(scenes: Scenes) -> None:
    fewer = generate(Boxes(), KEY, 3, GRID, Chunks(4))
    assert same(fewer, jax.tree.map(lambda leaf: leaf[:3], scenes))
    other = generate(Boxes(), jax.random.key(4), 3, GRID, Chunks(4))
    assert not same(other, fewer)


def test_targets_are_the_solvers_log_potential(scenes: Scenes) -> None:
    solve = jax.jit(lambda sigma, goal, price: solve_potential(sigma, goal, price, solver=Screened(tolerance=1e-5)))
    for i in range(5):
        sigma = conductivity(scenes.blocked[i], scenes.goal_index[i], GRID)
        exact = solve(sigma, scenes.goal_index[i], scenes.price[i])
        joined = np.isfinite(np.asarray(exact.log_phi))
        wanted = -float(exact.screening_length) * np.asarray(exact.log_phi)[joined]
        np.testing.assert_allclose(np.asarray(scenes.target[i])[joined], wanted, atol=0.05)
        assert not np.asarray(scenes.target[i])[~joined].any()
        assert ((np.asarray(scenes.steps[i]) > 0) == (joined & (np.asarray(scenes.target[i]) > 0))).mean() > 0.999
        assert scenes.status[i] == Status.OK


def test_kept_chunks_are_read_back_and_missing_ones_made_again(tmp_path: Path, scenes: Scenes) -> None:
    first = generate(Boxes(), KEY, 5, GRID, Chunks(4, tmp_path))
    files = sorted(tmp_path.iterdir())
    assert len(files) == 2
    before = files[0].stat().st_mtime_ns
    files[1].unlink()
    again = generate(Boxes(), KEY, 5, GRID, Chunks(4, tmp_path))
    assert same(first, scenes)
    assert same(again, scenes)
    assert files[0].stat().st_mtime_ns == before


def test_damaged_or_foreign_chunks_are_refused(tmp_path: Path) -> None:
    generate(Boxes(), KEY, 2, GRID, Chunks(4, tmp_path))
    with pytest.raises(ValueError, match="another key or grid"):
        generate(Boxes(), jax.random.key(8), 2, GRID, Chunks(4, tmp_path))
    (file,) = tmp_path.iterdir()
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    with pytest.raises(ValueError, match=file.name):
        generate(Boxes(), KEY, 2, GRID, Chunks(4, tmp_path))


def test_scenes_without_a_field_are_left_out(scenes: Scenes) -> None:
    marked = jax.tree.map(lambda leaf: leaf, scenes)
    status = marked.status.at[1].set(int(Status.GOAL_OCCUPIED))
    fewer = usable(Scenes(**{**vars(marked), "status": status}))
    assert len(fewer.status) == 4
    np.testing.assert_array_equal(fewer.goal_index, scenes.goal_index[jnp.array([0, 2, 3, 4])])
    with pytest.raises(ValueError, match="given none"):
        usable(Scenes(**{**vars(marked), "status": jnp.full(5, 4)}))
    with pytest.raises(ValueError, match="at least one, given 0"):
        generate(Boxes(), KEY, 0, GRID)
