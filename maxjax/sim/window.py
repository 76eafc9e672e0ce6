"""A rolling map of what the scans have shown: occupied, seen free, or unknown.

    hit this scan:              evidence ← min(evidence + 2, 6)
    seen free this scan:        evidence ← max(evidence − 1, 0)        occupied  iff  evidence > 0

Evidence is log-odds in small integers, clamped. One hit occupies a voxel at once, and only clear looks wear it down,
one each: on doubt, hits win. The floor is 0, so that a wall never has to argue against a long free past.

Frame: the window is a box of voxels aligned with the world's axes and moving by whole voxels; voxel i has its centre at
spacing · (corner + i), so one at the origin, and the world's ground is the plane z = 0.

Free space is not carved by marching along the rays, but by looking up each voxel in the range image (channels x
azimuths): a voxel is seen free when the nearest return in a window of beams around its direction lies beyond the
voxel's far side. The window spans the voxel's own width: near voxels span many beams, far ones no more than the beam
they lie on and its neighbours. Minima over windows of growing size are made once a scan; then a voxel costs one read.
Because the *least* range decides, one return anywhere on a wall's patch protects it, whatever share of its neighbours
is lost.

A lost beam measures nothing: it may be the sky or a drop-out. It counts as free to the lidar's range only in columns
(azimuths) where other beams returned; over a city the lower ones always meet the ground. A column without returns is
blind, and blind beams carve nothing: neither do an empty scan or a dead sector.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int32, UInt8

from maxjax.core.grid import Index3
from maxjax.sim.lidar import Lidar, Scan, directions
from maxjax.worlds.geoms import matmul

# Evidence of one hit and most of it; a clear look takes 1. A false hit goes after 2 clear looks, a lasting one after 6.
_HIT = 2
_MOST = 6
# Bit of a cell that says that it was ever seen free; the bits below hold the evidence.
_CLEAR = 128
# Half widths of the beam windows [channels]. A step up costs sight of voxels beside walls, a window a pass a scan.
_WINDOWS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 128)
# Returns in a column and its two neighbours below which the column is blind.
_ALIVE = 3
# A wall may be measured this many standard deviations too far before it looks clear.
_SIGMAS = 3.0


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Window:
    """What is known around the vehicle; batch axes lead.

    Attributes:
        cells: evidence of being occupied, 0 to 6, plus 128 where a voxel was seen free since it entered the window. One
            byte a voxel is what a batch of flights has to hold; read it by `occupied`, `seen` and `ground`.
        corner: index of voxel (0, 0, 0) in the world's lattice.
        spacing: edge of a voxel [m]; static.
    """

    cells: UInt8[Array, "*batch nx ny nz"]
    corner: Int32[Array, "*batch 3"]
    spacing: float = dataclasses.field(metadata={"static": True})


def empty(position: Float[Array, "3"], shape: Index3 = (101, 101, 101), spacing: float = 2.0) -> Window:
    """A window that knows nothing, centred on a position.

    Args:
        position: world frame [m].
        shape: voxels along x, y, z. Static.
        spacing: edge of a voxel [m]. Static.

    Raises:
        ValueError: for a shape that is not three positive integers, or a spacing that is not a positive finite number.
    """
    if len(shape) != 3 or min(shape) < 1:
        raise ValueError(f"shape: expected three positive integers, given {shape}")
    if not (math.isfinite(spacing) and spacing > 0):
        raise ValueError(f"spacing: expected a positive number of metres, given {spacing}")
    known = jnp.all(jnp.isfinite(position))
    corner = _corner(jnp.where(known, position, 0.0), shape, spacing)
    return Window(jnp.zeros(shape, jnp.uint8), corner, spacing)


def recentre(window: Window, position: Float[Array, "3"]) -> Window:
    """The window moved by whole voxels so that its middle voxel holds `position`; what leaves it is forgotten.

    Args:
        window: one window.
        position: world frame [m]; where it is not finite, nothing moves.
    """
    known = jnp.all(jnp.isfinite(position))
    corner = _corner(jnp.where(known, position, 0.0), window.cells.shape, window.spacing)
    corner = jnp.where(known, corner, window.corner)
    return Window(_moved(window.cells, corner - window.corner), corner, window.spacing)


def origin(window: Window) -> Float[Array, "*batch 3"]:
    """World position of the centre of voxel (0, 0, 0) [m]: `Grid.origin`, but traced."""
    return window.spacing * window.corner.astype(jnp.float32)


def occupied(window: Window) -> Bool[Array, "*batch nx ny nz"]:
    """Voxels taken for occupied, ground included as far as it was met."""
    evidence: Array = window.cells % _CLEAR
    return evidence > 0


def seen(window: Window) -> Bool[Array, "*batch nx ny nz"]:
    """Voxels seen free at some time and not occupied now: the ones in which a vehicle may count on stopping."""
    return window.cells == _CLEAR


def ground(window: Window) -> Bool[Array, "*batch nx ny nz"]:
    """Voxels that reach below z = 0, the world's ground: known without looking, or paths would dive under it.

    With a voxel centre at z = 0 that is the layer around it (feet of buildings included) and what lies deeper.
    """
    layer = window.corner[..., 2, None] + jnp.arange(window.cells.shape[-1])
    return jnp.broadcast_to((layer <= 0)[..., None, None, :], window.cells.shape)


def fuse(
    window: Window,
    scan: Scan,
    lidar: Lidar,
    position: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
    snapshot: bool = False,
) -> Window:
    """One scan taken into the map; safe under `jit` and `vmap`.

    Args:
        window: one window; recentre it first.
        scan: its distances and hits; world points are formed anew from the pose given here.
        lidar: the sensor's model. Static.
        position: where the vehicle believes the sensor is, world frame [m].
        rotation: sensor frame -> world frame, as believed.
        snapshot: forget everything but this scan, as the paper does. Static.

    Returns:
        The window; unchanged (with `snapshot`: empty) by a scan without returns or a pose that is not finite.
    """
    if scan.distance.shape != (lidar.rays,):
        raise ValueError(f"scan: expected {lidar.rays} rays as in `lidar`, given {scan.distance.shape}; use vmap")
    hit = _hits(window, scan, lidar, position, rotation)
    free = _seen_free(window, scan, lidar, position, rotation)
    cells = jnp.zeros_like(window.cells) if snapshot else window.cells
    evidence = cells % _CLEAR
    clear = cells - evidence
    more = jnp.minimum(evidence, _MOST - _HIT) + _HIT + clear
    less = jnp.where(evidence > 0, evidence - 1, evidence) + _CLEAR
    return Window(jnp.where(hit, more, jnp.where(free, less, cells)), window.corner, window.spacing)


def _corner(position: Float[Array, "3"], shape: tuple[int, ...], spacing: float) -> Int32[Array, "3"]:
    middle = jnp.floor(position / spacing + 0.5).astype(jnp.int32)
    return middle - jnp.asarray(shape, jnp.int32) // 2


def _moved(array: Array, shift: Int32[Array, "3"]) -> Array:
    """`array` seen from `shift` voxels further on; zero where it shows nothing."""
    for axis, n in enumerate(array.shape):
        step = jnp.clip(shift[axis], -n, n)
        config = [(0, 0, 0)] * 3
        config[axis] = (n, n, 0)
        wide = lax.pad(array, jnp.zeros((), array.dtype), config)
        array = lax.dynamic_slice_in_dim(wide, n + step, n, axis)
    return array


def _hits(
    window: Window, scan: Scan, lidar: Lidar, position: Float[Array, "3"], rotation: Float[Array, "3 3"]
) -> Bool[Array, "nx ny nz"]:
    """Voxels that hold a return."""
    shape = window.cells.shape
    distance = jnp.where(scan.hit, scan.distance, 0.0)
    points = position + distance[:, None] * matmul(directions(lidar), rotation.T)
    lattice = jnp.floor(points / window.spacing + 0.5)
    # Compared as floats, so that a far or NaN point cannot wrap around into the window.
    index = lattice - window.corner.astype(jnp.float32)
    inside = scan.hit & jnp.all((index >= 0) & (index < jnp.asarray(shape)), axis=1)
    i, j, k = jnp.where(inside[:, None], index, -1.0).astype(jnp.int32).T
    flat = jnp.where(inside, (i * shape[1] + j) * shape[2] + k, math.prod(shape))
    return jnp.zeros(math.prod(shape), bool).at[flat].set(True, mode="drop").reshape(shape)


def _seen_free(
    window: Window, scan: Scan, lidar: Lidar, position: Float[Array, "3"], rotation: Float[Array, "3 3"]
) -> Bool[Array, "nx ny nz"]:
    """Voxels whose far side lies in front of every return in the beams around them."""
    columns = lidar.rays // lidar.channels
    minima = _minima(scan, lidar)
    centre = [
        (window.spacing * (window.corner[axis] + lax.iota(jnp.int32, n)).astype(jnp.float32) - position[axis]).reshape(
            [-1 if axis == other else 1 for other in range(3)]
        )
        for axis, n in enumerate(window.cells.shape)
    ]
    x, y, z = (rotation[0, i] * centre[0] + rotation[1, i] * centre[1] + rotation[2, i] * centre[2] for i in range(3))
    span = jnp.abs(centre[0]) + jnp.abs(centre[1]) + jnp.abs(centre[2])
    level_squared = x * x + y * y
    range_squared = level_squared + z * z
    inverse = lax.rsqrt(jnp.maximum(range_squared, 1e-6))
    distance = range_squared * inverse
    half = 0.5 * window.spacing
    # The cube reaches this far beyond its centre along the line of sight.
    far = distance + half * span * inverse + _SIGMAS * lidar.range_noise

    rise = math.radians(lidar.elevation_max - lidar.elevation_min) / (lidar.channels - 1)
    channel = (_arctan2(z, jnp.sqrt(level_squared)) - math.radians(lidar.elevation_min)) / rise
    column = _arctan2(y, x) * (columns / (2.0 * math.pi))
    row = jnp.floor(channel + 0.5).astype(jnp.int32)
    turn = jnp.floor(column + 0.5).astype(jnp.int32) % columns

    # Half the voxel's width as an angle. Every beam counts for the voxel around the sensor, and for those above and
    # below it that no beam meets.
    inside = (row >= 0) & (row < lidar.channels)
    near = distance < 2.0 * half
    around = (jnp.abs(centre[0]) <= half) & (jnp.abs(centre[1]) <= half) & (jnp.abs(centre[2]) <= half)
    needed = jnp.where(around | (near & ~inside), float(_WINDOWS[-1]), half * inverse / rise)
    level = sum((needed > w + 0.5).astype(jnp.int32) for w in _WINDOWS[:-1])
    flat = (level * lidar.channels + jnp.clip(row, 0, lidar.channels - 1)) * columns + turn
    return (inside | near) & (minima.reshape(-1)[flat] > far)


def _minima(scan: Scan, lidar: Lidar) -> Float[Array, "level channel column"]:
    """Least range in windows of growing size around every beam; zero where one of its columns is blind."""
    image = scan.distance.reshape(lidar.channels, -1)
    hit = scan.hit.reshape(lidar.channels, -1)
    columns = image.shape[1]
    returns = jnp.sum(hit, axis=0)
    alive = returns + jnp.roll(returns, 1) + jnp.roll(returns, -1) >= _ALIVE
    image = jnp.where(hit, image, jnp.where(alive, lidar.max_range, 0.0))
    # Beams stand closer along a channel than across: the same angle spans more of them.
    rise = (lidar.elevation_max - lidar.elevation_min) / (lidar.channels - 1)
    wide = [min(math.ceil(w * rise * columns / 360.0), columns // 2) for w in _WINDOWS]
    high = [min(w, lidar.channels) for w in _WINDOWS]
    # Beams of windows that run over the image's edge: azimuths close the circle, above and below there are none.
    image = jnp.concatenate([image[:, columns - wide[-1] :], image, image[:, : wide[-1]]], axis=1)
    image = jnp.pad(image, ((high[-1], high[-1]), (0, 0)), constant_values=jnp.inf)
    levels, beams = [], [1, 1]
    for half in zip(high, wide, strict=True):
        for axis in range(2):
            image, beams[axis] = _minimum_of(image, axis, beams[axis], 2 * half[axis] + 1)
        # `image` starts at the first beam of each window.
        start = (high[-1] - half[0], wide[-1] - half[1])
        levels.append(image[start[0] : start[0] + lidar.channels, start[1] : start[1] + columns])
    return jnp.stack(levels)


def _minimum_of(image: Float[Array, "a b"], axis: int, beams: int, target: int) -> tuple[Float[Array, "c d"], int]:
    """Minima of `beams` beams, from each one on, made into minima of `target` beams; as many fewer of them."""
    while beams < target:
        step = min(beams, target - beams)
        n = image.shape[axis]
        first, last = (lax.slice_in_dim(image, k, n - step + k, axis=axis) for k in (0, step))
        image, beams = jnp.minimum(first, last), beams + step
    return image, beams


# Odd minimax polynomial of arctan on [0, 1], good to 1e-5 rad: a thousandth of the angle between beams.
_ARCTAN = (0.9998660, -0.3302995, 0.1801410, -0.0851330, 0.0208351)


def _arctan2(y: Array, x: Array) -> Array:
    """Angle of (x, y) [rad]; several times faster on CPU than `jnp.arctan2`, which no loop can vectorise."""
    a, b = jnp.abs(x), jnp.abs(y)
    t = jnp.minimum(a, b) / jnp.maximum(jnp.maximum(a, b), 1e-12)
    q = t * t
    angle = jnp.zeros_like(t)
    for coefficient in reversed(_ARCTAN):
        angle = angle * q + coefficient
    angle = angle * t
    angle = jnp.where(b > a, 0.5 * np.pi - angle, angle)
    angle = jnp.where(x < 0, np.pi - angle, angle)
    return jnp.where(y < 0, -angle, angle)
