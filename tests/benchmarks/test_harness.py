"""Timing, and result files that are written whole and name no path."""

from __future__ import annotations

import dataclasses
import json
import os
import sys
from pathlib import Path

import jax.numpy as jnp
import pytest

from benchmarks.common import harness


@dataclasses.dataclass(frozen=True)
class Settings:
    size: int
    out: Path


def test_saved_file_names_no_path_of_this_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["/somewhere/bench.py", "--out", str(tmp_path), "--map", "/a/b/c.npz", "--n", "3"])
    path = harness.save("tiny", Settings(3, tmp_path), [{"a": 1, "b": None}, {"a": 2.5, "c": "x"}], tmp_path)
    text = path.read_text()
    for place in (str(tmp_path), "/somewhere", "/a/b", os.getcwd(), str(Path.home()) + os.sep):
        assert place not in text
    document = json.loads(text)
    assert document["provenance"]["command"].endswith("--map c.npz --n 3")
    assert document["config"] == {"size": 3}
    assert os.listdir(tmp_path) == ["tiny.json"]


def test_failed_save_leaves_the_old_file(tmp_path: Path) -> None:
    path = harness.save("tiny", Settings(1, tmp_path), [{"a": 1}], tmp_path)
    before = path.read_text()
    with pytest.raises(ValueError, match="JSON"):
        harness.save("tiny", Settings(1, tmp_path), [{"a": float("nan")}], tmp_path)
    assert path.read_text() == before
    assert os.listdir(tmp_path) == ["tiny.json"]


def test_measure_counts_its_calls() -> None:
    calls = 0

    def work() -> object:
        nonlocal calls
        calls += 1
        return {"a": jnp.ones(3)}

    timing = harness.measure(work, 4)
    assert calls == 5
    assert timing.n == 4
    assert 0.0 <= timing.min_s <= timing.median_s <= timing.max_s
    assert timing.compile_s >= 0.0
    with pytest.raises(ValueError, match="at least 1"):
        harness.measure(work, 0)


def test_a_run_goes_on_from_rows_of_the_same_settings_and_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    origin = harness.provenance() | {"commit": "a" * 40, "dirty": False}
    monkeypatch.setattr(harness, "provenance", lambda: origin)
    rows: list[harness.Row] = [{"a": 1}, {"a": 2}]
    assert harness.begun("tiny", Settings(3, tmp_path), tmp_path) == []
    harness.keep("tiny", Settings(3, tmp_path), rows, tmp_path)
    assert harness.begun("tiny", Settings(3, Path("elsewhere")), tmp_path) == rows
    assert harness.begun("tiny", Settings(4, tmp_path), tmp_path) == []
    for changed in ({"commit": "b" * 40}, {"dirty": True}, {"cpus": 64}):
        with monkeypatch.context() as other:
            other.setattr(harness, "provenance", lambda changed=changed: origin | changed)
            assert harness.begun("tiny", Settings(3, tmp_path), tmp_path) == []
