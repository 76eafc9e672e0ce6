"""Where the time of a plan goes: a recorder that is found by context, so that it stands in no signature.

    with recording() as recorder:
        with timed("solve"):
            ...
    recorder.report()    # {"compile": 0.0, "solve": 0.02, "total": 0.02}

`time_stage` books on the innermost `recording` of the same context, and nowhere if there is none. A new thread has a
context of its own: what it does is not booked.
"""

from __future__ import annotations

import contextlib
import contextvars
import time
from collections.abc import Iterator, Mapping


class Recorder:
    """Seconds by name, compilation apart."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {"compile": 0.0}

    def book(self, name: str, seconds: float) -> None:
        """Add to what was booked under this name."""
        self.seconds[name] = self.seconds.get(name, 0.0) + seconds

    def report(self, shares: int = 1) -> dict[str, float]:
        """All that was booked, and `total` without compilation; of each, one of so many equal shares [s]."""
        seconds = {name: spent / shares for name, spent in self.seconds.items()}
        return {**seconds, "total": sum(spent for name, spent in seconds.items() if name != "compile")}


_RECORDER: contextvars.ContextVar[Recorder | None] = contextvars.ContextVar("recorder", default=None)


@contextlib.contextmanager
def recording() -> Iterator[Recorder]:
    """A new recorder for what is `time_stage` inside."""
    recorder = Recorder()
    token = _RECORDER.set(recorder)
    try:
        yield recorder
    finally:
        _RECORDER.reset(token)


@contextlib.contextmanager
def time_stage(name: str) -> Iterator[None]:
    """Book the wall-clock time of a block of code, less what it books as `compile`; one that raises is not booked."""
    recorder, started = _RECORDER.get(), time.perf_counter()
    if recorder is None:
        yield
        return
    before = recorder.seconds["compile"]
    yield
    recorder.book(name, time.perf_counter() - started - (recorder.seconds["compile"] - before))


def sum_reports(first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
    """Two reports in one."""
    return {name: first.get(name, 0.0) + second.get(name, 0.0) for name in {**first, **second}}
