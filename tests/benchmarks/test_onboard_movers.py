"""The benchmark of the loop on board among movers runs at a small size, compiles nothing in flight, and has a table."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from benchmarks import onboard_movers, tables


@pytest.mark.nightly
def test_the_loop_on_board_among_movers_writes_a_row_a_flight_and_one_of_all(tmp_path: Path) -> None:
    rows = onboard_movers.main(dataclasses.replace(onboard_movers.TINY, out=tmp_path))
    document = json.loads((tmp_path / "onboard_movers.json").read_text())
    assert document["rows"] == rows
    assert [row["flight"] for row in rows] == ["0", "all"]
    assert all(row["compilations"] == 0 and row["cycles"] == onboard_movers.TINY.cycles for row in rows)
    assert "| by a clock |" in tables.onboard_movers(document)
