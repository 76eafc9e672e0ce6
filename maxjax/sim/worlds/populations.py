"""Populations: movers of a city by key, around the way of a vehicle.

    drones   spheres and boxes of 0.3 to 0.6 m, 3 to 40 m high, 2 m from walls
    birds    capsules 0.3 m thick, 0.6 to 1.4 times the asked speed, but 3 to 15 m/s; as drones
    cars     4.5 x 1.8 x 1.5 m, to and fro on a straight way at the ground, 0.5 m from walls
    cranes   jibs of 12 to 20 m that turn about one of their ends, 1 m from walls; their masts are left out

Their curves have their middles within 40 m of the box around both ends of the vehicle's way. *Encounters* are straight:
they pass the vehicle's nominal way, flown straight at 5 m/s, at a time uniform along it in a distance of 0 to 2 m at
closest approach. Within 15 m of that point they are free of walls and ground; what they pass through further away is
not looked at.

A mover takes the first of 256 ways (`sim.worlds.mover_ways`) that is free; later ones are smaller, and slower. Nobody
is within 5 m of the start or the goal in the first two seconds. Movers may pass through one another. Those without a
way are hidden far below the ground, so that equal count and kind are one program under `vmap`.

Frame: world, ENU, metres.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from maxjax.compile.executable import stored
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.mover_ways import DRAWS, TYPES, Draw, Drawn, Place
from maxjax.sim.worlds.movers import Movers
from maxjax.sim.worlds.solid_distance import distance

KINDS = ("drones", "birds", "cars", "cranes")
_ALONE = 5.0  # from both ends of the vehicle's way, in the first _SECONDS [m]
_SECONDS = 2.0
_HIDDEN = (0.0, 0.0, -1000.0)
_WAYS = 256  # drawn for a mover


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Population:
    """A population of movers; static.

    Attributes:
        count: of movers.
        speed: greatest [m/s]; of birds the mean one, of cranes that of their tips.
        kind: drones, birds, cars, cranes, mixed (as many of each), or encounters.

    Raises:
        ValueError: for another kind, no movers or more than 256, or a speed that is not above 0 and at most 15 m/s.
    """

    count: int = 10
    speed: float = 5.0
    kind: str = "drones"

    def __post_init__(self) -> None:
        kinds = (*KINDS, "mixed", "encounters")
        if self.kind not in kinds:
            raise ValueError(f"kind of movers: expected one of {', '.join(kinds)}, given {self.kind!r}")
        if not 1 <= self.count <= 256:
            raise ValueError(f"movers: expected 1 to 256, given {self.count}")
        if not 0.0 < self.speed <= 15.0:
            raise ValueError(f"speed of movers: expected above 0 and at most 15 m/s, given {self.speed:g}")

    @property
    def fastest(self) -> float:
        """Speed that none of them exceeds [m/s]."""
        flies = self.kind in ("birds", "mixed")
        return min(max(1.4 * self.speed, 3.0), 15.0) if flies else self.speed

    @property
    def body(self) -> tuple[float, float, float]:
        """Edges along x, y and z of a box around any of them, however it is turned [m]; of a jib, around a part."""
        return (5.0, 5.0, 1.6) if self.kind in ("cars", "mixed") else (1.0, 1.0, 1.0)

    @property
    def turn(self) -> float:
        """How fast any of them turns about itself at most [rad/s].

        What faces its way turns the faster the slower it is: half a turn between two looks is allowed for.
        """
        return 10.0 * math.pi if not {"birds", "cranes"}.isdisjoint(self.counts) else 0.0

    @property
    def counts(self) -> dict[str, int]:
        """How many of each kind, in the order of the movers."""
        if self.kind != "mixed":
            return {self.kind: self.count}
        shares = {kind: len(range(place, self.count, len(KINDS))) for place, kind in enumerate(KINDS)}
        return {kind: share for kind, share in shares.items() if share}


@stored("movers", static=("how",))
def population(
    geoms: Geoms, start: Float[Array, "3"], goal: Float[Array, "3"], key: PRNGKeyArray, *, how: Population
) -> Movers:
    """The movers of a city; pure, for `jit` and `vmap` over all but `how`.

    Args:
        geoms: of the city.
        start, goal: of the vehicle's way [m].
        key: of all their random numbers.
        how: how many, how fast, of which kind.

    Returns:
        As many movers as asked for; `place_movers` tells which of them have a way.
    """
    place = Place(geoms, start, goal)
    keys = jax.vmap(functools.partial(jax.random.fold_in, key))(jnp.arange(how.count))
    rows, kinds, used = [], [], 0
    for kind, count in how.counts.items():
        draw = functools.partial(_first, DRAWS[kind], kind in ("drones", "birds", "encounters"), place, how)
        numbers = jnp.arange(count)
        rows.append(lax.map(lambda given, draw=draw: draw(*given), (keys[used : used + count], numbers)))
        kinds += [TYPES[kind][number % len(TYPES[kind])] for number in range(count)]
        used += count
    tested = [dataclasses.replace(row, points=row.points[:, :0]) for row in rows]
    one: Drawn = jax.tree.map(lambda *x: jnp.concatenate(x), *tested)
    faces = np.array([kind in ("birds", "cranes") for kind, count in how.counts.items() for _ in range(count)])
    return _movers(one, tuple(kinds), faces)


def place_movers(movers: Movers) -> Bool[Array, "*batch m"]:
    """Which movers of a population are in the city; the others are hidden below it."""
    return movers.knots[..., 0, 2] > 0.5 * _HIDDEN[2]


def _movers(drawn: Drawn, kinds: tuple[int, ...], faces: Bool[np.ndarray, " m"]) -> Movers:
    """As closed forms: P sin α + Q cos α = √(P² + Q²) sin(α + atan2(Q, P)), axis by axis."""
    count = len(kinds)
    none = jnp.zeros((count, 2))
    turn = drawn.phase[:, :1] + jnp.arctan2(drawn.cosine, drawn.sine)
    twice = jnp.broadcast_to((2.0 * drawn.phase[:, 0] + drawn.phase[:, 1])[:, None], (count, 3))
    solids = Geoms(jnp.zeros((count, 3)), drawn.rotation, drawn.size, kinds)
    return Movers(
        solids=solids,
        knots=drawn.knot[:, None],
        velocity=drawn.velocity[:, None],
        step=jnp.ones(count),
        loops=jnp.zeros(count, bool),
        amplitude=jnp.stack(
            [jnp.hypot(drawn.sine, drawn.cosine), jnp.concatenate([none, drawn.lift[:, None]], 1)], axis=1
        ),
        frequency=jnp.stack([drawn.rate, 2.0 * drawn.rate], axis=1),
        phase=jnp.stack([turn, twice], axis=1),
        faces=jnp.asarray(faces),
    )


def _first(draw: Draw, floor: bool, place: Place, how: Population, key: PRNGKeyArray, number: Array) -> Drawn:
    """The first of many that is free, or one that is hidden; `floor`: whether the ground counts as a wall."""
    walls = place.geoms if floor else place.walls
    u = jax.random.uniform(key, (_WAYS, 12))
    late = jnp.arange(_WAYS) / _WAYS
    drawn = jax.vmap(lambda u, late: draw(u, late, place, how.speed, number))(u, late)
    fits = jax.vmap(functools.partial(_fits, place, walls, how.fastest))(drawn)
    chosen: Drawn = jax.tree.map(lambda x: x[jnp.argmax(fits)], drawn)
    there = jnp.any(fits)
    still = {name: jnp.where(there, getattr(chosen, name), 0.0) for name in ("velocity", "sine", "cosine", "lift")}
    return dataclasses.replace(chosen, knot=jnp.where(there, chosen.knot, jnp.asarray(_HIDDEN)), **still)


def _fits(place: Place, walls: Geoms, fastest: float, drawn: Drawn) -> Bool[Array, ""]:
    clear = jax.vmap(functools.partial(distance, walls))(drawn.points) if walls.type else jnp.full(1, jnp.inf)
    times = jnp.linspace(0.0, _SECONDS, 17)
    early = jax.vmap(drawn.at)(times)
    ends = jnp.stack([place.start, place.goal])
    apart = jnp.linalg.norm(early[:, None] - ends, axis=-1) - drawn.reach
    slack = 0.5 * fastest * times[1]  # no mover goes further between a sample and the nearest time
    return jnp.all(clear >= drawn.need) & jnp.all(apart >= _ALONE + slack)
