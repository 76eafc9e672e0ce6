"""Films of flights open, move and stay small."""

from __future__ import annotations

import functools
import io

import numpy as np
import pytest

from maxjax.sim.movers.among import AHEAD, Flag
from maxjax.sim.movers.moments import Moment
from maxjax.ui.figures import gif
from maxjax.ui.figures.film import Filmed, Look, film_flight
from maxjax.ui.figures.movers_from_above import Moving
from maxjax.ui.figures.style import ARRIVED, FLAGGED, MOTION, MOVER, PLANNED

matplotlib = pytest.importorskip("matplotlib")
from matplotlib import pyplot  # noqa: E402
from PIL import Image  # noqa: E402

from tests.ui.figures.town import GOAL, GRID, line, town  # noqa: E402


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


@functools.cache
def film() -> tuple[bytes, int]:
    parts = looks(2)
    count = sum(len(part.flown) for part in parts)
    flight = Filmed(parts, GOAL, np.linspace(2.0, 9.0, count), 0.5)
    return film_flight(flight, town(), GRID, title="Town"), count


def covered(image: np.ndarray, color: str) -> int:
    """Pixels of exactly this colour."""
    return int((image == [int(color[at : at + 2], 16) for at in (1, 3, 5)]).all(axis=2).sum())


def moving(count: int) -> list[Moving]:
    """One that flies beside the vehicle in a box of its own, and is larger later; flagged at the end."""
    found = []
    for k in range(count):
        body = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]) + 0.5 * k
        low = np.array([[[*(body[0] - 2.0 - 4.0 * share), 0.0]] for share in AHEAD])
        boxes = np.stack([low, low + np.array([6.0, 6.0, 9.0])], axis=2)
        motion = np.linspace([-20.0, -20.0, 5.0], [0.0, -20.0, 5.0], 13)
        found.append(Moving([body], Moment(boxes, motion, (Flag.NEAR,) if k > 20 else ())))
    return found


def test_a_film_shows_movers_what_may_hold_them_and_the_motion() -> None:
    parts = looks(3)
    count = sum(len(part.flown) for part in parts)
    flight = Filmed(parts, GOAL, np.linspace(2.0, 9.0, count), 0.5, moving(count))
    with Image.open(io.BytesIO(film_flight(flight, town(), GRID, title="Town"))) as opened:
        first = np.asarray(opened.convert("RGB"), np.int16)
        opened.seek(opened.n_frames - 1)
        last = np.asarray(opened.convert("RGB"), np.int16)
    for image in (first, last):
        assert covered(image, MOVER)
        assert covered(image, MOTION)
    assert covered(last, FLAGGED) > covered(first, FLAGGED) > 0  # the legend
    with pytest.raises(ValueError, match="moving: expected none or one for each of 31"):
        film_flight(Filmed(parts, GOAL, np.ones(count), 0.5, moving(2)), town(), GRID, title="Town")


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
    assert covered(last, ARRIVED) > covered(first, ARRIVED) > 0
    assert covered(first, PLANNED)
    assert not covered(last, MOVER)
    assert not pyplot.get_fignums()


@pytest.mark.large
def test_a_film_that_is_too_large_loses_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    content, _ = film()
    monkeypatch.setattr(gif, "LARGEST", len(content) // 2)
    smaller, _ = film.__wrapped__()
    assert len(smaller) <= len(content) // 2
    with Image.open(io.BytesIO(smaller)) as opened:
        assert opened.n_frames > 2


def test_a_film_needs_a_flight() -> None:
    with pytest.raises(ValueError, match="positions"):
        film_flight(Filmed([], GOAL, np.zeros(0), 0.5), town(), GRID, title="")
