"""Areas with holes as fences without: the same places, by shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely.geometry import Point, Polygon
from shapely.ops import unary_union

from maxjax.io.airspace.airspace import Airspace, Area
from maxjax.io.export.fences import Fence, fences_of
from maxjax.io.export.pieces import pieces_of
from maxjax.io.geo.earth import TangentPlane

EARTH = TangentPlane(52.0, 4.3, 0.0)


def circle(x: float, y: float, radius: float, count: int = 17, phase: float = 0.3) -> np.ndarray:
    angle = phase + 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def square(half: float) -> np.ndarray:
    return half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


@pytest.mark.parametrize(
    "rings",
    [
        (square(20.0), square(8.0)),
        (circle(0.0, 0.0, 30.0), circle(-10.0, 2.0, 8.0), circle(12.0, -3.0, 9.0, 5)),
        (circle(5.0, 5.0, 20.0, 9), circle(3.0, 6.0, 12.0, 11), circle(3.0, 6.0, 4.0, 4)),  # an island in the hole
        (square(20.0) * [1.0, 2.0], circle(0.0, -25.0, 9.0), circle(0.0, 20.0, 6.0)),
        (np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [15.0, 8.0], [0.0, 30.0]]), circle(7.0, 8.0, 2.0)),
    ],
)
def test_pieces_make_up_the_area(rings: tuple[np.ndarray, ...]) -> None:
    area = Polygon(rings[0])
    for ring in rings[1:]:
        area = area.symmetric_difference(Polygon(ring))
    pieces = [Polygon(ring) for ring in pieces_of(rings)]
    assert all(piece.is_valid and not piece.interiors for piece in pieces)
    assert sum(piece.area for piece in pieces) == pytest.approx(area.area, rel=1e-9)
    assert unary_union(pieces).symmetric_difference(area).area < 1e-6
    assert len(pieces) <= 4 * (len(rings) - 1) + 4


def polygons(fences: list[Fence], inclusion: bool) -> list[Polygon]:
    rings = [EARTH.local(np.column_stack([f.corners, np.full(len(f.corners), 10.0)]))[:, :2] for f in fences]
    return [Polygon(ring) for ring, fence in zip(rings, fences, strict=True) if fence.inclusion == inclusion]


def test_a_way_within_the_hole_of_a_keep_out_area_is_fenced_by_the_rest() -> None:
    rings = (square(50.0), square(30.0))
    air = Airspace(areas=(Area("ring", rings),))
    path = np.array([[-20.0, 0.0, 10.0], [20.0, 5.0, 10.0]])
    fences, remarks = fences_of(air, path, EARTH)
    assert len(fences) == 4
    whole = unary_union(polygons(fences, False)).buffer(1e-3)
    assert whole.symmetric_difference(Polygon(rings[0], [rings[1]])).area < 1.0
    assert not any(shapely.contains(whole, Point(x, y)) for x, y, _ in path)
    assert remarks == ("the area ring has holes, which no fence has: 4 fences stand for it",)


@pytest.mark.parametrize(
    ("path", "fenced"),
    [
        ([[-80.0, 0.0, 10.0], [-60.0, 5.0, 10.0]], True),
        ([[-20.0, 0.0, 10.0], [40.0, 5.0, 10.0]], False),  # from the hole into the area
        ([[-40.0, 0.0, 10.0], [-35.0, 5.0, 10.0]], False),  # within the area, beside the hole
        ([[-80.0, 0.0, 10.0], [0.0, 5.0, 10.0]], False),  # into the hole, over the area
    ],
)
def test_only_what_the_way_leads_over_is_left_out(path: list[list[float]], fenced: bool) -> None:
    air = Airspace(areas=(Area("ring", (square(50.0), square(30.0))),))
    fences, remarks = fences_of(air, np.array(path), EARTH)
    assert bool(fences) == fenced
    assert any("leads over or under it" in one for one in remarks) != fenced


def test_a_return_from_the_middle_of_a_leg_is_judged_as_from_its_ends() -> None:
    """The way home crosses the area from the middle of a leg, and from neither of its ends."""
    air = Airspace(areas=(Area("pond", (square(1.0) + np.array([0.0, 20.0]),)),))
    path = np.array([[0.0, 40.0, 10.0], [60.0, 40.0, 10.0], [41.0, 0.0, 10.0], [-39.0, 0.0, 10.0]])
    assert any("return to launch crosses" in remark for remark in fences_of(air, path, EARTH)[1])
    short = path[:3]
    assert not any("return to launch crosses" in remark for remark in fences_of(air, short, EARTH)[1])


def test_a_return_across_a_fence_is_named() -> None:
    air = Airspace(areas=(Area("school", (square(5.0),)),))
    path = np.array([[-20.0, 0.0, 10.0], [-20.0, 20.0, 10.0], [20.0, 20.0, 10.0], [20.0, 0.0, 10.0]])
    assert fences_of(air, path, EARTH)[1] == (
        "a return to launch crosses the fence of the area school from some places of the way",
    )
    assert fences_of(air, path[:2], EARTH)[1] == ()
