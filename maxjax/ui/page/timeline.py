"""Films: scenes that follow each other in time, on a timeline or in a shared page.

A film is a still scene and its cues: from the time of a cue on, its nodes take the place of all others in its part.
What moves is one node, the vehicle, with a position at every time.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from maxjax.core.grid import Point3
from maxjax.trajectories.trajectory import Trajectory
from maxjax.ui.page.colors import VEHICLE
from maxjax.ui.page.draw import plain_line
from maxjax.ui.page.nodes import Ball, Frame, Scene

VEHICLE_NODE = "/vehicle"
TRAIL_NODE = "/trail"
PLUMB_NODE = f"{VEHICLE_NODE}/plumb"
_PLUMB = 2.0  # width [px]
_TRAIL, _BEHIND, _STEP, _ABOVE = 9.0, 3.0, 0.2, 0.2  # width [px], length [s], between two [s], above its way [m]
_SIZE, _SHARE = 1.3, 0.012  # radius of the ball that stands for the vehicle: at least [m], and in extents of its way


@dataclasses.dataclass(frozen=True, eq=False)
class Cue:
    """Changes of a scene from a time on.

    Attributes:
        time: [s].
        part: names that begin with this are replaced.
        nodes: by these.
    """

    time: float
    part: str
    nodes: Scene


@dataclasses.dataclass(frozen=True, eq=False)
class Film:
    """A still scene, what is shown when, and where the vehicle is.

    Attributes:
        still: shown all the time.
        cues: in order of time.
        times: of the positions, rising [s].
        positions: of the vehicle, in the page's frame [m].
    """

    still: Scene
    cues: tuple[Cue, ...]
    times: Float[np.ndarray, " n"]
    positions: Float[np.ndarray, "n 3"]

    @property
    def duration(self) -> float:
        """[s]."""
        return float(self.times[-1])

    def vehicle(self, time: float) -> Point3:
        """Where the vehicle is at a time, linear between positions [m]."""
        x, y, z = (float(np.interp(time, self.times, self.positions[:, k])) for k in range(3))
        return x, y, z

    def begin(self) -> Scene:
        """The scene at the start, the vehicle with it.

        It is drawn so large that it is seen over its whole way, and a line leads straight down from it: as deep as the
        highest position, so that the ground hides what lies below.
        """
        size = max(_SIZE, _SHARE * float(np.ptp(self.positions, axis=0).max()))
        line = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -float(self.positions[:, 2].max())]])
        return {
            **self.still,
            VEHICLE_NODE: Ball(self.vehicle(0.0), size, VEHICLE),
            PLUMB_NODE: plain_line(line, VEHICLE, _PLUMB),
        }

    def showing(self, time: float) -> dict[str, Scene]:
        """The visible share of each part at a time."""
        return {cue.part: cue.nodes for cue in self.cues if cue.time <= time + 1e-9}


def trail_cues(times: Float[np.ndarray, " n"], positions: Float[np.ndarray, "n 3"]) -> tuple[Cue, ...]:
    """Where the vehicle was in the last seconds, in the page's frame [m]; a little above, or its way would hide it."""
    cues = []
    for now in np.arange(_STEP, times[-1] + 1e-9, _STEP):
        last = np.flatnonzero((times >= now - _BEHIND) & (times <= now + 1e-9))
        if len(last) > 1:
            way = positions[last] + np.array([0.0, 0.0, _ABOVE])
            cues.append(Cue(float(now), TRAIL_NODE, {TRAIL_NODE: plain_line(way, VEHICLE, _TRAIL)}))
    return tuple(cues)


def trajectory_film(trajectory: Trajectory, still: Scene, frame: Frame) -> Film:
    """The film of a trajectory in a still scene."""
    motion = trajectory.sampled(0.05)
    times, positions = np.asarray(motion.time, np.float64), frame.page(np.asarray(motion.position))
    return Film(still, trail_cues(times, positions), times, positions)
