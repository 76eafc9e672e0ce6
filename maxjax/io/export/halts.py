"""Stops in the middle of a flight: where a vehicle comes to rest that is told to, and what stands on that way.

    braking way  s = v (v / 2 a + a / 2 j + t)        straight on from each place of a track, t: until it leans

Whoever changes to a mode that holds the place leaves the autopilot's corners: the vehicle brakes along its velocity.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from maxjax.core.grid import Point3
from maxjax.core.voxel_map import VoxelMap
from maxjax.io.export.flown_track import TRACK_STEP, FlownTrack
from maxjax.verification.polylines import Paths
from maxjax.verification.verifier import verify_paths

# ArduCopter's LOIT_BRK_ACCEL [m/s²] and LOIT_BRK_JERK [m/s³], and how long it waits.
_BRAKES, _JERK, _LEANS = 2.5, 5.0, 0.3


@dataclasses.dataclass(frozen=True)
class Halts:
    """Stops from everywhere on a flight.

    Attributes:
        longest: braking way [m].
        touching: places from which it touches something [m].
        places: for which it was judged.
    """

    longest: float
    touching: tuple[Point3, ...]
    places: int

    def __str__(self) -> str:
        said = f"a stop on the way, as ArduCopter's BRAKE makes it, takes up to {self.longest:.1f} m straight on"
        if not self.touching:
            return f"{said}, and touches nothing from anywhere"
        x, y, z = self.touching[0]
        return (
            f"{said}: from {len(self.touching)} of {self.places} places it touches something, "
            f"first at x {x:.1f}, y {y:.1f}, z {z:.1f}"
        )


def halts_of(track: FlownTrack, where: VoxelMap) -> Halts:
    """The stops from every place of a track, against what stands in a map."""
    velocity = np.gradient(track.points, TRACK_STEP, axis=0) if len(track.points) > 1 else np.zeros((1, 3))
    speed = np.linalg.norm(velocity, axis=1)
    ways = 0.5 * speed / _BRAKES + 0.5 * _BRAKES / _JERK + _LEANS
    ends = track.points + ways[:, None] * velocity
    solid = VoxelMap(np.asarray(where.occupied), np.asarray(where.ground), None, where.grid)
    count = len(ends)
    lines = Paths(np.stack([track.points, ends], axis=1), np.full(count, 2, np.int64), np.zeros(count, np.int64))
    ok = verify_paths(lines, solid, radius=0.0).ok
    touching = tuple((x, y, z) for x, y, z in track.points[~ok].tolist())
    return Halts(float((ways * speed).max(initial=0.0)), touching, count)
