"""The protocols with movers at a tiny size: one world each, true positions."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from experiments.moving_protocols import TINY, main, section


@pytest.mark.nightly
def test_a_row_says_who_arrived_and_how_to_fly_a_contact_again(tmp_path: Path) -> None:
    rows = main(dataclasses.replace(TINY, out=tmp_path))
    assert len(rows) == 1
    row = rows[0]
    assert row["arrived"] == row["flights"] == 1
    assert row["contacts"] == 0
    assert row["unflagged"] == 0
    assert row["unflagged_at_contact"] == 0
    assert 105.0 / 5.0 < float(row["seconds"] or 0.0) < 40.0
    text = section(json.loads((tmp_path / "moving_protocols.json").read_text()))
    assert "| SANDO 20 | verified motions | true positions | 0.1 | 1 of 1 |" in text
    contact = {**row, "arrived": 0, "contacts": 1, "seconds": None, "again": "python -m x --first 3"}
    del contact["unflagged_at_contact"]  # files that were written before that was counted
    document = json.loads((tmp_path / "moving_protocols.json").read_text()) | {"rows": [contact]}
    assert "- `python -m x --first 3`" in section(document)
