"""Three procedural cities: pure functions of a key, with a fixed number and order of geoms a map.

    layout(name, key) -> Geoms

- `midtown` (training): 4 by 4 lots of mid-rise blocks, terraces, courtyards and parks; cross streets
  staggered.
- `downtown`: 4 by 4 lots of towers of 20 to 120 m, streets of 18 to 28 m, squares, courtyards, podiums,
  buildings on columns, bridges across streets.
- `suburb`: 64 houses with pitched or stepped roofs along four bending roads, gardens with trees, poles,
  parked vehicles.

Frame: ENU, metres, z up; the ground is the plane z = 0, the city fills about |x|, |y| <= 120 and is turned as
a whole by a random angle, so that streets are not aligned with the voxels. Geoms that a seed does not use are padding
far below the ground.
"""

from __future__ import annotations

from jaxtyping import PRNGKeyArray

from maxjax.sim.worlds.block_city import DOWNTOWN, MIDTOWN, block_city
from maxjax.sim.worlds.geoms import Geoms
from maxjax.sim.worlds.suburb import suburb

MAPS = ("midtown", "downtown", "suburb")


def layout(name: str, key: PRNGKeyArray) -> Geoms:
    """The city of this map and key; pure, for `jit` (static name) and `vmap` over keys.

    Args:
        name: one of `MAPS`.
        key: a JAX key; every key gives another city with the same geom types.

    Returns:
        Geoms, about 200, ground plane first.

    Raises:
        ValueError: for an unknown name.
    """
    if name == "midtown":
        return block_city(key, MIDTOWN)
    if name == "downtown":
        return block_city(key, DOWNTOWN)
    if name == "suburb":
        return suburb(key)
    raise ValueError(f"map: expected one of {', '.join(MAPS)}, given {name!r}")
