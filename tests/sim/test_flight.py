"""One flight around a building, against independent judges: C MuJoCo for contact, `verify` for every path flown."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from maxjax import VoxelMap
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.planning.problem.distances import Distances
from maxjax.sim.loop.flight import Flight, FlightConfig, World, watch
from maxjax.sim.loop.flight_state import LOG_PERIOD
from maxjax.sim.mapping import rolling_map as mapping
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.scenes import scene_xml
from maxjax.ui.methods import planner_named
from maxjax.verification.verifier import verify
from tests.scenes import wall_and_tower

LIDAR = Lidar(rays=4096, channels=64)  # as in test_faults.py: one program for both
CONFIG = FlightConfig(
    planner=planner_named("field"), shape=(45, 45, 17), lidar=LIDAR, plans=40, distances=Distances(1.0, 4.0)
)
START, GOAL = np.array([-24.0, 1.0, 6.0], np.float32), np.array([14.0, -2.0, 8.0], np.float32)
KEY = jax.random.key(5)


@pytest.fixture(scope="module")
def flights() -> list[Flight]:
    """The flight before its first iteration and after each."""
    world = World(wall_and_tower(), jnp.asarray(START), jnp.asarray(GOAL), KEY, Disturbances())
    return list(watch(world, CONFIG))


def track(flight: Flight) -> np.ndarray:
    position = np.asarray(flight.log.position, float)
    return position[np.isfinite(position[:, 0])]


def test_it_arrives(flights: list[Flight]) -> None:
    log = flights[-1].log
    assert Status(int(log.status)) == Status.OK
    assert np.linalg.norm(track(flights[-1])[-1] - GOAL) <= CONFIG.tolerance + 0.01
    assert log.planning_iterations == len(flights) - 1
    assert log.certified == log.planning_iterations - log.failed_plans
    # Around the wall, not far around.
    straight = np.linalg.norm(GOAL - START)
    assert straight < log.flown_length < 1.6 * straight


def test_an_iteration_keeps_the_types_of_its_state(flights: list[Flight]) -> None:
    """Else it would be compiled for the first one, and again for all others."""
    types = [[(x.shape, x.dtype, x.weak_type) for x in jax.tree.leaves(one)] for one in (flights[0], flights[-1])]
    assert types[0] == types[1]


def test_length_and_time_are_those_of_the_track(flights: list[Flight]) -> None:
    log, points = flights[-1].log, track(flights[-1])
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(float(log.flown_length), rel=0.01)
    assert len(points) - 1 == pytest.approx(float(log.duration) / LOG_PERIOD, abs=1)


def test_nothing_was_ever_near_to_the_judgement_of_mujoco(flights: list[Flight]) -> None:
    model = mujoco.MjModel.from_xml_string(
        scene_xml(wall_and_tower()).replace(
            "</worldbody>", '<body name="probe" mocap="true"><geom type="sphere" size="0.5"/></body></worldbody>'
        )
    )
    data = mujoco.MjData(model)
    gaps = []
    for point in track(flights[-1]):
        data.mocap_pos[0] = point
        mujoco.mj_kinematics(model, data)
        gaps.append(min(mujoco.mj_geomDistance(model, data, k, model.ngeom - 1, 1e3, None) for k in range(3)) + 0.5)
    assert min(gaps) > CONFIG.radius
    # The flight looks at every physics step, ten times as often as the track.
    assert min(gaps) - 0.3 < float(flights[-1].log.clearance) <= min(gaps) + 1e-3


def grid_of(flight: Flight) -> Grid:
    x, y, z = (float(v) for v in mapping.origin(flight.rolling_map))
    return Grid(CONFIG.shape, CONFIG.spacing, (x, y, z))


def test_every_path_flown_passes_the_judge_on_the_map_of_its_time(flights: list[Flight]) -> None:
    judged = 0
    for flight in flights[1:]:
        margin = float(flight.log.margin[flight.log.planning_iterations - 1])
        if np.isnan(margin):
            continue
        grid, path = grid_of(flight), np.asarray(flight.path)
        ground = np.asarray(mapping.ground(flight.rolling_map))
        ground, occupied = np.array(ground), np.asarray(mapping.occupied_voxels(flight.rolling_map)) | ground
        here = tuple(np.asarray(grid.index_of(jnp.asarray(path[0]))))
        occupied[here], ground[here] = False, False
        moved = np.concatenate([[True], np.any(np.diff(path, axis=0) != 0, axis=1)])
        # Steps aside are straight and keep the radius as well, where they begin outside of it.
        radius, ball = CONFIG.distances.radius, 3 * CONFIG.spacing
        found = verify(path[moved], VoxelMap.on(grid, occupied, ground), radius=radius, exemptions=(ball, ball))
        assert found.ok, (flight.log.planning_iterations, found)
        judged += 1
    assert judged >= 5


def test_it_can_stop_within_what_it_has_seen(flights: list[Flight]) -> None:
    for flight in flights[1:]:
        grid, reference = grid_of(flight), flight.reference
        known = np.asarray(mapping.seen(flight.rolling_map))
        here = np.asarray(grid.index_of(jnp.asarray(flight.path[0])))
        voxels = np.asarray(grid.index_of(jnp.asarray(reference.course.points)))
        inside = np.all((voxels >= 0) & (voxels < CONFIG.shape), axis=1)
        seen = inside & (known[tuple(np.where(inside[:, None], voxels, 0).T)] | np.all(voxels == here, axis=1))
        # A reference that is too fast to stop says so by its excess.
        moving = np.asarray(reference.speed) > 0.02  # what rounding leaves of 0
        assert np.all(seen[moving]) or reference.excess > 0
