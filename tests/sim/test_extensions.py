"""Extensions of a flight: all hooks are called in order, parts are found by their class, and none costs nothing."""

from __future__ import annotations

import dataclasses
import inspect
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from maxjax.planning.path.route import Route
from maxjax.planning.problem.problem import Problem
from maxjax.sim.loop.flight import Extension, Flight, FlightConfig, World, iteration_of, take_off
from maxjax.sim.loop.flight_state import extensions_of
from maxjax.sim.loop.follow import step_alone
from maxjax.sim.loop.parts import part_of, with_part
from maxjax.sim.sensors.lidar import Lidar
from maxjax.sim.vehicle.disturbances import Disturbances
from maxjax.sim.worlds.geoms import ground_plane

HOOKS = {name for name, value in vars(Extension).items() if inspect.isfunction(value)}


@dataclasses.dataclass(frozen=True)
class Straight:
    """A planner by which the way is the straight line."""

    name: str = "straight"
    batched: bool = True
    needs_ground: bool = False

    def route(self, problem: Problem) -> Route:
        return Route(jnp.stack([problem.start, problem.goal]), problem.status, certified=jnp.array(False))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Count:
    """How often."""

    times: jax.Array


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Given:
    """A command as it was [N]."""

    command: jax.Array


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Heavy(Extension):
    """Remembers commands and adds thrust to them; counts time steps in the flight's part and looks in the log's."""

    extra: float

    @property
    def looks(self) -> bool:
        return True

    def take_off(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        none = Count(jnp.int32(0))
        flight = dataclasses.replace(flight, log=flight.log.with_part(none))
        return flight.with_part(none).with_part(Given(jnp.zeros(4)))

    def look(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        return dataclasses.replace(flight, log=flight.log.with_part(Count(flight.log.part(Count).times + 1)))

    def thrusts(
        self, world: World, flight: Flight, config: FlightConfig, command: jax.Array
    ) -> tuple[Flight, jax.Array]:
        flight = flight.with_part(Count(flight.part(Count).times + 1)).with_part(Given(command))
        return flight, command + self.extra


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Weak(Extension):
    """Motors give a share of their thrust, which the log remembers."""

    share: jax.Array

    def take_off(self, world: World, flight: Flight, config: FlightConfig) -> Flight:
        return dataclasses.replace(flight, log=flight.log.with_part(Given(jnp.zeros(4))))

    def thrusts(
        self, world: World, flight: Flight, config: FlightConfig, command: jax.Array
    ) -> tuple[Flight, jax.Array]:
        command = self.share * command
        return dataclasses.replace(flight, log=flight.log.with_part(Given(command))), command


CONFIG = FlightConfig(planner=Straight(), lidar=Lidar(channels=4, rays=64), shape=(15, 15, 9), plans=2)
WORLD = World(ground_plane(), jnp.array([0.0, 0.0, 9.0]), jnp.array([9.0, 0.0, 9.0]), jax.random.key(0), Disturbances())
SHARES, EXTRA, STEPS = jnp.array([0.25, 0.5]), 2.0, 3


def built(*extensions: Extension) -> FlightConfig:
    return dataclasses.replace(CONFIG, extensions=extensions)


def program(config: FlightConfig) -> str:
    """Take-off and an iteration as they are traced."""
    return str(jax.make_jaxpr(lambda world: iteration_of(config)(world, take_off(world, config)))(WORLD))


def test_all_hooks_are_called_and_one_that_changes_nothing_leaves_the_program_as_it_is() -> None:
    called: set[str] = set()

    class Told(Extension):
        def __getattribute__(self, name: str) -> Any:
            called.add(name)
            return super().__getattribute__(name)

    assert program(built(Told())) == program(CONFIG)
    assert called >= HOOKS - {"look"}  # that one below: a scan for it changes the program


@pytest.fixture(scope="module")
def flown() -> Flight:
    """Two flights of some time steps, whose motors give other shares."""
    config = built(Heavy(EXTRA))

    def fly(share: jax.Array) -> Flight:
        world = dataclasses.replace(WORLD, extensions=(Weak(share),))

        def step(flight: Flight, _: None) -> tuple[Flight, None]:
            return step_alone(world, flight, config, jnp.zeros(3)), None

        return jax.lax.scan(step, take_off(world, config), None, STEPS)[0]

    return jax.jit(jax.vmap(fly))(SHARES)


def test_values_pass_through_the_configurations_extensions_then_the_worlds(flown: Flight) -> None:
    """The other order would differ by (1 - share) times what is added."""
    expected = SHARES[:, None] * (flown.part(Given).command + EXTRA)
    np.testing.assert_allclose(flown.log.part(Given).command, expected, rtol=1e-6)
    assert (np.ptp(np.asarray(flown.vehicle.thrust), axis=0) > 0.0).all()


def test_parts_are_kept_from_step_to_step_and_found_by_their_class(flown: Flight) -> None:
    np.testing.assert_array_equal(flown.part(Count).times, STEPS)
    np.testing.assert_array_equal(flown.log.part(Count).times, 1)  # the look at take-off
    assert flown.has(Count)
    assert not flown.has(Weak)
    with pytest.raises(ValueError, match="expected a flight built with Weak, given one with Count, Given"):
        flown.part(Weak)
    with pytest.raises(ValueError, match="expected a flight built with Weak, given one with Heavy"):
        built(Heavy(0.0)).extension(Weak)


def test_a_part_takes_the_place_of_that_of_its_class() -> None:
    parts = with_part(with_part((), Count(jnp.int32(1))), Weak(jnp.float32(0.5)))
    again = with_part(parts, Count(jnp.int32(7)))
    assert [type(part) for part in again] == [Count, Weak]
    assert int(part_of(again, Count).times) == 7
    assert int(part_of(parts, Count).times) == 1


def test_an_extension_takes_the_place_of_that_of_its_class_and_two_are_refused() -> None:
    config = built(Heavy(1.0)).with_extension(Heavy(2.0))
    assert config.extensions == (Heavy(2.0),)
    with pytest.raises(ValueError, match="extensions: expected at most one of a class, given Heavy, Heavy"):
        extensions_of(dataclasses.replace(WORLD, extensions=(Heavy(3.0),)), config)
