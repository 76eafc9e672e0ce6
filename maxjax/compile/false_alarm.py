"""Silence XLA's false alarm about executables that are read back.

On machines with AVX-512, XLA reports of each kept executable that it was compiled for another machine (jax-ml/jax issue
38445): its list of features holds preferences that no machine states. It writes below Python, to the file descriptor of
standard error, at a level that can be set only before JAX is imported. So what is written while an executable is read
is gathered, and written on without those lines.
"""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import threading
from collections.abc import Iterator

_ALARM = b"cpu_aot_loader"
_STDERR = 2
_LOCK = threading.Lock()


@contextlib.contextmanager
def without_false_alarm() -> Iterator[None]:
    """Leave out lines of XLA's loader of executables from standard error; others come when the context ends."""
    with _LOCK, contextlib.ExitStack() as stack:
        try:
            gathered = stack.enter_context(tempfile.TemporaryFile())
            kept = os.dup(_STDERR)
        except OSError:  # no room, or no standard error: nothing is left out
            yield
            return
        stack.callback(os.close, kept)
        if sys.stderr is not None:
            sys.stderr.flush()
        os.dup2(gathered.fileno(), _STDERR)
        try:
            yield
        finally:
            os.dup2(kept, _STDERR)
            gathered.seek(0)
            for line in gathered:
                if _ALARM not in line:
                    os.write(_STDERR, line)
