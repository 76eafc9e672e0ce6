"""`load_map`: windows that hold map and ends, voxels of every kind against independent oracles, real files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.path import Path as Outline

import maxjax
from maxjax.core.files import FileError
from maxjax.core.grid import Grid
from maxjax.io import PointCloud, Window, map_of
from maxjax.io.kinds.footprints import Footprint, Footprints
from maxjax.io.kinds.prisms import prism_voxels
from tests.io.cityjson import column_heights

EXTENT = np.array([[3.0, -20.0, 5.0], [90.0, 31.0, 40.0]])


def test_a_window_holds_map_and_ends_on_the_same_lattice() -> None:
    for ends in ((), ((-30.0, 4.0, 60.0), (50.0, 200.0, 2.0))):
        grid, sentence = Window(ends=ends).grid(EXTENT)
        held = np.concatenate([EXTENT, np.reshape(ends, (-1, 3))])
        assert sentence == ""
        assert (np.array(grid.lower) + 2 <= held.min(0)).all()
        assert (np.array(grid.upper) - 18 >= held.max(0)).all()
        np.testing.assert_array_equal(np.array(grid.origin) % 2, 0)
        assert not np.array(grid.shape).astype(int).__mod__(8).any()


def test_bounds_spacing_centre_and_ground_choose_the_window() -> None:
    grid, _ = Window(bounds=(0.0, 0.0, 0.0, 9.0, 20.0, 30.0)).grid(EXTENT)
    assert (grid.lower, grid.upper) == ((-1.0, -1.0, -1.0), (9.0, 21.0, 31.0))
    grid, _ = Window(spacing=0.5).grid(EXTENT, 0.1)
    assert grid.spacing == 0.5
    assert Window().grid(EXTENT, 0.25)[0].spacing == 0.25
    grid, _ = Window(center=(5.0, 5.0, 5.0), ground=0.3).grid(EXTENT)
    assert grid.shape == (101, 101, 101)
    assert (grid.origin[2] - 0.3) % 2 == pytest.approx(0)


def test_a_map_too_large_is_cut_around_the_ends_or_refused() -> None:
    wide = np.array([[0.0, 0.0, 0.0], [50_000.0, 50_000.0, 100.0]])
    with pytest.raises(ValueError, match=r"--bounds, or a --spacing of \d"):
        Window().grid(wide)
    grid, sentence = Window(ends=((900.0, 900.0, 9.0), (1200.0, 900.0, 9.0))).grid(wide)
    assert "leaves a part of the map out" in sentence
    assert grid.lower[0] < 800
    assert grid.upper[0] > 1300
    assert grid.upper[2] > 100


@pytest.mark.parametrize(
    "given",
    [
        {"spacing": 0.0},
        {"spacing": float("nan")},
        {"bounds": (0.0, 0.0, 0.0, 0.0, 1.0, 1.0)},
        {"bounds": (0.0, 0.0, 0.0, float("inf"), 1.0, 1.0)},
        {"center": (0.0, 0.0, float("nan"))},
        {"center": (0.0, 0.0, 0.0), "bounds": (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)},
        {"ground": float("inf")},
    ],
)
def test_windows_that_are_none(given: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="expected"):
        Window(**given)  # type: ignore[arg-type]


def star(rng: np.random.Generator, middle: np.ndarray, corners: int) -> np.ndarray:
    """A star-shaped polygon."""
    angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
    return middle + rng.uniform(2, 14, (corners, 1)) * np.stack([np.cos(angle), np.sin(angle)], 1)


def test_prisms_fill_every_column_that_their_footprint_touches() -> None:
    rng = np.random.default_rng(0)
    grid = Grid((24, 25, 12), 2.0, (-23.0, -24.0, 0.0))
    for _ in range(20):
        outline, hole = star(rng, rng.normal(0, 8, 2), 9), star(rng, np.zeros(2), 5) * 0.3
        building = Footprint((outline, hole), 3.5, 12.0, "a")
        found = Footprints((building,), np.zeros((0, 3, 3)), "a")
        solid, ground = prism_voxels(found, grid)
        # Points on a fine lattice in each column: what they find must be there, and nothing a voxel away from them.
        fine = (np.arange(48 * 5) + 0.5) / 5 - 24, (np.arange(50 * 5) + 0.5) / 5 - 25
        points = np.stack(np.meshgrid(*fine, indexing="ij"), -1).reshape(-1, 2)
        inside = np.logical_xor(*(Outline(np.vstack([r, r[:1]])).contains_points(points) for r in (outline, hole)))
        columns = inside.reshape(24, 10, 25, 10)
        assert solid.any(axis=2)[columns.any(axis=(1, 3))].all()
        along = np.linspace(0, 1, 300)[:, None, None]
        edges = np.concatenate([(r + along * (np.roll(r, -1, 0) - r)).reshape(-1, 2) for r in (outline, hole)])
        touched = np.zeros((24, 25), bool)
        index = np.floor((edges - np.array(grid.lower[:2])) / 2).astype(int)
        index = index[((index >= 0) & (index < (24, 25))).all(axis=1)]
        touched[tuple(index.T)] = True
        extra = solid.any(axis=2) & ~columns.any(axis=(1, 3)) & ~touched
        assert extra.sum() <= 3  # columns that an edge cuts a corner of, between two points of the sampling
        level = np.flatnonzero(solid.any(axis=(0, 1)))
        assert (level[0], level[-1]) == (2, 6)  # above the ground's top voxel up to 12 m
        np.testing.assert_array_equal(ground.any(axis=(0, 1)), np.arange(12) <= 2)


def test_delft_agrees_with_its_model_column_by_column(data: Path) -> None:
    path = data / "ahn3_delft" / "testarea.city.json"
    town = maxjax.load_map(path)
    assert town.file.crs == "EPSG:7415"
    x, y = (town.grid.origin[i] + 2.0 * np.arange(0, town.grid.shape[i], 4) for i in (0, 1))
    base, roof, _ = column_heights(path, x, y)
    solid = (town.occupied & ~town.ground)[::4, ::4]
    house = np.isfinite(roof) & (roof - base > 2)
    assert house.sum() > 100
    top = town.grid.shape[2] - 1 - solid[:, :, ::-1].argmax(axis=2)
    assert solid.any(axis=2)[house].all()
    # Roofs are flat at the highest point of their building, so never below the model's, to within a voxel.
    assert (town.grid.origin[2] + 2.0 * top + 1.0 >= roof - 1e-6)[house].all()


def survey() -> PointCloud:
    """A meadow with a tree (a crown at 8 m), a bridge deck, a wire and a house."""
    rng = np.random.default_rng(0)
    flat = np.c_[rng.uniform(0, 60, (4000, 2)), np.zeros(4000)]
    crown = np.c_[rng.uniform(10, 18, (200, 2)), rng.uniform(7.5, 8.5, 200)]
    deck = np.c_[rng.uniform(30, 38, (200, 2)), np.full(200, 8.0)]
    wire = np.c_[rng.uniform(20, 28, (200, 2)), np.full(200, 8.0)]
    roof = np.c_[rng.uniform(46, 54, (200, 2)), np.full(200, 8.0)]
    classes = np.repeat([2, 1, 26, 14, 6], [4000, 200, 200, 200, 200]).astype(np.uint8)
    points = np.concatenate([flat, crown, deck, wire, roof]).astype(np.float32)
    return PointCloud(points, np.zeros(3), classes == 2, classes == 6, "a.laz", classes)


def test_what_a_crown_or_a_deck_hides_is_solid_and_what_a_wire_hides_is_not() -> None:
    def below(found: maxjax.VoxelMap, x: float, y: float) -> bool:
        i, j, k = (round((p - o) / 2) for p, o in zip((x, y, 4.0), found.grid.origin, strict=True))
        return bool(found.occupied[i, j, k])

    closed, opened = map_of(survey(), Window()), map_of(survey(), Window(), maxjax.Reading(below="open"))
    assert [below(closed, x, x) for x in (14, 34, 24, 50)] == [True, True, False, True]
    assert [below(opened, x, x) for x in (14, 34, 24, 50)] == [False, False, False, True]


def test_delft_is_planned_from_end_to_end(data: Path) -> None:
    pytest.importorskip("laspy")
    ends = (84_815.0, 447_420.0, 25.0), (84_990.0, 447_635.0, 25.0)
    town = maxjax.load_map(data / "ahn3_delft" / "ahn3_cropped_1.laz", spacing=4.0, reading=maxjax.Reading(ends=ends))
    assert town.file.read["points"] == 640_510
    assert town.file.counts == {"inside": 640_510, "outside": 0, "missing": 0}
    for end in ends:
        index = np.round((np.array(end) - np.array(town.grid.origin)) / 4).astype(int)
        assert ((index > 0) & (index < town.grid.shape)).all()
    plan = maxjax.plan(town, *ends, planner=maxjax.AStar())
    assert plan.status == maxjax.Status.OK


def test_a_voxel_map_keeps_its_grid_but_for_bounds(tmp_path: Path) -> None:
    occupied = np.random.default_rng(0).random((8, 9, 10)) < 0.5
    np.savez(tmp_path / "a.npz", occupied=occupied, spacing=0.5, origin=np.array([1.0, 2.0, 3.0]))
    whole = maxjax.load_map(tmp_path / "a.npz", crs="EPSG:28992")
    np.testing.assert_array_equal(whole.occupied, occupied)
    assert (whole.file.crs, whole.grid.spacing) == ("EPSG:28992", 0.5)
    part = maxjax.load_map(tmp_path / "a.npz", bounds=((1.75, 2.75, 3.75), (3.25, 4.25, 5.25)))
    np.testing.assert_array_equal(part.occupied, occupied[2:5, 2:5, 2:5])
    assert part.grid.origin == (2.0, 3.0, 4.0)
    with pytest.raises(FileError, match="meet the map"):
        maxjax.load_map(tmp_path / "a.npz", bounds=(50, 50, 50, 60, 60, 60))
    with pytest.raises(ValueError, match="brings its own"):
        maxjax.load_map(tmp_path / "a.npz", spacing=1.0)
    with pytest.raises(ValueError, match="six numbers"):
        maxjax.load_map(tmp_path / "a.npz", bounds=(0, 1))


def test_every_number_of_a_map_can_be_written_as_json(data: Path) -> None:
    for name in ("octomap/geb079.bt", "la_venice/buildings-addresses-060372733002.osm"):
        found = maxjax.load_map(data / name)
        file = found.file
        assert json.loads(json.dumps([file.read, file.dropped, file.counts, file.remarks, file.origin]))
