"""Independent judges of a plan: SciPy's distance transform and labels, scikit-fmm's eikonal geodesic.

Nothing here imports maxjax or JAX, so it runs in worker processes beside a device.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from scipy import ndimage

_STEP = 0.02  # spacing of the samples along a path [voxels]


@dataclasses.dataclass(frozen=True)
class Case:
    """A problem and what was planned, in voxels; small enough to send to a worker."""

    occupied: np.ndarray  # packed bits of (nx, ny, nz)
    ground: np.ndarray  # packed bits
    shape: tuple[int, int, int]
    start: np.ndarray  # (3,) index coordinates
    goal: np.ndarray
    rungs: tuple[float, ...]  # margins tried, largest first [voxels]
    margin: float  # the one reported [voxels]
    path: np.ndarray  # (t, 3) index coordinates, empty if none
    measured: bool = True  # whether its length is judged too, which takes longest


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What the oracles say of a case."""

    margin: float | None  # the largest rung at which start and goal share a component; None if none
    unsafe: bool  # some sample of the path lies in a voxel within the margin
    geodesic: float  # eikonal distance on the dilated grid [voxels]; NaN where there is none or it was not asked for


def distances(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Distance of every voxel to the obstacles and to the ground [voxels], by SciPy's exact transform."""
    size = int(np.prod(case.shape))
    occupied, ground = (
        np.unpackbits(bits, count=size).reshape(case.shape).astype(bool) for bits in (case.occupied, case.ground)
    )
    return distance(occupied & ~ground), distance(ground)


def distance(mask: np.ndarray) -> np.ndarray:
    """Distance of every voxel to the centre of one of a set [voxels]; infinite where it is empty."""
    return np.asarray(ndimage.distance_transform_edt(~mask)) if mask.any() else np.full(mask.shape, np.inf)


def blocked_at(near: np.ndarray, low: np.ndarray, radius: float) -> np.ndarray:
    """The grid dilated by `radius` voxels, its ground by one at most."""
    return np.asarray((near <= radius + 1e-6) | (low <= min(radius, 1) + 1e-6))


def judge(case: Case) -> Verdict:
    """Reachability by `ndimage.label`, safety by dense sampling, length by second-order fast marching."""
    start, goal = (tuple(np.floor(x + 0.5).astype(int)) for x in (case.start, case.goal))
    near, low = distances(case)
    margin = None
    for radius in case.rungs:
        blocked = blocked_at(near, low, radius)
        if blocked[start] or blocked[goal]:
            continue
        labels, _ = ndimage.label(~blocked)
        if labels[start] == labels[goal]:
            margin = radius
            break
    if len(case.path) == 0:
        return Verdict(margin, False, np.nan)
    blocked = blocked_at(near, low, case.margin)
    return Verdict(margin, _unsafe(case.path, blocked), _geodesic(case, blocked) if case.measured else np.nan)


def _unsafe(path: np.ndarray, blocked: np.ndarray) -> bool:
    for a, b in itertools.pairwise(path):
        count = int(np.ceil(np.linalg.norm(b - a) / _STEP)) + 1
        samples = a + np.linspace(0, 1, count)[:, None] * (b - a)
        index = np.floor(samples + 0.5).astype(int)
        if np.any(index < 0) or np.any(index >= blocked.shape) or blocked[tuple(index.T)].any():
            return True
    return False


def _geodesic(case: Case, blocked: np.ndarray) -> float:
    """Travel time at unit speed from a small ball around the goal, plus the ball's radius."""
    import skfmm  # an extra; the sampler beside this judge does without

    offset = np.stack(np.meshgrid(*[np.arange(n) for n in case.shape], indexing="ij"), -1) - case.goal
    distance = np.linalg.norm(offset, axis=-1)
    # A larger ball starts fast marching from a smoother front; it must not reach the nearest wall.
    walls = distance[blocked].min() if blocked.any() else np.inf
    radius = float(np.clip(walls - 1, 1, 5))
    if np.linalg.norm(case.start - case.goal) <= radius:
        return float(np.linalg.norm(case.start - case.goal))
    time = skfmm.travel_time(np.ma.MaskedArray(distance - radius, blocked), np.ones(case.shape), order=2)
    # Trilinear among the free voxels around the start.
    base = np.clip(np.floor(case.start).astype(int), 0, np.array(case.shape) - 2)
    fraction = case.start - base
    total = weight = 0.0
    for corner in np.ndindex(2, 2, 2):
        index = tuple(base + corner)
        share = float(np.prod(np.where(corner, fraction, 1 - fraction)))
        if not time.mask[index] if np.ndim(time.mask) else True:
            total, weight = total + share * float(time[index]), weight + share
    return total / weight + radius
