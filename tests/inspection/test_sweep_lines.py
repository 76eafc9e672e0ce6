"""Lines of surveys against shapely: inside the area, as far apart as asked, few turns."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from shapely.geometry import LineString, MultiLineString, Polygon

from maxjax.inspection.sweep_lines import Rows, beside, lawn_mower, narrowest

U_SHAPE = np.array(
    [[0.0, 0.0], [90.0, 0.0], [90.0, 60.0], [60.0, 60.0], [60.0, 20.0], [30.0, 20.0], [30.0, 60.0], [0.0, 60.0]]
)
SLANTED = np.array([[0.0, 0.0], [80.0, 30.0], [70.0, 60.0], [-12.0, 31.0]])
BEGIN = np.zeros(2)
HEADINGS = np.arange(0.0, 180.0, 10.0).tolist()


@pytest.mark.parametrize("outline", [U_SHAPE, SLANTED], ids=["U", "slanted"])
@pytest.mark.parametrize("heading", [None, 0.0, 37.0])
def test_lines_fill_the_area(outline: np.ndarray, heading: float | None) -> None:
    """Of every place in it, a line within half a step; little of them outside, no more length than that takes."""
    lines = lawn_mower(outline, Rows(9.0), heading, BEGIN)
    area, drawn = Polygon(outline), MultiLineString([LineString(line) for line in lines])
    missed = area.difference(drawn.buffer(4.5 + 1e-6, cap_style="flat"))
    assert missed.area < 1e-3 * area.area
    assert drawn.intersection(area).length > 0.7 * drawn.length
    assert drawn.length <= 1.5 * area.area / 9.0
    if heading is not None:
        ways = np.array([line[1] - line[0] for line in lines])
        along = np.array([np.sin(np.radians(heading)), np.cos(np.radians(heading))])
        np.testing.assert_allclose(np.abs(ways @ along), np.linalg.norm(ways, axis=1))


def test_few_turns() -> None:
    """The default heading needs no more lines than any other, to ten degrees."""
    for outline in (SLANTED, np.array([[0.0, 0.0], [100.0, 10.0], [95.0, 40.0], [5.0, 25.0]])):
        own = len(lawn_mower(outline, Rows(5.0), None, BEGIN))
        others = [
            len(lawn_mower(outline, Rows(5.0), heading, BEGIN)) for heading in np.arange(0.0, 180.0, 10.0).tolist()
        ]
        assert own <= min(others)
        across = np.array([-np.sin(narrowest(outline)), np.cos(narrowest(outline))])
        assert np.ptp(outline @ across) == pytest.approx(
            min(np.ptp(outline @ [-np.sin(a), np.cos(a)]) for a in np.linspace(0.0, np.pi, 2000)), rel=1e-3
        )


def test_pieces_are_flown_one_by_one() -> None:
    """Of a U: the ways from line to line are short, but for those from one leg of it to the other."""
    lines = lawn_mower(U_SHAPE, Rows(6.0), 90.0, BEGIN)
    gaps = [float(np.linalg.norm(b[0] - a[-1])) for a, b in itertools.pairwise(lines)]
    assert sum(gap > 7.0 for gap in gaps) <= 2
    assert np.linalg.norm(lines[0][0]) < 6.0


def test_lines_beyond_the_area() -> None:
    """They lie, and reach, so far beyond a rectangle."""
    box = np.array([[0.0, 0.0], [50.0, 0.0], [50.0, 20.0], [0.0, 20.0]])
    lines = lawn_mower(box, Rows(5.0, beyond=7.0), 90.0, BEGIN)
    corners = np.concatenate(lines)
    np.testing.assert_allclose([corners[:, 0].min(), corners[:, 0].max()], [-7.0, 57.0])
    count = len(lines)
    np.testing.assert_allclose([corners[:, 1].min(), corners[:, 1].max()], [-7.0 + 17.0 / count, 27.0 - 17.0 / count])
    meeting = lawn_mower(U_SHAPE, Rows(6.0, beyond=16.0), 90.0, BEGIN)
    assert all(line.shape == (2, 2) for line in meeting)
    assert Polygon(U_SHAPE).buffer(16.1, cap_style="square", join_style="mitre").contains(MultiLineString(meeting))


def test_a_corridor() -> None:
    """Lines as far from its middle as they should be, in turn to and fro."""
    middle = np.array([[0.0, 0.0], [60.0, 0.0], [100.0, 40.0], [100.0, 90.0]])
    lines = beside(middle, 30.0, 11.0)
    assert len(lines) == 3
    for line, offset in zip(lines, (-10.0, 0.0, 10.0), strict=True):
        drawn = LineString(line)
        places = [drawn.interpolate(share, normalized=True) for share in np.linspace(0.05, 0.95, 40)]
        away = [LineString(middle).distance(place) for place in places]
        assert max(away) <= 1.09 * abs(offset) + 1e-6  # on the mitre of a bend by 45 degrees
        assert np.median(away) == pytest.approx(abs(offset), abs=1e-6)
    assert np.linalg.norm(lines[1][0] - lines[0][-1]) < 12.0
