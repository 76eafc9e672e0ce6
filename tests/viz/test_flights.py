"""Pictures of flights show what they say; films open, move and stay small."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest

from maxjax.core.grid import Grid
from maxjax.viz import flights as module
from maxjax.viz.flights import Look, figure_flights, film_flight

matplotlib = pytest.importorskip("matplotlib")
from matplotlib import pyplot  # noqa: E402
from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: E402
from PIL import Image  # noqa: E402

GRID = Grid((60, 60, 20), 2.0, (-59.0, -59.0, 1.0))
GOAL = np.array([30.0, 5.0, 8.0])


def town() -> np.ndarray:
    obstacle = np.zeros(GRID.shape, bool)
    obstacle[25:33, 27:33, :12] = True
    obstacle[10:16, 40:50, :4] = True
    return obstacle


def line(end: np.ndarray = GOAL, points: int = 61) -> np.ndarray:
    start = np.array([-40.0, -10.0, 6.0])
    along = np.linspace(0.0, 1.0, points)[:, None]
    return start + along * (end - start) + np.sin(np.pi * along) * np.array([0.0, 30.0, 4.0])


def figure(**changes: Any) -> Any:
    flown = {3: line(), 4: line(GOAL + 4.0), 9: line(GOAL - 12.0)[:30]}
    goals = {3: GOAL, 4: GOAL + 4.0, 9: GOAL - 12.0}
    inputs = {
        "flown": flown,
        "goals": goals,
        "failed": {9: "IN_CONTACT"},
        "title": "Town",
        "caption": "2 of 3 arrived.",
    }
    return figure_flights(town(), GRID, **(inputs | changes))


def test_flights_are_lines_in_metres_that_failed_ones_differ_from() -> None:
    drawn = figure()
    axes = drawn.axes[0]
    assert axes.get_xlabel().endswith("[m]")
    assert axes.get_ylabel().endswith("[m]")
    assert axes.get_aspect() == 1.0
    shown = {len(one.get_xdata()): one for one in axes.lines if len(one.get_xdata()) > 1 and one.get_color() != "white"}
    np.testing.assert_array_equal(shown[30].get_xdata(), line(GOAL - 12.0)[:30, 0])
    assert shown[30].get_color() != shown[61].get_color()
    assert shown[30].get_linestyle() != shown[61].get_linestyle()
    assert [text.get_text() for text in axes.texts] == ["9"]
    labels = [text.get_text() for text in drawn.legends[0].get_texts()]
    assert {"start", "goal", "flown, arrived (2)"} < set(labels)
    assert any("failed (1)" in label for label in labels)
    assert "failed" not in " ".join(text.get_text() for text in figure(failed={}).legends[0].get_texts())


def test_everything_flown_is_in_view_and_nothing_hides_it() -> None:
    drawn = figure()
    canvas = FigureCanvasAgg(drawn)
    canvas.draw()
    axes = drawn.axes[0]
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    points = np.concatenate([line(), line(GOAL + 4.0)])
    assert x0 < points[:, 0].min() < points[:, 0].max() < x1
    assert y0 < points[:, 1].min() < points[:, 1].max() < y1
    legend = drawn.legends[0].get_window_extent()
    assert not legend.overlaps(axes.get_window_extent())
    assert not legend.overlaps(drawn.texts[-1].get_window_extent())
    page = drawn.bbox
    for box in (legend, axes.get_tightbbox(), drawn.axes[1].get_tightbbox()):
        assert page.x0 <= box.x0
        assert box.x1 <= page.x1
        assert page.y0 <= box.y0
    assert not pyplot.get_fignums()


def test_figures_refuse_what_they_cannot_show() -> None:
    with pytest.raises(ValueError, match="at least one flight"):
        figure(flown={})
    with pytest.raises(ValueError, match="obstacle"):
        figure_flights(town()[1:], GRID, {1: line()}, {1: GOAL}, {})


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
    return film_flight(parts, town(), GRID, GOAL, np.linspace(2.0, 9.0, count), radius=0.5, title="Town"), count


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
    blue, green = (
        tuple(int(color[at : at + 2], 16) for at in (1, 3, 5)) for color in (module.ARRIVED, module._PLANNED)
    )
    assert (last == blue).all(axis=2).sum() > (first == blue).all(axis=2).sum() > 0
    assert (first == green).all(axis=2).any()
    assert not pyplot.get_fignums()


def test_a_film_that_is_too_large_loses_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    content, _ = film()
    monkeypatch.setattr(module, "_LARGEST", len(content) // 2)
    smaller, _ = film()
    assert len(smaller) <= len(content) // 2
    with Image.open(io.BytesIO(smaller)) as opened:
        assert opened.n_frames > 2


def test_a_film_needs_a_flight() -> None:
    with pytest.raises(ValueError, match="positions"):
        film_flight([], town(), GRID, GOAL, np.zeros(0), radius=0.5, title="")
