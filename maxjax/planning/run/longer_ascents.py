"""Ascents that run out of steps, made again with more: a maze can need more of them than a city."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Int64

from maxjax.core.status import Status
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.path.route import Routes

FACTORS = (4, 16, 64, 256, 1024)
"""Steps of the further ascents, in terms of those of the first one, until one arrives."""


def with_longer_ascents(
    attempt: Callable[[Int64[np.ndarray, " n"], Ascent], Routes],
    count: int,
    settings: Ascent,
    factors: Sequence[int] = FACTORS,
) -> Routes:
    """Attempt several problems; those that stall go again, by themselves, with longer ascents.

    Args:
        attempt: (which of them, settings) ↦ a route for each.
        count: how many there are.
        settings: of the first attempt.
        factors: how many times as many steps each further attempt has.
    """
    results = attempt(np.arange(count), settings)
    for factor in factors:
        waiting = np.flatnonzero(results.route.status == Status.PATH_STALLED)
        if not waiting.size:
            break
        results = results.put(waiting, attempt(waiting, dataclasses.replace(settings, steps=settings.steps * factor)))
    return results
