"""Small scenes for the tests of data, training and models: random boxes, and a network that learns them in seconds."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32, PRNGKeyArray

from maxjax.core.grid import Grid
from maxjax.nn.architecture import Autoencoder

GRID = Grid((12, 12, 12), 2.0, (0.0, 0.0, 0.0))
MINI = Autoencoder(((4,), (6,)), ((6,), (4,)), (3, 3), start="free", flood=True, skips=True, patch=2, dropout=0.2)


@dataclasses.dataclass(frozen=True)
class Boxes:
    """Random boxes in a price that grows along x, with a goal that stands free."""

    grid: Grid = GRID
    sealed: bool = False

    def __call__(
        self, key: PRNGKeyArray
    ) -> tuple[Bool[Array, "nx ny nz"], Float[Array, "nx ny nz"], Int32[Array, " 3"]]:
        corners, sizes, goals = jax.random.split(key, 3)
        low = jax.random.randint(corners, (6, 3), 0, self.grid.shape[0])
        size = jax.random.randint(sizes, (6, 3), 1, 6)
        goal = jax.random.randint(goals, (3,), 0, self.grid.shape[0])
        voxels = jnp.stack(jnp.meshgrid(*map(jnp.arange, self.grid.shape), indexing="ij"), -1)[..., None, :]
        boxes = jnp.any(jnp.all((voxels >= low) & (voxels < low + size), axis=-1), axis=-1)
        near = jnp.all(jnp.abs(voxels[..., 0, :] - goal) <= 1, axis=-1)
        price = 1 + 2 * voxels[..., 0, 0].astype(jnp.float32) / self.grid.shape[0]
        return (boxes & ~near) | self.sealed, price, goal
