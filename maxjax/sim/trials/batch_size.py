"""How many flights fly at a time: what memory holds, a multiple of the number of devices.

on a CPU    one flight a device; any size that is asked for, as far as it fits into free memory
on a GPU    as many as fit, 4096 a device at most, of which 512 are computed at a time (`sim.loop.flight`):
                free >= PROGRAM + FLIGHT n + AT_ONCE min(n, 512)
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence

import jax

from maxjax.sim.loop.flight import AT_ONCE, FlightConfig

# Measured on one H100 with maps of 101³, 500 and 2,000 flights: memory for a voxel of a flight, for one of those that
# are computed at a time, and for any batch [B].
_FLIGHT, _COMPUTED, _PROGRAM = 1.5e6 / 101**3, 18e6 / 101**3, 1e9
# Larger batches would be written down too seldom: as many take a quarter of a minute.
_LARGEST = 4096


def first_size(
    config: FlightConfig, devices: Sequence[jax.Device], wanted: int | None, warn: Callable[[str], None]
) -> int:
    """Flights at a time to begin with, no more than memory holds.

    Args:
        config: how to fly; the shape of its map.
        devices: to fly on.
        wanted: chosen by the user, or that of an earlier run; None: the default of the devices.
        warn: called with a sentence when that size does not fit.
    """
    count, on_cpu = len(devices), devices[0].platform == "cpu"
    free = free_memory(devices[0]) / (count if on_cpu else 1)
    fits = count * _fitting(max(free - _PROGRAM, 0.0), math.prod(config.shape))
    if wanted is None:
        # Two cores gain nothing from a second flight, and lose where one takes longer than another.
        return count if on_cpu else count * min(_LARGEST, max(fits // count, 1))
    size = round_up(wanted, count)
    # The allocator of a GPU reports failure. A host would start to swap, and then end the process.
    while on_cpu and size > count and size > fits:
        size = halve(size, devices, warn)
    return size


def _fitting(free: float, voxels: int) -> int:
    """Flights that so much memory holds."""
    most = int(free / ((_FLIGHT + _COMPUTED) * voxels))
    return most if most <= AT_ONCE else int((free / voxels - _COMPUTED * AT_ONCE) / _FLIGHT)


def halve(size: int, devices: Sequence[jax.Device], warn: Callable[[str], None]) -> int:
    """The next smaller batch.

    Raises:
        MemoryError: if there is none.
    """
    count = len(devices)
    free = free_memory(devices[0]) / 1e9
    if size <= count:
        raise MemoryError(f"one flight does not fit into the {free:.1f} GB free on a device; free some memory")
    smaller = max(size // 2 // count, 1) * count
    warn(f"A batch of {size} flights does not fit into {free:.1f} GB of free memory; going on with {smaller}.")
    return smaller


def round_up(size: int, count: int) -> int:
    """The least multiple of `count` that is no less than `size`."""
    return -(-size // count) * count


def free_memory(device: jax.Device) -> float:
    """Free memory of a device [B]; infinity where it is not known."""
    stats = device.memory_stats()
    if stats and "bytes_limit" in stats:
        return float(stats["bytes_limit"] - stats["bytes_in_use"])
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError, AttributeError):
        return math.inf
