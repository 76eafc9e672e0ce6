"""The first view of a way: not hidden by what stands around it, low where nothing does."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

import maxjax
from maxjax.ui.page.camera import SHEET, above_sheet, hiding, over_map, over_way, seen
from maxjax.ui.page.nodes import point3
from maxjax.ui.page.page_map import City

WAY = np.linspace([60.0, 100.0, 11.0], [140.0, 100.0, 11.0], 33)  # from the map's lower corner


def city_of(towers: list[tuple[slice, slice]], lower: float = 0.0) -> City:
    """Towers of 120 m on 200 m of plain ground."""
    occupied = np.zeros((100, 100, 65), bool)
    occupied[:, :, 0] = True
    ground = occupied.copy()
    for i, j in towers:
        occupied[i, j, :60] = True
    origin = lower + 1.0, lower + 1.0, 1.0
    return City("town", maxjax.VoxelMap.of(occupied, spacing=2.0, origin=origin, ground=ground))


def hidden(city: City, position: np.ndarray) -> float:
    """Share of the way that is hidden from a position in the page's frame, by SciPy's interpolation at 0.1 m."""
    found = []
    position = city.frame.map(position) - np.array(city.grid.lower)
    for point in WAY:
        along = np.linspace(0.0, 1.0, int(np.linalg.norm(point - position) / 0.1))[:, None]
        places = ((position + along * (point - position)) / 2.0 - 0.5).T
        found.append(map_coordinates(city.occupied.astype(float), places, order=0).any())
    return float(np.mean(found))


@pytest.mark.parametrize("lower", [0.0, 233_000.0])
def test_a_way_between_towers_is_seen(lower: float) -> None:
    street = [(slice(25, 75), slice(36, 46)), (slice(25, 75), slice(54, 64))]
    city = city_of(street, lower)
    way = city.frame.page(WAY + np.array(city.grid.lower))
    position, target = map(np.array, over_way(city, way))
    np.testing.assert_allclose(target, way.mean(axis=0))
    low = target + np.linalg.norm(position - target) * np.array([-0.343, -0.543, 0.766])
    assert hidden(city, low) > 0.9  # from where an open way is looked at
    assert hidden(city, position) < 0.1
    for place in (low, position):
        assert seen(city, place, way) == pytest.approx(1.0 - hidden(city, place), abs=0.1)


def test_an_open_way_is_seen_from_the_south_west_and_low() -> None:
    city = city_of([])
    position, target = map(np.array, over_way(city, city.frame.page(WAY)))
    away = position - target
    assert away[0] < 0.0
    assert away[1] < 0.0
    assert np.degrees(np.arcsin(away[2] / np.linalg.norm(away))) == pytest.approx(50.0)
    assert hidden(city, position) == 0.0


def test_a_whole_map_is_looked_at_in_its_middle() -> None:
    position, target = over_map(city_of([]))
    assert np.linalg.norm(target[:2]) < 20.0
    assert position[2] > 120.0


@pytest.mark.parametrize("lower", [0.0, 233_000.0])
def test_whole_buildings_hide_a_way(lower: float) -> None:
    near, far, beside = (
        (slice(40, 60), slice(36, 46)),
        (slice(40, 60), slice(54, 64)),
        (slice(10, 14), slice(36, 46)),
    )
    city = city_of([near, far, beside], lower)
    way = city.frame.page(WAY + np.array(city.grid.lower))
    eye = way.mean(axis=0) + np.array([0.0, -120.0, 40.0])
    expected = np.zeros((100, 100), bool)
    expected[near] = True
    np.testing.assert_array_equal(hiding(city, point3(eye), way), expected)
    assert not hiding(city, point3(way.mean(axis=0) + np.array([0.0, 0.0, 200.0])), way).any()


@pytest.mark.parametrize("turn", [0.0, 40.0, 155.0])
def test_on_a_telephone_all_of_a_way_is_seen_above_the_panel(turn: float) -> None:
    """By a pinhole camera that SciPy turns: x to the right, y down, z into the picture."""
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    way = (WAY - WAY.mean(axis=0)) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [5.0, -3.0, 10.0]
    high, wide = 2.0 * np.tan(np.radians(37.5)), 2.0 * np.tan(np.radians(37.5)) * 390.0 / 844.0
    before = np.array([-40.0, -60.0, 80.0])
    eye, target = map(np.array, above_sheet(point3(before), (5.0, -3.0, 10.0), way, (high, wide)))
    ahead = (target - eye) / np.linalg.norm(target - eye)
    np.testing.assert_allclose(np.cross(ahead, [5.0, -3.0, 10.0] - before), 0.0, atol=1e-9)
    rotation, _ = Rotation.align_vectors(np.stack([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]), np.stack([ahead, [0, 0, 1]]),
                                         weights=[np.inf, 1.0])  # fmt: skip
    x, y, depth = rotation.apply(way - eye).T
    assert depth.min() > 0.0
    across, down = x / depth / wide + 0.5, y / depth / high + 0.5
    assert across.min() > 0.0
    assert across.max() < 1.0
    assert down.min() > 0.0
    assert down.max() < 1.0 - SHEET
    # And it fills more than two thirds of that room along one side.
    assert max(np.ptp(across), np.ptp(down) / (1.0 - SHEET)) > 2.0 / 3.0
