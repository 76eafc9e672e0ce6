"""How far a predicted log-potential is from the certified one, scene by scene.

    l2 = ‖ŷ − y‖ / ‖y‖        l2_normalised = ‖v̂ − v‖ / ‖v‖,   v = 1 − y / max y

over the goal's component, without the goal. y = −ℓ log φ grows with distance; v is the log-potential scaled to 1 at the
goal and 0 at the farthest voxel, the quantity of the paper as we read it. Angles are between the gradients of ŷ and y,
by the wall-aware differences that an ascent climbs by (`fields.gradient`).
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from maxjax.core.grid import Grid
from maxjax.fields.gradient import gradient
from maxjax.nn.architecture import Autoencoder
from maxjax.nn.autoencoder import Params, apply_folded
from maxjax.nn.dataset import Scenes, network_inputs
from maxjax.nn.encoding import UNIT, encode
from maxjax.nn.layers import Formulation


@functools.partial(jax.jit, static_argnames=("network", "grid", "by"))
def evaluate(
    params: Params, scenes: Scenes, network: Autoencoder, grid: Grid, by: Formulation = "direct"
) -> dict[str, Float[Array, " n"]]:
    """Errors of every scene: `l2`, `l2_normalised`, `angle_median`, `angle_95` [deg].

    Args:
        params: of `autoencoder.fold`, perhaps `cast`.
        scenes: a batch; taken one by one.
        network, grid, by: static, as in `autoencoder.apply_folded`.
    """

    def one(scene: Scenes) -> dict[str, Float[Array, ""]]:
        x, base = encode(network.start, network.flood, network_inputs(scene, grid))
        predicted = base + UNIT[network.start] * apply_folded(params, x[None], network, by=by)[0]
        return errors(predicted, scene)

    found: dict[str, Float[Array, " n"]] = lax.map(one, scenes)
    return found


def errors(predicted: Float[Array, "nx ny nz"], scene: Scenes) -> dict[str, Float[Array, ""]]:
    """Errors of one scene.

    Args:
        predicted: y [voxels].
        scene: the truth.
    """
    counts, true = scene.steps > 0, scene.target
    farthest = jnp.max(jnp.where(counts, true, 0))

    def norm(x: Array) -> Array:
        return jnp.sqrt(jnp.sum(jnp.where(counts, x, 0) ** 2))

    error = norm(predicted - true)
    ours, best = gradient(predicted, counts), gradient(true, counts)
    sizes = jnp.linalg.norm(ours, axis=-1) * jnp.linalg.norm(best, axis=-1)
    known = counts & (sizes > 1e-9)
    cosine = jnp.sum(ours * best, axis=-1) / jnp.where(known, sizes, 1)
    angle = jnp.where(known, jnp.degrees(jnp.arccos(jnp.clip(cosine, -1, 1))), jnp.nan)
    median, high = jnp.nanpercentile(angle, jnp.array([50.0, 95.0]))
    return {
        "l2": error / norm(true),
        "l2_normalised": error / norm(farthest - true),
        "angle_median": median,
        "angle_95": high,
    }


def summary(found: dict[str, Float[Array, " n"]]) -> dict[str, float]:
    """The mean over the scenes of each error."""
    return {name: float(np.mean(np.asarray(values))) for name, values in found.items()}
