"""Cameras against the figures of their data sheets and similar triangles."""

from __future__ import annotations

import math

import pytest

from maxjax.inspection.camera_table import CAMERAS
from maxjax.inspection.photo_camera import Camera

# Angles of view from corner to corner as their makers state them [deg].
STATED = {
    "DJI M3E": 84.0,
    "DJI P1 24 mm": 84.0,
    "DJI P1 35 mm": 63.5,
    "DJI P1 50 mm": 46.8,
    "DJI Phantom 4 RTK": 84.0,
    "DJI Mavic 2 Pro": 77.0,
}


def test_ten_cameras_are_known() -> None:
    """Each can be made, has a source, and a name of its own."""
    made = [Camera.named(row["name"]) for row in CAMERAS]
    assert len(made) >= 10
    assert len({camera.name for camera in made}) == len(made)
    assert all(camera.source for camera in made)


@pytest.mark.parametrize(("name", "stated"), STATED.items())
def test_angles_of_view_are_those_of_the_data_sheets(name: str, stated: float) -> None:
    """Sensor and focal length give the angle that the maker states, to three degrees (the true lens is rounded)."""
    half = math.hypot(*Camera.named(name).half_tangents)
    assert 2.0 * math.degrees(math.atan(half)) == pytest.approx(stated, abs=3.0)


def test_a_pixel_by_similar_triangles() -> None:
    """At 8 m the M3E's pixel of 3.28 µm behind 12.29 mm covers 2.13 mm, and 5280 of them the footprint's width."""
    camera = Camera.named("dji m3e")
    pixel = 17.3e-3 / 5280
    assert camera.ground_sample_distance(8.0) == pytest.approx(8.0 * max(pixel, 13e-3 / 3956) / 12.29e-3)
    width, height = camera.footprint(8.0)
    assert width == pytest.approx(8.0 * 17.3 / 12.29)
    assert height == pytest.approx(8.0 * 13.0 / 12.29)


def test_a_field_of_view_from_corner_to_corner() -> None:
    """A square camera of 90 degrees from corner to corner: half a diagonal is as long as the distance."""
    camera = Camera("mine", (1000, 1000), field_of_view=90.0)
    assert math.hypot(*camera.footprint(3.0)) == pytest.approx(6.0)


def test_photos_are_no_faster_than_the_shutter() -> None:
    """Photos 7 m apart every 0.7 s: 10 m/s."""
    assert Camera.named("DJI M3E").fastest(7.0) == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, "given none"),
        ({"sensor": (13.2, 8.8)}, "given none"),
        ({"sensor": (13.2, 8.8), "focal_length": 8.8, "field_of_view": 84.0}, "given both"),
        ({"sensor": (13.2, 0.0), "focal_length": 8.8}, "sensor"),
        ({"sensor": (13.2, 8.8), "focal_length": 0.0}, "focal_length"),
        ({"field_of_view": 0.0}, "field_of_view"),
        ({"field_of_view": 175.0}, "below 170"),
        ({"field_of_view": math.nan}, "field_of_view"),
        ({"field_of_view": 84.0, "interval": 0.0}, "interval"),
        ({"field_of_view": 84.0, "gimbal": (10.0, -10.0)}, "gimbal"),
    ],
)
def test_cameras_that_are_none(options: dict[str, object], said: str) -> None:
    """Without an angle of view, or with numbers that mean nothing: a sentence that names the number."""
    with pytest.raises(ValueError, match=said):
        Camera("mine", (4000, 3000), **options)  # type: ignore[arg-type]


def test_an_unknown_name_tells_the_known_ones() -> None:
    """As for every registry of the house."""
    with pytest.raises(ValueError, match="DJI M3E"):
        Camera.named("DJI M9")
