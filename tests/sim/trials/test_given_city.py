"""Trials in a city of one's own: their ends keep the rules, by the solids and by hand, and depend on nothing else."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.baselines.astar_planner import AStar
from maxjax.core.files import FileError
from maxjax.core.rng_streams import named_key
from maxjax.core.status import Status
from maxjax.io import Window
from maxjax.io.load import load_map
from maxjax.sim.loop.flight import FlightConfig, World, take_off
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.trials.batches import draw_trials, fly_trials, site_of
from maxjax.sim.trials.campaign import Campaign
from maxjax.sim.trials.cities import TrialSite
from maxjax.sim.trials.given_city import GivenCity, digest_of
from maxjax.sim.trials.trial_movers import movers_of
from maxjax.sim.worlds.geoms import BOX, SPHERE, Geoms
from maxjax.sim.worlds.movers import straight
from maxjax.sim.worlds.populations import Population, place_movers, population
from maxjax.sim.worlds.solid_distance import distance, horizontal_distance

SMALL = FlightConfig(planner=AStar(), shape=(51, 51, 17), spacing=4.0, lidar=Lidar(rays=2048, channels=32), plans=5)
_take_off = jax.jit(lambda world: take_off(world, SMALL))
# South-west and north-east corners of houses, and their heights [m], from the first corner on.
HOUSES = ((0, 0, 12, 10, 9.0), (70, 4, 84, 20, 22.0), (30, 60, 52, 70, 15.0), (96, 80, 110, 96, 31.0))


def quarter(folder: Path, houses: Any = HOUSES, name: str = "quarter.geojson") -> Path:
    """Houses as GeoJSON, in degrees: a metre is about 9e-6 of latitude there, and 1.46e-5 of longitude."""
    features = []
    for west, south, east, north, height in houses:
        ring = [(west, south), (east, south), (east, north), (west, north), (west, south)]
        degrees = [[4.3 + 1.46e-5 * x, 52.07 + 9.0e-6 * y] for x, y in ring]
        shape = {"type": "Polygon", "coordinates": [degrees]}
        features.append({"type": "Feature", "properties": {"building": "yes", "height": height}, "geometry": shape})
    (folder / name).write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return folder / name


def of_voxels(file: Path, occupied: Any, ground: Any, ends: Any = None) -> GivenCity:
    """The city of voxels of 2 m whose ground is known, which files of voxels do not tell."""
    np.savez(file, occupied=occupied | ground, spacing=2.0, origin=np.array([501.0, 1.0, 1.0]))
    loaded = dataclasses.replace(load_map(file), ground=ground & ~occupied)
    return GivenCity.of(loaded, file.name, digest_of(file), ends)


def slope(folder: Path, ends: Any = None) -> GivenCity:
    """A plain 12 m up beside one at sea level, with a tower on each."""
    ground, occupied = np.zeros((90, 60, 24), bool), np.zeros((90, 60, 24), bool)
    ground[:, :, :2] = True
    ground[45:, :, 2:8] = True
    occupied[20:26, 28:34, 2:14] = occupied[66:72, 28:34, 8:18] = True
    return of_voxels(folder / "slope.npz", occupied, ground, ends)


@pytest.fixture(scope="module")
def city(tmp_path_factory: pytest.TempPathFactory) -> GivenCity:
    return GivenCity.load(quarter(tmp_path_factory.mktemp("city")))


def test_ends_keep_the_rules_by_the_exact_distances_of_the_solids(city: GivenCity) -> None:
    drawn = city.draw(7, range(60))
    start, goal = (np.asarray(end, np.float64) for end in (drawn.start, drawn.goal))
    assert np.asarray(drawn.valid).all()
    assert not np.asarray(drawn.excluded).any()
    assert not np.asarray(drawn.city).any()
    apart = np.linalg.norm(goal - start, axis=1)
    assert 50.0 <= apart.min() < 56.0
    assert 74.0 < apart.max() <= 80.0
    ends = np.concatenate([start, goal])
    assert 3.0 <= ends[:, 2].min() < 4.0
    assert 14.0 < ends[:, 2].max() <= 15.0
    assert (64.0 * ends[:, :2] % 1.0 == 0.0).all()
    measures = [jax.jit(jax.vmap(measure, (None, 0))) for measure in (horizontal_distance, distance)]
    for a, b in zip(start, goal, strict=True):
        geoms = city.solids(a, b)
        assert set(geoms.type[1:]) == {BOX}
        both = jnp.asarray([a, b], jnp.float32)
        clear, around = (np.asarray(measure(geoms, both)) for measure in measures)
        assert ((clear >= 10.0 - 1e-4) & (clear <= 40.0 + 2.0 * np.sqrt(2.0))).all()
        assert around.min() >= 3.0
    assert len(np.unique(start, axis=0)) == 60


def test_a_trial_depends_on_file_seed_and_index_alone(city: GivenCity, tmp_path: Path) -> None:
    company = city.draw(0, range(9))
    picked = city.draw(0, [7, 2])
    for field in dataclasses.fields(company):
        np.testing.assert_array_equal(getattr(picked, field.name), np.asarray(getattr(company, field.name))[[7, 2]])
    moved = GivenCity.load(shutil.copy(quarter(tmp_path), tmp_path / "moved.geojson"))
    np.testing.assert_array_equal(moved.draw(0, [2]).start, picked.start[1:])
    assert moved.identity == city.identity
    assert moved.name != city.name
    other = GivenCity.load(quarter(tmp_path, [*HOUSES[:3], (96, 80, 110, 96, 33.0)]))
    assert other.identity["file"] != city.identity["file"]
    assert other.identity["voxels"] != city.identity["voxels"]
    for trial in (other.draw(0, [2]), city.draw(1, [2])):
        assert (np.asarray(trial.start) != np.asarray(picked.start[1:])).any()
    for seed, indices in ((-1, [0]), (0, [-1]), (2**31, [0]), (0, [])):
        with pytest.raises(ValueError, match="expected"):
            city.draw(seed, indices)


def test_ends_stand_above_the_ground_beneath_them(tmp_path: Path) -> None:
    city = slope(tmp_path)
    assert city.world.origin == (590.0, 60.0, 4.0)
    drawn = city.draw(3, range(60))
    assert np.asarray(drawn.valid).all()
    found = set()
    for end in (*np.asarray(drawn.start, np.float64), *np.asarray(drawn.goal, np.float64)):
        ground = 12.0 if end[0] >= 0.0 else 0.0
        assert ground + 3.0 <= end[2] <= ground + 15.0
        assert city.world.ground_at(end) == ground
        found.add(ground)
    assert found == {0.0, 12.0}


def test_ways_through_a_wall_from_edge_to_edge_are_rejected_and_counted(tmp_path: Path) -> None:
    """Over a wall there is a way; through one up to the top of the map there is none."""
    occupied, ground = np.zeros((70, 110, 14), bool), np.zeros((70, 110, 14), bool)
    ground[:, :, 0] = True
    for top, name in ((9, "open"), (14, "closed")):
        occupied[34, :, 1:top] = True
        city = of_voxels(tmp_path / f"{name}.npz", occupied, ground)
        drawn = city.draw(0, range(40))
        assert np.asarray(drawn.valid).all()
        east = [np.asarray(end)[:, 0] > 0.0 for end in (drawn.start, drawn.goal)]
        assert (east[0] != east[1]).any() == (name == "open")
        if name == "open":
            assert not np.asarray(drawn.excluded).any()
        else:  # the eastern side is the larger one
            assert east[0].all()
            assert np.asarray(drawn.excluded).sum() > 10


def test_movers_keep_their_heights_above_the_ground_of_the_way(tmp_path: Path) -> None:
    city = slope(tmp_path, ((640.0, 20.0, 24.0), (640.0, 100.0, 24.0)))
    drawn = city.draw(0, [0])
    start, goal = (np.asarray(end[0]) for end in (drawn.start, drawn.goal))
    np.testing.assert_array_equal(start, [50.0, -40.0, 20.0])
    how, key = Population(3, 4.0, "drones"), jax.random.key(5)
    place = TrialSite(city, 0, start, goal)
    movers, geoms = place.movers(how, key), place.solids
    there = np.asarray(place_movers(movers))
    assert there.sum() > 1
    heights = np.asarray(movers.knots)[there, 0, 2]
    assert heights.min() >= 12.0 + 3.0
    assert heights.max() <= 12.0 + 40.0
    # The same as in the lowered world, and free of the solids of this one.
    down = jnp.array([0.0, 0.0, 12.0])
    low = population(
        dataclasses.replace(geoms, position=geoms.position - down), start - down, goal - down, key, how=how
    )
    np.testing.assert_allclose(np.asarray(movers.knots)[there, 0], np.asarray(low.knots)[there, 0] + down, rtol=1e-6)


def test_solids_are_all_within_sight_of_the_ends(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    houses = [(x, y, x + 10, y + 12, 12.0) for x, y in rng.uniform(0, 900, (120, 2)).round()]
    city = GivenCity.load(quarter(tmp_path, houses))
    drawn = city.draw(0, range(5))
    for start, goal in zip(np.asarray(drawn.start), np.asarray(drawn.goal), strict=True):
        near, every = city.solids(start, goal), city.world.solids(start, goal, city.slots)
        assert np.asarray(near.position).shape == (city.slots + 1, 3) == np.asarray(every.position).shape
        boxes = city.world.boxes
        for share in np.linspace(0.0, 1.0, 5):
            place = start + share * (goal - start)
            gap = np.maximum(np.abs(boxes[:, :2] - place[:2]) - boxes[:, 2:4], 0.0)
            needed = boxes[np.linalg.norm(gap, axis=1) < 100.0]
            held = np.asarray(near.position)[1:, :2]
            assert all((np.abs(held - row[:2]).max(axis=1) < 1e-3).any() for row in needed)


# --- Campaigns. ---


def campaign(city: GivenCity, count: int = 2, **changes: Any) -> Campaign:
    return Campaign(city, 0, range(count), **{"config": SMALL, **changes})


def test_a_folder_of_another_file_is_refused(city: GivenCity, tmp_path: Path) -> None:
    told = campaign(city).configuration()
    assert told["map"] == "quarter.geojson"
    assert told["city"] == city.identity
    assert json.loads(json.dumps(told)) == told
    campaign(city).ledger(tmp_path / "out")
    campaign(city).ledger(tmp_path / "out")
    quarter(tmp_path, [*HOUSES[:3], (96, 80, 110, 96, 31.5)])
    for other in (
        GivenCity.load(tmp_path / "quarter.geojson"),
        GivenCity.load(quarter(tmp_path), Window(spacing=1.0)),
        GivenCity.load(quarter(tmp_path), ends=((-20.0, 0.0, 8.0), (40.0, 0.0, 8.0))),
    ):
        with pytest.raises(ValueError, match="holds another campaign: city was"):
            campaign(other).ledger(tmp_path / "out")
    with pytest.raises(ValueError, match="holds another campaign: map was"):
        Campaign("suburb", 0, range(2), config=SMALL).ledger(tmp_path / "out")


def test_keys_of_flights_and_movers_are_those_of_the_content(city: GivenCity) -> None:
    stream = city.identity["file"][:16]
    expected = named_key(jax.random.key(0), f"flights {stream}")
    assert (jax.random.key_data(campaign(city).key) == jax.random.key_data(expected)).all()


@pytest.mark.large
def test_flights_are_flown_between_the_drawn_ends_and_resumed(city: GivenCity, tmp_path: Path) -> None:
    whole = campaign(city, 2, movers=Population(4, 4.0, "encounters"))
    outcomes = [one for some in fly_trials(whole, batch=1, folder=tmp_path) for one in some]
    drawn = draw_trials(whole)
    lines = whole.ledger(tmp_path).positions()
    for row, outcome in enumerate(outcomes):
        assert outcome.planning_iterations > 0
        assert outcome.flagged is not None
        np.testing.assert_array_equal(np.float32(outcome.start), drawn["start"][row])
        np.testing.assert_allclose(lines[row][0], outcome.start, atol=1e-6)
        geoms = site_of(whole, drawn, row).solids
        walls = jax.vmap(distance, (None, 0))(geoms, jnp.asarray(lines[row]))
        assert outcome.clearance <= float(walls.min()) + 2e-3  # type: ignore[operator]
        movers = movers_of(whole.configuration(), outcome, city)
        assert movers is not None
        assert outcome.hidden_movers == 4 - int(place_movers(movers).sum())
    again = [one for some in fly_trials(whole, batch=1, folder=tmp_path) for one in some]
    assert again == outcomes


def test_a_mover_that_rests_on_the_start_is_told_before_take_off(city: GivenCity) -> None:
    drawn = city.draw(0, [0])
    start, goal = drawn.start[0], drawn.goal[0]
    solids = Geoms(jnp.zeros((1, 3)), jnp.eye(3)[None], jnp.array([[0.4, 0.0, 0.0]]), (SPHERE,))
    geoms, still = TrialSite(city, 0, np.asarray(start), np.asarray(goal)).solids, jnp.zeros((1, 3))
    for aside, status in ((0.0, Status.START_OCCUPIED), (0.85, Status.START_OCCUPIED), (2.0, Status.OK)):
        movers = straight(solids, start[None] + jnp.array([aside, 0.0, 0.0]), still)
        world = World(geoms, start, goal, jax.random.key(0), SMALL.disturbances, movers)
        assert int(_take_off(world).log.status) == status


def test_an_end_inside_a_building_is_a_status(tmp_path: Path) -> None:
    """In metres from the middle of all houses, the first one is 12 by 10 m, around (-49, -43)."""
    inside, outside = (-49.0, -43.0, 4.0), (-20.0, -20.0, 6.0)
    for ends, status in (
        ((inside, outside), Status.START_OCCUPIED),
        ((outside, inside), Status.GOAL_OCCUPIED),
        (((-20.0, -20.0, -0.5), outside), Status.START_OCCUPIED),
        ((outside, (20.0, -20.0, 6.0)), Status.OK),
    ):
        city = GivenCity.load(quarter(tmp_path), ends=ends)
        drawn = city.draw(0, [0])
        geoms = city.solids(np.asarray(drawn.start[0]), np.asarray(drawn.goal[0]))
        world = World(geoms, drawn.start[0], drawn.goal[0], jax.random.key(0), SMALL.disturbances, None)
        assert int(_take_off(world).log.status) == status


# --- What cannot be flown in. ---


@pytest.mark.parametrize(
    ("ends", "sentence"),
    [
        (((-2000.0, 0.0, 5.0), (0.0, 30.0, 5.0)), r"start: expected a place in the map, between \[.*given \[-2000"),
        (((0.0, 30.0, 5.0), (0.0, 30.0, 290.0)), "goal: expected a place in the map"),
        (((float("nan"), 30.0, 5.0), (0.0, 30.0, 9.0)), "start: expected a place in the map"),
        (((0.0, 30.0, 5.0), (0.0, 1e9, 9.0)), "expected"),
    ],
)
def test_ends_outside_of_the_map_are_refused(ends: Any, sentence: str, tmp_path: Path) -> None:
    window = Window(bounds=(-60.0, -60.0, -2.0, 60.0, 60.0, 40.0))
    with pytest.raises(ValueError, match=sentence):
        GivenCity.load(quarter(tmp_path), window, ends=ends)


def test_ends_beyond_what_the_file_covers_are_told(tmp_path: Path) -> None:
    window = Window(bounds=(-90.0, -90.0, -2.0, 90.0, 90.0, 40.0))
    for ends, said in (
        (((0.0, 30.0, 5.0), (0.0, 30.0, 9.0)), ""),
        (((-90.0, 90.0, 5.0), (90.0, -90.0, 9.0)), "start and goal: beyond what the file covers"),
        (((0.0, 0.0, 5.0), (90.0, -85.0, 9.0)), "goal: beyond what the file covers"),
    ):
        city = GivenCity.load(quarter(tmp_path), window, ends=ends)
        assert "".join(city.beyond).startswith(said)
        assert bool(city.beyond) == bool(said)


def test_a_file_without_buildings_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    with pytest.raises(FileError, match=r"empty\.geojson"):
        GivenCity.load(tmp_path / "empty.geojson")


def test_a_map_without_room_for_ends_says_what_to_give(tmp_path: Path) -> None:
    occupied = np.zeros((40, 40, 10), bool)
    occupied[:, :, 0] = True
    occupied[::4, ::4, :6] = True
    np.savez(tmp_path / "pillars.npz", occupied=occupied, spacing=2.0, origin=np.ones(3))
    with pytest.raises(
        ValueError, match=r"pillars\.npz: expected places 10 to 40 m from what stands there.*--ground Z"
    ):
        GivenCity.load(tmp_path / "pillars.npz")
    given = GivenCity.load(tmp_path / "pillars.npz", ends=((5.0, 5.0, 8.0), (61.0, 5.0, 8.0)))
    assert "it tells no ground: flat ground is taken at its lowest voxel, z = 0 m" in given.remarks[-1]


def test_a_plain_of_ground_alone_is_flown_over(tmp_path: Path) -> None:
    ground = np.zeros((60, 60, 6), bool)
    ground[:, :, 0] = True
    city = of_voxels(tmp_path / "plain.npz", np.zeros_like(ground), ground)
    assert np.asarray(city.draw(0, range(5)).valid).all()
    assert len(city.world.boxes) == 0


def test_a_map_of_too_many_voxels_says_which_options_make_it_smaller(tmp_path: Path) -> None:
    file = quarter(tmp_path, [*HOUSES, (9000, 9000, 9010, 9010, 12.0)])
    with pytest.raises(ValueError, match=r"give --bounds, or a --spacing of"):
        GivenCity.load(file)
    assert np.asarray(GivenCity.load(file, Window(bounds=(-4600, -4550, 0, -4400, -4400, 50))).draw(0, [0]).valid).all()


def test_a_folder_of_meshes_is_told_by_all_its_files(tmp_path: Path) -> None:
    (tmp_path / "tiles" / "east").mkdir(parents=True)
    for name, text in (("a.obj", "v 0 0 0"), ("east/b.obj", "v 1 1 1")):
        (tmp_path / "tiles" / name).write_text(text)
    first = digest_of(tmp_path / "tiles")
    assert first == digest_of(tmp_path / "tiles")
    os.rename(tmp_path / "tiles" / "a.obj", tmp_path / "tiles" / "c.obj")
    renamed = digest_of(tmp_path / "tiles")
    (tmp_path / "tiles" / "east" / "b.obj").write_text("v 1 1 2")
    assert len({first, renamed, digest_of(tmp_path / "tiles")}) == 3
