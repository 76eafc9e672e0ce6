"""Inspections by a round against a field: a tiny run."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from experiments import covering

pytestmark = pytest.mark.nightly


def test_ways_to_order_photos_are_compared_on_the_same_sights(tmp_path: Path) -> None:
    rows = covering.main(dataclasses.replace(covering.TINY, out=tmp_path))
    assert [row["way"] for row in rows] == ["round", "field", "field, of the round's"]
    whole, field, own = rows
    assert whole["wanted_100"] == pytest.approx(1.0, abs=1e-3)
    assert whole["photos"] == own["photos"]
    assert float(field["seconds"] or 0) > float(whole["seconds"] or 0)  # type: ignore[arg-type]
    for row in rows:
        assert float(row["once_25"] or 0) >= float(row["wanted_25"] or 0)  # type: ignore[arg-type]
    document = {"rows": rows, "config": {"distance": 8.0}, "provenance": {"device": "1 x cpu", "cpus": 2}}
    assert "a round through viewpoints" in covering.section(document)  # type: ignore[arg-type]
