"""Seeing movers: a look at one scan, from returns to tracks.

    scan → returns that move → clusters → visible bodies → tracks → memory

A return moves if the range images of the last looks saw nothing where it is. Of a body that stands free in the air all
returns count, if a part of it moves or a confirmed track expects its mover there: so the whole body of a slow one is
found, and one that flies away along the line of sight.

What has rested is left to the map: its returns are no longer a mover's, so that it becomes background. It is followed
all the same, if it has been seen to move, for it may start again; what never was is a wall, and its track fades.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int32

from maxjax.compile.lowering import rotate
from maxjax.sim.movers.clusters import Clusters, Signs, cluster_returns, gather_rays
from maxjax.sim.movers.detection import detect_bodies
from maxjax.sim.movers.range_memory import Memory, empty_memory, margin, remember_scan, was_empty
from maxjax.sim.movers.reachable_sets import Tracks
from maxjax.sim.movers.tracking import (
    Association,
    ExpectedView,
    TrackerState,
    has_stopped,
    initial_tracker_state,
    is_parked,
    predict_tracks,
    update_tracks,
)
from maxjax.sim.movers.tracking_settings import TrackingSettings
from maxjax.sim.sensors.lidar import Scan, directions
from maxjax.sim.sensors.range_image import clear_range, pixel

# A mover that is hidden at its middle, so far in front of its body, is not seen [m].
_HIDDEN = 0.3


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class PerceptionState:
    """The state of perception: tracks of movers and memory of scans; batch axes lead.

    Attributes:
        following: the tracks, and what they are made from.
        memory: range images of the last looks.
        moving: rays of the last scan that ended at a confirmed mover: no part of a map.
        broken: slots whose set did not hold what was measured: the mover broke a bound, or two were confused.
        near: slots that were confirmed just now, nearer than `TrackingSettings.near`.
        rests: slots whose mover has stopped: the map has it, too.
        walls: those of them that never moved.
        overflow: whether returns, bodies or tracks were left out for want of room.
    """

    following: TrackerState
    memory: Memory
    moving: Bool[Array, "*batch r"]
    broken: Bool[Array, "*batch s"]
    near: Bool[Array, "*batch s"]
    rests: Bool[Array, "*batch s"]
    walls: Bool[Array, "*batch s"]
    overflow: Bool[Array, "*batch"]

    @property
    def tracks(self) -> Tracks:
        """Movers that are followed, at the time of the last look."""
        return self.following.tracks


def initial_perception(sight: TrackingSettings) -> PerceptionState:
    """The state before the first look."""
    flags = jnp.zeros(sight.slots, bool)
    moving = jnp.zeros(sight.lidar.rays, bool)
    none = jnp.zeros((), bool)
    return PerceptionState(initial_tracker_state(sight), empty_memory(sight), moving, flags, flags, flags, flags, none)


def process_scan(
    seeing: PerceptionState,
    scan: Scan,
    position: Float[Array, "3"],
    rotation: Float[Array, "3 3"],
    time: Float[Array, ""],
    sight: TrackingSettings,
) -> PerceptionState:
    """Update the state of perception by a scan; safe under `jit` and `vmap`.

    Args:
        seeing: after the last look.
        scan: its distances; places are computed from the pose given here.
        position: estimated, of the sensor, world frame [m]. A pose that is not finite shows nothing.
        rotation: estimated, sensor frame -> world frame.
        time: of the end of the scan [s].
        sight: settings. Static.

    Raises:
        ValueError: for a scan of another sensor.
    """
    if scan.distance.shape != (sight.lidar.rays,):
        raise ValueError(f"looked: expected {sight.lidar.rays} rays as in `sight.lidar`, given {scan.distance.shape}")
    known = jnp.all(jnp.isfinite(position)) & jnp.all(jnp.isfinite(rotation))
    scan = dataclasses.replace(scan, distance=jnp.where(known, scan.distance, jnp.inf))
    position, rotation = jnp.where(known, position, 0.0), jnp.where(known, rotation, jnp.eye(3))
    returned = (scan.distance > 0.0) & (scan.distance < jnp.inf)
    rays = directions(sight.lidar)
    own = jnp.where(returned, scan.distance, 0.0)[:, None] * rays
    points = position + rotate(rotation, own)

    expected = predict_tracks(seeing.following, time, sight).tracks
    signs = _signs(seeing, points, returned & (scan.distance <= sight.reach), position, expected, sight)
    clusters = cluster_returns(points, scan.distance, signs, sight)
    bodies = detect_bodies(clusters, scan, position, rotation, sight)
    view = _view(expected, scan, position, rotation, sight)
    view = dataclasses.replace(view, plain=known & view.plain, stands=known & view.stands)
    following, matches = update_tracks(seeing.following, bodies, view, time, sight)

    rests = has_stopped(following, sight)
    moving = _moving(clusters, matches, following.tracks.confirmed & ~rests, sight)
    pose = (jnp.where(known, position, jnp.nan), rotation)
    distance = jnp.linalg.norm(following.tracks.place - position, axis=1)
    return PerceptionState(
        following=following,
        memory=remember_scan(seeing.memory, scan, moving, pose, time, sight),
        moving=moving,
        broken=matches.broken,
        near=matches.appeared & (distance < sight.near),
        rests=rests,
        walls=rests & ~is_parked(following, sight),
        overflow=clusters.overflow | matches.left_out,
    )


def _signs(
    seeing: PerceptionState,
    points: Float[Array, "r 3"],
    near: Bool[Array, " r"],
    position: Array,
    tracks: Tracks,
    sight: TrackingSettings,
) -> Signs:
    near &= points[:, 2] > sight.floor
    moves = near & was_empty(seeing.memory, points, sight)
    size = sight.bounds.edges
    awaited = tracks.confirmed & ~seeing.walls
    expected, around = jnp.zeros_like(near), jnp.zeros_like(near)
    low, high = tracks.low - tracks.half, tracks.high + tracks.half
    for k in range(sight.slots):
        expected |= awaited[k] & jnp.all((points >= low[k]) & (points <= high[k]), axis=1)
        around |= awaited[k] & jnp.all((points >= low[k] - size) & (points <= high[k] + size), axis=1)
    return Signs(moves, near & expected, near & (around | _beside(points - position, moves, sight)))


def _beside(offset: Float[Array, "r 3"], moves: Bool[Array, " r"], sight: TrackingSettings) -> Bool[Array, " r"]:
    """Returns that have a moving one at most a body's size away, and some up to twice that: by cells of that size."""
    size = sight.bounds.edges
    reach = np.ceil(sight.reach / size).astype(np.int32) + 1
    edge = 2 * reach + 1
    cell = jnp.clip(jnp.floor(offset / size).astype(jnp.int32) + reach, 0, edge - 1)
    moving, some, _ = gather_rays(jnp.linalg.norm(offset, axis=1), moves, sight.points)
    around = np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), -1).reshape(-1, 3)
    cells = jnp.clip(cell[moving][:, None] + around, 0, edge - 1)
    marked = jnp.zeros(math.prod(edge.tolist()), bool).at[_flat(cells, edge)].max(some[:, None])
    return marked[_flat(cell, edge)]


def _flat(cell: Int32[Array, "*n 3"], edge: Int32[np.ndarray, "3"]) -> Int32[Array, "*n"]:
    flat: Array = (cell[..., 0] * edge[1] + cell[..., 1]) * edge[2] + cell[..., 2]
    return flat


def _view(
    tracks: Tracks, scan: Scan, position: Float[Array, "3"], rotation: Float[Array, "3 3"], sight: TrackingSettings
) -> ExpectedView:
    """The view where movers are expected: in the field of view, within reach, and not behind something."""
    lidar = sight.lidar
    x, y, z = rotate(rotation.T, tracks.place - position).T
    level = x * x + y * y
    distance = jnp.sqrt(level + z * z)
    row, column = pixel(x, y, z, level, lidar)
    inside = (row >= 1.0) & (row <= lidar.channels - 2.0) & (distance < sight.reach)
    i = jnp.clip(jnp.round(jnp.where(inside, row, 0.0)), 0, lidar.channels - 1).astype(jnp.int32)
    j = jnp.round(jnp.where(inside, column, 0.0)).astype(jnp.int32) % lidar.columns
    clear = clear_range(scan, lidar).reshape(-1)[i * lidar.columns + j]
    room = margin(distance, sight)
    plain = inside & (clear > 0.0) & (clear > distance - jnp.max(tracks.half, axis=1) - room - _HIDDEN)
    return ExpectedView(plain, plain & (clear < distance), room)


def _moving(
    clusters: Clusters, matches: Association, movers: Bool[Array, " s"], sight: TrackingSettings
) -> Bool[Array, " r"]:
    """Rays that ended at one of the movers."""
    d = sight.detections
    chosen = jnp.where(movers & (matches.of_track >= 0), matches.of_track, d)
    body = jnp.zeros(d + 1, bool).at[chosen].set(True).at[d].set(False)
    return jnp.zeros(sight.lidar.rays, bool).at[clusters.ray].max(body[clusters.cluster])
