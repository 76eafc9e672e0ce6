"""Measurements that may be of several movers: those of which a track learns nothing, so that its set stays true.

    several:   the sets of two confirmed tracks or more hold what was measured: either may be it
    merged:    a confirmed track in plain view found nothing of its own, and its body may be a part of this one

A set that is propagated without a measurement holds its mover, whatever was measured; one that is intersected with
what belongs to another does not. So where movers pass each other their sets grow for some looks, and tell them apart
once they are apart. A set that has grown wide tells nothing apart any more: then what may be it is taken for it.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Bool, Int32

from maxjax.sim.movers.detection import Detections
from maxjax.sim.movers.reachable_sets import Tracks

# Width of a set from which on it tells no mover from another [m].
_WIDE = 3.0


def is_ambiguous(
    tracks: Tracks,
    seen: Detections,
    consistent: Bool[Array, "s d"],
    chosen: Int32[Array, " s"],
    plain: Bool[Array, " s"],
) -> Bool[Array, " s"]:
    """Tracks whose measurement may be another one's as well.

    Args:
        tracks: at the time of the look, before it.
        seen: measurements.
        consistent: whether the set of a track holds a measurement.
        chosen: measurement of each track, or -1.
        plain: tracks that would be seen, were they alone.
    """
    confirmed = tracks.used & tracks.confirmed
    several = jnp.sum(consistent & confirmed[:, None], axis=0) > 1
    low, high = tracks.low - tracks.half, tracks.high + tracks.half
    touches = jnp.all((low[:, None] <= seen.seen_high[None]) & (seen.seen_low[None] <= high[:, None]), axis=-1)
    missing = confirmed & (chosen < 0) & plain
    merged = jnp.any(touches & missing[:, None], axis=0)
    narrow = jnp.all(tracks.high - tracks.low < _WIDE, axis=-1)
    ambiguous: Array = (chosen >= 0) & (several | merged)[jnp.maximum(chosen, 0)] & confirmed & narrow
    return ambiguous
