"""Waypoints left out of a file, since autopilots brake for each: lines that stay near the path and keep what it keeps.

A part of a leg becomes one line where the line stays within a tolerance of all of its points and comes no nearer to
anything than that part, or than the radius and the least of the mission; else it is split at the point that is
farthest off the line. The waypoints of the mission stay.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float64

from maxjax.planning.mission import Mission
from maxjax.trajectories.clear_curve import project
from maxjax.verification.verifier import verify

TOLERANCES = (1.0, 0.7, 0.5, 0.3, 0.2, 0.1, 0.05)
"""Distances from the path that are tried [m]; the greatest is what corners of a trajectory may leave it by."""
_LESS = 1e-3  # by which a line may come nearer [m]


def thin(mission: Mission, tolerance: float) -> Mission:
    """The mission without points of its path that lie within a tolerance [m] of the lines that remain."""
    kept = list[int]()
    for leg, first in enumerate(mission.places[:-1].tolist()):
        kept += _kept(mission, leg, (first, int(mission.places[leg + 1])), tolerance)
    kept.append(len(mission.path) - 1)
    return dataclasses.replace(mission, path=mission.path[kept], places=np.searchsorted(kept, mission.places))


def thinned_missions(mission: Mission) -> Iterator[Mission]:
    """The mission thinned by each of the tolerances, where that leaves anything out, the same one once."""
    counts = {len(mission.path)}
    for tolerance in TOLERANCES:
        found = thin(mission, tolerance)
        if len(found.path) not in counts:
            yield found
        counts.add(len(found.path))


def left_out(mission: Mission, thinned: Mission) -> tuple[int, ...]:
    """Numbers of the points of a mission's path that a thinned one has not."""
    found, k = list[int](), 0
    for number, point in enumerate(mission.path):
        if k < len(thinned.path) and (point == thinned.path[k]).all():
            k += 1
        else:
            found.append(number)
    return tuple(found)


def thinning_remark(mission: Mission, thinned: Mission) -> str:
    """A sentence on what is left out."""
    aside = project(mission.path, thinned.path)[0].max()
    return (
        f"{len(mission.path) - len(thinned.path)} of {len(mission.path)} waypoints are left out, since autopilots "
        f"brake for each: they lie up to {aside:.2f} m beside its lines, which come no nearer to anything"
    )


def _kept(mission: Mission, leg: int, ends: tuple[int, int], tolerance: float) -> list[int]:
    """Numbers of the points of a part of a leg that stay, without its last one."""
    first, last = ends
    if last <= first + 1:
        return [first]
    part = mission.path[first : last + 1]
    back = bool((part[0] == part[-1]).all())
    apart = np.linalg.norm(part - part[0], axis=1) if back else project(part, part[[0, -1]])[0]
    if apart.max() <= tolerance and _as_clear(part, mission, mission.legs[leg].radius):
        return [first]
    middle = first + int(np.clip(apart.argmax(), 1, last - first - 1))
    return _kept(mission, leg, (first, middle), tolerance) + _kept(mission, leg, (middle, last), tolerance)


def _as_clear(part: Float64[np.ndarray, "_ 3"], mission: Mission, radius: float) -> bool:
    """Whether the line between the ends of a part keeps what that keeps, or the radius, or the least of the mission."""
    line, own = verify(part[[0, -1]], mission.map), verify(part, mission.map)
    return line.ok and line.clearance >= min(own.clearance, max(radius, mission.clearance)) - _LESS
