"""Travel times from the goal by fast marching, and the potential that they make.

    |∇T| = 1 in free voxels, T = 0 at the goal;    φ = exp(−T / scale)

The other fields without local minima. eikonalfm knows no obstacles: they get a speed of 10⁻⁶. It offers fast marching
plain and factored, no fast sweeping.
"""

from __future__ import annotations

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.common.harness import package
from benchmarks.common.screened_system import Mask

_IN_WALLS = 1e-6  # speed in obstacles, for a method that knows none


def marching(component: Mask, index: tuple[int, ...]) -> dict[str, Callable[[], np.ndarray] | None]:
    """Travel times from the goal at unit speed [voxels], by method; None where its package is not installed.

    Args:
        component: free voxels that are joined to the goal.
        index: voxel of the goal.
    """
    free = component.copy()
    free[index] = True
    ones = np.ones(free.shape)
    skfmm, eikonalfm = package("skfmm"), package("eikonalfm")

    def scikit() -> np.ndarray:
        front = np.ones(free.shape)
        front[index] = -1  # the front starts half a voxel around the goal
        assert skfmm is not None
        return np.ma.filled(skfmm.travel_time(np.ma.MaskedArray(front, ~free), ones, order=2), np.inf)

    speed = np.where(free, 1.0, _IN_WALLS)

    def plain() -> np.ndarray:
        assert eikonalfm is not None
        return np.asarray(eikonalfm.fast_marching(speed, index, (1.0, 1.0, 1.0), 2))

    def factored() -> np.ndarray:
        assert eikonalfm is not None
        dx = (1.0, 1.0, 1.0)
        tau = eikonalfm.factored_fast_marching(speed, index, dx, 2)
        return np.asarray(tau * eikonalfm.distance(free.shape, dx, index, indexing="ij"))

    return {
        "scikit-fmm, fast marching": scikit if skfmm else None,
        "eikonalfm, fast marching": plain if eikonalfm else None,
        "eikonalfm, factored fast marching": factored if eikonalfm else None,
    }


def as_potential(travel: np.ndarray, component: Mask, index: tuple[int, ...]) -> Float[Array, "nx ny nz"]:
    """Log φ = −T; 0 at the goal, −∞ outside its component."""
    log_phi = np.where(component & np.isfinite(travel), -travel, -np.inf)
    log_phi[index] = 0.0
    return jnp.asarray(log_phi, jnp.float32)
