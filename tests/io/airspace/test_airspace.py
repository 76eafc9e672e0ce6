"""Altitude bands and areas as voxels, beside shapely."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import maxjax
from maxjax import Airspace, Area, Status, load_airspace
from maxjax.core.status import Closure
from maxjax.core.terrain import Terrain
from maxjax.io.airspace.airspace import Reasons
from maxjax.io.geo.earth import Degrees, Projected, TangentPlane
from maxjax.io.geo.vertical_zero import VerticalZero
from maxjax.ui.methods import planner_named

shapely = pytest.importorskip("shapely", reason="needs shapely (extra dev)")
affinity = pytest.importorskip("shapely.affinity")

GRID = maxjax.Grid((14, 12, 10), 2.0, (-13.0, 51.0, 3.0))
PLACE = TangentPlane(52.0, 4.3, 0.0)
NOTHING = np.zeros(GRID.shape, bool)


def star(rng: np.random.Generator, middle: np.ndarray, radius: float, count: int = 9) -> np.ndarray:
    """A ring that does not cross itself."""
    angles = np.sort(rng.uniform(0, 2 * math.pi, count))
    reach = radius * rng.uniform(0.4, 1.0, count)
    ring: np.ndarray = middle + (reach * np.array([np.cos(angles), np.sin(angles)])).T
    return ring


def squares() -> np.ndarray:
    x0, y0, _ = GRID.lower
    return np.array(
        [[shapely.box(x0 + 2 * i, y0 + 2 * j, x0 + 2 * i + 2, y0 + 2 * j + 2) for j in range(12)] for i in range(14)]
    )


def hills(rng: np.random.Generator) -> np.ndarray:
    """Ground voxels: columns of different heights, some without any."""
    tops = rng.integers(0, 5, GRID.shape[:2])
    return np.asarray(np.arange(GRID.shape[2]) < tops[:, :, None])


def ground_under(ground: np.ndarray) -> np.ndarray:
    """Height of the ground by plain loops: that of the nearest column that has some."""
    z0 = GRID.lower[2]
    columns = {
        (i, j): z0 + 2.0 * (int(np.flatnonzero(ground[i, j])[-1]) + 1)
        for i in range(14)
        for j in range(12)
        if ground[i, j].any()
    }
    return np.array(
        [
            [
                columns[(i, j)]
                if (i, j) in columns
                else [
                    h
                    for (a, b), h in columns.items()
                    if (a - i) ** 2 + (b - j) ** 2 == min((c - i) ** 2 + (d - j) ** 2 for c, d in columns)
                ]
                for j in range(12)
            ]
            for i in range(14)
        ],
        dtype=object,
    )


def layers() -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper face of each layer [m]."""
    low = GRID.lower[2] + 2.0 * np.arange(GRID.shape[2])
    return low, low + 2.0


def same_as(closed: Reasons, i: int, j: int, heights: Any, expected: Any) -> bool:
    """Whether a column is as expected for one of the heights that its ground may have."""
    options = heights if isinstance(heights, list) else [heights]
    return any(np.array_equal(closed[i, j] > 0, expected(h)) for h in options)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("keep_in", [False, True])
def test_areas_close_what_they_touch_and_open_what_they_hold(seed: int, keep_in: bool) -> None:
    rng = np.random.default_rng(seed)
    middle = np.array([0.0, 62.0]) + rng.uniform(-4, 4, 2)
    outline = star(rng, middle, 14.0)
    hole = middle + 0.3 * (outline[::-1] - middle)
    ground = hills(rng)
    floor, ceiling = rng.uniform(0, 4), rng.uniform(5, 14)
    area = Area("a", (outline, hole), keep_in, floor, ceiling, bool(seed % 2), bool(seed // 2))
    closed = Airspace(areas=(area,)).closed(ground, GRID)
    assert set(np.unique(closed)) <= {Closure.OPEN, Closure.AREA}
    shape, boxes = shapely.Polygon(outline, [hole]), squares()
    under = ground_under(ground)
    low, high = layers()
    for i in range(14):
        for j in range(12):
            meets, inside = boxes[i, j].intersects(shape), shape.contains(boxes[i, j])

            def expected(h: float, meets: bool = meets, inside: bool = inside) -> np.ndarray:
                # The ground is somewhere in its highest voxel.
                begin = floor + ((h if keep_in else h - 2.0) if area.floor_above_ground else 0.0)
                end = ceiling + ((h - 2.0 if keep_in else h) if area.ceiling_above_ground else 0.0)
                if keep_in:
                    return np.asarray(~(inside & (low >= begin) & (high <= end)))
                return np.asarray(meets & (high > begin) & (low < end) & (begin < end))

            assert same_as(closed, i, j, under[i, j], expected)


@pytest.mark.parametrize("seed", range(3))
def test_a_band_opens_the_voxels_that_lie_in_it_whole(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ground = hills(rng)
    band = Airspace(floor=1.5, ceiling=9.0, highest=15.0)
    closed = band.closed(ground, GRID)
    low, high = layers()
    under = ground_under(ground)
    for i in range(14):
        for j in range(12):

            def expected(h: float) -> np.ndarray:
                return np.asarray(~((low >= h + 1.5) & (high <= h - 2.0 + 9.0) & (high <= 15.0)))

            assert same_as(closed, i, j, under[i, j], expected)
    assert set(np.unique(closed)) == {Closure.OPEN, Closure.BAND}


def test_a_voxel_is_closed_for_a_reason_that_is_named() -> None:
    """Words for each closed voxel and for no open one."""
    rng = np.random.default_rng(0)
    terrain = Terrain.of(hills(rng), GRID)
    rules = Airspace(floor=1.5, ceiling=9.0, areas=(Area("'yard'", (star(rng, np.array([0.0, 62.0]), 8.0),)),))
    closed = rules.closed_over(terrain)
    for index in zip(*(rng.integers(0, n, 30).tolist() for n in GRID.shape), strict=True):
        named = rules.reasons_at(index, terrain)
        assert bool(named) == (closed[index] != Closure.OPEN)
        if closed[index] == Closure.AREA:
            assert "in the keep-out area 'yard'" in named
    ground = terrain.at(-13.0, 51.0)
    level = int((ground + 12.0 - GRID.lower[2]) / 2.0)
    assert "above 9 m above ground" in rules.reasons_at((0, 0, min(level, 9)), terrain)


def test_a_band_that_ends_on_faces_opens_all_up_to_them() -> None:
    flat = NOTHING.copy()
    flat[:, :, :2] = True
    closed = Airspace(floor=2.0, ceiling=8.0).closed(flat, GRID)
    assert np.flatnonzero(closed[3, 3] == Closure.OPEN).tolist() == [3, 4]
    # Of flat ground at a stated height there is no doubt.
    stated = Airspace(floor=2.0, ceiling=8.0).closed_over(Terrain.flat(6.0, GRID))
    assert np.flatnonzero(stated[3, 3] == Closure.OPEN).tolist() == [3, 4, 5]


def test_two_areas_to_keep_in_open_both() -> None:
    areas = [Area(name, (square(x, 62.0, 5.0),), keep_in=True) for name, x in (("west", -6.0), ("east", 6.0))]
    both = Airspace(areas=tuple(areas)).closed(NOTHING, GRID) == Closure.OPEN
    west, east = (Airspace(areas=(area,)).closed(NOTHING, GRID) == Closure.OPEN for area in areas)
    assert west.any()
    assert east.any()
    np.testing.assert_array_equal(both, west | east)


def test_heights_above_ground_need_ground() -> None:
    for airspace in (Airspace(floor=2.0), Airspace(areas=(Area("a", (square(0.0, 62.0, 5.0),), ceiling=20.0),))):
        with pytest.raises(ValueError, match="expected a map with ground"):
            airspace.closed(NOTHING, GRID)
    Airspace(highest=10.0, areas=(Area("a", (square(0.0, 62.0, 5.0),)),)).closed(NOTHING, GRID)


def square(x: float, y: float, half: float) -> np.ndarray:
    return np.array([[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]])


AIR = maxjax.Grid((24, 24, 16), 2.0, (1.0, 1.0, -3.0))
START, GOAL = (4.0, 24.0, 9.0), (44.0, 24.0, 9.0)


def town() -> tuple[np.ndarray, np.ndarray]:
    ground = np.zeros(AIR.shape, bool)
    ground[:, :, :2] = True
    occupied = ground.copy()
    occupied[11:13, 4:8, :8] = True
    return occupied, ground


@pytest.mark.large
@pytest.mark.parametrize("method", ["solver", "astar"])
def test_a_path_keeps_every_rule_wherever_it_is_sampled(method: str) -> None:
    occupied, ground = town()
    school = np.array([[15.0, 14.0], [33.0, 10.0], [30.0, 40.0], [17.0, 36.0]])
    airspace = Airspace(floor=4.0, ceiling=20.0, highest=19.0, areas=(Area("school", (school,), ceiling=40.0),))
    plan = maxjax.plan(
        maxjax.VoxelMap.on(AIR, occupied, ground),
        START,
        GOAL,
        planner=planner_named(method),
        distances=maxjax.Distances(margin=4.0),
        airspace=airspace,
    )
    assert plan.status == Status.OK
    free = maxjax.plan(
        maxjax.VoxelMap.on(AIR, occupied, ground),
        START,
        GOAL,
        planner=planner_named(method),
        distances=maxjax.Distances(margin=4.0),
    )
    assert plan.length > free.length + 3.0
    for path, kept in ((plan.path, True), (free.path, False)):
        t = np.linspace(0, len(path) - 1, 20_001)
        points = np.column_stack([np.interp(t, np.arange(len(path)), path[:, k]) for k in range(3)])
        inside = shapely.contains_xy(shapely.Polygon(school), points[:, 0], points[:, 1])
        assert inside.any() != kept
        assert points[:, 2].min() >= 4.0
        assert points[:, 2].max() <= 19.0
    limits = maxjax.FlightLimits(speed=5.0)
    motion = maxjax.trajectory(plan, limits)
    at = motion.at(np.arange(0.0, motion.duration, 0.01)).position
    assert not shapely.contains_xy(shapely.Polygon(school), at[:, 0], at[:, 1]).any()
    assert at[:, 2].max() <= 19.0


def test_an_area_has_no_price_and_does_not_count_as_an_obstacle() -> None:
    occupied, ground = town()
    occupied = ground
    strip = Airspace(areas=(Area("strip", (np.array([[2.0, 29.0], [46.0, 29.0], [46.0, 31.0], [2.0, 31.0]]),)),))
    plan = maxjax.plan(
        maxjax.VoxelMap.on(AIR, occupied, ground), START, GOAL, distances=maxjax.Distances(margin=8.0), airspace=strip
    )
    assert plan.status == Status.OK
    assert plan.length == pytest.approx(math.dist(START, GOAL), abs=0.01)
    assert plan.cost == pytest.approx(plan.length, rel=1e-4)
    assert plan.clearance == math.inf


def test_buildings_in_a_closed_area_stay_obstacles() -> None:
    occupied, ground = town()
    everywhere = Airspace(areas=(Area("block", (square(24.0, 12.0, 6.0),)),))
    plan = maxjax.plan(
        maxjax.VoxelMap.on(AIR, occupied, ground),
        START,
        GOAL,
        distances=maxjax.Distances(margin=4.0),
        airspace=everywhere,
    )
    alone = maxjax.plan(maxjax.VoxelMap.on(AIR, occupied, ground), START, GOAL, distances=maxjax.Distances(margin=4.0))
    assert plan.status == alone.status == Status.OK
    assert math.isfinite(plan.clearance)


SCHOOL = Area("school", (square(4.0, 24.0, 3.0),))
KEPT = Area("field", (square(40.0, 24.0, 8.0),), keep_in=True)


@pytest.mark.parametrize(
    ("airspace", "start", "goal", "status"),
    [
        (Airspace(areas=(SCHOOL,)), START, GOAL, Status.START_IN_CLOSED_AREA),
        (Airspace(areas=(SCHOOL,)), GOAL, START, Status.GOAL_IN_CLOSED_AREA),
        (Airspace(areas=(KEPT,)), START, GOAL, Status.START_IN_CLOSED_AREA),
        (Airspace(floor=10.0), START, (44.0, 24.0, 15.0), Status.START_OUTSIDE_BAND),
        (Airspace(ceiling=12.0), START, (44.0, 24.0, 15.0), Status.GOAL_OUTSIDE_BAND),
        (Airspace(highest=5.0), START, GOAL, Status.START_OUTSIDE_BAND),
        (Airspace(ceiling=10.0), (24.0, 10.0, 9.0), GOAL, Status.START_OCCUPIED),
        (Airspace(ceiling=10.0), (math.nan, 10.0, 9.0), GOAL, Status.NONFINITE_INPUT),
        (Airspace(ceiling=10.0), (-40.0, 10.0, 9.0), GOAL, Status.START_OUTSIDE_MAP),
        (Airspace(areas=(Area("wall", (np.array([[20, -9], [28, -9], [28, 99], [20, 99.0]]),)),)), START, GOAL,
         Status.NO_VALID_PATH),
    ],
)  # fmt: skip
def test_ends_in_closed_airspace_have_a_status_of_their_own(
    airspace: Airspace, start: tuple[float, ...], goal: tuple[float, ...], status: Status
) -> None:
    occupied, ground = town()
    plan = maxjax.plan(
        maxjax.VoxelMap.on(AIR, occupied, ground),
        start,
        goal,
        planner=maxjax.AStar(),
        distances=maxjax.Distances(margin=4.0),
        airspace=airspace,
    )
    assert plan.status == status
    assert len(plan.path) == 0


@pytest.mark.large
def test_batches_and_fleets_keep_the_rules_and_name_them() -> None:
    occupied, ground = town()
    airspace = Airspace(areas=(SCHOOL,))
    starts = np.array([START, (10.0, 40.0, 9.0)])
    goals = np.array([GOAL, GOAL])
    options: dict[str, Any] = {"distances": maxjax.Distances(margin=4.0), "airspace": airspace}
    where = maxjax.VoxelMap.on(AIR, occupied, ground)
    maps = maxjax.VoxelMap.on(AIR, np.stack([occupied] * 2), np.stack([ground] * 2))
    batch = maxjax.plan_batch(where, starts, goals, **options)
    several = maxjax.plan_batch(maps, starts, goals, **options)
    fleet = maxjax.plan_to_goal(where, starts, GOAL, **options)
    np.testing.assert_array_equal(batch[1].map.closed, np.where(occupied, 0, airspace.closed(ground, AIR)))
    expected = [Status.START_IN_CLOSED_AREA, Status.OK]
    assert batch.status.tolist() == several.status.tolist() == fleet.status.tolist() == expected


# Files.


def degrees(ring: np.ndarray) -> list[list[float]]:
    """A closed ring of the map as longitudes and latitudes."""
    places = PLACE.geodetic(np.column_stack([ring, np.zeros(len(ring))]))
    return [[float(x), float(y)] for y, x in [*places[:, :2], places[0, :2]]]


def feature(rings: list[Any], layer: dict[str, Any] | None = None, kind: str = "Polygon", **properties: Any) -> Any:
    geometry: dict[str, Any] = {"type": kind, "coordinates": rings} | ({"layer": layer} if layer else {})
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def written(folder: Path, *features: Any, **more: Any) -> Path:
    file = folder / "areas.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": list(features), **more}))
    return file


def test_a_file_is_read_in_the_words_of_ed_318_and_of_qgroundcontrol(tmp_path: Path) -> None:
    outline, hole = square(0.0, 62.0, 9.0), square(0.0, 62.0, 3.0)
    rings = [degrees(outline), degrees(hole)]
    layer = {"lower": 10, "lowerReference": "AGL", "upper": 400, "upperReference": "AMSL", "uom": "ft"}
    many = [rings, [degrees(square(6.0, 56.0, 2.0))]]
    file = written(
        tmp_path,
        feature(rings, layer, type="PROHIBITED", name=[{"text": "school", "lang": "en"}]),
        feature([degrees(outline)], name="field", inclusion=True, lower=5, upper=50),
        feature(many, kind="MultiPolygon", identifier="m"),
        feature([degrees(outline)], type="NO_RESTRICTION"),
        feature([degrees(square(9e4, 0.0, 9.0))], name="elsewhere"),
    )
    airspace = load_airspace(file, PLACE, GRID, floor=3.0)
    assert airspace.floor == 3.0
    school, field, first, second = airspace.areas
    assert (school.name, field.name, first.name) == ("'school'", "'field'", "'m'")
    assert (school.keep_in, field.keep_in) == (False, True)
    assert (school.floor, school.ceiling) == pytest.approx((3.048, 121.92))
    assert (school.floor_above_ground, school.ceiling_above_ground) == (True, False)
    assert (field.floor, field.ceiling, first.floor, second.ceiling) == (5.0, 50.0, -math.inf, math.inf)
    for ring, given in zip(school.rings, (outline, hole), strict=True):
        np.testing.assert_allclose(ring, given, atol=1e-3)
    elsewhere, unlimited, free = airspace.remarks
    assert elsewhere.endswith(": 1")
    assert "'m'" in unlimited
    assert "1 zones that restrict nothing (NO_RESTRICTION)" in free


def test_an_area_far_larger_than_the_map_closes_all_of_it(tmp_path: Path) -> None:
    country = [[[3.0, 50.7], [7.3, 50.7], [7.3, 53.6], [3.0, 53.6], [3.0, 50.7]]]
    closed = load_airspace(written(tmp_path, feature(country)), PLACE, GRID).closed(NOTHING, GRID)
    assert (closed == Closure.AREA).all()
    world = [[[-180.0, -90.0], [180.0, -90.0], [180.0, 90.0], [-180.0, 90.0], [-180.0, -90.0]]]
    opened = load_airspace(written(tmp_path, feature(world, inclusion=True)), PLACE, GRID).closed(NOTHING, GRID)
    assert (opened == Closure.OPEN).all()


def test_an_area_across_the_antimeridian_lies_where_it_is(tmp_path: Path) -> None:
    fiji = TangentPlane(-17.0, 179.9999, 0.0)
    ring = fiji.geodetic(np.column_stack([square(0.0, 62.0, 5.0), np.zeros(4)]))[:, 1::-1]
    ring[:, 0] %= 360.0
    outline = [[float(x) - 360.0, float(y)] for x, y in [*ring, ring[0]]]
    found = load_airspace(written(tmp_path, feature([outline])), fiji, GRID)
    np.testing.assert_allclose(found.areas[0].rings[0], square(0.0, 62.0, 5.0), atol=1e-3)


def split_at_180(outline: np.ndarray, holes: Sequence[np.ndarray] = ()) -> list[list[list[list[float]]]]:
    """An area with longitudes beyond 180, split there by shapely as RFC 7946 asks."""
    whole = shapely.Polygon(outline, holes)
    found = []
    for low, turn in ((0.0, 0.0), (180.0, -360.0)):
        part = affinity.translate(whole.intersection(shapely.box(low, -90.0, low + 180.0, 90.0)), turn)
        for one in getattr(part, "geoms", [part]):
            found.append([np.array(ring.coords).tolist() for ring in (one.exterior, *one.interiors)])
    return found


@pytest.mark.parametrize("kept", [False, True])
@pytest.mark.parametrize("longitude", [180.0, -179.9999, 179.9998])
def test_an_area_split_at_180_degrees_is_one(tmp_path: Path, longitude: float, kept: bool) -> None:
    fiji = TangentPlane(-17.0, longitude, 0.0)

    def on_earth(ring: np.ndarray) -> np.ndarray:
        found = fiji.geodetic(np.column_stack([ring, np.zeros(len(ring))]))[:, 1::-1]
        found[:, 0] %= 360.0
        return found

    outline, hole = square(0.0, 62.0, 40.0), square(3.0, 62.0, 20.0)
    parts = split_at_180(on_earth(outline), [on_earth(hole)])
    assert len(parts) >= 2
    found = load_airspace(written(tmp_path, feature(parts, kind="MultiPolygon", inclusion=kept)), fiji, GRID)
    (area,) = found.areas
    wanted = shapely.Polygon(outline, [hole])
    rings = [shapely.Polygon(ring) for ring in area.rings]
    assert rings[0].difference(rings[1]).symmetric_difference(wanted).area < 0.01
    whole = Airspace(areas=(Area("a", (outline + 1e-3, hole - 1e-3), kept),)).closed(NOTHING, GRID)
    differ = whole != found.closed(NOTHING, GRID)
    assert differ.any(axis=2).sum() <= 0.02 * differ.shape[0] * differ.shape[1]


def test_parts_with_other_points_on_the_seam_are_one(tmp_path: Path) -> None:
    fiji = TangentPlane(0.0, 180.0, 0.0)
    west = [[179.9, -0.1], [180.0, -0.1], [180.0, 0.02], [180.0, 0.1], [179.9, 0.1], [179.9, -0.1]]
    east = [[-180.0, -0.05], [-179.9, -0.05], [-179.9, 0.1], [-180.0, 0.1], [-180.0, -0.05]]
    found = load_airspace(written(tmp_path, feature([[west], [east]], kind="MultiPolygon", inclusion=True)), fiji, GRID)
    assert len(found.areas) == 1
    assert (found.closed(NOTHING, GRID) == Closure.OPEN).all()


def test_an_edge_across_180_degrees_that_is_not_split_is_refused(tmp_path: Path) -> None:
    ring = [[179.9, -0.1], [-179.9, -0.1], [-179.9, 0.1], [179.9, 0.1], [179.9, -0.1]]
    with pytest.raises(ValueError, match=r"split there \(RFC 7946\).*from longitude 179.9 to -179.9"):
        load_airspace(written(tmp_path, feature([ring])), TangentPlane(0.0, 180.0, 0.0), GRID)


SPLIT = shapely.Polygon([(-9.0, 54.0), (3.0, 52.5), (11.0, 57.0), (12.0, 70.0), (1.0, 73.5), (-10.0, 68.0)])
HOLES = [shapely.box(-3.0, 58.0, 4.0, 62.0), shapely.box(5.0, 64.0, 8.0, 66.0)]


def cut_in_two(place: TangentPlane, shape: Any) -> list[Any]:
    """Coordinates of a MultiPolygon as RFC 7946 has them, cut at 180 degrees."""

    def moved(ring: Any) -> np.ndarray:
        metres = np.asarray(ring.coords)
        found = place.geodetic(np.column_stack([metres, np.zeros(len(metres))]))[:, 1::-1]
        found[:, 0] %= 360.0
        return found

    whole = shapely.Polygon(moved(shape.exterior), [moved(hole) for hole in shape.interiors])
    parts = []
    for side, box in ((0.0, shapely.box(170.0, -90.0, 180.0, 90.0)), (360.0, shapely.box(180.0, -90.0, 190.0, 90.0))):
        part = whole.intersection(box)
        for polygon in getattr(part, "geoms", [part]):
            rings = [polygon.exterior, *polygon.interiors]
            parts.append([[[x - side, y] for x, y in ring.coords] for ring in rings])
    return parts


@pytest.mark.parametrize("keep_in", [False, True])
@pytest.mark.parametrize("longitude", [179.99999, 180.0, -179.99995])
@pytest.mark.parametrize("kind", ["plane", "projected", "degrees"])
def test_an_area_that_is_cut_at_180_degrees_is_one(tmp_path: Path, keep_in: bool, longitude: float, kind: str) -> None:
    place = TangentPlane(-17.0, longitude, 0.0)
    shape = SPLIT.difference(shapely.union_all(HOLES))
    parts = cut_in_two(place, shape)
    assert len(parts) >= 2
    file = written(tmp_path, feature(parts, kind="MultiPolygon", inclusion=keep_in))
    earth, grid, moved = place, GRID, shape
    if kind == "degrees":
        earth = Degrees(longitude, -17.0)
    if kind == "projected":
        earth = Projected("EPSG:3832", VerticalZero(0.0))
        x, y, _ = earth.local(place.geodetic(np.zeros((1, 3))))[0].tolist()
        scale = 1.0457  # of Mercator at 17 degrees south
        grid = maxjax.Grid(GRID.shape, 2.0, (x - 13.0, y + 53.0, 3.0))
        moved = shapely.affinity.translate(shapely.affinity.scale(shape, scale, scale, origin=(0.0, 0.0)), x, y)
    found = load_airspace(file, earth, grid)
    assert len(found.areas) == 1
    closed = found.closed(np.zeros(grid.shape, bool), grid)[:, :, 3] == Closure.AREA
    x0, y0, _ = grid.lower
    for i, j in np.ndindex(*closed.shape):
        cell = shapely.box(x0 + 2 * i, y0 + 2 * j, x0 + 2 * i + 2, y0 + 2 * j + 2)
        if moved.boundary.intersects(cell.buffer(0.1)) and not moved.boundary.intersects(cell.buffer(-0.1)):
            continue  # a few centimetres decide
        assert closed[i, j] == (moved.intersects(cell) if not keep_in else not moved.contains(cell))


@pytest.mark.parametrize("longitude", [180.0, -179.9999, 179.9999])
def test_an_area_around_the_earth_has_no_edge_at_180_degrees(tmp_path: Path, longitude: float) -> None:
    fiji = TangentPlane(-17.0, longitude, 0.0)
    world = [[[-180.0, -90.0], [180.0, -90.0], [180.0, 90.0], [-180.0, 90.0], [-180.0, -90.0]]]
    for keep_in in (True, False):
        found = load_airspace(written(tmp_path, feature(world, inclusion=keep_in)), fiji, GRID)
        assert (found.closed(NOTHING, GRID) == (Closure.OPEN if keep_in else Closure.AREA)).all()


def test_an_area_around_the_earth_has_none_where_one_corner_alone_lies_across(tmp_path: Path) -> None:
    """Of a map in the north, whose north-western corner lies farther west than its south-western one."""
    grid = maxjax.Grid((20, 20, 4), 100.0, (-950.0, -950.0, 50.0))
    corner = np.array([[*grid.lower[:2], 0.0]])
    west = -180.0 + 5e-6 - float(TangentPlane(70.0, 0.0, 0.0).geodetic(corner)[0, 1])
    world = [[[-180.0, -90.0], [180.0, -90.0], [180.0, 90.0], [-180.0, 90.0], [-180.0, -90.0]]]
    found = load_airspace(written(tmp_path, feature(world, inclusion=True)), TangentPlane(70.0, west, 0.0), grid)
    assert (found.closed(np.zeros(grid.shape, bool), grid) == Closure.OPEN).all()


def test_coordinates_of_a_reference_system_are_taken_as_such(tmp_path: Path) -> None:
    delft, grid = maxjax.Projected("EPSG:28992"), maxjax.Grid((8, 8, 4), 2.0, (85000.0, 447000.0, 0.0))
    ring = square(85008.0, 447008.0, 4.0)
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::28992"}}
    file = written(tmp_path, feature([[*ring.tolist(), ring[0].tolist()]]), crs=crs)
    np.testing.assert_allclose(load_airspace(file, delft, grid).areas[0].rings[0], ring, atol=2e-3)


BOW = np.array([[-5.0, 55.0], [5.0, 65.0], [5.0, 55.0], [-5.0, 65.0]])
GOOD = degrees(square(0.0, 62.0, 5.0))
BAD = {
    "self-crossing": (feature([degrees(BOW)]), "does not cross itself"),
    "crossing hole": (feature([GOOD, degrees(square(5.0, 62.0, 3.0))]), "does not cross itself"),
    "hole outside": (feature([GOOD, degrees(square(20.0, 62.0, 3.0))]), "holes inside"),
    "not closed": (feature([GOOD[:-1]]), "end where they begin"),
    "two points": (feature([[GOOD[0], GOOD[1], GOOD[0]]]), "4 or more points"),
    "swapped": (feature([[[y, x] for x, y in GOOD]]), "swapped"),
    "off the Earth": (feature([[[x, y + 50.0] for x, y in GOOD]]), "swapped"),
    "outside": (feature([degrees(square(5e3, 62.0, 5.0))]), "expected an area in the map"),
    "metres": (feature([[[x * 1e4, y * 1e4] for x, y in GOOD]]), "in degrees"),
    "empty": (feature([]), "expected an outline"),
    "no ring": (feature([[]]), "4 or more points"),
    "a point": (feature([4.3, 52.0], kind="Point"), "expected a Polygon"),
    "no geometry": ({"type": "Feature", "properties": {}, "geometry": None}, "expected a Polygon"),
    "text": (feature([[["a", "b"], *GOOD[1:]]]), "malformed"),
    "no number": (feature([GOOD], lower="ground"), "expected lower as a height"),
    "endless": (feature([GOOD], upper=1e400), "no JSON number"),
    "huge": (feature([GOOD], upper=1e300), "expected upper as a height"),
    "reference": (feature([GOOD], upper=10, upperReference="STD"), "AGL or AMSL"),
    "unit": (feature([GOOD], upper=10, uom="km"), "uom m or ft"),
    "upside down": (feature([GOOD], lower=20, upper=10), "ceiling above its floor"),
    "inclusion": (feature([GOOD], inclusion="yes"), "inclusion true or false"),
    "no feature": ("school", "malformed"),
}


@pytest.mark.parametrize("name", BAD)
def test_files_that_cannot_be_used_get_one_sentence(tmp_path: Path, name: str) -> None:
    broken, sentence = BAD[name]
    with pytest.raises(ValueError, match=sentence) as caught:
        load_airspace(written(tmp_path, broken), PLACE, GRID)
    assert "areas.geojson" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_values_that_cannot_be_used_get_one_sentence() -> None:
    for given in ({"floor": math.nan}, {"ceiling": math.inf}, {"floor": 20.0, "ceiling": 20.0}):
        with pytest.raises(ValueError, match="expected"):
            Airspace(**given)
    for changes in ({"rings": ()}, {"rings": (np.zeros((2, 2)),)}, {"floor": 9.0, "ceiling": 8.0}):
        with pytest.raises(ValueError, match="expected"):
            Area(**{"name": "a", "rings": (square(0.0, 0.0, 1.0),)} | changes)  # type: ignore[arg-type]
