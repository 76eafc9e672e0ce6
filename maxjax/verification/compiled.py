"""The verdicts of `verifier.plain_verdicts` by `verifier.cpp`: the same, many times as fast, where there is a compiler.

The library is built in a thread when a verdict is first asked for, and kept (`compile.native`); until it is there, the
plain verifier judges. A call of it leaves the interpreter to other threads.
"""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from maxjax.compile import native
from maxjax.verification.asked import Asked
from maxjax.verification.verdicts import Verdicts

SOURCE = Path(__file__).with_name("verifier.cpp")

# `Verdict` of the source.
_VERDICT = np.dtype(
    [(name, np.float64) for name in ("length", "clearance", "cruise_clearance")]
    + [(name, np.float64, 3) for name in ("nearest", "cruise_nearest")]
    + [("first_hit", np.int64, 3)]
    + [(name, np.bool_) for name in ("ok", "inside", "finite", "too_near")],
    align=True,
)
_NO_MEMORY = 2


class _Request(ctypes.Structure):
    """`Request` of the source."""

    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("points", "counts", "map_of", "exemptions")),
        *((name, ctypes.c_void_p) for name in ("occupied", "ground", "blocked")),
        *((f"next_{name}", ctypes.c_int64) for name in ("occupied", "ground", "blocked")),
        *((name, ctypes.c_int64) for name in ("paths", "width", "maps")),
        ("shape", 3 * ctypes.c_int64),
        ("origin", 3 * ctypes.c_double),
        *((name, ctypes.c_double) for name in ("spacing", "radius", "tolerance", "allowed", "cruise")),
        *((name, ctypes.c_void_p) for name in ("verdicts", "clearance_at")),
    )


def at_hand() -> ctypes.CDLL | None:
    """The library, if it takes no waiting."""
    return native.at_hand(SOURCE)


def compiled_verdicts(asked: Asked, library: ctypes.CDLL) -> Verdicts:
    """The verdicts of the library.

    Raises:
        MemoryError: where memory did not suffice.
        RuntimeError: where the library finds a path without a map, or without a point.
    """
    paths, grid = asked.paths, asked.grid
    points = np.ascontiguousarray(paths.points, np.float64)
    counts, map_of = (np.ascontiguousarray(numbers, np.int64) for numbers in (paths.counts, paths.map_of))
    exemptions = np.ascontiguousarray(asked.exemptions)
    occupied, ground = _in_order(asked.volumes.occupied), _in_order(asked.volumes.ground)
    blocked = None if asked.volumes.blocked is None else _in_order(asked.volumes.blocked)
    verdicts, clearance_at = np.empty(len(counts), _VERDICT), np.empty(points.shape[:2])
    request = _Request(
        *(array.ctypes.data for array in (points, counts, map_of, exemptions, occupied, ground)),
        None if blocked is None else blocked.ctypes.data,
        *(0 if volume is None else volume.strides[0] for volume in (occupied, ground, blocked)),
        *points.shape[:2],
        len(occupied),
        grid.shape,
        grid.origin,
        *(grid.spacing, asked.kept, asked.tolerance, asked.allowed, asked.cruise),
        *(verdicts.ctypes.data, clearance_at.ctypes.data),
    )
    failed = library.verify_paths(ctypes.byref(request))
    if failed == _NO_MEMORY:
        raise MemoryError(f"verifier: no memory for {len(counts)} paths in maps of {grid.shape}")
    if failed:
        raise RuntimeError("verifier.cpp refuses what `Asked` has checked: a path without a map, or without a point")
    fields = {name: verdicts[name] for name in _VERDICT.names or ()}
    return Verdicts(**fields, clearance_at=clearance_at, counts=paths.counts)


def _in_order(volumes: Bool[np.ndarray, "m nx ny nz"]) -> Bool[np.ndarray, "m nx ny nz"]:
    """Maps of which each lies in one row, as the library reads them; one that stands for all remains one."""
    *_, ny, nz = volumes.shape
    if volumes.strides[1:] == (ny * nz, nz, 1):
        return volumes
    if volumes.strides[0] == 0:
        return np.broadcast_to(np.ascontiguousarray(volumes[:1]), volumes.shape)
    return np.ascontiguousarray(volumes)
