"""Distances to keep: what is never undercut, and what a metre costs nearer to obstacles.

radius    nothing on a path is nearer to the cube of an obstacle
n(d)      what a metre costs at the distance d, 1 from the margin on; or n(x), given for each voxel
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32

from maxjax.core.grid import Grid
from maxjax.fields.price import Price

# n of distances [m]; pure, of arrays.
Law = Callable[[Float[Array, "*b"]], Float[Array, "*b"]]

# Distances at which a law is tried when it is given, from the wall to the margin.
_TRIED = 101


@jax.tree_util.register_static
@dataclasses.dataclass(frozen=True)
class Distances:
    """How far a path keeps from obstacles, true distances to their cubes; static under `jit`.

    Attributes:
        radius: nothing on the path is nearer than this [m], but near an end that itself stands nearer; at 0 the path
            may graze obstacles, and the ground, too.
        margin: from where on a metre costs no more than its length [m].
        price: what it costs below the margin: a `maxjax.Price`; a function of the distance [m], which is asked below
            the margin only; or an array of n ≥ 1 for each voxel of the map, which then has no law of distance.

    Raises:
        ValueError: if a distance is no finite number, negative, or the margin below the radius; if a price is none of
            these, or falls below 1.
    """

    radius: float = 1.0
    margin: float = 8.0
    price: Price | Law | PriceVolume | np.ndarray = Price()  # noqa: RUF009 (frozen)

    def __post_init__(self) -> None:
        for name in ("radius", "margin"):
            given = getattr(self, name)
            number = numbers_of(name, given)
            if number.shape != () or number.dtype.kind not in "iuf" or not 0 <= number < np.inf:
                raise ValueError(f"{name}: expected a finite number of metres, at least 0, given {given!r}")
            object.__setattr__(self, name, float(number))
        if self.margin < self.radius:
            raise ValueError(f"margin: expected at least the radius, {self.radius:g} m, given {self.margin:g}")
        if callable(self.price):
            _check_law(self.price, self.margin)
        elif not isinstance(self.price, Price | PriceVolume):
            volume = PriceVolume.of(self.price)
            object.__setattr__(self, "price", volume)

    @property
    def room(self) -> float:
        """Half the width of the box around each point of a path that meets free voxels only [voxels]."""
        return 0.5 if self.radius > 0 else 0.0

    @property
    def priced(self) -> bool:
        """Whether distance has a price at all."""
        return self.margin > 0 and not (isinstance(self.price, Price) and self.price.height == 0)

    def price_at(self, distance: Float[Array, "*b"]) -> Float[Array, "*b"]:
        """The price n by the law of distance [m]; exact distances below the margin are enough."""
        if isinstance(self.price, Price):
            return self.price.price_at(distance, self.margin)
        if not callable(self.price):
            return jnp.ones_like(distance)
        return jnp.where(distance < self.margin, jnp.maximum(self.price(distance), 1), 1).astype(distance.dtype)

    def within(self, grid: Grid) -> Distances:
        """The distances themselves.

        Raises:
            ValueError: if one is longer than the map, or the price is given for voxels of another map.
        """
        longest = grid.spacing * max(grid.shape)
        for name, given in (("radius", self.radius), ("margin", self.margin)):
            if given > longest:
                raise ValueError(f"{name}: expected at most {longest:g} m, the longest edge of the map, given {given}")
        if isinstance(self.price, PriceVolume):
            grid.check_volume("price", self.price.n)
        return self

    def split(self, grid: Grid) -> tuple[Distances, Float32[np.ndarray, "nx ny nz"] | None]:
        """Static part of a price, and the price of each voxel, which is data; None: there is none."""
        if not isinstance(self.price, PriceVolume):
            return self, None
        grid.check_volume("price", self.price.n)
        return dataclasses.replace(self, price=Price(height=0.0)), self.price.n


@dataclasses.dataclass(frozen=True, eq=False)
class PriceVolume:
    """Prices of the voxels of a map.

    Attributes:
        n: at least 1.
    """

    n: Float32[np.ndarray, "nx ny nz"]

    @classmethod
    def of(cls, given: Any) -> PriceVolume:
        """Prices of an array.

        Raises:
            ValueError: unless it holds finite numbers of at least 1, one for each voxel.
            TypeError: for a traced array, as under `jax.grad`.
        """
        if isinstance(given, jax.core.Tracer):
            raise TypeError(
                f"price: expected numbers, given a traced array {given.aval}: a plan has none by prices; differentiate "
                "-screening_length * maxjax.solve_potential(sigma, goal_index, price).log_phi at the start"
            )
        price = numbers_of("price", given)
        if price.ndim != 3 or price.dtype.kind not in "iuf":
            raise ValueError(
                "price: expected a maxjax.Price, a function of the distance, or numbers of the map's shape "
                f"(nx, ny, nz), given {type(given).__name__} {price.dtype} {price.shape}"
            )
        least, most = float(price.min(initial=1.0)), float(price.max(initial=1.0))
        if not (least >= 1 and np.isfinite(most)):
            raise ValueError(f"price: expected finite numbers of at least 1, given some from {least:g} to {most:g}")
        return cls(price.astype(np.float32))


def _check_law(law: Law, margin: float) -> None:
    """Try a law of distance; raises as `Distances`."""
    if len(inspect.signature(law).parameters) != 1:
        raise ValueError(f"price: expected a function of one array, the distance [m], given {law!r}")
    distances = jnp.linspace(0.0, margin, _TRIED)[:-1]
    found = np.asarray(law(distances))
    if found.shape != distances.shape or not np.isfinite(found).all() or (found < 1).any():
        raise ValueError(
            f"price: expected a function with finite values of at least 1 from the wall to {margin:g} m, "
            f"given one with {found.min() if found.size else found} at the least, of shape {found.shape}"
        )


def numbers_of(name: str, given: Any) -> np.ndarray:
    """Prices that a user gave as an array.

    Raises:
        ValueError: if it is none.
    """
    try:
        return np.asarray(given)
    except (ValueError, TypeError) as error:  # ragged lists; arrays that are traced
        reason = str(error).splitlines()[0]
        raise ValueError(f"{name}: expected an array, given {type(given).__name__}: {reason}") from error
