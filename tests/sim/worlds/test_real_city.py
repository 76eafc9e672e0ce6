"""Footprints as boxes, against the polygons."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Outline

from maxjax.core.grid import Grid
from maxjax.io.readers.osm import load_osm
from maxjax.sim.worlds import real_city
from maxjax.sim.worlds.scenes import occupancy

TOLERANCE = 0.5


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def corners(row: np.ndarray) -> np.ndarray:
    x, y, a, b, _, _, yaw = row
    return turned(np.array([(-a, -b), (a, -b), (a, b), (-a, b)]), yaw) + np.array([x, y])


def contains(rings: tuple[np.ndarray, ...], points: np.ndarray) -> np.ndarray:
    return np.logical_xor.reduce([Outline(np.vstack([r, r[:1]])).contains_points(points) for r in rings])


def away(rings: tuple[np.ndarray, ...], points: np.ndarray) -> np.ndarray:
    """Distance of points to a polygon, 0 inside."""
    least = np.where(contains(rings, points), 0.0, np.inf)
    for ring in rings:
        for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
            t = np.clip((points - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-300), 0, 1)
            least = np.minimum(least, np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))
    return least


def check(rings: tuple[np.ndarray, ...], tolerance: float = TOLERANCE) -> np.ndarray:
    """The rows, after their two promises held at random points."""
    rows = real_city.footprint_rows(rings, 5.0, tolerance)
    rng = np.random.default_rng(0)
    every = np.concatenate(rings)
    points = rng.uniform(every.min(0), every.max(0), (2000, 2))
    boxes = [Outline(corners(row)) for row in rows]
    covered = np.logical_or.reduce([box.contains_points(points, radius=1e-6) for box in boxes])
    covered |= np.logical_or.reduce([box.contains_points(points, radius=-1e-6) for box in boxes])
    assert not np.any(contains(rings, points) & ~covered)
    u = rng.uniform(-1, 1, (200, 2))
    for row in rows:
        inside = turned(u * row[2:4], row[6]) + row[:2]
        assert away(rings, inside).max() <= np.sqrt(2) * tolerance + 1e-6
    return rows


@settings(max_examples=25, deadline=None)
@given(st.integers(3, 14), st.integers(0, 10**6), st.sampled_from([0.2, 0.5, 1.0]))
def test_boxes_cover_any_polygon_and_hardly_exceed_it(count: int, seed: int, tolerance: float) -> None:
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0, 2 * np.pi, count))
    reach = rng.uniform(2, 15, count)
    star = reach[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    check((star,), tolerance)
    check((star, 0.4 * star), tolerance)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.0, 2.5, -0.7])
def test_a_rectangle_is_one_box_and_an_l_two(angle: float) -> None:
    rectangle = turned(np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 4.0), (0.0, 4.0)]), angle) + 30.0
    (row,) = check((rectangle,))
    assert 4 * row[2] * row[3] == pytest.approx(36.0)
    assert (row[4], row[5]) == (0.0, 5.0)
    ell = turned(np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 4.0), (3.0, 4.0), (3.0, 8.0), (0.0, 8.0)]), angle)
    rows = check((ell,))
    assert len(rows) == 2
    assert np.sum(4 * rows[:, 2] * rows[:, 3]) == pytest.approx(48.0)


def test_a_courtyard_stays_open_and_a_crack_is_closed() -> None:
    def square(half: float) -> np.ndarray:
        return turned(half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]), 0.4)

    rows = check((square(10.0), square(4.0)))
    assert len(rows) == 4
    assert not real_city.inside_boxes(rows, np.zeros((1, 2))).any()
    assert real_city.inside_boxes(check((square(10.0), square(0.2))), np.zeros((1, 2))).all()


def test_without_a_tolerance_it_is_refused() -> None:
    with pytest.raises(ValueError, match="expected a positive number of metres, given 0"):
        real_city.footprint_rows((np.eye(2),), 1.0, 0.0)


def test_a_crop_keeps_boxes_that_reach_into_it_and_solids_have_their_voxels() -> None:
    rows = np.array([[50.0, 0, 5, 2, 0, 8, 0], [70.0, 0, 15, 2, 0, 8, 0], [80.0, 0, 15, 2, 0, 8, np.pi / 2]])
    kept = real_city.crop(rows, np.array([40.0, 0.0]), 20.0)
    np.testing.assert_allclose(kept, [[10, 0, 5, 2, 0, 8, 0], [30, 0, 15, 2, 0, 8, 0]])
    geoms = real_city.city(kept, 8)
    assert len(geoms.type) == 9
    occupied, ground = occupancy(geoms, Grid((60, 20, 20), 1.0, (0.5, -9.5, -4.5)))
    expected = np.zeros((60, 20, 20), bool)
    expected[5:45, 8:12, 5:13] = True  # from 5 to 15 and from 15 to 45 m, 4 m wide, 8 m high
    np.testing.assert_array_equal(occupied & ~ground, expected)
    np.testing.assert_array_equal(ground[0, 0], np.arange(20) < 5)
    with pytest.raises(ValueError, match="expected at least 2, one a box, given 1"):
        real_city.city(kept, 1)


def test_national_coordinates_have_to_be_centred_first() -> None:
    """Dutch northings: cropped rows make the solids of a city at the origin, others are refused."""
    corner = np.array([80_000.0, 447_501.0])
    rows = real_city.footprint_rows((corner + np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 4.0), (0.0, 4.0)]),), 5.0)
    with pytest.raises(ValueError, match="within 100000 m of the origin, given 447503 m; centre them first"):
        real_city.city(rows, 1)
    geoms = real_city.city(real_city.crop(rows, corner, 20.0), 1)
    np.testing.assert_allclose(geoms.position[1], [4.5, 2.0, 2.5], atol=1e-5)


def test_real_footprints_are_covered(data: Path) -> None:
    buildings = load_osm(data / "la_venice" / "buildings-addresses-060372742021.osm").buildings
    manifold = sorted(buildings, key=lambda b: len(b.rings), reverse=True)
    assert len(manifold[0].rings) > 10
    for building in [*manifold[:2], *buildings[::40]]:
        check(building.rings)
