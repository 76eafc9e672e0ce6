"""Maps of any size are drawn: what stands in the fine one stands in the coarse one."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import maxjax
from maxjax import VoxelMap
from maxjax.core.status import Closure
from maxjax.ui.figures import drawable as module
from maxjax.ui.figures.drawable import drawable, title_with_remark


def town(shape: tuple[int, int, int] = (13, 9, 11)) -> VoxelMap:
    rng = np.random.default_rng(0)
    ground = np.zeros(shape, bool)
    ground[:, :, :3] = True
    return VoxelMap.of(rng.random(shape) < 0.1, spacing=2.0, origin=(5.0, -3.0, 1.0), ground=ground)


@pytest.mark.parametrize("factor", [1, 2, 3])
def test_a_coarser_map_holds_what_the_fine_one_holds(factor: int) -> None:
    fine = town()
    reasons = np.full(fine.grid.shape, Closure.OPEN, np.uint8)
    reasons[5:7, :, 6] = Closure.AREA
    fine = fine.closing(reasons)
    coarse = fine.coarser(factor)
    assert coarse.grid.spacing == 2.0 * factor
    np.testing.assert_allclose(coarse.grid.lower, fine.grid.lower)
    assert coarse.closed is not None
    for index in np.ndindex(*coarse.grid.shape):
        part = tuple(slice(factor * i, factor * (i + 1)) for i in index)
        assert coarse.occupied[index] == fine.occupied[part].any()
        obstacle = (fine.occupied & ~fine.ground)[part].any()
        assert coarse.ground[index] == (fine.ground[part].any() and not obstacle)
        assert coarse.closed[index] == (Closure.OPEN if coarse.occupied[index] else fine.closed[part].max())
    with pytest.raises(ValueError, match="factor from 1 on"):
        fine.coarser(0)


def test_what_is_too_large_is_drawn_coarser_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    fine, within = town(), np.ones((13, 9), bool)
    within[:4] = False
    assert drawable(fine, within) == (fine, within, "")
    monkeypatch.setattr(module, "MOST_DRAWN", 300)
    coarse, columns, remark = drawable(fine, within)
    assert coarse.occupied.size <= 300
    assert remark == "drawn in voxels of 4 m"
    assert columns is not None
    np.testing.assert_array_equal(columns, np.arange(7)[:, None] >= np.full((1, 5), 2))
    assert title_with_remark("a.las", remark) == "a.las, drawn in voxels of 4 m"
    assert title_with_remark(None, "") is None


def test_a_home_that_cannot_be_written_is_no_news(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    (tmp_path / "home").write_text("no folder")
    program = "from maxjax.ui.figures.style import load_matplotlib; load_matplotlib()"
    where = {name: value for name, value in os.environ.items() if name not in ("MPLCONFIGDIR", "XDG_CONFIG_HOME")}
    where |= {"HOME": str(tmp_path / "home"), "PYTHONPATH": str(Path(maxjax.__file__).parents[1])}
    done = subprocess.run([sys.executable, "-c", program], env=where, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
