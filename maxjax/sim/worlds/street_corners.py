"""Street corners: planning problems that a single scan shows, with towers on the straight line.

A sensor at a crossing looks into two streets; the start stands in one of them and the goal in the other.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool

from maxjax.core.grid import Grid, Point3

_STREET = (1.0, 17.0)  # heights that a flight in a street uses [m]
_TALL = 30.0  # what nobody flies over to save length [m]
_APART = (60.0, 90.0)
_REACH = 75.0  # of the corner from the middle of the city [m]
_CLEAR = 9.0  # of start, goal and sensor from buildings, horizontally [m]
_HEIGHTS = (4.0, 10.0)  # of start, goal and sensor [m]
_DRAWS = 50_000
_TRIALS = 12


@dataclasses.dataclass(frozen=True)
class Corner:
    """A problem: where the sensor hovers, where the flight starts and ends [m]."""

    sensor: Point3
    start: Point3
    goal: Point3


def corners(occupied: Bool[np.ndarray, "nx ny nz"], grid: Grid, seed: int) -> list[Corner]:
    """Street corners, best first: of many drawn triples, those whose straight line runs through towers the longest.

    Args:
        occupied: the city without its ground.
        grid: its grid.
        seed: of the draws; equal seeds give equal corners.

    Raises:
        ValueError: if no triple qualifies.
    """
    height = grid.origin[2] + grid.spacing * np.arange(grid.shape[2])
    street = (height > _STREET[0]) & (height < _STREET[1])
    built = np.any(occupied[:, :, street], axis=2)
    tall = np.any(occupied[:, :, height > _TALL], axis=2)
    from scipy import ndimage  # a quarter of a second that most commands can do without

    clearance = grid.spacing * ndimage.distance_transform_edt(~built)
    middle = np.asarray(grid.origin[:2])
    rng = np.random.default_rng(seed)
    places = np.argwhere(clearance >= _CLEAR) * grid.spacing + middle
    places = places[np.abs(places).max(axis=1) <= _REACH]
    if len(places) == 0:
        raise ValueError(f"seed {seed}: this city has no open street; choose another seed")
    triples = places[rng.integers(0, len(places), (_DRAWS, 3))]
    sensor, start, goal = triples.swapaxes(0, 1)

    def along(values: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Values on the straight lines from a to b, at 64 points each."""
        x = a[:, None] + np.linspace(0.0, 1.0, 64)[:, None] * (b - a)[:, None]
        index = np.round((x - middle) / grid.spacing).astype(int)
        return np.asarray(values[index[..., 0], index[..., 1]])

    apart = np.linalg.norm(goal - start, axis=1)
    good = (apart >= _APART[0]) & (apart <= _APART[1])
    for end in (start, goal):
        good &= along(clearance, sensor, end).min(axis=1) >= 0.5 * _CLEAR
    walled = np.where(good, along(tall, start, goal).mean(axis=1), 0.0)
    heights = np.round(rng.uniform(*_HEIGHTS, (_DRAWS, 3)), 1)
    chosen: list[int] = []
    for i in np.argsort(-walled, kind="stable"):
        if walled[i] == 0 or len(chosen) == _TRIALS:
            break
        # Another view, not the last one a metre further.
        if all(np.abs(triples[i] - triples[j]).max() > _CLEAR for j in chosen):
            chosen.append(int(i))
    if not chosen:
        raise ValueError(f"seed {seed}: this city has no street corner with a tower; choose another seed")

    def point(i: int, k: int) -> Point3:
        x, y = triples[i, k]
        return (float(x), float(y), float(heights[i, k]))

    return [Corner(point(i, 0), point(i, 1), point(i, 2)) for i in chosen]
