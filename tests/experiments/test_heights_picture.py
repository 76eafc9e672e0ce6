"""The picture of heights is drawn, the same each time."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.heights_picture import Config, main


@pytest.mark.nightly
def test_the_picture_is_drawn_and_repeats(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    for name in ("a.png", "b.png"):
        main(Config(tmp_path / name))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "a.png").stat().st_size > 20_000
