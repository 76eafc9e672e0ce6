"""The offline table at a small size: what it measures holds there, and its text says no more than its rows."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("skfmm", reason="fast marching needs scikit-fmm: pip install 'maxjax[bench]'")

import maxjax
from benchmarks.common.problems import problems, seal, solvable
from experiments.offline_methods import finder
from experiments.offline_table import TINY, main, section, turning

GRID = maxjax.Grid.centered((0.0, 0.0, 0.0), TINY.shape, 2.0)


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    out = tmp_path_factory.mktemp("offline")
    main(dataclasses.replace(TINY, out=out))
    found: dict[str, Any] = json.loads((out / "offline_table.json").read_text())
    return found


@pytest.mark.nightly
def test_every_method_has_a_row_or_a_reason(document: dict[str, Any]) -> None:
    rows = document["rows"]
    assert {row["method"] for row in rows} == set(TINY.methods)
    left_out = {row["method"] for row in rows if not row["map"]}
    assert left_out <= {"paper alone"}
    for row in rows:
        assert all(value is None or isinstance(value, str | int | float) for value in row.values())


@pytest.mark.nightly
def test_what_the_rows_say_of_solver_and_rivals(document: dict[str, Any]) -> None:
    rows = {row["method"]: row for row in document["rows"] if row["map"] == "suburb"}
    ours, rival, marched = rows["solver"], rows["astar"], rows["fast marching"]
    assert ours["ok"] == ours["certified"] == ours["problems"] == ours["shared"] == TINY.problems
    assert rival["ok"] == marched["ok"] == TINY.problems
    assert rival["over_astar"] == 1
    assert ours["over_astar"] < 1
    assert ours["length_m"] == pytest.approx(marched["length_m"], rel=0.03)
    for row in rows.values():
        assert row["ms_min"] <= row["ms_median"] <= row["ms_max"]
        assert row["find_ms_median"] < row["ms_median"]
        assert row["ok"] == row["problems"] or row["failures"]


@pytest.mark.nightly
def test_the_section_names_every_row_and_what_is_left_out(document: dict[str, Any]) -> None:
    text = section(document)
    for row in document["rows"]:
        if row["map"]:
            assert f"{row['ok']}/{row['problems']}" in text
        else:
            assert row["left_out"] in text.split("Not measured:")[1]
    assert "None" not in text
    assert "nan" not in text


@pytest.mark.nightly
def test_where_a_peer_wins_the_text_says_so(document: dict[str, Any]) -> None:
    rows = [dict(row) for row in document["rows"] if row["method"] in ("solver", "astar")]
    ours, rival = rows
    rival |= {"ms_median": ours["ms_median"] / 2, "length_m": ours["length_m"] - 1.0}
    text = section(document | {"rows": rows})
    assert "Shorter where both solve than ours: A*" in text
    assert "Quicker (median) than ours: A*" in text
    rival |= {"ms_median": 2 * ours["ms_median"], "length_m": ours["length_m"] + 1.0}
    text = section(document | {"rows": rows})
    assert "Shorter" not in text
    assert "Quicker" not in text
    # Fewer problems are other problems: their mean length is no win, and the count is shown.
    rival |= {"length_m": 1.0, "shared_solved": 1, "ok": 1, "failures": "PATH_STALLED: 1"}
    text = section(document | {"rows": rows})
    assert "Shorter" not in text
    assert f"(1 of {TINY.problems})" in text
    assert f"A* solves 1 of {TINY.problems} (PATH_STALLED: 1)" in text


def test_turning_is_that_of_corners_and_circles() -> None:
    assert turning(np.array([[0, 0, 0], [1, 0, 0], [5, 0, 0]], np.float32)) == pytest.approx(0, abs=1e-4)
    assert turning(np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]], np.float32)) == pytest.approx(45)
    assert turning(np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0]], np.float32)) == pytest.approx(90)
    t = np.linspace(0, np.pi, 200)
    arc = 5 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    assert turning(arc) == pytest.approx(np.degrees(1 / 5), rel=0.01)


def test_a_sealed_problem_is_not_solvable() -> None:
    (problem,) = problems("suburb", 1, 0, GRID)
    assert solvable(problem).all()
    assert not solvable(seal(problem, "start")).any()
    assert not solvable(seal(problem, "goal")).any()


def test_rrt_star_is_found_or_left_out_with_the_reason() -> None:
    found = finder("rrtstar")
    assert isinstance(found, str) == (importlib.util.find_spec("ompl") is None)
    assert not isinstance(found, str) or "OMPL" in found


def test_unknown_methods_are_refused() -> None:
    for name in ("dijkstra", "network twice", "paper aloud"):
        with pytest.raises(ValueError, match="method"):
            finder(name)


@pytest.mark.nightly
def test_at_own_distances_paths_keep_the_radius_and_pay_for_clearance(document: dict[str, Any], tmp_path: Path) -> None:
    main(dataclasses.replace(TINY, own=True, methods=("solver", "astar"), out=tmp_path))
    own: dict[str, Any] = json.loads((tmp_path / "offline_table_own.json").read_text())
    text = section(own)
    assert "our own distances" in text
    assert "3DMaxConvNet" not in text
    assert "3DMaxConvNet" in section(document)
    for row in own["rows"]:
        assert row["ok"] == row["problems"] == TINY.problems
        assert row["clearance_least_m"] >= 1.0
