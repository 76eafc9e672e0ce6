"""Scenes: a procedural city as a MuJoCo model, for C MuJoCo and MJX alike.

    scene = make_scene("downtown", seed=3)        # the same city for the same seed on every machine
    city = scene.voxels(grid)                     # its true map

All geoms are static (fixed to the world, no contacts): the model serves ray casting and distances; it has no
degrees of freedom and cannot be stepped. A batch of scenes is one MJX model whose geom arrays carry a leading
axis (`place`).
"""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import jax
import numpy as np
from jaxtyping import Array, UInt32

from maxjax.compile.executable import stored
from maxjax.core.grid import Grid
from maxjax.core.rng_streams import named_key
from maxjax.core.voxel_map import VoxelMap
from maxjax.sim.worlds.geoms import BOX, CAPSULE, ELLIPSOID, PLANE, SPHERE, Geoms, quaternion
from maxjax.sim.worlds.layouts import MAPS, layout
from maxjax.sim.worlds.rasterize import occupancy

if TYPE_CHECKING:
    import mujoco

__all__ = ["MAPS", "Scene", "layout", "make_scene", "occupancy", "scene_xml"]

_TYPE_NAMES = {PLANE: "plane", SPHERE: "sphere", CAPSULE: "capsule", ELLIPSOID: "ellipsoid", BOX: "box"}


@dataclasses.dataclass(frozen=True)
class Scene:
    """One city.

    Attributes:
        name: its map, one of `MAPS`.
        seed: its seed.
        geoms: its solids.
    """

    name: str
    seed: int
    geoms: Geoms

    @functools.cached_property
    def model(self) -> mujoco.MjModel:
        """The same solids, in the same order, as a compiled MuJoCo model."""
        import mujoco  # plans and flights do without

        return mujoco.MjModel.from_xml_string(scene_xml(self.geoms))

    def voxels(self, grid: Grid) -> VoxelMap:
        """The true map of the city on a grid, its ground below z = 0."""
        solid, ground = occupancy(self.geoms, grid)
        return VoxelMap.on(grid, solid | ground, ground)


def scene_xml(geoms: Geoms) -> str:
    """MJCF of one scene, geoms in order.

    Raises:
        ValueError: for batched geoms.
    """
    if geoms.position.ndim != 2:
        raise ValueError(f"geoms.position: expected shape (g, 3), given {geoms.position.shape}; index the batch first")
    root = ElementTree.Element("mujoco", model="city")
    # mjx.ray reads the materials' colours and fails without any.
    ElementTree.SubElement(ElementTree.SubElement(root, "asset"), "material", name="concrete", rgba="0.7 0.7 0.7 1")
    world = ElementTree.SubElement(root, "worldbody")
    positions, rotations, sizes = (
        np.asarray(a, np.float64) for a in (geoms.position, quaternion(geoms.rotation), geoms.size)
    )
    for geom_type, position, rotation, size in zip(geoms.type, positions, rotations, sizes, strict=True):
        ElementTree.SubElement(
            world,
            "geom",
            type=_TYPE_NAMES[geom_type],
            pos=_numbers(position),
            quat=_numbers(rotation),
            size=_numbers(size),
            material="concrete",
            contype="0",
            conaffinity="0",
        )
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def make_scene(name: str, seed: int) -> Scene:
    """The city of a map and a seed.

    Args:
        name: one of `MAPS`.
        seed: 0 to 2^32 - 1; the name of the map is folded into the key, so that maps share no random numbers.

    Raises:
        ValueError: for an unknown name, with the list of maps, or a seed out of range.
    """
    if name not in MAPS:
        raise ValueError(f"map: expected one of {', '.join(MAPS)}, given {name!r}")
    if not 0 <= seed < 2**32:
        raise ValueError(f"seed: expected 0 to {2**32 - 1}, given {seed}")
    return Scene(name, seed, _built(np.uint32(seed), name=name))


@stored("city", static=("name",))
def _built(seed: UInt32[Array, ""] | np.uint32, name: str) -> Geoms:
    return layout(name, named_key(jax.random.key(seed), name))
