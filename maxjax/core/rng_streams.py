"""Random streams: the key that every random number of a city, a trial and a flight is drawn from.

    city                  named(key(seed), MAP)
    trial i               fold_in(named(key(seed), "trials MAP"), i)
    flight of trial i     fold_in(named(key(seed), "flights MAP"), i)
    its movers            fold_in(named(key(seed), "movers MAP"), i)
    swaps of a fleet      named(key(seed), "swaps MAP")
    flight of vehicle k   fold_in(named(key(seed), "fleet MAP"), k)
    inside a flight       stream(key of the flight, Stream.X, planning iteration)

The numbers are part of the definition of every recorded result: a changed number is another flight.
"""

from __future__ import annotations

import enum
import zlib

import jax
from jaxtyping import Array, Int32, PRNGKeyArray

# A stream drawn once a planning iteration has at least this many indices of its own.
ITERATIONS = 9000


class Stream(enum.IntEnum):
    """Streams of one flight: the first index that each one folds into the flight's key.

    The first four are drawn from once a flight, the others once a planning iteration.
    """

    WIND_DIRECTION = 1
    DRIFT_DIRECTION = 2
    SENSOR_OUTAGE = 3
    FIRST_GUST = 4
    SCAN = 1_000
    VIEWPOINT = 10_000
    GUSTS = 100_000
    FAULTS = 200_000


def stream(key: PRNGKeyArray, which: Stream, iteration: int | Int32[Array, ""] = 0) -> PRNGKeyArray:
    """The key of one stream of a flight.

    Args:
        key: of the flight.
        which: the stream.
        iteration: planning iterations so far, below `ITERATIONS`; 0 for a stream that is drawn from once.
    """
    return jax.random.fold_in(key, int(which) + iteration)


def named_key(key: PRNGKeyArray, name: str) -> PRNGKeyArray:
    """The key that belongs to a name, so that maps and purposes with one seed share no draws."""
    return jax.random.fold_in(key, zlib.crc32(name.encode()))
