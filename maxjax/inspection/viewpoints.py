"""Viewpoints for a surface: candidates, what they show, and few of them that show it as often as asked.

surface → candidates (free, in the gimbal's range) → sights (rays) → set multi-cover → viewpoints, coverage
"""

from __future__ import annotations

import dataclasses

import numpy as np

from maxjax.inspection.candidates import Aim
from maxjax.inspection.scenery import Scenery
from maxjax.inspection.seen_area import Coverage, unseen_parts
from maxjax.inspection.set_cover import choose_photos
from maxjax.inspection.views import Views
from maxjax.inspection.visibility import Sights, find_sights


@dataclasses.dataclass(frozen=True, eq=False)
class Viewpoints:
    """Views to take photos from.

    Attributes:
        views: of them, in no order.
        coverage: what they show.
        tried: how many views they were chosen from.
        least: no fewer of these show as much.
    """

    views: Views
    coverage: Coverage
    tried: int
    least: int


def find_viewpoints(aim: Aim, scenery: Scenery) -> Viewpoints:
    """Viewpoints that show a surface as often as asked, where anything that may be flown to does.

    Args:
        aim: surface, free space, camera and what photos are to be like.
        scenery: what hides.

    Raises:
        ValueError: if nothing that may be flown to shows anything of it.
    """
    surface, wanted = aim.surface, aim.capture.views
    views, sights = find_candidates(aim, scenery)
    unseen = np.flatnonzero(np.bincount(sights.point, minlength=len(surface)) == 0)
    parts = unseen_parts(surface, unseen, aim.reasons(unseen), aim.spacing)
    if len(unseen) == len(surface):
        raise ValueError(f"target: expected something of {surface.name} to be seen from where may be flown: {parts[0]}")
    choice = choose_photos(sights.matrix, surface.points, surface.areas, wanted)
    chosen = choice.photos
    resolution = aim.capture.limits(aim.camera).resolution
    coverage = Coverage.of(surface, _of(sights, chosen), wanted, resolution, parts)
    return Viewpoints(views.some(chosen), coverage, len(views), choice.least)


def find_candidates(aim: Aim, scenery: Scenery) -> tuple[Views, Sights]:
    """Views that photos are chosen from, and what they show.

    Args:
        aim: surface, free space, camera and what photos are to be like.
        scenery: what hides.
    """
    surface, limits = aim.surface, aim.capture.limits(aim.camera)
    views = aim.first_views()
    sights = find_sights(views, surface, scenery, aim.camera, limits)
    missing = np.bincount(sights.point, minlength=len(surface)) < aim.capture.views
    if not missing.any():
        return views, sights
    more = aim.more_views(missing, views)
    return views.joined(more), _both(sights, find_sights(more, surface, scenery, aim.camera, limits))


def _both(first: Sights, second: Sights) -> Sights:
    """Sights of some views and of others, numbered on."""
    pairs = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in ("point", "incidence", "resolution")
    }
    photo = np.concatenate([first.photo, second.photo + first.shape[0]])
    return Sights(photo=photo, **pairs, shape=(first.shape[0] + second.shape[0], first.shape[1]))


def _of(sights: Sights, chosen: np.ndarray) -> Sights:
    """Sights of some views, numbered as these."""
    number = np.full(sights.shape[0], -1)
    number[chosen] = np.arange(len(chosen))
    kept = number[sights.photo] >= 0
    pairs = {name: getattr(sights, name)[kept] for name in ("point", "incidence", "resolution")}
    return Sights(photo=number[sights.photo[kept]], **pairs, shape=(len(chosen), sights.shape[1]))
