"""Training scenes: what one scan from a place in a city leaves a planner to solve.

    key → city → sensor's position → scan → voxels → goal → (blocked, price, goal)

A scene is what one planning problem of a flight looks like to the planner: 32,768 rays from a place in the open, 3 to
15 m above the ground, the grid of 101³ voxels about it; below z = 0 everything is ground. The goal stands in the open
at the same heights. The price rises from 1 at the planner's margin to 1 + a on the wall, a drawn anew for each scene.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray

from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.occupancy import voxelize
from maxjax.fields.price import SCREENING_LENGTH, Price, lattice_price
from maxjax.planning.problem.distances import Distances
from maxjax.planning.problem.problem import formulate
from maxjax.sim.sensors.lidar import Lidar, scan
from maxjax.sim.worlds.geoms import Geoms, rotation_z
from maxjax.sim.worlds.layouts import layout
from maxjax.sim.worlds.raycast import cast_rays

TINY_GRID = Grid((33, 33, 33), 4.0, (-64.0, -64.0, -64.0))
"""Of scenes on which to see that training works."""

_LIDAR = Lidar()
_LOW, _HIGH = 3.0, 15.0  # [m] above ground
_DISTANCES = Distances(price=Price(height=1.0))
_REACH = 95.0  # [m], of poses and goals from the middle of the city, along x and y
_SKY = 400.0  # [m], above any roof
_APART = 3.0  # [m], to walls: further than the voxel that a place shares with one
# Places drawn for each; the first that will do is taken.
_POSES, _GOALS = 16, 32


Scene = tuple[Bool[Array, "nx ny nz"], Float[Array, "nx ny nz"], Int32[Array, " 3"]]


@dataclasses.dataclass(frozen=True)
class ScannedCity:
    """Scenes of a map: a pure function of a key to (blocked, price, goal_index).

    Attributes:
        name: of `sim.worlds.layouts.MAPS`.
        grid: shape and spacing; it is moved to the sensor, in whole voxels.
        heights: least and largest height a of the price (`fields.price`); (0, 0): no prices.
    """

    name: str
    grid: Grid
    heights: tuple[float, float] = (0.0, 0.0)

    def __call__(self, key: PRNGKeyArray) -> Scene:
        """The scene of a key."""
        return _draw(self.name, self.grid, self.heights, key)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _GoalCarry:
    """The problem of the goal tried last, and the goals that are left to try."""

    blocked: Bool[Array, "nx ny nz"]
    price: Float[Array, "nx ny nz"]
    goal_index: Int32[Array, " 3"]
    status: Int32[Array, ""]
    left: Bool[Array, " goals"]


def _draw(name: str, grid: Grid, heights: tuple[float, float], key: PRNGKeyArray) -> Scene:
    city, places, turn, noise = jax.random.split(key, 4)
    geoms = layout(name, city)
    u = jax.random.uniform(places, (_POSES + _GOALS, 3))
    low, high = jnp.array([-_REACH, -_REACH, _LOW]), jnp.array([_REACH, _REACH, _HIGH])
    points = low + (high - low) * u
    standing = _in_the_open(geoms, points)
    position = points[jnp.argmax(standing[:_POSES])]
    angle = jax.random.uniform(turn, (), maxval=2 * jnp.pi)
    returns = scan(geoms, _LIDAR, position, rotation_z(angle), noise)
    # The grid is static: the city is shifted by whole voxels until the sensor is in its middle.
    middle = jnp.asarray(grid.origin) + 0.5 * grid.spacing * (jnp.asarray(grid.shape) - 1)
    shift = middle - grid.spacing * jnp.round(position / grid.spacing)
    occupied = voxelize(returns.points + shift, grid).occupied
    bottom = grid.origin[2] + grid.spacing * (jnp.arange(grid.shape[2]) - 0.5) - shift[2]
    ground = jnp.broadcast_to(bottom < -1e-3, grid.shape)
    goals = points[_POSES:] + shift
    eligible = standing[_POSES:] & grid.contains(goals)

    def attempt(carry: _GoalCarry) -> _GoalCarry:
        chosen = jnp.argmax(carry.left)
        ends = grid.fractional_index(jnp.stack([position + shift, goals[chosen]]))
        problem = formulate(occupied | ground, ground, ends, _DISTANCES, grid)
        left = carry.left.at[chosen].set(False)
        assert problem.price is not None  # its height is not 0
        return _GoalCarry(problem.blocked, problem.price, problem.goal_index, problem.status, left)

    def unsolved(carry: _GoalCarry) -> Bool[Array, ""]:
        return (carry.status != Status.OK) & jnp.any(carry.left)

    volumes = jnp.ones(grid.shape, bool), jnp.ones(grid.shape, jnp.float32)
    nothing = *volumes, jnp.zeros(3, jnp.int32), jnp.int32(Status.NO_VALID_PATH)
    found = lax.while_loop(unsolved, attempt, _GoalCarry(*nothing, eligible))
    # Without a goal nothing is free: the solve will say so, and the scene is not used.
    blocked = found.blocked | (found.status != Status.OK)
    height = jax.random.uniform(jax.random.fold_in(key, 1), (), minval=heights[0], maxval=heights[1])
    price = lattice_price(1 + height * (found.price - 1), SCREENING_LENGTH)
    return blocked, price, found.goal_index


def _in_the_open(geoms: Geoms, points: Float[Array, "n 3"]) -> Bool[Array, " n"]:
    """Whether nothing but sky is above each point [m], a metre of air below it, and a voxel's width around it."""
    down = jnp.array([[0.0, 0.0, -1.0]])
    around = _APART * jnp.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])

    def roof(xy: Float[Array, " 2"]) -> Float[Array, ""]:
        return _SKY - cast_rays(geoms, jnp.append(xy, _SKY), down)[0]

    roofs = jax.vmap(roof)((points[:, None, :2] + around).reshape(-1, 2)).reshape(-1, len(around))
    return jnp.max(roofs, axis=1) < points[:, 2] - 1.0
