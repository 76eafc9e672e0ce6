"""A tiny run of the long ways, its plans beside A*'s."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import maxjax
from experiments import long_ways


@pytest.mark.nightly
@pytest.mark.usefixtures("compiled_astar")
def test_a_tiny_run_compares_and_reports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    occupied = np.zeros((40, 32, 16), bool)
    occupied[14:24, 6:26] = True
    ground = np.zeros_like(occupied)
    ground[:, :, 0] = True
    where = maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(0.0, 0.0, 0.0), ground=ground)
    monkeypatch.setattr(long_ways, "_made", lambda _: where)
    (row,) = long_ways.main(dataclasses.replace(long_ways.TINY, out=tmp_path))
    assert row["ok"] == row["astar_ok"] == row["certified"] == row["problems"] == 1
    assert 0.85 < float(str(row["ratio_worst"])) <= 1.0  # a lattice path is up to 1.13 times as long
    assert "| city of tiles" in long_ways.section(json.loads((tmp_path / "long_ways.json").read_text()))


def test_ends_stand_clear_and_at_their_heights() -> None:
    occupied = np.zeros((60, 40, 30), bool)
    occupied[20:30, 10:30, :12] = True
    ground = np.zeros_like(occupied)
    ground[:, :, :2] = True
    where = maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(5.0, 7.0, 0.0), ground=ground)
    ends = long_ways.draw_ends(where, 30, np.random.default_rng(0))
    height = ends[..., 2] - 3.0  # the ground's upper face
    assert ((height > 4.0) & (height < 17.0)).all()
    assert (np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) >= 40.0).all()
    low, high = np.array([44.0, 26.0]), np.array([64.0, 66.0])  # the house
    beside = np.maximum(np.maximum(low - ends[..., :2], ends[..., :2] - high), 0.0)
    assert (np.linalg.norm(beside, axis=2) > 3.0).all()
