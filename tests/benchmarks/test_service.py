"""A service at a small size keeps its files, and processes that write one folder lose nothing of each other's."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="the page needs the extra view: pip install 'maxjax[view]'")

from benchmarks import service, tables


@pytest.mark.nightly
@pytest.mark.usefixtures("compiled_astar")
def test_a_service_holds_what_it_held_and_a_full_folder_takes_new_programs(tmp_path: Path) -> None:
    rows = service.main(dataclasses.replace(service.TINY, out=tmp_path))
    document = json.loads((tmp_path / "service.json").read_text())
    assert document["rows"] == rows
    *looks, flat, cache = rows
    assert [(row["plans"], row["solved"], row["clients"]) for row in looks] == [(20, 20, 1), (40, 40, 2), (60, 60, 3)]
    assert flat["handles_last"] <= flat["handles_first"]  # type: ignore[operator]
    assert cache["solved"] == 2 * 2 * 2  # two processes, twice, two plans each
    assert cache["compiled_again"] == 0
    assert cache["programs"] > 2  # type: ignore[operator]
    assert cache["last_MB"] <= cache["limit_MB"]  # type: ignore[operator]
    assert "60 plans (60 OK) and 3 clients" in tables.service(document)


def test_what_grows_is_seen() -> None:
    looks = [{"memory_MB": 100.0 + k, "handles": 9, "threads": 20} for k in range(50)]
    flat = service.flatness(looks)
    # Medians of looks 10 to 17 and of 42 to 49.
    assert (flat["memory_MB_first"], flat["memory_MB_last"]) == (113.5, 145.5)
    assert flat["handles_first"] == flat["handles_last"] == 9
