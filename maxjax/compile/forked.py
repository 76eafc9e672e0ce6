"""Refuse to run in a copy of a process (`os.fork`) that JAX has run in, where every program would wait for ever.

JAX's threads do not come along into the copy, and their locks stay held. A process of its own, `spawn` or
`forkserver` of `multiprocessing`, has its own.
"""

from __future__ import annotations

import os
import sys

_running = False
_forked = False


def refuse_after_fork() -> None:
    """Find out whether this process can run programs; called before the first one.

    Raises:
        RuntimeError: if it was forked from one in which JAX had run.
    """
    if _forked:
        raise RuntimeError(
            "this process was forked from one in which JAX had run, and no program would end here; start it by 'spawn' "
            "or 'forkserver', as in multiprocessing.get_context('spawn').Pool(4), or fork before maxjax is first used"
        )


def _look() -> None:
    global _running
    # In the parent, since the lock that JAX takes to answer may stay held in the child. One that cannot be asked runs.
    bridge = sys.modules.get("jax._src.xla_bridge")
    _running = bridge is not None and getattr(bridge, "backends_are_initialized", lambda: True)()


def _note() -> None:
    global _forked
    _forked = _forked or _running


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_look, after_in_child=_note)
