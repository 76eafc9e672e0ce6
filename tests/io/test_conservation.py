"""Nothing solid of a CityJSON is lost: each fault by itself, and random solids against their own volume."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

import maxjax
from maxjax.core.grid import Grid
from maxjax.io.geo.polygons import covering
from maxjax.io.geo.triangles import voxels_touched

Box = tuple[float, float, float, float, float, float]
Solid = Callable[[float, float, float], bool]
# West, south, bottom, east, north, top: two that keep the window wide.
AROUND: tuple[Box, ...] = ((-57, -57, 0, -53, -53, 6), (53, 53, 0, 57, 57, 6))
IDENTITY = np.eye(4)


class City:
    """A document that grows, its vertices whole millimetres."""

    def __init__(self) -> None:
        self.vertices: list[list[int]] = []
        self.things: dict[str, Any] = {}
        for k, box in enumerate(AROUND):
            self.add(f"around {k}", "Building", [self.solid(self.box(box))])

    def points(self, *corners: tuple[float, float, float]) -> list[int]:
        first = len(self.vertices)
        self.vertices += [[round(1000 * number) for number in corner] for corner in corners]
        return list(range(first, first + len(corners)))

    def box(self, box: Box, *, slope: float = 0.0) -> list[list[list[int]]]:
        """Faces of a box, the bottom first, then the top; its bottom rises eastwards by `slope`."""
        x0, y0, z0, x1, y1, z1 = box
        flat = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
        low = self.points(*((x, y, z0 + slope * (x == x1)) for x, y in flat))
        high = self.points(*((x, y, z1) for x, y in flat))
        walls = [[[low[i], low[(i + 1) % 4], high[(i + 1) % 4], high[i]]] for i in range(4)]
        return [[low[::-1]], [high], *walls]

    def solid(self, faces: list[list[list[int]]], lod: str = "2") -> dict[str, Any]:
        return {"type": "Solid", "lod": lod, "boundaries": [faces]}

    def add(self, name: str, kind: str, geometry: list[dict[str, Any]], **more: Any) -> None:
        self.things[name] = {"type": kind, "geometry": geometry, **more}

    def read(self, folder: Path, **more: Any) -> tuple[Solid, maxjax.io.load.LoadedMap]:
        document = {
            "type": "CityJSON",
            "version": "2.0",
            "transform": {"scale": [0.001] * 3, "translate": [0.0] * 3},
            "CityObjects": self.things,
            "vertices": self.vertices,
            **more,
        }
        (folder / "a.city.json").write_text(json.dumps(document))
        found = maxjax.load_map(folder / "a.city.json", spacing=1.0)
        occupied = np.asarray(found.occupied)

        def at(x: float, y: float, z: float) -> bool:
            i, j, k = np.floor(np.subtract((x, y, z), found.grid.lower)).astype(int)
            return bool(occupied[i, j, k])

        return at, found


def test_an_upper_storey_and_eaves_stand_where_they_are_with_air_below(tmp_path: Path) -> None:
    city = City()
    profile = [(-10, 0), (0, 0), (0, 15), (25, 15), (25, 30), (-10, 30)]
    near, far = (city.points(*((x, y, z) for x, z in profile)) for y in (-10, 10))
    sides = [[[near[i], near[(i + 1) % 6], far[(i + 1) % 6], far[i]]] for i in range(6)]
    city.add("house", "Building", [city.solid([[near[::-1]], [far], *sides])])
    at, _ = city.read(tmp_path)
    assert at(15.5, 0.5, 22.5)
    assert at(-5.5, 0.5, 7.5)
    assert not at(15.5, 0.5, 8.5)
    assert not at(15.5, 0.5, 32.5)


@pytest.mark.parametrize(
    "fault", ["no bottom", "no top", "sloping", "twice", "all twice", "smaller ground", "apart", "turned"]
)
def test_a_box_is_solid_whatever_is_wrong_with_its_shell(tmp_path: Path, fault: str) -> None:
    city = City()
    box = (-10.0, -10.0, 0.0, 10.0, 10.0, 30.0)
    faces = city.box(box, slope=4.0 if fault == "sloping" else 0.0)
    if fault == "no bottom":
        faces = faces[1:]
    elif fault == "no top":
        faces.pop(1)
    elif fault == "twice":
        faces.append(faces[0])
    elif fault == "all twice":
        faces += [face[:] for face in faces]
    elif fault == "smaller ground":
        faces.append([city.points((-5, -5, 0), (-5, 5, 0), (5, 5, 0), (5, -5, 0))])
    elif fault == "apart":
        faces[1] = [city.points((-10, -10, 29.99), (10, -10, 30), (10, 10, 30), (-10, 10, 30))]
    elif fault == "turned":
        faces = [[ring[::-1] for ring in face] if k % 2 else face for k, face in enumerate(faces)]
    city.add("house", "Building", [city.solid(faces)])
    at, found = city.read(tmp_path)
    assert all(at(x, y, z) for x in (-9.5, 0.5, 9.5) for y in (-9.5, 0.5) for z in (5.5, 15.5, 29.5))
    assert not at(0.5, 0.5, 32.5)
    assert not at(15.5, 0.5, 10.5)
    assert not found.file.dropped


def test_coarse_solids_stand_where_finer_surfaces_do_not_close(tmp_path: Path) -> None:
    city = City()
    faces = city.box((-10, -10, 0, 10, 10, 30))
    walls = {"type": "MultiSurface", "lod": "2", "boundaries": faces[2:]}
    city.add("house", "Building", [city.solid(faces, "1"), walls])
    at, _ = city.read(tmp_path)
    assert at(0.5, 0.5, 15.5)


KINDS = ["Bridge", "OtherConstruction", "BuildingInstallation", "GenericCityObject", "SolitaryVegetationObject"]
KINDS += ["PlantCover", "CityFurniture", "Tunnel", "+Chimney", "TransportSquare"]


@pytest.mark.parametrize("kind", KINDS)
def test_every_type_stands(tmp_path: Path, kind: str) -> None:
    city = City()
    city.add("thing", kind, [city.solid(city.box((-10, -10, 10, 10, 10, 20)))])
    at, found = city.read(tmp_path)
    assert at(0.5, 0.5, 15.5)
    assert found.file.read[kind] == 1
    assert not found.file.dropped


def test_a_template_stands_at_each_of_its_places(tmp_path: Path) -> None:
    city = City()
    tree = City()
    faces = [[[i - 16 for i in ring] for ring in face] for face in tree.box((-2, -2, 0, 2, 2, 8))]
    turned = np.array([[0, -2, 0, 0], [2, 0, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]], float)  # twice as wide, 3 m up
    for k, (place, matrix) in enumerate((((-20, 0, 0), IDENTITY), ((20, 0, 0), turned))):
        one = {"type": "GeometryInstance", "template": 0, "boundaries": city.points(place)}
        one["transformationMatrix"] = matrix.ravel().tolist()
        city.add(f"tree {k}", "SolitaryVegetationObject", [one])
    corners = (np.array(tree.vertices[16:]) / 1000).tolist()
    templates = {"templates": [city.solid(faces, "3")], "vertices-templates": corners}
    at, _ = city.read(tmp_path, **{"geometry-templates": templates})
    assert at(-19.5, 0.5, 6.5)
    assert not at(-16.5, 0.5, 6.5)
    assert at(23.5, 0.5, 9.5)
    assert not at(20.5, 0.5, 12.5)


def test_what_has_no_height_is_counted_unless_a_part_has_one(tmp_path: Path) -> None:
    city = City()
    flat = {"type": "MultiSurface", "lod": "0", "boundaries": [[city.points((0, 0, 0), (9, 0, 0), (9, 9, 0))]]}
    city.add("whole", "Building", [flat], children=["part"])
    city.add("part", "BuildingPart", [flat, city.solid(city.box((0, 0, 0, 9, 9, 9)))], parents=["whole"])
    _, found = city.read(tmp_path)
    assert not found.file.dropped
    city.add("lost", "Building", [flat])
    city.add("empty", "Building", [])
    city.add("lamp", "CityFurniture", [flat])
    _, found = city.read(tmp_path)
    expected = {"buildings without a height": 2, "CityFurniture objects without a height": 1}
    assert dict(found.file.dropped) == expected
    assert any("2 buildings without a height" in remark for remark in found.file.remarks)


def test_a_courtyard_stays_free_whichever_way_its_hole_goes(tmp_path: Path) -> None:
    for turn in (1, -1):
        city = City()
        outer, inner = city.box((-12, -12, 0, 12, 12, 20)), city.box((-6, -6, 0, 6, 6, 20))
        faces = [[outer[k][0], inner[k][0][::-turn]] for k in (0, 1)] + outer[2:] + inner[2:]
        city.add("house", "Building", [city.solid(faces)])
        at, _ = city.read(tmp_path)
        assert at(9.5, 0.5, 10.5)
        assert not at(0.5, 0.5, 10.5)


def test_random_boxes_are_solid_through_and_through(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    city = City()
    boxes = []
    for k in range(40):
        low = rng.uniform((-45, -45, 0), (35, 35, 8))
        box = tuple(np.round([*low, *(low + rng.uniform(2, 9, 3))], 3).tolist())
        boxes.append(box)
        faces = city.box(box)
        open_at = int(rng.integers(6)) if k % 2 else None
        faces = [face for j, face in enumerate(faces) if j != open_at]
        kind = str(rng.choice(["Building", "CityFurniture", "Bridge"]))
        city.add(f"thing {k}", kind, [city.solid(faces)])
    _, found = city.read(tmp_path)
    x, y, z = (found.grid.origin[axis] + np.arange(found.grid.shape[axis]) for axis in range(3))
    occupied = np.asarray(found.occupied)
    for x0, y0, z0, x1, y1, z1 in boxes:
        inside = np.ix_((x > x0) & (x < x1), (y > y0) & (y < y1), (z > z0) & (z < z1))
        assert occupied[inside].all()
    assert found.file.read["shells"] == 42
    assert not found.file.dropped


def test_triangles_of_a_concave_face_with_a_hole_have_its_area() -> None:
    shapely = pytest.importorskip("shapely")
    rng = np.random.default_rng(1)
    grid = Grid((30, 30, 3), 1.0, (-14.5, -14.5, -1.0))
    for _ in range(20):
        angle = np.sort(rng.uniform(0, 2 * np.pi, 11))
        outer = rng.uniform(5, 13, (11, 1)) * np.column_stack([np.cos(angle), np.sin(angle)])
        hole = 2.0 * np.column_stack([np.cos(angle), np.sin(angle)])
        face = shapely.Polygon(outer, [hole])
        if not face.is_valid:
            continue
        found = covering([np.column_stack([ring, np.zeros(11)]) for ring in (outer, hole)])
        along, across = found[:, 1] - found[:, 0], found[:, 2] - found[:, 0]
        area = 0.5 * np.abs(np.cross(along, across)[:, 2]).sum()
        assert area == pytest.approx(face.area, rel=1e-9)
        voxels = voxels_touched(found, grid).any(axis=2)
        for i, j in np.ndindex(30, 30):
            square = shapely.box(i - 15, j - 15, i - 14, j - 14)
            assert voxels[i, j] == face.intersects(square)


@pytest.mark.parametrize("code", ["EPSG:2263", "EPSG:3857", "EPSG:28992"])
def test_a_model_is_in_metres_whatever_its_system(tmp_path: Path, code: str) -> None:
    longitude, latitude = (4.38, 52.0) if code == "EPSG:28992" else (-73.98, 40.75)
    to_plane = pyproj.Transformer.from_crs("EPSG:4326", code, always_xy=True)
    x, y = (round(value) for value in to_plane.transform(longitude, latitude))
    city = City()
    city.vertices.clear()
    city.things.clear()
    city.add("house", "Building", [city.solid(city.box((0, 0, 0, 100, 100, 60)))])
    vertices = (np.array(city.vertices) / 1000 + [x, y, 0]).tolist()
    document = {"type": "CityJSON", "version": "1.0", "CityObjects": city.things, "vertices": vertices}
    document["metadata"] = {"referenceSystem": f"urn:ogc:def:crs:EPSG::{code[5:]}"}
    (tmp_path / "a.city.json").write_text(json.dumps(document))
    found = maxjax.io.read_map(tmp_path / "a.city.json")
    corners = np.array([(x, y), (x + 100, y), (x + 100, y + 100), (x, y + 100)], float)
    to_degrees = pyproj.Transformer.from_crs(code, "EPSG:4326", always_xy=True)
    _, around = pyproj.Geod(ellps="WGS84").polygon_area_perimeter(*to_degrees.transform(*corners.T))
    faces = found.shells.faces.reshape(-1, 3)
    size = np.ptp(faces, axis=0)
    assert 2 * (size[0] + size[1]) == pytest.approx(around, rel=2e-3)
    assert size[2] == pytest.approx(60 * (1200 / 3937 if code == "EPSG:2263" else 1.0), abs=1e-6)


def test_a_compound_system_is_known_by_its_plane(tmp_path: Path) -> None:
    city = City()
    vertices = np.array(city.vertices) + np.array([500_000_000, 5_500_000_000, 0])
    system = {"referenceSystem": "urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::5783"}
    _, found = city.read(tmp_path, metadata=system, vertices=vertices.tolist())
    assert found.file.crs == "EPSG:25832"


def test_a_height_among_the_attributes_and_a_solid_called_an_outline_stand(tmp_path: Path) -> None:
    city = City()
    flat = {"type": "MultiSurface", "lod": "0", "boundaries": city.box((-10, -10, 2, 10, 10, 9))[:1]}
    city.add("outline", "Building", [flat])
    city.things["outline"]["attributes"] = {"measuredHeight": 30}
    solid = city.solid(city.box((20, 20, 0, 30, 30, 12)))
    city.add("solid", "Building", [{**solid, "lod": "0"}])
    at, found = city.read(tmp_path)
    assert [at(0.5, 0.5, z) for z in (15.5, 31.5, 33.5)] == [True, True, False]
    assert at(25.5, 25.5, 6.5)
    assert not found.file.dropped
    assert any("1 objects are outlines alone" in remark for remark in found.file.remarks)


def test_whoever_wants_less_asks_for_it(tmp_path: Path) -> None:
    city = City()
    city.add("tree", "SolitaryVegetationObject", [city.solid(city.box((0, 0, 0, 9, 9, 9)))])
    city.read(tmp_path)
    found = maxjax.load_map(tmp_path / "a.city.json", spacing=1.0, reading=maxjax.Reading(only=("Building",)))
    assert found.file.dropped == {"SolitaryVegetationObject objects that were not asked for": 1}
    assert found.file.read["Building"] == 2


def test_every_point_of_a_survey_is_in_a_voxel_outside_or_dropped(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy", reason="needs the extra las")
    rng = np.random.default_rng(0)
    survey = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    survey.header.scales = [0.01] * 3
    survey.x, survey.y, survey.z = rng.uniform(0, 60, (3, 3000))
    survey.classification = rng.choice([1, 2, 6, 7, 9, 14, 18], 3000)
    survey.withheld = rng.random(3000) < 0.1
    survey.return_number[:] = survey.number_of_returns[:] = 1
    survey.write(tmp_path / "a.las")
    reading = maxjax.Reading(drop_classes=(9, 14))
    bounds = (10.0, 10.0, -4.0, 50.0, 50.0, 40.0)
    file = maxjax.load_map(tmp_path / "a.las", bounds=bounds, reading=reading).file
    noise = (np.asarray(survey.withheld) != 0) | np.isin(survey.classification, (7, 18))
    unwanted = ~noise & np.isin(survey.classification, (9, 14))
    inside = ((np.asarray(survey.xyz)[:, :2] >= 9.0) & (np.asarray(survey.xyz)[:, :2] < 51.0)).all(axis=1)
    inside &= np.asarray(survey.z) < 41.0
    assert file.dropped["noise or withheld"] == noise.sum()
    assert file.dropped["of classes that are dropped"] == unwanted.sum()
    assert file.counts["inside"] == (inside & ~noise & ~unwanted).sum()
    assert file.read["points"] + noise.sum() + unwanted.sum() == 3000
    assert sum(file.counts.values()) == file.read["points"]
