"""The same cities as MJX models: one scene, or a batch of them under `vmap`, and MJX's own ray casting.

    model, data = mjx_scene(scene)
    model, data = place(model, data, layout(scene.name, key))    # another city of that map; vmap over keys

A module of its own, because importing MJX takes a second.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from maxjax.sim.worlds.geoms import Geoms, quaternion
from maxjax.sim.worlds.mjx_import import import_mjx
from maxjax.sim.worlds.scenes import Scene

if TYPE_CHECKING:
    from mujoco import mjx
else:
    mjx = import_mjx()


def mjx_scene(scene: Scene) -> tuple[mjx.Model, mjx.Data]:
    """The scene on the device: MJX model and data for `mjx.ray`."""
    model = mjx.put_model(scene.model)
    # mjx.kinematics raises an error for a model without degrees of freedom; the frames of static geoms are known.
    return place(model, mjx.make_data(model), scene.geoms)


def place(model: mjx.Model, data: mjx.Data, geoms: Geoms) -> tuple[mjx.Model, mjx.Data]:
    """Model and data with another layout of the same map; under `vmap`, a batch of scenes.

    Raises:
        ValueError: if the geom types differ from the model's, which are static.
    """
    types = tuple(int(t) for t in model.geom_type)
    if types != geoms.type:
        raise ValueError(f"geoms.type: expected the model's {len(types)} types, given {len(geoms.type)} that differ")
    model = model.tree_replace(
        {"geom_size": geoms.size, "geom_pos": geoms.position, "geom_quat": quaternion(geoms.rotation)}
    )
    return model, data.tree_replace({"geom_xpos": geoms.position, "geom_xmat": geoms.rotation})


def cast_rays_mjx(
    model: mjx.Model, data: mjx.Data, origin: Float[Array, "3"], directions: Float[Array, "r 3"]
) -> Float[Array, " r"]:
    """`raycast.cast_rays` by `mjx.ray` under `vmap`, on any MJX model; memory is O(rays x geoms)."""
    distance, _ = jax.vmap(mjx.ray, (None, None, None, 0))(model, data, origin, directions)
    return jnp.where(distance < 0.0, jnp.inf, distance)
