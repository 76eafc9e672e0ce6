"""The picture of a fleet: every path in it is verified, ends at the goal, and begins where a vehicle stands."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from experiments.fleet_picture import TINY, main


@pytest.mark.nightly
def test_all_paths_lead_to_the_goal(tmp_path: Path) -> None:
    config = dataclasses.replace(TINY, out=tmp_path / "fleet.png")
    paths = main(config)
    assert 8 <= len(paths) <= 12
    assert len({tuple(path[0]) for path in paths}) == len(paths)
    for path in paths:
        np.testing.assert_allclose(path[-1], config.goal)
    assert config.out.read_bytes().startswith(b"\x89PNG")
