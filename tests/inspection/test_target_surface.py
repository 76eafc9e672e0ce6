"""Surfaces of targets: areas by shapely, what is covered, and targets that are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shapely.geometry import Polygon

import maxjax
from maxjax.inspection.scenery import Scenery
from maxjax.inspection.target_surface import Surface, city_faces, surface_of
from maxjax.inspection.targets import check_outline
from maxjax.io.load import LoadedMap
from tests.inspection.towns import SAMPLES, rectangle, town

L_SHAPE = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 8.0], [8.0, 8.0], [8.0, 16.0], [0.0, 16.0]])


def surface(where: maxjax.VoxelMap, target: object, apart: float = 1.0) -> Surface:
    """That of a target in a map."""
    faces = city_faces(where)
    by_voxels = not isinstance(where, LoadedMap)
    return surface_of(where, faces, Scenery.of(where, faces, by_voxels=by_voxels), target, apart)  # type: ignore[arg-type]


def test_walls_and_roof_have_their_true_areas() -> None:
    """Of a house in the shape of an L: what shapely says, whatever the distance of the points."""
    plan = Polygon(L_SHAPE)
    for apart in (0.5, 3.0):
        found = surface(town((L_SHAPE, 12.0)), "house 0", apart)
        assert found.areas[found.roof].sum() == pytest.approx(plan.area)
        assert found.areas[~found.roof].sum() == pytest.approx(12.0 * plan.length)
        assert found.covered == pytest.approx(0.0)
        np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0)


def test_points_are_as_near_as_asked() -> None:
    """No place on the walls is farther than a distance from all points."""
    found = surface(town((L_SHAPE, 12.0)), "house 0", 1.0)
    rng = np.random.default_rng(0)
    wall = np.column_stack([np.full(300, 20.0), rng.uniform(0.0, 8.0, 300), rng.uniform(0.0, 12.0, 300)])
    away = np.linalg.norm(wall[:, None] - found.points, axis=2).min(axis=1)
    assert away.max() < 1.2


def test_normals_look_out_of_the_house() -> None:
    """A step along the normal leaves the plan, a step back enters it."""
    found = surface(town((L_SHAPE, 12.0)), "house 0")
    walls = found.some(~found.roof)
    plan = Polygon(L_SHAPE)
    from shapely import contains_xy

    for way, expected in ((0.05, False), (-0.05, True)):
        at = walls.points + way * walls.normals
        assert (contains_xy(plan, at[:, 0], at[:, 1]) == expected).all()


def test_a_wall_against_a_neighbour_is_no_facade() -> None:
    """A house of 12 m beside one of 8 m: of the wall between them the upper 4 m are left, and the area is told.

    To a distance of points along the roof's edge, 0.5 m times 10 m.
    """
    where = town((rectangle(0.0, 0.0, 10.0, 10.0), 12.0), (rectangle(10.0, 0.0, 20.0, 10.0), 8.0))
    found = surface(where, "house 0", 0.5)
    assert found.covered == pytest.approx(80.0, abs=5.0)
    between = found.points[np.abs(found.points[:, 0] - 10.0) < 1e-6]
    assert between[:, 2].min() >= 7.5


def test_a_neighbour_a_hand_away_covers_too() -> None:
    """Nothing flies, and nothing is seen, in a gap of 20 cm; in one of 2 m something may be."""
    for gap, covered in ((0.2, 80.0), (2.0, 0.0)):
        other = rectangle(10.0 + gap, 0.0, 20.0, 10.0)
        found = surface(town((rectangle(0.0, 0.0, 10.0, 10.0), 12.0), (other, 8.0)), "house 0", 0.5)
        assert found.covered == pytest.approx(covered, abs=5.0)


def test_by_place_by_outline_and_by_box() -> None:
    """A click on the roof, an outline around half a house, a box around its top."""
    where = town((rectangle(0.0, 0.0, 10.0, 10.0), 12.0), (rectangle(30.0, 0.0, 40.0, 10.0), 8.0))
    assert surface(where, (35.0, 5.0)).name == "house 1"
    assert surface(where, (28.0, 5.0)).name == "house 1"
    half = surface(where, rectangle(-1.0, -1.0, 5.0, 11.0), 0.5)
    assert half.area == pytest.approx(50.0 + 12.0 * 20.0, rel=0.03)
    top = surface(where, ((-1.0, -1.0, 9.0), (11.0, 11.0, 13.0)), 0.5)
    assert top.area == pytest.approx(100.0 + 3.0 * 40.0, rel=0.06)
    both = surface(where, ("house 0", "house 1"))
    assert both.area == pytest.approx(200.0 + 40.0 * 20.0)


def test_a_map_of_voxels_alone() -> None:
    """Its surface is that of its voxels; the building is found by a place."""
    occupied = np.zeros((20, 20, 12), bool)
    occupied[:, :, 0] = True
    ground = occupied.copy()
    occupied[6:12, 5:9, 1:8] = True
    where = maxjax.VoxelMap.of(occupied, spacing=2.0, origin=(0.0, 0.0, -1.0), ground=ground)
    found = surface(where, (17.0, 13.0))
    assert found.area == pytest.approx(4.0 * (6 * 4 + 2 * 7 * (6 + 4)))
    assert found.areas[found.roof].sum() == pytest.approx(4.0 * 24)


def test_a_building_that_is_not_there() -> None:
    """The names that are most like it are told, and how many there are."""
    where = maxjax.load_map(SAMPLES / "quarter.geojson")
    with pytest.raises(ValueError, match=r"given 'hous 6'; of its 15 buildings near it are house 6"):
        surface(where, "hous 6")
    with pytest.raises(ValueError, match=r"found none; the nearest is house \d+, \d+\.\d m away"):
        surface(where, (-110.0, -110.0))


@pytest.mark.parametrize(
    ("target", "said"),
    [
        (((0.0, 0.0), (10.0, 10.0), (10.0, 0.0), (0.0, 10.0)), "edges 1 and 3 do, at x 5.0, y 5.0"),
        (((0.0, 0.0), (10.0, 0.0), (20.0, 0.0)), "on a line|cross itself"),
        (((0.0, 0.0), (1.0, float("nan")), (0.0, 1.0)), "finite"),
        (((0.0, 0.0, 1.0),), "outline"),
        (((500.0, 500.0), (510.0, 500.0), (510.0, 510.0)), "within the map"),
    ],
)
def test_targets_that_are_none(target: object, said: str) -> None:
    """A sentence with the numbers."""
    with pytest.raises(ValueError, match=said):
        surface(town((rectangle(0.0, 0.0, 10.0, 10.0), 12.0)), target)


def test_outlines_that_only_touch_are_refused_like_those_that_cross() -> None:
    """As shapely's validity has it, over random outlines."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        corners = rng.integers(0, 6, (int(rng.integers(4, 7)), 2)).astype(float)
        if len(np.unique(corners, axis=0)) < len(corners):
            continue
        valid = Polygon(corners).is_valid
        try:
            check_outline("target", corners)
            assert valid
        except ValueError:
            assert not valid


def test_a_building_of_the_hague(data: Path) -> None:
    """By the name of a building with five parts: its area is less than that of its shells, by what is covered."""
    where = maxjax.load_map(
        data / "the_hague" / "DenHaag_01.city.json", spacing=2.0, bounds=(78240, 457590, 0, 79030, 458270, 60)
    )
    found = surface(where, "GUID_16E64847-3529-4640-9C4A-8FF9EEBA3F0F", 1.0)
    assert len(np.unique(found.part)) > 1
    assert 5000.0 < found.area < 8000.0
    assert found.covered > 500.0
    part = surface(where, found.names[int(found.part[0])], 1.0)
    assert part.area < found.area
