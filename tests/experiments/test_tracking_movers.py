"""The experiment on seeing movers runs at a tiny size and writes its section."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from experiments.tracking import TINY, field, main, section
from maxjax.sim.worlds.movers import places


@pytest.mark.nightly
def test_it_runs_and_writes_its_section(tmp_path: Path) -> None:
    (row,) = main(dataclasses.replace(TINY, out=tmp_path))
    assert (row["world"], row["looks"]) == ("suburb", 2)
    assert "| suburb | 2 | 5 |" in section(json.loads((tmp_path / "tracking.json").read_text()))


def test_its_truth_is_what_the_simulation_moves() -> None:
    script = field(0, 40, 3)
    given, velocity = places(script.movers(), np.float32(3.7))
    expected = script.at(3.7)
    np.testing.assert_allclose(given, expected[0], atol=1e-4)
    np.testing.assert_allclose(velocity, expected[1], atol=1e-4)
    assert np.abs(velocity).max() < 1.8
