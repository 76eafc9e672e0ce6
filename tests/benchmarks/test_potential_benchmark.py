"""The benchmark of the solver at a tiny size: what CI does not run, rots."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse import csr_matrix, diags_array

from benchmarks.common.screened_system import angles_of
from benchmarks.linear_solvers import hindsight, least
from benchmarks.potential import TINY, main


@pytest.mark.nightly
def test_benchmark_writes_and_prints_its_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = main(dataclasses.replace(TINY, json=True, out=tmp_path))
    text = (tmp_path / "potential.json").read_text()
    assert capsys.readouterr().out == text
    assert json.loads(text)["rows"] == rows
    measured = [row for row in rows if "note" not in row]
    assert all("unit" in row and float(str(row["median"])) > 0 for row in measured)
    named = {str(row["what"]): row for row in rows}
    ours = named["solve, downtown: maxjax"]
    assert ours["certified"]
    assert ours["within_1deg"] >= 0.95
    assert ours["within_5deg"] >= 0.999
    assert ours["arrived"] == ours["starts"] == 1
    # The angles are right because three other solvers of the same equations agree on them.
    for peer in ("SciPy CG, Jacobi, component", "SciPy CG, whole grid", "JAX, Jacobi-PCG, whole grid"):
        assert named[f"solve, downtown: {peer}"]["as_good"]
    assert named["size: downtown, 21³"]["certified"]
    for row in measured:
        if str(row["what"]).startswith("field"):
            assert row["arrived"] == 1
            # Same ends, same free voxels: no path is much longer than another.
            assert abs(float(str(row["length_m"])) / float(str(ours["length_m"])) - 1) < 0.05


def test_angles_are_those_of_plane_waves() -> None:
    x, y, _ = np.meshgrid(*[np.arange(9.0)] * 3, indexing="ij")

    def wave(degrees: float) -> np.ndarray:
        return np.asarray(np.exp(-(x * np.cos(np.radians(degrees)) + y * np.sin(np.radians(degrees))) / 2))

    angles = angles_of(wave(0), np.ones((9, 9, 9), bool))
    assert [angles(wave(degrees)) for degrees in (0.5, 3, 8)] == [(1, 1), (0, 1), (0, 0)]


def test_fewest_iterations_are_found() -> None:
    assert least(lambda count: (min(count / 37, 1.0), 1.0), (1.0, 1.0)) == 37
    assert least(lambda count: (0.5, 0.5), (1.0, 1.0)) == 2048


def test_hindsight_stops_when_good_and_keeps_the_best_of_a_stall() -> None:
    n = 40
    matrix = csr_matrix(diags_array([-1.0, 2.001, -1.0], offsets=[-1, 0, 1], shape=(n, n)))
    source = np.zeros(n)
    source[0] = 1
    exact = np.linalg.solve(matrix.toarray(), source)

    def right(x: np.ndarray) -> tuple[float, float]:
        share = float(np.mean(np.abs(x / exact - 1) < 1e-6))
        return share, share

    # A tridiagonal matrix with its source at one end needs one iteration a voxel.
    count, found = hindsight(right, (1.0, 1.0), matrix, source, lambda: None)
    assert (count, found) == (n, (1.0, 1.0))
    count, found = hindsight(lambda x: (0.5, 0.5), (1.0, 1.0), matrix, source, lambda: None)
    assert (count, found) == (10, (0.5, 0.5))
