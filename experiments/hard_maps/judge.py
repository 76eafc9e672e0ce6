"""The judge of one problem: what its status must be, and whether its path keeps the radius.

    joined at the radius → OK; below it alone → NO_SAFE_PATH with the largest radius that joins; else NO_VALID_PATH

Nothing here imports maxjax or JAX.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from benchmarks.common.dilation import joined
from benchmarks.common.safety import Walls, kept

# Rounding that a path is allowed [voxels].
_SLACK = 1.3e-3


@dataclasses.dataclass(frozen=True)
class Answer:
    """A problem and what was said of it, in voxels; `path` (t, 3) is empty without one, `named` a radius or NaN."""

    occupied: np.ndarray
    ends: np.ndarray
    radius: float
    status: str
    named: float
    path: np.ndarray


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What is so: whether the ends are joined, and whether status and path are right."""

    joined: bool
    right: bool
    safe: bool


def judge(answer: Answer) -> Verdict:
    """A problem's verdict."""
    voxels = np.floor(answer.ends + 0.5).astype(int)
    joins = joined(answer.occupied, answer.radius, voxels)
    if joins:
        right = answer.status == "OK"
    elif joined(answer.occupied, 0.0, voxels):
        right = answer.status == "NO_SAFE_PATH" and _largest(answer, voxels)
    else:
        right = answer.status == "NO_VALID_PATH"
    return Verdict(joins, right, answer.status != "OK" or _safe(answer))


def _largest(answer: Answer, voxels: np.ndarray) -> bool:
    """Whether the named radius joins the ends and the next distance between centres and cubes does not."""
    quarters = 4 * answer.named**2  # distances are roots of whole numbers, halved
    above = np.sqrt(np.floor(quarters + 1e-6) + 1) / 2
    return joined(answer.occupied, answer.named, voxels) and not joined(answer.occupied, above, voxels)


def _safe(answer: Answer) -> bool:
    path = answer.path
    if len(path) < 2 or not np.allclose(path[[0, -1]], answer.ends, atol=1e-4):
        return False
    found = kept(Walls(answer.occupied, np.zeros_like(answer.occupied), 1.0), path)
    return not found.occupied and found.least >= answer.radius - _SLACK
