"""Mutated inputs of every format are refused in words of maxjax, or give something finite.

python -m tests.fuzz --inputs 1050000      # at length
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("viser", reason="messages need the extra view: pip install 'maxjax[view]'")

from benchmarks import tables
from tests.fuzz import __main__ as at_length
from tests.fuzz.formats import FORMATS, share


@pytest.mark.large
@pytest.mark.parametrize("inputs", [20_000, pytest.param(200_000, marks=pytest.mark.nightly)])  # of all formats
@pytest.mark.parametrize("name", FORMATS)
def test_mutated_inputs_are_refused_or_finite(tmp_path: Path, name: str, inputs: int) -> None:
    tried = FORMATS[name]
    whole = tried.valid()
    assert tried.outcome(whole, tmp_path) == "taken"
    rng = np.random.default_rng(0)
    count = share(name, inputs)
    found = [tried.outcome(tried.damage(whole, rng), tmp_path) for _ in range(count)]
    assert found.count("refused") > 0.02 * count


def test_the_command_counts_and_keeps_what_ends_otherwise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(at_length, "FORMATS", {name: FORMATS[name] for name in ("a.obj", "a.3dmap")})
    monkeypatch.setattr("tests.fuzz.map_files.read_map", lambda path: 1 / 0)
    with pytest.raises(SystemExit, match=r"a\.obj"):
        at_length.main(at_length.Config(inputs=400, out=tmp_path))
    document = json.loads((tmp_path / "fuzz.json").read_text())
    assert [row["format"] for row in document["rows"]] == ["a.obj", "a.3dmap"]
    for row in document["rows"]:
        assert row["inputs"] == row["refused"] + row["taken"] + row["otherwise"]
        assert row["otherwise"] > 0
        assert len(list((tmp_path / "otherwise").glob(f"first-{row['format']}"))) == 1
    assert "| a.obj |" in tables.fuzz(document)
