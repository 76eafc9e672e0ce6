"""Importing MJX, which takes a second, without what it prints: that Warp, which nothing here needs, is missing."""

from __future__ import annotations

import contextlib
import functools
import io
import sys
from types import ModuleType

_MISSING = ("Failed to import warp:", "Failed to import mujoco_warp:")


@functools.cache
def import_mjx() -> ModuleType:
    """The module `mujoco.mjx`; what else its import prints comes on stderr, as stdout is for results."""
    heard = io.StringIO()
    with contextlib.redirect_stdout(heard):
        from mujoco import mjx
    for line in heard.getvalue().splitlines():
        if not line.startswith(_MISSING):
            print(line, file=sys.stderr)
    module: ModuleType = mjx
    return module
