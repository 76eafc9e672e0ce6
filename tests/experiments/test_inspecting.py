"""Photographs of buildings beside QGroundControl's patterns: the judges by geometry in closed form, and a tiny run."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest

import maxjax
from benchmarks.common.mesh_rays import MeshRays
from experiments import inspecting
from experiments.photo_judge import count_hits, count_photos, find_clearance
from experiments.qgc_patterns import LOWEST, Pattern, scan_structure, survey_polygon
from maxjax.inspection.scenery import Scenery
from maxjax.inspection.target_surface import city_faces, surface_of
from maxjax.inspection.views import Views
from tests.inspection.towns import rectangle, town

CAMERA = maxjax.Camera.named("DJI M3E")
CAPTURE = maxjax.Capture(8.0, (0.5, 0.5))
HOUSE, HOME = rectangle(0.0, 0.0, 20.0, 10.0), (-15.0, -15.0, 5.0)


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    """The twelve triangles of a box."""
    faces = city_faces(town((rectangle(*low[:2], *high[:2]), high[2] - low[2])))
    return np.asarray(faces.triangles + np.array([0.0, 0.0, low[2]]))


def scan() -> Pattern:
    """Around a house 24 m high."""
    return scan_structure(HOUSE, (0.0, 0.0, 24.0), HOME, CAMERA, CAPTURE)


def test_clearance_of_lines_beside_a_box() -> None:
    """From the distance of a point to a box, sampled finely: to a millimetre and half a step."""
    triangles = box((0.0, 0.0, 0.0), (10.0, 6.0, 8.0))
    rng = np.random.default_rng(0)
    for _ in range(20):
        path = rng.uniform([-15.0, -15.0, 1.0], [25.0, 25.0, 30.0], (4, 3))
        fine = np.concatenate([np.linspace(a, b, 4000) for a, b in itertools.pairwise(path)])
        off = np.maximum(np.maximum(-fine, fine - [10.0, 6.0, 8.0]), 0.0)
        assert find_clearance(path, triangles) == pytest.approx(np.linalg.norm(off, axis=1).min(), abs=0.012)
    through = np.array([[-5.0, 3.0, 4.0], [15.0, 3.0, 4.0]])
    assert find_clearance(through, triangles) < 0.002
    assert math.isinf(find_clearance(through, triangles[:0]))


def test_legs_that_pass_through_a_box() -> None:
    """Those that enter it are counted, once each; one that ends before it is not."""
    rays = MeshRays(box((0.0, 0.0, 0.0), (10.0, 6.0, 8.0)))
    path = np.array([[-5.0, 3.0, 4.0], [-1.0, 3.0, 4.0], [15.0, 3.0, 4.0], [15.0, 20.0, 4.0], [5.0, 3.0, 4.0]])
    assert count_hits(path, rays) == 2
    assert count_hits(path[:2], rays) == 0


def test_photos_of_a_wall_are_counted_where_their_frame_is() -> None:
    """A level photo shows a rectangle of the wall, footprint by footprint; nothing behind another wall."""
    where = town((HOUSE, 24.0), (rectangle(0.0, -6.0, 10.0, -5.0), 24.0))
    faces = city_faces(where)
    surface = surface_of(where, faces, Scenery.of(where, faces, by_voxels=False), "house 0", 0.5)
    views = Views(np.array([[15.0, -8.0, 12.0], [5.0, -8.0, 12.0]]), np.full(2, 0.5 * math.pi), np.zeros(2))
    counts = count_photos(views, surface, MeshRays(faces.triangles), CAMERA, CAPTURE)
    width, height = CAMERA.footprint(8.0)
    off = np.abs(surface.points - [15.0, 0.0, 12.0])
    inside = (surface.normals[:, 1] < -0.9) & (off[:, 0] <= 0.5 * width) & (off[:, 2] <= 0.5 * height)
    # From x 10 on; further west the wall in front hides the line of sight.
    clear = inside & (surface.points[:, 0] > 12.0)
    np.testing.assert_array_equal(counts[clear], 1)
    np.testing.assert_array_equal(counts[~inside], 0)


def test_laps_are_as_far_away_and_as_many_as_the_guide_says() -> None:
    """At the scan distance, clockwise, layers evenly from the top; photos look at the wall at a right angle."""
    pattern = scan()
    places = pattern.photos.position
    to_house = np.maximum(np.maximum(-places[:, :2], places[:, :2] - [20.0, 10.0]), 0.0)
    away = np.linalg.norm(to_house, axis=1)
    assert away.min() == pytest.approx(8.0, abs=1e-6)
    levels = np.unique(np.round(places[:, 2], 6))[::-1]
    _, layer = CAPTURE.steps(CAMERA)
    count = math.ceil(24.0 / layer)
    np.testing.assert_allclose(levels, np.maximum(24.0 * (count - 0.5 - np.arange(count)) / count, LOWEST))
    assert (np.diff(places[:, 2]) <= 1e-9).all()
    ways = pattern.photos.axes[:, 2]
    beside = np.sort(np.abs(to_house), axis=1)[:, 0] == 0.0  # not at a corner
    inward = -np.sign(places[:, :2] - [10.0, 5.0]) * (to_house > 0.0)
    np.testing.assert_allclose(ways[beside, :2], inward[beside], atol=1e-9)
    trigger, _ = CAPTURE.steps(CAMERA)
    lap = 2.0 * (20.0 + 10.0) + 8.0 * 8.0
    assert len(places) == count * (1 + math.floor(lap / trigger))
    assert tuple(pattern.path[0]) == tuple(pattern.path[-1]) == HOME


def test_transects_cover_a_polygon() -> None:
    """Over an L: lines no farther apart than the side lap asks, straight down, at one altitude."""
    outline = np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 30.0], [30.0, 30.0], [30.0, 80.0], [0.0, 80.0]])
    sweep = maxjax.Sweep(distance=30.0, overlap=(0.6, 0.5), turn=5.0)
    pattern = survey_polygon(outline, 2.0, HOME, CAMERA, sweep)
    places = pattern.photos.position
    np.testing.assert_allclose(places[:, 2], 32.0)
    np.testing.assert_allclose(pattern.photos.pitch, -0.5 * math.pi)
    lines = np.unique(np.round(places[:, 0], 6))
    assert np.diff(lines).max() <= sweep.apart(CAMERA) + 1e-6
    assert lines[0] <= 0.5 * sweep.apart(CAMERA)
    assert lines[-1] >= 60.0 - 0.5 * sweep.apart(CAMERA)
    assert places[places[:, 0] > 30.0, 1].max() <= 30.0 + 1e-6
    assert pattern.path[:, 1].max() == pytest.approx(85.0)
    for x in lines:
        along = np.sort(places[np.abs(places[:, 0] - x) < 1e-6, 1])
        np.testing.assert_allclose(np.diff(along), sweep.every(CAMERA))


def test_a_scan_passes_through_what_stands_beside() -> None:
    """A wall 8 m from the house: the lap meets it, and is told so by rays, by distances and by the verifier."""
    beside = rectangle(26.0, -4.0, 30.0, 14.0)
    where = town((HOUSE, 24.0), (beside, 24.0))
    path, triangles = scan().path, city_faces(where).triangles
    assert count_hits(path, MeshRays(triangles)) >= 2
    assert find_clearance(path, triangles) < 0.002
    assert not maxjax.verify(path, where, radius=1.5).ok
    alone = town((HOUSE, 24.0))
    assert count_hits(path, MeshRays(city_faces(alone).triangles)) == 0
    assert find_clearance(path, city_faces(alone).triangles) == pytest.approx(8.0, abs=1e-3)


@pytest.mark.nightly
def test_all_ways_are_judged_alike(tmp_path: Path) -> None:
    """Each building three times, an area twice; a run that was ended goes on; a section of RESULTS.md."""
    config = dataclasses.replace(inspecting.TINY, out=tmp_path)
    rows = {(str(row["building"]) == "area", row["way"]): row for row in inspecting.main(config)}
    assert set(rows) == {(False, way) for way in ("maxjax", "greedy", "structure scan")} | {
        (True, way) for way in ("maxjax", "survey")
    }
    ours = rows[False, "maxjax"]
    for row in rows.values():
        assert float(str(row["share"])) == pytest.approx(float(str(row["share_rays"])), abs=0.01)
    for way in ("maxjax", "greedy"):
        assert rows[False, way]["verified"]
        assert rows[False, way]["legs_hit"] == 0
        assert float(str(rows[False, way]["clearance_m"])) >= config.radius
    assert float(str(ours["share"])) > 0.98 > float(str(rows[False, "structure scan"]["share"]))
    assert int(str(ours["photos"])) <= int(str(rows[False, "greedy"]["photos"]))
    assert float(str(ours["share.plan"])) == pytest.approx(float(str(ours["share"])), abs=0.01)
    assert ours["photos_by_pymavlink"] in (None, ours["photos"])
    document = json.loads((tmp_path / "inspecting.json").read_text())
    assert "structure scan" in inspecting.section(document)
