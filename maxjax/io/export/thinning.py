"""Waypoints left out of a file, since autopilots brake for each: lines that stay near the path and keep what it keeps.

A part of a leg becomes one line where the line stays within a tolerance of all of its points and comes no nearer to
anything than that part, or than the radius and the least of the mission; else it is split at the point that is
farthest off the line. The waypoints of the mission stay.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float64

from maxjax.planning.mission import Mission
from maxjax.trajectories.clear_curve import project
from maxjax.verification.verifier import verify

TOLERANCES = (1.0, 0.7, 0.5, 0.3, 0.2, 0.1, 0.05)
"""Distances from the path that are tried [m]; the greatest is what corners of a trajectory may leave it by."""
_LESS = 1e-3  # by which a line may come nearer [m]

_Shortcuts = Callable[[int, int, int], bool]  # of a leg, from a point of the path to another one


def thin(mission: Mission, tolerance: float) -> Mission:
    """The mission without points of its path that lie within a tolerance [m] of the lines that remain."""
    return _thin(mission, tolerance, _shortcuts(mission))


def _thin(mission: Mission, tolerance: float, shortcuts: _Shortcuts) -> Mission:
    kept = list[int]()
    for leg, (first, last) in enumerate(itertools.pairwise(mission.places.tolist())):
        kept += _kept(mission.path, (leg, first, last), tolerance, shortcuts)
    kept.append(len(mission.path) - 1)
    return dataclasses.replace(mission, path=mission.path[kept], places=np.searchsorted(kept, mission.places))


def thinnings(mission: Mission) -> Iterator[Mission]:
    """The mission thinned by each of the tolerances, where that leaves anything out, the same one once."""
    counts, shortcuts = {len(mission.path)}, _shortcuts(mission)
    for tolerance in TOLERANCES:
        found = _thin(mission, tolerance, shortcuts)
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


def _kept(
    path: Float64[np.ndarray, "n 3"], part: tuple[int, int, int], tolerance: float, shortcuts: _Shortcuts
) -> list[int]:
    """Numbers of the points of a part of a leg that stay, without its last one."""
    leg, first, last = part
    if last <= first + 1:
        return [first]
    points = path[first : last + 1]
    back = bool((points[0] == points[-1]).all())
    apart = np.linalg.norm(points - points[0], axis=1) if back else project(points, points[[0, -1]])[0]
    if apart.max() <= tolerance and shortcuts(leg, first, last):
        return [first]
    middle = first + int(np.clip(apart.argmax(), 1, last - first - 1))
    halves = (leg, first, middle), (leg, middle, last)
    return [k for half in halves for k in _kept(path, half, tolerance, shortcuts)]


def _shortcuts(mission: Mission) -> _Shortcuts:
    """Whether a line between two points keeps what the path between them keeps, or the mission, or the radius."""

    @functools.cache
    def clear(leg: int, first: int, last: int) -> bool:
        line = verify(mission.path[[first, last]], mission.map)
        least = float(np.fmax(mission.legs[leg].radius, mission.clearance))
        if line.ok and line.clearance >= least - _LESS:
            return True
        own = verify(mission.path[first : last + 1], mission.map).clearance
        return line.ok and line.clearance >= own - _LESS

    return clear
