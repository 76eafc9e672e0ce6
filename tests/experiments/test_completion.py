"""Completion: a scan shows what is there, and training goes on where it ended."""

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.completion import judge, train
from experiments.completion.network import inputs_of
from experiments.completion.scenes import GROUND, OCCUPIED, SEEN_FREE, SEEN_OCCUPIED, draw_scene
from maxjax.nn.checkpoint import save_checkpoint


def test_a_scan_of_a_city_shows_no_more_than_there_is() -> None:
    bits = draw_scene("midtown", 3, 0, 0)
    np.testing.assert_array_equal(bits, draw_scene("midtown", 3, 0, 0))
    occupied, free = (bits & SEEN_OCCUPIED) > 0, (bits & SEEN_FREE) > 0
    there = (bits & (OCCUPIED | GROUND)) > 0
    assert occupied.any()
    assert free.any()
    # Returns have noise of centimetres, and a beam may pass the empty part of an occupied voxel.
    assert there[occupied].mean() > 0.99
    assert there[free].mean() < 0.1


def test_what_is_there_is_not_among_the_inputs() -> None:
    bits = draw_scene("midtown", 3, 0, 1)
    np.testing.assert_array_equal(inputs_of(jnp.asarray(bits)), inputs_of(jnp.asarray(bits ^ OCCUPIED)))


@pytest.mark.large
def test_training_goes_on_where_it_ended_and_lowers_the_loss(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = train.Config(
        tmp_path / "whole", cities=1, places=2, epochs=4, batch=2, rate=1e-2, tiny=True, out=tmp_path / "results"
    )
    rows = train.main(config)
    whole, _ = train.load(config.folder)
    parts = dataclasses.replace(config, folder=tmp_path / "parts")

    def once(*given: Any) -> None:
        save_checkpoint(*given)
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(train, "save_checkpoint", once)
        with pytest.raises(KeyboardInterrupt):
            train.main(parts)
    train.main(parts)
    for one, other in zip(jax.tree.leaves(whole), jax.tree.leaves(train.load(parts.folder)[0]), strict=True):
        np.testing.assert_array_equal(one, other)
    losses = [float(row["loss"] or 0) for row in rows]
    assert len(losses) == 4
    assert losses[-1] < losses[0]
    with pytest.raises(ValueError, match="choose another folder"):
        train.main(dataclasses.replace(config, rate=1e-3))


@pytest.mark.nightly
def test_the_judge_counts_plans_of_every_kind(tmp_path: Path) -> None:
    train.main(train.Config(tmp_path, cities=1, places=2, epochs=1, batch=2, tiny=True, out=tmp_path))
    rows = judge.main(judge.Config(tmp_path, maps=("suburb",), problems=1, out=tmp_path))
    plans = {row["unseen"]: row for row in rows if row["what"] == "plans"}
    assert set(plans) == {"free", "alike", "extruded", "truth", "network"}
    assert all(row["problems"] == 1 for row in plans.values())
    assert sum(int(row["voxels"] or 0) for row in rows if row["what"] == "reliability") > 0
