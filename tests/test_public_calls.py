"""What users call, as they call it: the map is a value, the planner is a value, batches are arrays."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import maxjax
from maxjax import Distances, Grid, Problem, Route, Status, VoxelMap
from maxjax.planning.run.field_planner import FieldPlanner
from maxjax.sim.loop import flight as flights
from maxjax.sim.loop.flight import Flight, FlightConfig, World
from maxjax.sim.sensors.lidar import Lidar
from tests.planners import unchecked
from tests.scenes import wall_and_tower

QUARTER = Path(__file__).parents[1] / "docs" / "samples" / "quarter.geojson"


def test_the_calls_that_the_design_names_run_as_written(tmp_path: Path) -> None:
    city = maxjax.load_map(QUARTER, ground=0.0)
    assert isinstance(city, VoxelMap)
    assert city.file.source == "quarter.geojson"
    assert city.earth is not None
    start, goal = (-75.0, 22.0, 5.0), (0.0, 60.0, 30.0)
    plan = maxjax.plan(city, start, goal)
    assert plan.status is Status.OK
    assert plan.map is not None
    again = maxjax.plan(
        city,
        start,
        goal,
        planner=maxjax.Field(),
        distances=maxjax.Distances(radius=1.0, margin=8.0),
        airspace=None,
    )
    np.testing.assert_array_equal(again.path, plan.path)
    names = ("status", "path", "length", "clearance", "cruise_clearance", "certified", "cost", "map", "timings")
    assert all(hasattr(plan, name) for name in names)
    starts, goals = np.array([start, goal, start]), np.array([goal, start, (-70.0, 30.0, 12.0)])
    plans = maxjax.plan_batch(city, starts, goals)
    assert plans.status.shape == plans.length.shape == (3,)
    assert plans[2].status == plans.status[2]
    fleet = maxjax.plan_to_goal(city, starts[[0, 2]], goal)
    assert len(fleet) == 2
    flight = maxjax.trajectory(plan, maxjax.FlightLimits())
    assert flight.plan is plan
    assert maxjax.verify(plan.path, plan.map, radius=1.0).ok
    for name in ("way.plan", "way.csv", "way.kml"):
        maxjax.export(tmp_path / name, flight)
        assert (tmp_path / name).stat().st_size > 100


def test_the_potential_is_solved_as_the_design_says() -> None:
    occupied = np.zeros((25, 21, 17), bool)
    city = VoxelMap.of(occupied, spacing=2.0, origin=(-100.0, -100.0, -100.0), ground=None)
    sigma = maxjax.conductivity(jnp.asarray(occupied), jnp.array([12, 10, 8]), city.grid)
    potential = maxjax.solve_potential(sigma, jnp.array([12, 10, 8]))
    assert bool(potential.certified)


TOWN = Grid((25, 21, 17), 2.0, (-24.0, -20.0, 0.0))


def town() -> VoxelMap:
    rng = np.random.default_rng(11)
    occupied, ground = np.zeros(TOWN.shape, bool), np.zeros(TOWN.shape, bool)
    ground[:, :, 0] = True
    for x, y in itertools.product((4, 11, 18), (4, 11)):
        occupied[x : x + 4, y : y + 4, : rng.integers(6, 14)] = True
    return VoxelMap.on(TOWN, occupied, ground)


def test_the_nearest_of_several_goals_is_the_one_that_costs_least() -> None:
    """A goal within a wall, and one in a block, are passed over; as is the nearest in a straight line behind houses."""
    city, start = town(), (-20.0, 0.0, 5.0)
    goals = np.array([(-14.0, 0.0, 5.0), (2.0, 0.0, 5.0), (22.0, 18.0, 5.0), (-20.0, 19.0, 5.0), (900.0, 0.0, 5.0)])
    each = [maxjax.plan(city, start, goal) for goal in goals]
    assert Status.OK in {plan.status for plan in each[1:]}
    assert each[4].status is Status.GOAL_OUTSIDE_MAP
    for some in (slice(None), slice(2, None), slice(2, 4)):
        found = maxjax.plan_to_nearest(city, start, goals[some])
        least = min((plan for plan in each[some] if plan.status is Status.OK), key=lambda plan: plan.cost)
        assert found.status is Status.OK
        np.testing.assert_array_equal(found.path, least.path)
    assert maxjax.plan_to_nearest(city, start, goals[4:]).status is Status.GOAL_OUTSIDE_MAP
    with pytest.raises(ValueError, match="goals"):
        maxjax.plan_to_nearest(city, start, np.zeros((0, 3)))


def test_routes_under_vmap_are_those_of_a_batch() -> None:
    """The same problems, in the whole map and with the same ascent; float32 positions."""
    where, rng = town(), np.random.default_rng(3)
    starts = rng.uniform((-22, -18, 6), (22, -14, 30), (6, 3)).astype(np.float32)
    goals = rng.uniform((-22, 14, 6), (22, 18, 30), (6, 3)).astype(np.float32)
    planner = maxjax.Field(focus=False)
    routes = jax.jit(jax.vmap(lambda s, g: maxjax.plan_route(where, s, g, planner)))(starts, goals)
    plans = maxjax.plan_batch(where, starts, goals, planner=planner)
    np.testing.assert_array_equal(np.asarray(routes.status), plans.status)
    assert plans.ok.all()
    np.testing.assert_array_equal(np.asarray(routes.certified), plans.certified)
    lengths = np.linalg.norm(np.diff(np.asarray(routes.path, np.float64), axis=1), axis=2).sum(axis=1)
    np.testing.assert_allclose(lengths, plans.length, rtol=1e-3)
    np.testing.assert_allclose(np.asarray(routes.cost), plans.cost, rtol=1e-3)
    np.testing.assert_allclose(np.asarray(routes.path)[:, [0, -1]], np.stack([starts, goals], axis=1), atol=1e-4)
    maps = VoxelMap.on(TOWN, np.stack([np.asarray(where.occupied)] * 2), where.ground)
    several = jax.vmap(lambda m, s, g: maxjax.plan_route(m, s, g, planner))(maps, starts[:2], goals[:2])
    np.testing.assert_allclose(np.asarray(several.cost), plans.cost[:2], rtol=1e-3)
    with pytest.raises(ValueError, match=r"map: expected one map, given a batch of 2; use jax\.vmap"):
        maxjax.plan_route(maps, starts[0], goals[0])


@dataclasses.dataclass(frozen=True)
class OverTheRoofs:
    """A stranger's planner: up, across, down, in whole voxels."""

    height: float
    name: str = "over the roofs"
    batched: bool = True

    def route(self, problem: Problem) -> Route:
        up, down = (end.at[2].set(self.height) for end in (problem.start, problem.goal))
        path = jnp.stack([problem.start, up, down, problem.goal])
        return Route(path, problem.status, certified=jnp.array(False))


@dataclasses.dataclass(frozen=True)
class OnTheHost(OverTheRoofs):
    """The same in NumPy."""

    batched: bool = False

    def route(self, problem: Problem) -> Route:
        route = super().route(problem)
        return Route(np.asarray(route.path), np.asarray(route.status), np.array(False))


@pytest.mark.parametrize("planner", [OverTheRoofs(15.0), OnTheHost(15.0)])
def test_a_strangers_planner_plans_alone_in_a_batch_and_as_a_route(planner: OverTheRoofs) -> None:
    where, start, goal = town(), np.array([-20.0, -18.0, 8.0]), np.array([20.0, 16.0, 8.0])
    plan = maxjax.plan(where, start, goal, planner=planner)
    assert (plan.status, plan.method, plan.certified) == (Status.OK, "over the roofs", False)
    assert plan.length == pytest.approx(2 * 22.0 + np.hypot(40.0, 34.0))
    low = maxjax.plan(where, start, goal, planner=dataclasses.replace(planner, height=6.0))
    assert low.status is Status.PATH_IN_COLLISION
    plans = maxjax.plan_batch(where, np.stack([start] * 3), np.stack([goal] * 3), planner=planner)
    np.testing.assert_allclose(plans.length, plan.length)
    route = jax.jit(lambda s, g: maxjax.plan_route(where, s, g, planner))(start, goal)
    np.testing.assert_allclose(np.asarray(route.path)[[0, -1]], [start, goal], atol=1e-4)


def test_a_strangers_batched_planner_goes_through_a_device_in_chunks() -> None:
    from maxjax.planning.problem.task import Task
    from maxjax.planning.run.execution import plan_task

    where, rng = town(), np.random.default_rng(5)
    starts, goals = (rng.uniform((-22, y, 6), (22, y + 3, 28), (5, 3)) for y in (-18, 14))
    task = Task.of(where, starts, goals)
    chunked, alone = plan_task(task, OverTheRoofs(15.0), chunk=2), plan_task(task, OverTheRoofs(15.0))
    np.testing.assert_array_equal(chunked.status, alone.status)
    np.testing.assert_allclose(chunked.length, alone.length)


# On the host planners are flown in sim/trials/test_execution.py, too.
@pytest.mark.parametrize("planner", [OverTheRoofs(20.0), pytest.param(OnTheHost(20.0), marks=pytest.mark.nightly)])
def test_a_strangers_planner_is_flown_and_a_strangers_stage_runs(planner: OverTheRoofs) -> None:
    def blinded(world: World, flight: Flight, config: FlightConfig) -> Flight:
        """A stranger's stage: it hides every other scan."""
        lost = flight.log.planning_iterations % 2 == 1
        points = jnp.where(lost, jnp.nan, flight.scan.points)
        return dataclasses.replace(flight, scan=dataclasses.replace(flight.scan, points=points))

    sense, fuse, *rest = flights.STAGES
    config = FlightConfig(
        planner=planner,
        shape=(45, 45, 25),
        lidar=Lidar(rays=1024, channels=32),
        plans=3,
        distances=Distances(1.0, 4.0),
        stages=(sense, blinded, fuse, *rest),
    )
    log = flights.fly_closed_loop(
        wall_and_tower(), jnp.array([-24.0, 1.0, 12.0]), jnp.array([14.0, -2.0, 12.0]), jax.random.key(0), config
    )
    assert int(log.planning_iterations) >= 1
    assert np.isfinite(float(log.flown_length))


@pytest.mark.large
def test_prices_are_a_law_a_function_or_a_number_for_each_voxel() -> None:
    """A dear half of the map is avoided; a function equals the law that it is."""
    where = VoxelMap.on(TOWN, np.zeros(TOWN.shape, bool))
    ends = np.array([-20.0, -18.0, 16.0]), np.array([20.0, -18.0, 16.0])
    price = np.ones(TOWN.shape)
    price[8:17, :12] = 5.0
    around = maxjax.plan(where, *ends, distances=Distances(price=price))
    straight = maxjax.plan(where, *ends)
    assert around.status is straight.status is Status.OK
    assert around.length > straight.length + 5
    assert around.cost < 40 + 4 * 18
    assert around.path[:, 1].max() > 2
    built = town()
    ends = np.array([-20.0, -18.0, 8.0]), np.array([20.0, 16.0, 8.0])
    law = maxjax.plan(built, *ends, distances=Distances(price=maxjax.Price("quadratic", 2.0)))
    same = maxjax.plan(built, *ends, distances=Distances(price=lambda d: 1 + 2.0 * (1 - d / 8.0) ** 2))
    assert same.cost == pytest.approx(law.cost, rel=1e-3)


def test_a_derivative_of_a_route_is_refused_with_what_has_one() -> None:
    city = VoxelMap.of(np.zeros((20, 20, 10), bool), spacing=2.0, origin=(0.0, 0.0, 0.0))
    start, goal = jnp.array([4.0, 4.0, 4.0]), jnp.array([30.0, 30.0, 10.0])
    with pytest.raises(TypeError, match=r"plan_route has no derivative.*solve_potential\(sigma, goal_index, price\)"):
        jax.grad(lambda start: maxjax.plan_route(city, start, goal).length)(start)
    with pytest.raises(TypeError, match=r"price: expected numbers, given a traced array .*solve_potential"):
        jax.grad(lambda n: maxjax.plan_route(city, start, goal, distances=Distances(1.0, 4.0, price=n)).length)(
            jnp.ones((20, 20, 10))
        )


def test_a_field_planner_is_a_value_with_its_solver() -> None:
    from maxjax.solvers.screened import Screened

    fine = maxjax.Field(solver=Screened(tolerance=1e-4))
    assert fine != maxjax.Field()
    assert fine == maxjax.Field(solver=Screened(tolerance=1e-4))
    assert isinstance(fine, FieldPlanner)
    with pytest.raises(ValueError, match=r"Field\.solver: expected a solver"):
        unchecked(maxjax.Field, solver="screened", potential=None)
    with pytest.raises(ValueError, match=r"Network\.max_sweeps"):
        maxjax.Network(max_sweeps=-1)
