"""The whole Warframe maps: a few scenarios, and the box that may stand for a map."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

import maxjax
from experiments import warframe_full as module
from maxjax.planning.search.astar import astar


@pytest.mark.nightly
def test_a_few_scenarios_are_solved_and_the_section_says_so(data: Path, tmp_path: Path) -> None:
    rows = module.main(dataclasses.replace(module.TINY, data=data, out=tmp_path))
    assert [(row["map"], row["method"]) for row in rows] == [("Simple", "solver"), ("Simple", "astar")]
    ours, rival = rows
    assert ours["ok"] == ours["certified"] == ours["scenarios"] == 4
    assert ours["passed_on_whole_map"] == ours["checked"] == rival["scenarios"] == 2
    assert float(ours["over_optimum_worst"] or 9) <= 1.05
    assert rival["off_optimum"] == 0
    document = json.loads((tmp_path / "warframe_full.json").read_text())
    text = module.section(document)
    assert "Of 4 scenarios that others made, 4 are solved and verified" in text
    assert text.count("| Simple |") == 2
    assert "A* meets the stated optimum in 2 of 2 scenarios" in text


def test_the_box_around_a_maze_has_the_shortest_paths_of_the_whole_map(tmp_path: Path) -> None:
    walls = {(9, j, k) for j in range(6, 12) for k in range(6, 12)} | {(12, j, 8) for j in range(4, 10)}
    lines = "".join(f"{x} {y} {z}\n" for x, y, z in sorted(walls))
    (tmp_path / "A.3dmap").write_text(f"voxel 20 22 18\n{lines}")
    (tmp_path / "A.3dmap.3dscen").write_text("version 1\nA.3dmap\n7 9 9 14 8 8 10.5 1.1\n7 8 9 11 9 9 9.25 1.2\n")
    maze = module.load(tmp_path, "A")
    assert {tuple(x) for x in np.argwhere(maze.occupied).tolist()} == walls
    assert maze.grid.shape == (20, 22, 18)
    assert maze.optimum.tolist() == [10.5, 9.25]
    box, grid = maze.cropped(1)
    assert grid.shape == (10, 10, 8)
    assert grid.origin == (6.0, 3.0, 5.0)
    for start, goal in zip(maze.starts, maze.goals, strict=True):
        inside, whole = (
            astar(o, *(tuple((end - np.array(g.origin, int)).tolist()) for end in (start, goal)))
            for o, g in ((box, grid), (maze.occupied, maze.grid))
        )
        lengths = [np.linalg.norm(np.diff(found.path, axis=0), axis=1).sum() for found in (inside, whole)]
        assert lengths[0] == pytest.approx(lengths[1])
        assert lengths[0] > np.linalg.norm(goal - start) + 1  # there is something in the way
        assert maxjax.verify(inside.path + np.array(grid.origin), maxjax.VoxelMap.on(maze.grid, maze.occupied)).ok


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "A.3dmap").write_text("type octile\n")
    with pytest.raises(ValueError, match="expected a first line 'voxel nx ny nz', found 'type octile'"):
        module.load(tmp_path, "A")
