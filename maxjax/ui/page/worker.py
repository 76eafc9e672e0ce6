"""A thread that answers the latest question: what was asked meanwhile, and is stale, is never worked on."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from typing import Generic, TypeVar

Question = TypeVar("Question")


class Worker(Generic[Question]):
    """Works on questions in a thread of its own, the latest first and all earlier ones not at all.

    Args:
        work: called with one question at a time.
    """

    def __init__(self, work: Callable[[Question], None]) -> None:
        self._work, self._waiting, self._closed = work, list[Question](), False
        self._changed = threading.Condition()
        self._busy = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def ask(self, question: Question) -> None:
        """Take a question in place of one that waits."""
        with self._changed:
            self._waiting = [question]
            self._changed.notify_all()

    @property
    def stale(self) -> bool:
        """Whether a later question waits: what is being worked on is of no use any more."""
        with self._changed:
            return bool(self._waiting)

    def rest(self, seconds: float) -> bool:
        """Wait until all is answered; whether it was within some seconds."""
        with self._changed:
            return self._changed.wait_for(lambda: not self._busy and not self._waiting, seconds)

    def close(self) -> None:
        """End the thread, after what it is working on."""
        with self._changed:
            self._closed, self._waiting = True, []
            self._changed.notify_all()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._closed or bool(self._waiting))
                if self._closed:
                    return
                question, self._waiting, self._busy = self._waiting[0], [], True
            try:
                self._work(question)
            except Exception:  # a page outlives what one question met
                traceback.print_exc()
