"""A rolling map of what the scans have shown: each voxel occupied, seen free, or unknown.

    return in the voxel:        evidence ← min(evidence + 2, 6)
    voxel seen free:            evidence ← max(evidence − loss, 0)     occupied  iff  evidence > 0

Evidence is log-odds in small integers, clamped to 0 to 6. One return occupies a voxel at once; each scan that sees it
free takes the map's `loss` away: 1 in a world that stands still; 3 among movers, where two scans clear what is gone.
Within one scan a return takes precedence. The lower bound 0 means that earlier free observations do not delay the
detection of a new obstacle.

Frame: the map is a box of voxels aligned with the world's axes that moves by whole voxels. Voxel i has its centre at
spacing · (corner + i), so one voxel centre lies at the origin; the world's ground is the plane z = 0.

Free space is found by projecting each voxel into the range image (channels x azimuths) instead of marching along the
rays: a voxel is seen free when the least range over the beams around its direction exceeds the range of its far side.
These beams span the voxel's own angular width, at least the nearest beam and its neighbours. Minimum filters of growing
size over the range image are computed once a scan; then each voxel costs one look-up. Because the least range decides,
one return anywhere on the patch of a wall that a voxel covers keeps it from being seen free, whatever share of the
beams is lost.

What a lost beam says: `sim.sensors.range_image`. A return whose `hit` was taken away, because it is a mover's, occupies
no voxel, but still ends its beam: nothing behind a mover is seen free.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, UInt8

from maxjax.compile.lowering import matmul
from maxjax.core.grid import Index3
from maxjax.sim.sensors.lidar import Lidar, Scan, directions
from maxjax.sim.sensors.range_image import clear_range, pixel, rise

# Evidence of one return, and its maximum. A single false return is removed by 2 scans that see the voxel free, a
# maximum by 6.
_RETURN = 2
_MAXIMUM = 6
# Bit of a cell that is set once it was seen free; the bits below hold the evidence.
_SEEN = 128
# Half widths of the minimum filters [channels]. Coarse steps hide voxels beside walls; each filter costs a pass a scan.
_HALF_WIDTHS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 128)
# A wall measured too far by up to this many standard deviations is not taken for free space.
_SIGMAS = 3.0


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class RollingMap:
    """The map around the vehicle; batch axes lead.

    Attributes:
        cells: evidence of being occupied, 0 to 6, plus 128 where a voxel was seen free since it entered the map. One
            byte a voxel bounds the memory of a batch of flights; read it by `occupied_voxels`, `seen` and `ground`.
        corner: index of voxel (0, 0, 0) in the world's lattice.
        spacing: edge of a voxel [m]; static.
        loss: evidence that a scan takes away which sees a voxel free, 1 to 6; static.
    """

    cells: UInt8[Array, "*batch nx ny nz"]
    corner: Int32[Array, "*batch 3"]
    spacing: float = dataclasses.field(metadata={"static": True})
    loss: int = dataclasses.field(default=1, metadata={"static": True})


def empty(
    position: Float[Array, "3"], shape: Index3 = (101, 101, 101), spacing: float = 2.0, loss: int = 1
) -> RollingMap:
    """A map without observations, centred on a position.

    Args:
        position: world frame [m].
        shape: voxels along x, y, z. Static.
        spacing: edge of a voxel [m]. Static.
        loss: evidence that a scan takes away which sees a voxel free, 1 to 6. Static.

    Raises:
        ValueError: for a shape that is not three positive integers, a spacing that is not a positive finite number, or
            another loss.
    """
    if len(shape) != 3 or min(shape) < 1:
        raise ValueError(f"shape: expected three positive integers, given {shape}")
    if not (math.isfinite(spacing) and spacing > 0):
        raise ValueError(f"spacing: expected a positive number of metres, given {spacing}")
    if loss not in range(1, _MAXIMUM + 1):
        raise ValueError(f"loss: expected 1 to {_MAXIMUM}, given {loss}")
    known = jnp.all(jnp.isfinite(position))
    corner = _corner(jnp.where(known, position, 0.0), shape, spacing)
    return RollingMap(jnp.zeros(shape, jnp.uint8), corner, spacing, loss)


def recentre(rolling_map: RollingMap, position: Float[Array, "3"], goal: Float[Array, "3"] | None = None) -> RollingMap:
    """The map moved by whole voxels so that its middle voxel holds `position`; voxels that leave it are dropped.

    A goal that the map holds stays in it, for without its goal nothing can be planned: who has to give way further
    than the map reaches is then off its middle, by up to half of that.

    Args:
        rolling_map: one map.
        position: world frame [m]; where it is not finite, nothing moves.
        goal: world frame [m]; None: there is none to keep.
    """
    known = jnp.all(jnp.isfinite(position))
    corner = _corner(jnp.where(known, position, 0.0), rolling_map.cells.shape, rolling_map.spacing)
    if goal is not None:
        corner = _with_goal(rolling_map, corner, goal)
    corner = jnp.where(known, corner, rolling_map.corner)
    moved = _moved(rolling_map.cells, corner - rolling_map.corner)
    return dataclasses.replace(rolling_map, cells=moved, corner=corner)


def origin(rolling_map: RollingMap) -> Float[Array, "*batch 3"]:
    """World position of the centre of voxel (0, 0, 0) [m]: `Grid.origin`, but traced."""
    return rolling_map.spacing * rolling_map.corner.astype(jnp.float32)


def occupied_voxels(rolling_map: RollingMap) -> Bool[Array, "*batch nx ny nz"]:
    """Voxels with evidence of being occupied; the ground as far as it returned beams."""
    evidence: Array = rolling_map.cells % _SEEN
    return evidence > 0


def seen(rolling_map: RollingMap) -> Bool[Array, "*batch nx ny nz"]:
    """Voxels seen free at some time and not occupied now: a vehicle may rely on stopping within them."""
    return rolling_map.cells == _SEEN


def ground(rolling_map: RollingMap) -> Bool[Array, "*batch nx ny nz"]:
    """Voxels that reach below z = 0, the world's ground; known without observation, so that no path leads below it.

    With a voxel centre at z = 0 these are the layer around it (feet of buildings included) and all layers below.
    """
    layer = rolling_map.corner[..., 2, None] + jnp.arange(rolling_map.cells.shape[-1])
    return jnp.broadcast_to((layer <= 0)[..., None, None, :], rolling_map.cells.shape)


def fuse_scan(
    rolling_map: RollingMap,
    scan: Scan,
    lidar: Lidar,
    position: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
    snapshot: bool = False,
) -> RollingMap:
    """One scan fused into the map; safe under `jit` and `vmap`.

    Args:
        rolling_map: one map; recentre it first.
        scan: its distances and hits; world points are computed from the pose given here.
        lidar: the sensor's model. Static.
        position: estimated position of the sensor, world frame [m].
        rotation: estimated, sensor frame -> world frame.
        snapshot: drop everything but this scan, as the paper does. Static.

    Returns:
        The map; unchanged (with `snapshot`: empty) by a scan without returns or a pose that is not finite.
    """
    if scan.distance.shape != (lidar.rays,):
        raise ValueError(f"scan: expected {lidar.rays} rays as in `lidar`, given {scan.distance.shape}; use vmap")
    hit = _hits(rolling_map, scan, lidar, position, rotation)
    free = _seen_free(rolling_map, scan, lidar, position, rotation)
    cells = jnp.zeros_like(rolling_map.cells) if snapshot else rolling_map.cells
    evidence = cells % _SEEN
    clear = cells - evidence
    more = jnp.minimum(evidence, _MAXIMUM - _RETURN) + _RETURN + clear
    less = jnp.where(evidence > rolling_map.loss, evidence - rolling_map.loss, 0) + _SEEN
    return dataclasses.replace(rolling_map, cells=jnp.where(hit, more, jnp.where(free, less, cells)))


def _with_goal(rolling_map: RollingMap, corner: Int32[Array, "3"], goal: Float[Array, "3"]) -> Int32[Array, "3"]:
    """The corner nearest to `corner` with which the map holds the goal too, if it holds it now."""
    shape = rolling_map.cells.shape
    held = _corner(goal, shape, rolling_map.spacing)
    reach = (jnp.asarray(shape, jnp.int32) - 1) // 2
    holds = jnp.all(jnp.isfinite(goal)) & jnp.all(jnp.abs(held - rolling_map.corner) <= reach)
    kept = jnp.clip(jnp.clip(corner, held - reach, held + reach), corner - reach // 2, corner + reach // 2)
    return jnp.where(holds, kept, corner)


def _corner(position: Float[Array, "3"], shape: tuple[int, ...], spacing: float) -> Int32[Array, "3"]:
    middle = jnp.floor(position / spacing + 0.5).astype(jnp.int32)
    return middle - jnp.asarray(shape, jnp.int32) // 2


def _moved(array: Array, shift: Int32[Array, "3"]) -> Array:
    """`array` with its origin moved by `shift` voxels; zero where it has no values."""
    for axis, n in enumerate(array.shape):
        step = jnp.clip(shift[axis], -n, n)
        config = [(0, 0, 0)] * 3
        config[axis] = (n, n, 0)
        wide = lax.pad(array, jnp.zeros((), array.dtype), config)
        array = lax.dynamic_slice_in_dim(wide, n + step, n, axis)
    return array


def _hits(
    rolling_map: RollingMap, scan: Scan, lidar: Lidar, position: Float[Array, "3"], rotation: Float[Array, "3 3"]
) -> Bool[Array, "nx ny nz"]:
    """Voxels that hold a return."""
    shape = rolling_map.cells.shape
    distance = jnp.where(scan.hit, scan.distance, 0.0)
    points = position + distance[:, None] * matmul(directions(lidar), rotation.T)
    lattice = jnp.floor(points / rolling_map.spacing + 0.5)
    # Compared as floats, so that the index of a far or NaN point does not overflow into the map.
    index = lattice - rolling_map.corner.astype(jnp.float32)
    inside = scan.hit & jnp.all((index >= 0) & (index < jnp.asarray(shape)), axis=1)
    i, j, k = jnp.where(inside[:, None], index, -1.0).astype(jnp.int32).T
    flat = jnp.where(inside, (i * shape[1] + j) * shape[2] + k, math.prod(shape))
    return jnp.zeros(math.prod(shape), bool).at[flat].set(True, mode="drop").reshape(shape)


def _seen_free(
    rolling_map: RollingMap, scan: Scan, lidar: Lidar, position: Float[Array, "3"], rotation: Float[Array, "3 3"]
) -> Bool[Array, "nx ny nz"]:
    """Voxels whose far side is nearer than every return in the beams around their direction."""
    columns = lidar.rays // lidar.channels
    minima = _minima(scan, lidar)
    centre = [
        _along(axis, rolling_map.spacing * (rolling_map.corner[axis] + lax.iota(jnp.int32, n)).astype(jnp.float32) - at)
        for axis, (n, at) in enumerate(zip(rolling_map.cells.shape, position, strict=True))
    ]
    x, y, z = (rotation[0, i] * centre[0] + rotation[1, i] * centre[1] + rotation[2, i] * centre[2] for i in range(3))
    span = jnp.abs(centre[0]) + jnp.abs(centre[1]) + jnp.abs(centre[2])
    level_squared = x * x + y * y
    range_squared = level_squared + z * z
    inverse = lax.rsqrt(jnp.maximum(range_squared, 1e-6))
    distance = range_squared * inverse
    half = 0.5 * rolling_map.spacing
    # The cube reaches this far beyond its centre along the line of sight.
    far = distance + half * span * inverse + _SIGMAS * lidar.range_noise

    channel, column = pixel(x, y, z, level_squared, lidar)
    row = jnp.floor(channel + 0.5).astype(jnp.int32)
    turn = jnp.floor(column + 0.5).astype(jnp.int32) % columns

    # Half the voxel's angular width. The voxel around the sensor, and those above and below it outside the field of
    # view, are compared with all beams.
    inside = (row >= 0) & (row < lidar.channels)
    near = distance < 2.0 * half
    around = (jnp.abs(centre[0]) <= half) & (jnp.abs(centre[1]) <= half) & (jnp.abs(centre[2]) <= half)
    needed = jnp.where(around | (near & ~inside), float(_HALF_WIDTHS[-1]), half * inverse / rise(lidar))
    level = sum((needed > w + 0.5).astype(jnp.int32) for w in _HALF_WIDTHS[:-1])
    flat = (level * lidar.channels + jnp.clip(row, 0, lidar.channels - 1)) * columns + turn
    return (inside | near) & (minima.reshape(-1)[flat] > far)


def _along(axis: int, values: Float[Array, " n"]) -> Float[Array, "..."]:
    """Values along one axis, shaped so that they broadcast to a volume."""
    return values.reshape([-1 if axis == other else 1 for other in range(3)])


def _minima(scan: Scan, lidar: Lidar) -> Float[Array, "level channel column"]:
    """Minimum filters of the range image, of growing size; zero where a column in the filter has no returns."""
    image = clear_range(scan, lidar)
    columns = image.shape[1]
    # Beams are denser along a channel than across: the same angle spans more of them.
    step = (lidar.elevation_max - lidar.elevation_min) / (lidar.channels - 1)
    wide = [min(math.ceil(w * step * columns / 360.0), columns // 2) for w in _HALF_WIDTHS]
    high = [min(w, lidar.channels) for w in _HALF_WIDTHS]
    # Padding: azimuths are periodic; above and below the field of view there are no beams.
    image = jnp.concatenate([image[:, columns - wide[-1] :], image, image[:, : wide[-1]]], axis=1)
    image = jnp.pad(image, ((high[-1], high[-1]), (0, 0)), constant_values=jnp.inf)
    levels, beams = [], [1, 1]
    for half in zip(high, wide, strict=True):
        for axis in range(2):
            image, beams[axis] = _minimum_of(image, axis, beams[axis], 2 * half[axis] + 1)
        # An entry of `image` is the minimum over a filter that begins there.
        start = (high[-1] - half[0], wide[-1] - half[1])
        levels.append(image[start[0] : start[0] + lidar.channels, start[1] : start[1] + columns])
    return jnp.stack(levels)


def _minimum_of(image: Float[Array, "a b"], axis: int, beams: int, target: int) -> tuple[Float[Array, "c d"], int]:
    """Running minima over `beams` beams extended to `target` beams, by doubling; the image shrinks accordingly."""
    while beams < target:
        step = min(beams, target - beams)
        n = image.shape[axis]
        first, last = (lax.slice_in_dim(image, k, n - step + k, axis=axis) for k in (0, step))
        image, beams = jnp.minimum(first, last), beams + step
    return image, beams
