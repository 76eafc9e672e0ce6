"""The film of wind: the clock that waits keeps what time alone loses, and every frame is there."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("PIL", reason="needs Pillow (extra viz)")

from PIL import Image

from experiments.wind_film import TINY, main


@pytest.mark.nightly
def test_time_alone_strays_and_the_clock_that_waits_does_not(tmp_path: Path) -> None:
    config = dataclasses.replace(TINY, wind=12.0, seed=3, since=100.0, out=tmp_path / "wind.gif")
    by_time, waits = main(config)
    assert by_time.aside.max() > 2.0
    assert waits.aside.max() < 1.0
    # By time alone the clock is the time; the other one comes to its end later, beyond the 2 s that are flown after it.
    np.testing.assert_array_equal(by_time.clock, by_time.time)
    assert waits.time[-1] - waits.clock[-1] > 2.5
    film = Image.open(io.BytesIO(config.out.read_bytes()))
    assert (film.format, film.n_frames) == ("GIF", 105)
    assert len(config.out.read_bytes()) < 2e6
