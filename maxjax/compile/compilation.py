"""Messages about a compilation: its program, and how long it took last time.

    with told(print):
        ...                  # "compiling solve, 9 s last time", and "" when nothing compiles any more

Times are remembered by the program's name in the cache folder; where none is known, none is given.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from maxjax.compile.cache import cache_folder
from maxjax.core.files import atomic_write

Tell = Callable[[str], None]

_listening: list[Tell] = []
# Programs that compile now, in one thread or several, and how long each took last time.
_running: dict[object, tuple[str, float | None]] = {}
_lock = threading.Lock()


@contextlib.contextmanager
def told(tell: Tell) -> Iterator[None]:
    """Call `tell` with what compiles, in any thread, whenever that changes; with "" when nothing does."""
    _listening.append(tell)
    try:
        yield
    finally:
        _listening.remove(tell)


@contextlib.contextmanager
def compiling(name: str) -> Iterator[None]:
    """Tell of a compilation, and remember how long it took; one that raises is not remembered."""
    this, started = object(), time.perf_counter()
    _running[this] = name, _remembered().get(name)
    _tell()
    try:
        yield
    finally:
        del _running[this]
        _tell()
    with _lock, contextlib.suppress(OSError):
        file = _file()
        if file is not None:
            content = _remembered() | {name: round(time.perf_counter() - started, 2)}
            atomic_write(file, json.dumps(content, indent=1, sort_keys=True) + "\n")


def _tell() -> None:
    now = list(_running.values())
    sentence = f"compiling {', '.join(name for name, _ in now)}" if now else ""
    known = [seconds for _, seconds in now if seconds is not None]
    if now and len(known) == len(now):
        sentence += f", {max(*known, 1):.0f} s last time"
    for tell in list(_listening):
        tell(sentence)


def _file() -> Path | None:
    folder = cache_folder()
    return None if folder is None else folder / "seconds.json"


def _remembered() -> dict[str, float]:
    """Seconds by name; nothing where the file is not readable."""
    file = _file()
    if file is None:
        return {}
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    if not isinstance(content, dict):
        return {}
    return {str(name): float(value) for name, value in content.items() if isinstance(value, int | float)}
