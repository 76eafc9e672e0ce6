"""Range images of the last looks, and what they say of a place: nothing was there, or something was.

    nothing stood at p at that time   ⟸   |p − x| + margin < min over the beams around p of their range
    something did                     ⟸   | |p − x| − that minimum | ≤ margin

x is where the sensor was. The minimum is over the 3 x 3 beams around p's direction: they enclose p, so that of a
surface that is sampled at most as coarsely as beams are spaced one beam is at least as near as p; what lies between two
beams alone (a wire, a far lamp post) can be missed. Beyond the field of view, in columns without returns, and beside
beams that ended at a mover, nothing is known.

Beams that ended at a mover are no part of the background, and say nothing of what is around them: the rest of the
minimum might not enclose p.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from maxjax.compile.lowering import rotate
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.sensors.lidar import Scan
from maxjax.sim.sensors.range_image import clear_range, pixel

# Largest error of a minimum over beams as the range of a surface: so much [m], and so much of the range.
_MARGIN, _SLOPE = 0.1, 0.01
_SIGMAS = 5.0


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Memory:
    """Posed range images, newest first; batch axes lead.

    Attributes:
        background: least range over 3 x 3 beams without those of movers [m]; 0 where nothing is known.
        position, rotation: of the sensor, world frame [m].
        time: of each [s]; -infinity where there is none yet.
    """

    background: Float[Array, "*batch k channels columns"]
    position: Float[Array, "*batch k 3"]
    rotation: Float[Array, "*batch k 3 3"]
    time: Float[Array, "*batch k"]


def empty_memory(sight: TrackingSettings) -> Memory:
    """No images."""
    k, lidar = sight.images, sight.lidar
    rotation = jnp.broadcast_to(jnp.eye(3), (k, 3, 3))
    return Memory(jnp.zeros((k, lidar.channels, lidar.columns)), jnp.zeros((k, 3)), rotation, jnp.full(k, -jnp.inf))


def remember_scan(
    memory: Memory,
    scan: Scan,
    moving: Bool[Array, " r"],
    pose: tuple[Array, Array],
    time: Array,
    sight: TrackingSettings,
) -> Memory:
    """The memory with a scan in place of its oldest image, if the newest is old enough.

    Args:
        memory: so far.
        scan: its distances.
        moving: rays that ended at a mover.
        pose: position [m] and rotation of the sensor; where it is not finite, nothing changes.
        time: of the end of the scan [s].
        sight: settings. Static.
    """
    position, rotation = pose
    known = jnp.all(jnp.isfinite(position)) & jnp.all(jnp.isfinite(rotation))
    # Looks are counted in time, which rounds.
    due = known & (time >= memory.time[0] + sight.apart - 1e-3)
    new = Memory(_background(scan, moving, sight)[None], position[None], rotation[None], jnp.reshape(time, (1,)))
    shifted: Memory = jax.tree.map(lambda a, b: jnp.where(due, jnp.concatenate([a, b[:-1]]), b), new, memory)
    return shifted


def was_empty(memory: Memory, points: Float[Array, "n 3"], sight: TrackingSettings) -> Bool[Array, " n"]:
    """Places, world frame [m], where the last images saw nothing until something came.

    Two images or more saw nothing there, and the two oldest ones did, or at most one saw something: a slow mover stands
    in the latest images where it is now.
    """
    witness = jax.vmap(functools.partial(_witness, sight=sight), (0, 0, 0, None))
    empty, taken = witness(memory.background, memory.position, memory.rotation, points)
    lately = (jnp.sum(empty, axis=0) >= 2) & (jnp.sum(taken, axis=0) <= 1)
    return lately | (empty[-1] & empty[-2])


def margin(distance: Array, sight: TrackingSettings) -> Array:
    """How far a measured surface may be from the least range around it [m]."""
    return _MARGIN + sight.pose_error + _SIGMAS * sight.lidar.range_noise + _SLOPE * distance


def _witness(
    background: Float[Array, "channels columns"],
    position: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
    points: Float[Array, "n 3"],
    sight: TrackingSettings,
) -> tuple[Bool[Array, " n"], Bool[Array, " n"]]:
    """Whether an image saw nothing at each place, and whether it saw something."""
    lidar = sight.lidar
    x, y, z = rotate(rotation.T, points - position).T
    level_squared = x * x + y * y
    distance = jnp.sqrt(level_squared + z * z)
    row, column = pixel(x, y, z, level_squared, lidar)
    inside = (row >= 0.0) & (row <= lidar.channels - 1)
    i = jnp.clip(jnp.floor(jnp.where(inside, row, 0.0) + 0.5), 0, lidar.channels - 1).astype(jnp.int32)
    j = jnp.floor(jnp.where(inside, column, 0.0) + 0.5).astype(jnp.int32) % lidar.columns
    least = background.reshape(-1)[i * lidar.columns + j]
    known, allowed = inside & (least > 0.0), margin(distance, sight)
    return known & (distance + allowed < least), known & (jnp.abs(distance - least) <= allowed)


def _background(scan: Scan, moving: Bool[Array, " r"], sight: TrackingSettings) -> Float[Array, "channels columns"]:
    image = jnp.where(moving.reshape(sight.lidar.channels, -1), 0.0, clear_range(scan, sight.lidar))
    image = jnp.minimum(image, jnp.minimum(jnp.roll(image, 1, axis=1), jnp.roll(image, -1, axis=1)))
    # Azimuths are periodic; above and below the field of view there are no beams.
    padded = jnp.pad(image, ((1, 1), (0, 0)), constant_values=jnp.inf)
    return jnp.minimum(image, jnp.minimum(padded[:-2], padded[2:]))
