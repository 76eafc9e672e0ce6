"""Images of problems, in a mirror and moved, which ask for the same path: what the planner makes of each.

A mirror turns what decides between equals: a point on a face belongs to the voxel on its greater side, here and in the
mirror. And the solver stops where no voxel would change by more than its tolerance, which it reaches otherwise where
its aggregates begin elsewhere; so of two ways that cost nearly the same it may take either.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import maxjax
from experiments.hard_maps.maps import Problems

SPACING = 2.0
"""Edge of a voxel [m]."""

WORST = ("worst_mirrored", "worst_mirrored_on_faces", "worst_moved", "worst_again")
"""Counts that are greatest values: what the dearer of two images costs more, as a share."""

DEARER = 0.02
"""Beyond this share two images are planned again, to a tighter tolerance."""

_FIELD = maxjax.Field()
_ACCURATE = maxjax.Field(solver=maxjax.Screened(tolerance=1e-4))
_FAR = (84888.0, 447501.0, 0.0)  # where the moved maps lie [m]
_PAD = 3  # how much wider the solid is in which maps are moved [voxels]


def compared(problems: Problems, plans: maxjax.Plans, radius: float, axis: int) -> dict[str, Any]:
    """Counts of the images of problems, and what of two of them costs more.

    Args:
        problems: some of one kind.
        plans: theirs.
        radius: [voxels].
        axis: that is mirrored.
    """
    mirror, near = problems.mirrored(axis), problems.embedded((1, 1, 2), _PAD)
    far = problems.embedded((2, 2, 1), _PAD)
    mirrored, here, there = planned(mirror, radius), planned(near, radius), planned(far, radius, _FAR)
    faces, reflected, moved = problems.on_faces, _apart(plans, mirrored), _apart(here, there)
    # Where the field's tolerance decides between ways, a tighter one decides alike.
    unlike = (problems, mirror, (reflected > DEARER) & ~faces), (near, far, moved > DEARER)
    again = [
        _apart(*(planned(one.some(which), radius, planner=_ACCURATE) for one in pair)).max()
        for *pair, which in unlike
        if which.any()
    ]
    counts = {
        "images": len(plans),
        "mirrored_otherwise": int((mirrored.status != plans.status).sum()),
        "moved_otherwise": int((here.status != there.status).sum()),
        "unlike": int(sum(which.sum() for *_, which in unlike)),
    }
    worst = reflected[~faces], reflected[faces], moved, np.array(again)
    return counts | {name: round(float(one.max(initial=0.0)), 6) for name, one in zip(WORST, worst, strict=True)}


def planned(
    problems: Problems,
    radius: float,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    planner: maxjax.Field = _FIELD,
) -> maxjax.Plans:
    """The plans of problems on a grid whose first voxel's centre lies at `origin` [m]; radius in voxels."""
    n = problems.occupied.shape[1]
    grid = maxjax.Grid((n, n, n), SPACING, origin)
    starts, goals = (np.array(origin) + SPACING * problems.ends[:, k] for k in range(2))
    distances = maxjax.Distances(radius=SPACING * radius)
    city = maxjax.VoxelMap.on(grid, problems.occupied)
    return maxjax.plan_batch(city, starts, goals, planner=planner, distances=distances)


def _apart(one: maxjax.Plans, other: maxjax.Plans) -> np.ndarray:
    """How much more the dearer of two plans costs, as a share; 0 where not both are OK."""
    with np.errstate(invalid="ignore"):
        ratio = np.maximum(one.cost / other.cost, other.cost / one.cost) - 1.0
    return np.where(one.ok & other.ok, ratio, 0.0)
