"""A jitted function whose compilation is timed by itself: `Program`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax

from maxjax.compile.executable import Stored
from maxjax.compile.stage_timer import time_stage


class Program:
    """A jitted function that is compiled before its first call, so that compilation can be timed apart.

    Arguments are pytrees of arrays, keywords are static; one executable is kept for each combination of shapes, dtypes
    and keywords, also for later processes (`compile.executable`).
    """

    def __init__(self, name: str, function: Callable[..., Any], static: tuple[str, ...] = ()) -> None:
        self.name = name
        self._stored = Stored(name, function, static)

    def __call__(self, *arrays: Any, **static: Any) -> Any:
        """Run, blocked until ready; timed under the program's name."""
        ready = self._stored.executable(arrays, static, _compile)
        with time_stage(self.name):
            return jax.block_until_ready(ready(*arrays))

    def start(self, *arrays: Any, **static: Any) -> Any:
        """Run without waiting for the result; only compilation is timed."""
        return self._stored.executable(arrays, static, _compile)(*arrays)

    def prepare(self, *arrays: Any, **static: Any) -> None:
        """Compile for arguments like these, of which only shapes and dtypes are read."""
        self._stored.executable(arrays, static, _compile)


def _compile() -> Any:
    return time_stage("compile")
