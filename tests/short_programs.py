"""Programs as tests compile them: the same values, with less to trace and to compile (tests/conftest.py).

Turns of a loop are compiled once instead of several times over, and of what `compile.lowering` has in two forms only
that of a CPU is traced, which would otherwise be chosen behind both. Forms of accelerators have tests of their own.
"""

from __future__ import annotations

import jax

from maxjax.compile import lowering
from maxjax.sim.worlds import raycast

_WHOLE = raycast._UNROLL, lowering._TARGET
_SHORT = 1, jax.make_user_context("cpu")


def shorten(short: bool = True) -> None:
    """From now on; False: as users compile them."""
    raycast._UNROLL, lowering._TARGET = _SHORT if short else _WHOLE
