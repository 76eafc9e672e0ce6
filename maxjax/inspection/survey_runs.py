"""From the lines of a survey to what is flown of them: heights, free runs, room to turn, and photos that are lost.

    line in plan → heights → samples → those in free air, in runs → straight legs between few waypoints

A run is a part of a line all of whose places keep the radius in open air. Between two runs the vehicle flies around
what is in the way; photos that were to be taken there are lost, and named.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.inspection.free_space import FreeSpace
from maxjax.inspection.height_profile import Below, legs_along, lift
from maxjax.inspection.leg_costs import straight_legs
from maxjax.inspection.sweep import Sweep
from maxjax.inspection.sweep_lines import Line
from maxjax.planning.look import Look
from maxjax.planning.waypoint import Waypoint

Points = Float64[np.ndarray, "n 3"]
Reason = Literal["closed", "beyond", "blocked"]

_WORDS = {
    "closed": "the air there is closed",
    "beyond": "the map ends there; load more of it",
    "blocked": "something stands there, and the line is flown around it",
}


@dataclasses.dataclass(frozen=True, eq=False)
class Run:
    """A part of a line that is flown.

    Attributes:
        points: waypoints of it [m], those at which photos begin and end among them.
        first, last: numbers of these two.
        line: number of the line, from 0 on.
    """

    points: Points
    first: int
    last: int
    line: int

    @property
    def length(self) -> float:
        """Of all of it [m]."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    def waypoints(self, sweep: Sweep, every: float, speed: float, margin: float) -> list[Waypoint]:
        """Waypoints, photos so far apart [m], at a speed [m/s], and a margin of the legs between them [m]."""
        found = []
        for k, (x, y, z) in enumerate(self.points.tolist()):
            look = None
            if k == self.first:
                look = Look(pitch=math.radians(sweep.pitch), every=every, photo=self.first == self.last)
            if k == self.last:
                look = dataclasses.replace(look or Look(), every=0.0)
            place = Waypoint((x, y, z), look=look)
            found.append(place if k == 0 else dataclasses.replace(place, margin=margin, speed=speed))
        return found


@dataclasses.dataclass(frozen=True)
class Lost:
    """Photos of a line that cannot be taken where they were to be.

    Attributes:
        photos: how many.
        line: number of the line, from 0 on.
        place: middle of where they were to be taken [m].
        reason: why.
    """

    photos: int
    line: int
    place: tuple[float, float, float]
    reason: Reason

    def __str__(self) -> str:
        x, y, z = self.place
        where = f"{self.photos} photos of line {self.line + 1} around x {x:.1f}, y {y:.1f}, z {z:.1f}"
        return f"{where} are lost: {_WORDS[self.reason]}"


def runs_of(
    lines: list[Line], below: Below, free: FreeSpace, sweep: Sweep, every: float
) -> tuple[list[Run], list[Lost]]:
    """What is flown of some lines, and the photos that are lost.

    Args:
        lines: in plan [m], in order and direction.
        below: what lies below.
        free: the air.
        sweep: how far above, and room to turn.
        every: distance from one photo to the next [m].
    """
    runs, lost = list[Run](), list[Lost]()
    for number, line in enumerate(lines):
        points, first, last = _with_turns(line, below, sweep)
        held = free.holds(points)
        parts = [(a, b) for a, b in _stretches(held[first : last + 1])]
        for k, (a, b) in enumerate(parts):
            begin = _back(held, first) if k == 0 and a == 0 else first + a
            end = _on(held, last) if k == len(parts) - 1 and first + b == last else first + b
            runs.append(_run(points, (begin, first + a, first + b, end), number, free, sweep.distance))
        lost += _lost(points[first : last + 1], held[first : last + 1], number, free, every)
    return runs, lost


def _with_turns(line: Line, below: Below, sweep: Sweep) -> tuple[Points, int, int]:
    """Samples of a line with room to turn at both ends, and where the line itself begins and ends."""
    if not sweep.turn:
        points = lift(line, below, sweep.distance)
        return points, 0, len(points) - 1
    ends = []
    for end, inner in ((line[0], line[1]), (line[-1], line[-2])):
        way = end - inner
        ends.append(end + sweep.turn * way / np.linalg.norm(way))
    points = lift(np.concatenate([ends[0][None], line, ends[1][None]]), below, sweep.distance)
    count = max(1, math.ceil(sweep.turn))
    return points, count, len(points) - 1 - count


def _stretches(held: Bool[np.ndarray, " n"]) -> list[tuple[int, int]]:
    """First and last numbers of what is held without a break."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], held, [False]]).astype(int)))
    return [(a, b - 1) for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)]


def _back(held: Bool[np.ndarray, " n"], k: int) -> int:
    """How far back from a place all is held."""
    while k > 0 and held[k - 1]:
        k -= 1
    return k


def _on(held: Bool[np.ndarray, " n"], k: int) -> int:
    """How far on from a place all is held."""
    while k + 1 < len(held) and held[k + 1]:
        k += 1
    return k


def _run(points: Points, marks: tuple[int, int, int, int], line: int, free: FreeSpace, distance: float) -> Run:
    """The run between marks: where it begins, where photos do, where these end, and where it does."""
    kept = set[int]()
    for a, b in itertools.pairwise(marks):
        kept |= {a + k for k in _legs(points[a : b + 1], free, distance)}
    numbers = sorted(kept)
    return Run(points[numbers], numbers.index(marks[1]), numbers.index(marks[2]), line)


def _legs(points: Points, free: FreeSpace, distance: float) -> list[int]:
    """Numbers of points between which straight legs are free, few of them."""
    numbers = legs_along(points, distance)
    while True:
        pairs = np.array(list(itertools.pairwise(numbers)), np.int64).reshape(-1, 2)
        clear = straight_legs(points, pairs[:, 0], pairs[:, 1], free) | (np.diff(pairs, axis=1)[:, 0] <= 1)
        if clear.all():
            return numbers
        numbers = sorted({*numbers, *pairs[~clear].mean(axis=1).astype(int).tolist()})


def _lost(points: Points, held: Bool[np.ndarray, " n"], line: int, free: FreeSpace, every: float) -> list[Lost]:
    """Photos that were to be taken where nothing may fly."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1))])
    found = []
    for a, b in _stretches(~held):
        photos = math.floor(along[b] / every + 1e-9) - math.ceil(along[a] / every - 1e-9) + 1
        if photos > 0:
            x, y, z = points[(a + b) // 2].tolist()
            part, low, high = points[a : b + 1], np.array(free.grid.origin), np.array(free.grid.upper)
            beyond = ((part < low) | (part > high - 0.5 * free.grid.spacing)).any(axis=1)
            closed = free.closed(part).mean() > 0.5
            found.append(
                Lost(photos, line, (x, y, z), "beyond" if beyond.mean() > 0.5 else "closed" if closed else "blocked")
            )
    return found
