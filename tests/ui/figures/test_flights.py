"""Pictures of flights show what they say."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from maxjax.ui.figures.flights import Flown, figure_flights

matplotlib = pytest.importorskip("matplotlib")
from matplotlib import pyplot  # noqa: E402
from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: E402

from tests.ui.figures.town import GOAL, GRID, line, town  # noqa: E402

FLIGHTS = [
    Flown(3, line(), GOAL, True),
    Flown(4, line(GOAL + 4.0), GOAL + 4.0, True),
    Flown(9, line(GOAL - 12.0)[:30], GOAL - 12.0, False),
]


def figure(flights: Sequence[Flown] = FLIGHTS) -> Any:
    return figure_flights(town(), GRID, flights, title="Town", caption="2 of 3 arrived.")


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
    unharmed = [dataclasses.replace(flight, arrived=True) for flight in FLIGHTS]
    assert "failed" not in " ".join(text.get_text() for text in figure(unharmed).legends[0].get_texts())


def test_heights_are_those_flown_over_what_stands_below() -> None:
    side = figure().axes[2]
    assert side.get_ylabel() == "Height, z [m]"
    shown = [one for one in side.lines if len(one.get_xdata()) > 1]
    assert len(shown) == len(FLIGHTS)
    for one, flight in zip(shown, FLIGHTS, strict=True):
        np.testing.assert_allclose(one.get_ydata(), flight.line[:, 2])
        gaps = np.linalg.norm(np.diff(flight.line[:, :2], axis=0), axis=1)
        np.testing.assert_allclose(np.diff(one.get_xdata()), gaps)
    over = np.array([[-30.0, -30.0, 40.0], [-4.0, -4.0, 40.0], [0.0, 0.0, 40.0], [4.0, 4.0, 40.0], [30.0, 30.0, 40.0]])
    (roof,) = figure([Flown(1, over, GOAL, True)]).axes[2].collections
    # The block in the middle is 12 voxels of 2 m high, from z = 0 on.
    assert {y for path in roof.get_paths() for y in path.vertices[:, 1].tolist()} == {0.0, 24.0}


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
    assert not legend.overlaps(drawn.axes[2].get_tightbbox())
    assert not axes.get_tightbbox().overlaps(drawn.axes[2].get_tightbbox())
    for box in (legend, *(one.get_tightbbox() for one in drawn.axes)):
        assert page.x0 <= box.x0
        assert box.x1 <= page.x1
        assert page.y0 <= box.y0
    assert not pyplot.get_fignums()


def test_figures_refuse_what_they_cannot_show() -> None:
    with pytest.raises(ValueError, match="at least one flight"):
        figure([])
    with pytest.raises(ValueError, match="obstacle"):
        figure_flights(town()[1:], GRID, FLIGHTS)
