"""The clearance table: judged figures of planned paths."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from experiments import clearance
from experiments.problem_sets import Instance
from maxjax import Grid, Status, VoxelMap

NONE = np.zeros((0, 3))


@pytest.mark.nightly
def test_a_tiny_run_plans_keeps_judges_and_reports(tmp_path: Path) -> None:
    pytest.importorskip("skfmm", reason="fast marching is scikit-fmm's: pip install 'maxjax[bench]'")
    (first,) = clearance.main(dataclasses.replace(clearance.TINY, variants=("astar",), out=tmp_path))
    assert first["ok"] == first["problems"] == first["solvable"] == 2
    assert first["unsafe"] == first["certified"] == 0
    assert float(first["over_cheapest_mean"] or 0) >= 0.98
    text = clearance.section(json.loads((tmp_path / "clearance.json").read_text()))
    assert "| suburb | astar | 2 of 2 | 0 | 0 |" in text


@pytest.mark.nightly
def test_a_run_that_was_ended_goes_on_with_the_block_that_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("skfmm", reason="fast marching is scikit-fmm's: pip install 'maxjax[bench]'")
    monkeypatch.setattr(clearance, "BLOCK", 1)
    real, planned = clearance.outcome_of, []
    config = dataclasses.replace(clearance.TINY, problems=3, variants=("astar",), workers=1, out=tmp_path)

    def until(most: int) -> Callable[[Instance, clearance.Variant], clearance.Outcome]:
        def outcome_of(instance: Instance, how: clearance.Variant) -> clearance.Outcome:
            planned.append(instance)
            if len(planned) > most:
                raise KeyboardInterrupt
            # The last one fails: an outcome without a path is kept as well.
            return real(instance, how)._replace(seconds=0.5, **({"path": NONE} if len(planned) % 3 == 0 else {}))

        return outcome_of

    monkeypatch.setattr(clearance, "outcome_of", until(3))
    (whole,) = clearance.main(config)
    assert not list(tmp_path.glob("*.partial"))
    planned.clear()
    monkeypatch.setattr(clearance, "outcome_of", until(1))
    with pytest.raises(KeyboardInterrupt):
        clearance.main(config)
    with pytest.raises(ValueError, match="a block of another run: seed was 0 there, is 1 here"):
        clearance.main(dataclasses.replace(config, seed=1))
    planned.pop()
    monkeypatch.setattr(clearance, "outcome_of", until(3))
    assert clearance.main(config) == [whole]
    assert len(planned) == 3
    assert whole["ok"] == 2


def test_figures_count_what_was_possible() -> None:
    """A wall with a gap of 3 and one of 9 voxels, a floor of ground; paths through either."""
    grid = Grid((41, 41, 9), 2.0, (0.0, 0.0, 0.0))
    ground = np.zeros(grid.shape, bool)
    ground[:, :, 0] = True
    occupied = ground.copy()
    occupied[20] = True
    occupied[20, 14:17, 1:] = occupied[20, 24:33, 1:] = False
    ends = np.array([[8.0, 40, 10], [72.0, 40, 10]])
    instances = [Instance(VoxelMap.on(grid, occupied, ground), ends[0], ends[1])] * 3
    near = np.array([[4.0, 20, 5], [20, 15, 5], [36, 20, 5]])
    wide = np.array([[4.0, 20, 5], [20, 28, 5], [36, 20, 5]])
    through = np.array([[4.0, 20, 5], [36.0, 20, 5]])
    outcomes = {"solver": [clearance.Outcome(Status.OK, True, path, 1.0) for path in (near, wide, through)]}
    judged = clearance.judged_by(instances, outcomes, {"solver": ("quadratic", 4.0, 8.0)})["solver"]
    assert [one.unsafe for one in judged] == [False, False, True]
    assert judged[0].ways[1] > judged[0].ways[0]
    assert np.isfinite(judged[0].ways[2])
    off_the_corner = 2 * (1.5 - 0.5 * 5 / 16) / np.hypot(1, 5 / 16)
    assert judged[0].cruise == pytest.approx(off_the_corner, abs=0.01)
    assert judged[1].cost < judged[0].cost
    assert judged[1].cheapest == judged[0].cheapest < judged[0].cost
    row = clearance._figures(outcomes["solver"], judged)
    assert row["possible_4"] == 3
    assert row["below_4"] == 2
    assert row["below_2"] == 1
