"""A jitted function whose compilation is timed by itself: `Program`."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import Any

import jax

from maxjax.planning.recorder import timed


class Program:
    """A jitted function that is compiled before its first call, so that compilation can be timed apart.

    Arguments are pytrees of arrays, keywords are static; one executable is kept for each combination of shapes, dtypes
    and keywords.
    """

    def __init__(self, name: str, function: Callable[..., Any], static: tuple[str, ...] = ()) -> None:
        self.name = name
        self._jit = jax.jit(function, static_argnames=static)
        self._compiled: dict[Hashable, Callable[..., Any]] = {}

    def __call__(self, *arrays: Any, **static: Any) -> Any:
        """Run, blocked until ready; timed under the program's name."""
        ready = self._executable(arrays, static)
        with timed(self.name):
            return jax.block_until_ready(ready(*arrays))

    def start(self, *arrays: Any, **static: Any) -> Any:
        """Run without waiting for the result; only compilation is timed."""
        return self._executable(arrays, static)(*arrays)

    def _executable(self, arrays: tuple[Any, ...], static: Mapping[str, Any]) -> Callable[..., Any]:
        leaves, tree = jax.tree.flatten(arrays)
        key = (tree, tuple((x.shape, x.dtype) for x in leaves), tuple(sorted(static.items())))
        if key not in self._compiled:
            with timed("compile"):
                self._compiled[key] = self._jit.lower(*arrays, **static).compile()
        return self._compiled[key]
