"""One LiDAR scan from a place in a city, the sensor level."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from maxjax.compile.executable import stored
from maxjax.core.grid import Grid, Point3
from maxjax.sim.sensors.lidar import Lidar, Scan, scan
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.scenes import Scene, occupancy

LIDAR = Lidar()
_ATOM = 0.01  # [m]; a sensor whose surroundings of this size meet no solid is in the open


@dataclasses.dataclass(frozen=True)
class Returns:
    """Measurements of a sensor.

    Attributes:
        points: returns [m].
        missed: rays without a surface in range.
        dropped: rays whose return was lost.
    """

    points: Float[np.ndarray, "n 3"]
    missed: int
    dropped: int

    @property
    def counts(self) -> dict[str, int]:
        """Rays by outcome."""
        n = len(self.points)
        return {"rays": n + self.missed + self.dropped, "returns": n, "missed": self.missed, "dropped": self.dropped}


def measure(scene: Scene, position: Point3) -> Returns:
    """One scan from a position, level; its noise is that of the scene's seed.

    Raises:
        ValueError: for a position that is not finite, or inside a solid.
    """
    if not np.isfinite(position).all():
        raise ValueError(f"position: expected three finite coordinates [m], given {position}")
    if np.abs(position).max() > 1e6 or occupancy(scene.geoms, Grid((1, 1, 1), _ATOM, position))[0].any():
        raise ValueError(f"position: expected a place in the open above z = 0, given {position} inside an obstacle")
    found, surfaces = _scan(scene.geoms, jnp.asarray(position, jnp.float32), jax.random.key(scene.seed))
    hit = np.asarray(found.hit)
    missed = int((~np.asarray(surfaces)).sum())
    return Returns(np.asarray(found.points)[hit], missed, int((~hit).sum()) - missed)


@stored("scan")
def _scan(geoms: Geoms, position: Float[Array, "3"], key: PRNGKeyArray) -> tuple[Scan, Bool[Array, " r"]]:
    """The scan, and which rays meet a surface in range before any is dropped."""
    whole = dataclasses.replace(LIDAR, dropout=0.0)
    attitude = jnp.eye(3)
    # Equal in all but the dropout, so that the compiler casts the rays once.
    return scan(geoms, LIDAR, position, attitude, key), scan(geoms, whole, position, attitude, key).hit
