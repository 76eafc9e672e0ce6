"""Moments of a flight among movers, on the host: tracks and the chosen motion, for films and pages.

position k of the log  ↔  moment k: the boxes that may hold movers now and later, the motion flown from then on
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from maxjax.sim.loop.flight_state import Flight
from maxjax.sim.movers.among import Among, Flag
from maxjax.sim.movers.motions import at, duration

_POINTS = np.linspace(0.0, 1.0, 13, dtype=np.float32)  # of a motion, shares of its duration


@dataclasses.dataclass(frozen=True)
class Moment:
    """Tracks and the chosen motion at a look; world frame.

    Attributes:
        boxes: lower and upper corners of those that may hold movers [m], at the shares `among.AHEAD` of the horizon.
        motion: points of the motion that is flown, to its place of rest [m].
        flags: that are up.
    """

    boxes: Float[np.ndarray, "h b 2 3"]
    motion: Float[np.ndarray, "p 3"]
    flags: tuple[Flag, ...]


def moments_of(flights: Sequence[Flight]) -> list[Moment]:
    """A moment for each position of a flight's log; none where no movers were expected.

    Args:
        flights: before its first planning period and after each, as `sim.loop.flight.watch` yields them.
    """
    records = [flight.part(Among).record for flight in flights[1:] if flight.has(Among)]
    if not records:
        return []
    record = jax.tree.map(lambda *parts: jnp.concatenate(parts), *records)
    corners = np.stack([np.asarray(record.least), np.asarray(record.greatest)], axis=-2)
    up = np.asarray(record.up)
    lasts = duration(record.flown.motion)
    motions = np.stack([np.asarray(at(record.flown.motion, share * lasts)[0]) for share in _POINTS], axis=1)
    looks = int(np.isfinite(np.asarray(flights[-1].log.position)).all(axis=1).sum()) - 1
    found = []
    for k in range(looks):
        used = np.isfinite(corners[k]).all(axis=(0, 2, 3))
        flags = tuple(flag for flag in Flag if up[k, flag])
        found.append(Moment(corners[k][:, used], motions[k], flags))
    # Nothing is chosen at the last position.
    return [*found, *found[-1:]]
