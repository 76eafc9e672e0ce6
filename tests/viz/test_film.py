"""Films of flights open, move and stay small."""

from __future__ import annotations

import io

import numpy as np
import pytest

from maxjax.viz import gif
from maxjax.viz.film import Filmed, Look, film_flight
from maxjax.viz.style import ARRIVED, PLANNED

matplotlib = pytest.importorskip("matplotlib")
from matplotlib import pyplot  # noqa: E402
from PIL import Image  # noqa: E402
from viz.town import GOAL, GRID, line, town  # noqa: E402


def looks(periods: int) -> list[Look]:
    flown = line(points=10 * periods + 1)
    known = town().any(axis=2)
    parts = []
    for period in range(periods):
        part = flown[10 * period + (period > 0) : 10 * period + 11]
        scan = np.random.default_rng(period).uniform(-50, 50, (400, 3))
        path = np.stack([part[0], 0.5 * (part[0] + GOAL), GOAL])
        parts.append(Look(scan, known, (-60.0, -60.0), 2.0, path, part))
    return parts


def film(periods: int = 4) -> tuple[bytes, int]:
    parts = looks(periods)
    count = sum(len(part.flown) for part in parts)
    flight = Filmed(parts, GOAL, np.linspace(2.0, 9.0, count), 0.5)
    return film_flight(flight, town(), GRID, title="Town"), count


def test_a_film_moves_at_ten_frames_a_second() -> None:
    content, count = film()
    assert content.startswith(b"GIF89a")
    with Image.open(io.BytesIO(content)) as opened:
        assert opened.size == (960, 540)
        assert opened.n_frames == -(-(count - 1) // 2) + 1
        assert opened.info["duration"] == 100
        first = np.asarray(opened.convert("RGB"), np.int16)
        opened.seek(opened.n_frames - 1)
        last = np.asarray(opened.convert("RGB"), np.int16)
    assert 0.001 < (np.abs(first - last).sum(axis=2) > 30).mean() < 0.5
    blue, green = (tuple(int(color[at : at + 2], 16) for at in (1, 3, 5)) for color in (ARRIVED, PLANNED))
    assert (last == blue).all(axis=2).sum() > (first == blue).all(axis=2).sum() > 0
    assert (first == green).all(axis=2).any()
    assert not pyplot.get_fignums()


@pytest.mark.large
def test_a_film_that_is_too_large_loses_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    content, _ = film()
    monkeypatch.setattr(gif, "LARGEST", len(content) // 2)
    smaller, _ = film()
    assert len(smaller) <= len(content) // 2
    with Image.open(io.BytesIO(smaller)) as opened:
        assert opened.n_frames > 2


def test_a_film_needs_a_flight() -> None:
    with pytest.raises(ValueError, match="positions"):
        film_flight(Filmed([], GOAL, np.zeros(0), 0.5), town(), GRID, title="")
