"""The benchmark of the page runs at a small size, where there is a browser."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="the page needs the extra view: pip install 'maxjax[view]'")
pytest.importorskip("playwright", reason="no playwright: pip install playwright")

from benchmarks import page, tables
from benchmarks.common.browser import chromium


@pytest.mark.nightly
def test_drags_are_timed_and_frames_counted(tmp_path: Path) -> None:
    if chromium() is None:
        pytest.skip("no Chromium on this machine: apt-get install chromium")
    rows = page.main(dataclasses.replace(page.TINY, out=tmp_path))
    document = json.loads((tmp_path / "page.json").read_text())
    assert document["rows"] == rows
    drags, answers = rows[:2]
    assert drags["n"] == 2
    assert drags["median"] > 0  # type: ignore[operator]
    assert answers["median"] > 0  # type: ignore[operator]
    named = {str(row["what"]).removesuffix(", half the resolution"): row for row in rows}
    assert named["frames, without a map"]["triangles"] == 0
    # Four boxes that stand apart on the ground: five sides each are seen, of two triangles.
    page_row, bare = named["frames, 4 boxes"], named["bare WebGL, 4 boxes"]
    assert page_row["triangles"] == bare["triangles"] >= 4 * 5 * 2  # type: ignore[operator]
    assert bare["median"] > 0  # type: ignore[operator]
    assert f"computed by {bare['by']}" in tables.page(document)
    assert "drag to verified path" in tables.page(document)
