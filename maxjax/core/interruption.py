"""Ctrl-C: the process ends within two seconds, between two files, whatever it is doing.

Python runs its signal handlers in the main thread and between two instructions. A compilation or a program on a
device is one instruction that takes minutes, and a `KeyboardInterrupt` raised behind it unwinds through libraries that
do not expect it. Here the operating system's handler writes a byte to a socket instead. A thread waits for the byte
and ends the process by `os._exit`, without the destructors of a runtime that is at work in other threads.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

INTERRUPTED = 130
"""Exit code: 128 and the number of SIGINT, as shells count."""

_PATIENCE = 1.0  # what a file being written may still take [s]
_STDERR = 2
_ERASE_LINE_AND_SHOW_CURSOR = "\r\x1b[2K\x1b[?25h"

_writing = threading.Lock()
_unfinished: set[Path] = set()


def end_on_interrupt(sentence: str) -> None:
    """From now on, Ctrl-C prints a sentence on stderr and ends the process with `INTERRUPTED`.

    To be called in the main thread, before libraries that take long to import. A process that was started with
    interrupts ignored (`nohup`) goes on ignoring them.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        return
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    threading.Thread(target=_wait, args=(reader, writer, sentence), name="interruption", daemon=True).start()
    signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    signal.signal(signal.SIGINT, lambda *_: None)  # instead of raising KeyboardInterrupt


@contextlib.contextmanager
def ending_by(action: Callable[[], None]) -> Iterator[None]:
    """Within this block, Ctrl-C, SIGTERM and SIGHUP call an action in place of ending the process.

    For what has to be left in order, as a vehicle in flight. Outside of the main thread, signals keep their meaning.

    Args:
        action: is called in the main thread, at each signal; it must return at once.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    signals = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    woken = signal.set_wakeup_fd(-1)
    before = {number: signal.signal(number, lambda *_: action()) for number in signals}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(woken)


@contextlib.contextmanager
def finishing(temporary: Path | None = None) -> Iterator[None]:
    """Keep an interruption from ending the process within this block, a second at most.

    Args:
        temporary: file that is gone when the block ends; where the block takes longer, the interruption removes it.
    """
    names = set() if temporary is None else {temporary}
    with _writing:
        _unfinished.update(names)
        try:
            yield
        finally:
            _unfinished.difference_update(names)


def _wait(reader: socket.socket, writer: socket.socket, sentence: str) -> None:
    """End the process when SIGINT has come; the writer is an argument so that it stays open."""
    while signal.SIGINT not in reader.recv(64):
        pass
    # Never released, so that no other file is started.
    if not _writing.acquire(timeout=_PATIENCE):
        for temporary in list(_unfinished):
            with contextlib.suppress(OSError):
                temporary.unlink(missing_ok=True)
    # A progress bar is erased. The streams of Python may be locked by a thread that is writing.
    prefix = _ERASE_LINE_AND_SHOW_CURSOR if os.isatty(_STDERR) else ""
    with contextlib.suppress(OSError):
        os.write(_STDERR, f"{prefix}{sentence}\n".encode())
    os._exit(INTERRUPTED)
