"""The paper's loop: its dilation and smoothing before SciPy's, its paths before walls, and a tiny run."""

from __future__ import annotations

import dataclasses
import itertools
import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage

from experiments.paper_loop.stage import Loop, before_walls, dilated, smoothed_gradients
from experiments.paper_loop.study import BEFORE, FEW, LAYERS, LOOPS, TINY, Config, flight_of, main, row_of
from experiments.paper_loop.tables import section
from maxjax.fields.gradient import gradient
from tests.scenes import outcome

SHAPE = (24, 20, 16)
LADDER = (4, 3, 2, 1, 0)


def city(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Occupied voxels and those of them that are ground."""
    rng = np.random.default_rng(seed)
    ground = np.zeros(SHAPE, bool)
    ground[:, :, 0] = True
    return ground | (rng.random(SHAPE) < 0.01 * (1 + seed)), ground


@pytest.mark.parametrize("seed", range(6))
def test_the_largest_dilation_that_joins_the_ends_is_taken(seed: int) -> None:
    occupied, ground = city(seed)
    ends = np.array([[2, 3, 6], [21, 16, 9]], np.int32)
    found, joined = dilated(jnp.asarray(occupied), jnp.asarray(ground), jnp.asarray(ends))
    apart = ndimage.distance_transform_edt(~(occupied & ~ground))
    low = ndimage.distance_transform_edt(~ground)
    for reach in LADDER:
        closed = occupied | (apart <= reach) | (low <= min(reach, 1))
        closed[tuple(ends.T)] = False
        labels, _ = ndimage.label(~closed)
        if labels[tuple(ends[0])] == labels[tuple(ends[1])]:
            break
    np.testing.assert_array_equal(np.asarray(found), closed)
    assert bool(joined) == (labels[tuple(ends[0])] == labels[tuple(ends[1])])


def test_ends_in_separate_chambers_are_not_joined() -> None:
    occupied = np.zeros(SHAPE, bool)
    occupied[12] = True
    ends = jnp.array([[2, 3, 6], [21, 16, 9]], jnp.int32)
    _, joined = dilated(jnp.asarray(occupied), jnp.zeros(SHAPE, bool), ends)
    assert not joined


def test_gradients_are_smoothed_as_scipy_does() -> None:
    rng = np.random.default_rng(3)
    free = rng.random(SHAPE) < 0.9
    u = rng.normal(size=SHAPE).astype(np.float32)
    log_phi = jnp.asarray(np.where(free, u, -np.inf))
    raw = np.asarray(gradient(log_phi, jnp.asarray(free)))
    expected = ndimage.gaussian_filter(raw, (5, 5, 5, 0), mode="nearest")
    found = smoothed_gradients(log_phi, jnp.asarray(free), "gradients")
    np.testing.assert_allclose(np.asarray(found), expected, atol=2e-5)


def test_walls_of_least_value_repel() -> None:
    """A flat field beside a wall: the gradient points away from it by one reading, and nowhere by the other."""
    free = np.ones(SHAPE, bool)
    free[10] = False
    u = np.zeros(SHAPE, np.float32)
    u[0] = -1.0  # the least value
    log_phi = jnp.where(free, u, -jnp.inf)
    repels = np.asarray(smoothed_gradients(log_phi, jnp.asarray(free), "field"))
    assert (repels[12:16, 5:15, 5:11, 0] > 0).all()
    flat = np.asarray(smoothed_gradients(log_phi, jnp.asarray(free), "walls"))
    np.testing.assert_allclose(flat[12:16, 5:15, 5:11, 0], 0, atol=1e-6)


def test_a_path_ends_before_a_wall() -> None:
    free = np.ones(SHAPE, bool)
    free[10] = False
    path = np.stack([np.linspace(2, 20, 73), np.full(73, 8.0), np.full(73, 8.0)], axis=1).astype(np.float32)
    found = np.asarray(before_walls(jnp.asarray(path), jnp.asarray(free)))
    inside = path[: np.argmax(np.floor(path[:, 0] + 0.5) == 10)]
    np.testing.assert_array_equal(found[: len(inside)], inside)
    np.testing.assert_array_equal(found[len(inside) :], np.broadcast_to(inside[-1], (73 - len(inside), 3)))


def test_layers_differ_by_one_thing_each() -> None:
    chain: list[Any] = [LOOPS[BEFORE], *LAYERS.values()]
    for before, after in itertools.pairwise(chain):
        changed = [f.name for f in dataclasses.fields(Loop) if getattr(before, f.name) != getattr(after, f.name)]
        assert len(changed) == 1, (before, after)


def test_the_section_holds_every_loop_and_its_interval() -> None:
    rows = []
    for name in LOOPS:
        for trials in (2, 60):
            statuses = ["OK" if trial % 2 else "PATH_STALLED" for trial in range(trials)]
            row = row_of("suburb", name, [outcome(trial, status) for trial, status in enumerate(statuses)])
            rows.append({**row, "device": "1 x NVIDIA H100"})
    many = section({"name": "paper_loop_many", "rows": rows})
    assert many.count("30 of 60") == len(LOOPS)
    assert "1 of 2" not in many
    text = section({"name": "paper_loop", "rows": rows})
    first, every = text.split("#### Loops of which more were flown")
    assert "(NVIDIA H100)" in first
    assert f"{BEFORE} (downtown)" in every.split("Not flown:")[1]
    for name in LOOPS:
        assert f"| {name} | 1 of 2 | 1.3 to 98.7 % |" in first  # 1 - 0.025^(1/2) above, by hand
        assert f"| {name} | 30 of 60 |" in every
    assert "PATH_STALLED: 30" in every
    assert "50 of 50" in first
    assert FEW == 50


@pytest.mark.nightly
def test_a_tiny_run_flies_and_reports_what_was_kept(tmp_path: Path) -> None:
    kept = dataclasses.replace(TINY, keep=tmp_path / "kept", out=tmp_path)
    (row,) = main(kept)
    found: Any = row
    assert (found["trials"], found["contacts"], found["statuses"]) == (1, 0, "OUT_OF_PLANS: 1")
    assert found["failed_plans"] == TINY.plans
    main(dataclasses.replace(kept, loops=()))  # flies nothing: what was flown so far
    document = json.loads((tmp_path / "paper_loop.json").read_text())
    assert document["rows"] == [row]
    assert f"| {BEFORE} |" in section(document)


def test_unknown_loops_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"loops: expected parts of .*given sail"):
        main(Config(loops=(BEFORE, "sail"), out=tmp_path))


def test_a_loop_takes_the_place_of_the_planning_stage() -> None:
    stages = flight_of(LOOPS[BEFORE], TINY.plans).stages
    assert stages is not None
    assert [stage for stage in stages if isinstance(stage, Loop)] == [LOOPS[BEFORE]]
