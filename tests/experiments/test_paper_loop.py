"""The paper's loop: its dilation and smoothing before SciPy's, each choice of a reading, and a tiny run."""

from __future__ import annotations

import dataclasses
import itertools
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy import ndimage

from experiments.paper_loop import stage
from experiments.paper_loop.reading import BEFORE, READINGS, Reading
from experiments.paper_loop.repulsion import Repulsion
from experiments.paper_loop.sources import solved_in_float64
from experiments.paper_loop.stage import Loop, Sought, dilated, period_of, smoothed_gradients
from experiments.paper_loop.study import FEW, TINY, Config, Whole, best_reading, flight_of, layers, main, row_of
from experiments.paper_loop.tables import section
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.conductivity import conductivity
from maxjax.planners import Field
from maxjax.sim.loop.flight import FlightConfig, World, take_off
from maxjax.sim.sensors.lidar import Scan
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.trajectories.limits import FlightLimits
from maxjax.trajectories.online import Setpoint, setpoint_at
from tests.scenes import house, outcome

SHAPE = (24, 20, 16)
LADDER = (4, 3, 2, 1, 0)


def city(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Occupied voxels and those of them that are ground."""
    rng = np.random.default_rng(seed)
    ground = np.zeros(SHAPE, bool)
    ground[:, :, 0] = True
    return ground | (rng.random(SHAPE) < 0.01 * (1 + seed)), ground


@pytest.mark.parametrize("seed", range(6))
def test_the_largest_dilation_that_joins_the_ends_is_taken(seed: int) -> None:
    occupied, ground = city(seed)
    ends = np.array([[2, 3, 6], [21, 16, 9]], np.int32)
    found, joined = dilated(jnp.asarray(occupied), jnp.asarray(ground), jnp.asarray(ends))
    apart = ndimage.distance_transform_edt(~(occupied & ~ground))
    low = ndimage.distance_transform_edt(~ground)
    for reach in LADDER:
        closed = occupied | (apart <= reach) | (low <= min(reach, 1))
        closed[tuple(ends.T)] = False
        labels, _ = ndimage.label(~closed)
        if labels[tuple(ends[0])] == labels[tuple(ends[1])]:
            break
    np.testing.assert_array_equal(np.asarray(found), closed)
    assert bool(joined) == (labels[tuple(ends[0])] == labels[tuple(ends[1])])


def test_ends_in_separate_chambers_are_not_joined() -> None:
    occupied = np.zeros(SHAPE, bool)
    occupied[12] = True
    ends = jnp.array([[2, 3, 6], [21, 16, 9]], jnp.int32)
    _, joined = dilated(jnp.asarray(occupied), jnp.zeros(SHAPE, bool), ends)
    assert not joined


def test_gradients_are_smoothed_as_scipy_does() -> None:
    rng = np.random.default_rng(3)
    free = rng.random(SHAPE) < 0.9
    u = rng.normal(size=SHAPE).astype(np.float32)
    log_phi = jnp.asarray(np.where(free, u, -np.inf))
    raw = np.asarray(stage.gradient(log_phi, jnp.asarray(free)))
    expected = ndimage.gaussian_filter(raw, (5, 5, 5, 0), mode="nearest")
    found = smoothed_gradients(log_phi, jnp.asarray(free), Reading())
    np.testing.assert_allclose(np.asarray(found), expected, atol=2e-5)


def test_walls_of_least_value_repel() -> None:
    """A flat field beside a wall: the gradient points away from it by one reading, and nowhere by the others."""
    free = np.ones(SHAPE, bool)
    free[10] = False
    u = np.zeros(SHAPE, np.float32)
    u[0] = -1.0  # the least value
    log_phi, beside = jnp.where(free, u, -jnp.inf), np.s_[12:16, 5:15, 5:11, 0]
    repels = np.asarray(smoothed_gradients(log_phi, jnp.asarray(free), Reading(walls="least")))
    assert (repels[beside] > 0).all()
    flat = np.asarray(smoothed_gradients(log_phi, jnp.asarray(free), Reading(sees_walls=True)))
    np.testing.assert_allclose(flat[beside], 0, atol=1e-6)


def test_gradients_of_the_logarithm_are_as_large_far_from_the_goal_as_near_it() -> None:
    """φ that falls by e a voxel: its own gradient falls with it, that of its logarithm does not."""
    log_phi = -jnp.broadcast_to(jnp.arange(24.0)[:, None, None], SHAPE)
    free = jnp.ones(SHAPE, bool)
    of_log, of_phi = (
        np.asarray(smoothed_gradients(log_phi, free, Reading(climbs=climbs, sees_walls=True)))[6:18, 10, 8, 0]
        for climbs in ("log φ", "φ")
    )
    np.testing.assert_allclose(of_log, of_log[0], rtol=0.3)
    assert (of_phi < 0).all()
    assert of_phi[0] / of_phi[-1] > 20  # over 11 voxels, after a smoothing by 5


def test_a_field_in_double_precision_solves_the_same_equation() -> None:
    """Each voxel holds the mean of its neighbours, weighted by the faces between: no leak."""
    free = np.ones(SHAPE, bool)
    free[10, :15] = False
    goal = jnp.array([20, 5, 8], jnp.int32)
    with jax.enable_x64(True):
        sigma = conductivity(jnp.asarray(~free), goal, Grid(SHAPE, 1.0, (0.0, 0.0, 0.0)))
        found = solved_in_float64(sigma, goal, None)
        phi, sigma = np.asarray(found.phi), np.asarray(sigma, np.float64)
    assert phi.dtype == np.float64
    inflow, leaves = np.zeros(SHAPE), np.zeros(SHAPE)
    outside = np.pad(phi, 1), np.pad(sigma, 1, mode="edge")
    for axis, step in itertools.product(range(3), (0, 2)):
        beside = tuple(slice(step, step + n) if a == axis else slice(1, 1 + n) for a, n in enumerate(SHAPE))
        other, near = (one[beside] for one in outside)
        face = 2 * sigma * near / np.maximum(sigma + near, 1e-300)
        inflow, leaves = inflow + face * other, leaves + face
    inner = free.copy()
    inner[tuple(goal)] = False
    for axis in range(3):  # how a face to the ground outside conducts is the solver's own
        inner[(slice(None),) * axis + ([0, -1],)] = False
    np.testing.assert_allclose((inflow / np.where(leaves > 0, leaves, 1))[inner], phi[inner], rtol=1e-9)


def test_double_precision_is_refused_where_it_would_be_single() -> None:
    with pytest.warns(UserWarning, match="float64"), pytest.raises(ValueError, match="JAX_EXPLICIT_X64_DTYPES"):
        solved_in_float64(jnp.ones(SHAPE), jnp.array([1, 1, 1]), None)


CONFIG = FlightConfig(planner=Field(), shape=(41, 21, 21))
START, GOAL, PLATE = 4.0, 36.0, 20


@pytest.fixture
def straight(monkeypatch: pytest.MonkeyPatch) -> list[tuple[np.ndarray, Array | None]]:
    """A field that falls with the distance to the goal, whatever is in the way; open voxels and prices as asked."""
    asked: list[tuple[np.ndarray, Array | None]] = []

    def potential(sigma: Array, goal_index: Array, price: Array | None) -> SimpleNamespace:
        if not isinstance(sigma, jax.core.Tracer):
            asked.append((np.asarray(sigma > 0), price))
        indices = jnp.stack(jnp.meshgrid(*map(jnp.arange, sigma.shape), indexing="ij"), axis=-1)
        distance = jnp.linalg.norm((indices - goal_index).astype(jnp.float32), axis=-1)
        return SimpleNamespace(log_phi=jnp.where(sigma > 0, -distance, -jnp.inf), certified=jnp.array(False))

    monkeypatch.setattr(stage, "potential_from", lambda _: potential)
    return asked


def path_of(loop: Loop, width: int = 19) -> np.ndarray:
    """The path along x towards a plate of this width, in index coordinates."""
    occupied = np.zeros(CONFIG.shape, bool)
    occupied[PLATE, :width] = True
    ends = jnp.array([[START, 8, 10], [GOAL, 8, 10]], jnp.float32)
    no = jnp.array(False)
    nothing = Sought(no, jnp.broadcast_to(ends[0], (stage._STEPS + 3, 3)), no, no)
    given = jnp.asarray(occupied), jnp.zeros(CONFIG.shape, bool), ends
    return np.asarray(loop.seek(CONFIG, given, nothing).path)


@pytest.mark.usefixtures("straight")
def test_a_path_ends_where_its_reading_says() -> None:
    """Before the dilated plate, within its dilation but before itself, or beyond it."""
    before, within, beyond = (
        path_of(Loop(Reading(ends=ends, straight=3.0)))[-1, 0] for ends in ("dilated", "occupied", "nowhere")
    )
    assert START + 3 < before < PLATE - 1.5  # of the dilations the largest that joins the ends: one voxel, by the hole
    assert PLATE - 1.5 <= within < PLATE - 0.5
    assert beyond == GOAL


@pytest.mark.usefixtures("straight")
@pytest.mark.parametrize("metres", [3.0, 10.0])
def test_the_last_metres_are_one_edge(metres: float) -> None:
    path = path_of(Loop(Reading(ends="nowhere", straight=metres)))
    longest = CONFIG.spacing * np.abs(np.diff(path, axis=0)).max()
    assert metres - CONFIG.spacing < longest <= metres


@pytest.mark.usefixtures("straight")
def test_string_pulling_leaves_the_corners_of_a_path_alone() -> None:
    loop = Loop(Reading(), guarded=True)
    slack, taut = (path_of(one, width=0) for one in (loop, dataclasses.replace(loop, taut=True)))
    np.testing.assert_array_equal(slack[[0, -1]], taut[[0, -1]])
    assert slack[-1, 0] == GOAL
    (length, points), (shorter, corners) = (
        (np.linalg.norm(np.diff(path, axis=0), axis=1).sum(), len(np.unique(path, axis=0))) for path in (slack, taut)
    )
    assert shorter <= length
    assert corners < points / 10


def test_prices_take_the_place_of_the_dilation(straight: list[tuple[np.ndarray, Array | None]]) -> None:
    loop = Loop(Reading(), guarded=True)
    for one in (loop, dataclasses.replace(loop, priced=True)):
        path_of(one, width=4)
    (narrow, none), (wide, price) = straight
    assert none is None
    assert price is not None
    assert narrow.sum() < wide.sum()
    beside = np.asarray(price)[PLATE - 4 : PLATE, 1, 10]
    assert (np.diff(beside) > 0).all()  # dearer towards the plate
    np.testing.assert_array_equal(np.asarray(price)[2:10, 1, 10], 1)


@pytest.mark.parametrize("segment", [1.0, 3.5, 20.0])
def test_a_segment_is_flown_to_its_end_in_its_period(segment: float) -> None:
    limits = FlightLimits(speed=5.0, acceleration=3.0, deviation=0.3)
    config = dataclasses.replace(CONFIG, limits=limits, period=period_of(segment, limits))
    resting: Any = SimpleNamespace(vehicle=SimpleNamespace(velocity=jnp.zeros(3)))
    path = jnp.array([[0.0, 0, 0], [50, 0, 0]])
    reference = Loop(Reading(segment=segment)).refer(resting, path, jnp.array(True), config)
    end = setpoint_at(reference, jnp.float32(config.period))
    np.testing.assert_allclose(end.position[0], segment, atol=config.sampling.spacing)
    np.testing.assert_allclose(end.velocity, 0, atol=1e-5)
    assert config.period < 1.2 * float(reference.duration) + 0.4


def pushed(layer: Repulsion, ahead: float) -> tuple[np.ndarray, np.ndarray]:
    """By how much a set-point in flight along x is moved [m] and accelerated [m/s²], a return straight ahead [m]."""
    hit = jnp.array([[ahead, 0.0, 0.0]])
    flight: Any = SimpleNamespace(
        scan=Scan(hit, jnp.array([ahead]), jnp.array([True])),
        vehicle=SimpleNamespace(position=jnp.zeros(3)),
        log=SimpleNamespace(duration=jnp.float32(0)),
    )
    world: Any = SimpleNamespace(disturbances=Disturbances(), key=jax.random.key(0), extensions=())
    zero = jnp.zeros(3)
    moved = layer.setpoint(world, flight, CONFIG, Setpoint(zero, jnp.array([2.0, 0, 0]), zero, jnp.float32(0)))
    return np.asarray(moved.position), np.asarray(moved.acceleration)


def test_a_layer_that_only_repels_pushes_back_along_the_course() -> None:
    for layer, moves, brakes in (("across", False, False), ("repulsive", False, True), ("drift", True, False)):
        position, acceleration = pushed(Repulsion(layer), 2.0)  # type: ignore[arg-type]
        assert (position[0] < -0.5, acceleration[0] < -0.3) == (moves, brakes), layer


def test_a_layer_reaches_as_far_as_its_reading_says() -> None:
    for reach in (3.0, 6.0):
        assert pushed(Repulsion("repulsive", reach), 0.9 * reach)[1][0] < 0
        np.testing.assert_array_equal(pushed(Repulsion("repulsive", reach), 1.1 * reach)[1], 0)
        assert -reach <= pushed(Repulsion("drift", reach), 0.5)[0][0] < -0.5 * reach


@pytest.mark.usefixtures("straight")
@pytest.mark.parametrize("patience", [None, 3])
def test_a_flight_is_given_up_after_its_patience_alone(patience: int | None) -> None:
    """At rest before a wall all around the goal: every plan leads nowhere."""
    loop = Loop(Reading(ends="dilated", patience=patience))
    world = World(house(), jnp.array([0.0, 0, 5]), jnp.array([30.0, 0, 5]), jax.random.key(0), Disturbances())
    config = dataclasses.replace(CONFIG, plans=6, stages=(loop,))
    flight = take_off(world, config)
    cells = flight.rolling_map.cells.at[22:26].set(2)  # before the start, without a gap
    flight = dataclasses.replace(flight, rolling_map=dataclasses.replace(flight.rolling_map, cells=cells))
    done = []
    for _ in range(config.plans):
        flight = loop(world, dataclasses.replace(flight, done=jnp.array(False)), config)
        done.append(bool(flight.done))
    assert done == [patience is not None and k + 1 >= patience for k in range(config.plans)]
    assert (int(flight.log.status) == Status.PATH_STALLED) == (patience is not None)


def test_a_reading_names_what_it_changes() -> None:
    assert len({*map(str, READINGS.values())}) == len(READINGS)
    assert str(Reading()) == "paper"
    assert str(BEFORE) in READINGS
    changes = {"climbs": "φ", "walls": "least", "sees_walls": True, "ends": "nowhere", "straight": 4.0, "segment": 3.5}
    changes |= {"reactive": "drift", "reach": 6.0, "plans": 50, "patience": 10}
    assert {f.name for f in dataclasses.fields(Reading)} == {"field", *changes}
    for name, value in changes.items():
        assert str(dataclasses.replace(Reading(), **{name: value})) != "paper", name  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [{"field": "sail"}, {"segment": 0.0}, {"patience": 0}])
def test_what_is_no_reading_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Reading(**wrong)


def test_layers_differ_by_one_thing_each() -> None:
    def choices(loop: Loop) -> dict[str, Any]:
        return {**dataclasses.asdict(loop), **dataclasses.asdict(loop.reading), "reading": None}

    chain = [choices(loop) for loop in layers(Reading()).values() if isinstance(loop, Loop)]
    for before, after in itertools.pairwise(chain):
        assert sum(before[name] != after[name] for name in before) == 1, (before, after)


def test_the_best_reading_arrives_most_often_by_the_papers_network() -> None:
    arrived = {"paper": (3, 40), "paper; gradients of φ": (20, 21), "exact": (50, 50)}
    rows = [
        {"map": place, "loop": name, "arrived": count, "trials": 50}
        for name, counts in arrived.items()
        for place, count in zip(("downtown", "suburb"), counts, strict=True)
    ]
    assert best_reading(rows) == Reading()


@pytest.mark.parametrize("name", ["paper_readings", "paper_loop"])
def test_the_section_holds_every_loop_and_its_interval(name: str) -> None:
    loops = layers(Reading()) if name == "paper_loop" else READINGS
    rows = []
    for loop in loops:
        for trials in (2, 60):
            statuses = ["OK" if trial % 2 else "PATH_STALLED" for trial in range(trials)]
            row = row_of("suburb", loop, [outcome(trial, status) for trial, status in enumerate(statuses)])
            rows.append({**row, "device": "1 x NVIDIA H100"})
    first, every = section({"name": name, "rows": rows}).split("#### Loops of which more were flown")
    assert "(NVIDIA H100)" in first
    for loop in loops:
        assert f"| {loop} | 1 of 2 | 1.3 to 98.7 % |" in first  # 1 - 0.025^(1/2) above, by hand
        assert f"| {loop} | 30 of 60 |" in every
    assert "PATH_STALLED: 30" in every
    assert "50 of 50" in first
    assert FEW == 50


@pytest.mark.nightly
def test_a_tiny_run_flies_and_reports_what_was_kept(tmp_path: Path) -> None:
    kept = dataclasses.replace(TINY, keep=tmp_path / "kept", out=tmp_path)
    (row,) = main(kept)
    found: Any = row
    assert (found["trials"], found["contacts"], found["statuses"]) == (1, 0, "OUT_OF_PLANS: 1")
    main(dataclasses.replace(kept, loops=()))  # flies nothing: what was flown so far
    document = json.loads((tmp_path / "paper_readings.json").read_text())
    assert document["rows"] == [row]
    assert f"| {TINY.loops[0]} |" in section(document)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [({"loops": ("sail",)}, r"loops: expected parts of .*given sail"), ({"shard": (2, 2)}, "shard: expected k of n")],
)
def test_what_cannot_be_flown_is_refused(wrong: dict[str, Any], told: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=told):
        main(Config(out=tmp_path, **wrong))


def test_every_loop_of_a_shard_is_flown_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    flown: list[Path] = []
    monkeypatch.setattr("experiments.paper_loop.study._fly", lambda _, __, folder: flown.append(folder))
    monkeypatch.setattr("experiments.paper_loop.study.flight_of", lambda *_: CONFIG)
    for k in range(3):
        main(Config(loops=("drifts",), trials=1200, shard=(k, 3), keep=tmp_path / "kept", out=tmp_path))
    assert len(flown) == len(set(flown)) == 2 * 3 * sum("drifts" in name for name in READINGS)


def test_a_loop_takes_the_place_of_the_planning_stage() -> None:
    for name, loop in layers(Reading(field="exact")).items():
        if not isinstance(loop, Whole):
            stages = flight_of(loop).stages
            assert stages is not None
            assert [one for one in stages if isinstance(one, Loop)] == [loop], name
