"""Windows on an accelerator: how many of them are planned at a time, and how many chunks of them.

One chunk is a program under `vmap`; of each shape of windows and each size that is used one is compiled.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Int64

from maxjax.compile.stage_timer import recording
from maxjax.compile.threads import concurrently
from maxjax.core.grid import Index3
from maxjax.planning.path.ascent import Ascent
from maxjax.planning.path.route import Routes, equal_shares
from maxjax.planning.planner import FieldClimber
from maxjax.planning.run.device_maps import DeviceMaps
from maxjax.planning.run.longer_ascents import with_longer_ascents
from maxjax.planning.run.pipeline import layout_of
from maxjax.planning.windows.focus_window import View
from maxjax.planning.windows.growth import WindowFinder

# Windows are small, and their kernels short: one of 512 takes a third to a half as long as one of 32. Voxels of all
# windows of a chunk.
_SIZES, _VOXELS = (32, 64, 128, 256, 512), 2**26
# While one chunk waits for its host, the device is busy with another.
_CHUNKS = 2


def finder_on_device(maps: DeviceMaps, planner: FieldClimber, chunk: int | None) -> WindowFinder:
    """Finds windows and their routes in maps on a device.

    Args:
        maps: on the device.
        planner: how.
        chunk: problems at a time. None: what suits an accelerator.
    """

    def full(shape: Index3) -> int:
        return chunk or max(size for size in _SIZES if size * math.prod(shape) <= _VOXELS or size == _SIZES[0])

    def size_of(view: View) -> int:
        count = min(len(view), full(view.grid.shape))
        return chunk or next(size for size in _SIZES if size >= count)

    def find(view: View) -> Routes:
        def attempt(which: Int64[np.ndarray, " n"], settings: Ascent) -> Routes:
            some = view.some(which)
            with recording() as recorder:
                route = maps.routes(some, planner.with_ascent(settings), size_of(some))
            return Routes(route, equal_shares(recorder, len(which)))

        return with_longer_ascents(attempt, len(view), planner.ascent)

    def prepare(views: list[View]) -> None:
        """Compile what the first windows need, side by side."""
        sizes = {layout_of(view): size_of(view) for view in views}
        for _ in concurrently(lambda layout: maps.prepare(layout, planner, sizes[layout]), sizes, len(sizes) or 1):
            pass

    return WindowFinder(find, maps.choose, full, _CHUNKS, prepare)
