"""Work in daemon threads, waited for in Python so that Ctrl-C interrupts the wait.

A main thread that waits for a device program blocks in C++ and handles no signal until the program has ended, and the
exit of a thread pool joins its threads, which wait for theirs. Here KeyboardInterrupt leaves the wait at once: items
that were not started are dropped, and the threads of started ones do not keep the process alive.
"""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def concurrently(function: Callable[[Item], Result], items: Iterable[Item], threads: int) -> Iterator[Result]:
    """`map` in daemon threads: results in the order of the items, each as soon as it and those before it are known.

    Args:
        function: called in a thread of its own; what it raises is raised here.
        items: all are taken at once.
        threads: at most so many items at a time.

    Raises:
        ValueError: for less than one thread.
    """
    if threads < 1:
        raise ValueError(f"threads: expected at least 1, given {threads}")
    waiting: queue.SimpleQueue[tuple[Future[Result], Item]] = queue.SimpleQueue()
    futures: list[Future[Result]] = []
    for item in items:
        futures.append(Future())
        waiting.put((futures[-1], item))

    def take() -> tuple[Future[Result], Item] | None:
        try:
            return waiting.get_nowait()
        except queue.Empty:
            return None

    def drop() -> None:
        while take() is not None:
            pass

    def work() -> None:
        while (task := take()) is not None:
            future, item = task
            try:
                future.set_result(function(item))
            except BaseException as error:
                drop()
                future.set_exception(error)

    for _ in range(min(threads, len(futures))):
        threading.Thread(target=work, daemon=True).start()
    try:
        for future in futures:
            yield future.result()
    finally:
        # After an interrupt, or a consumer that stops early.
        drop()


def in_parts(function: Callable[[slice], Result], count: int, size: int) -> list[Result]:
    """The values of a function for parts of a batch: on all cores, or in this thread where it is one part.

    Args:
        function: of which rows.
        count: rows in all, at least 1.
        size: rows of a part.
    """
    parts = [slice(k, min(k + size, count)) for k in range(0, count, size)]
    return list(concurrently(function, parts, os.cpu_count() or 1)) if len(parts) > 1 else [function(parts[0])]


def interruptible(function: Callable[[], Result]) -> Result:
    """The value of `function()`, called in a daemon thread while this one stays open to KeyboardInterrupt."""
    (result,) = concurrently(lambda _: function(), [None], 1)
    return result


def as_finished(
    take: Callable[[], Item | None], function: Callable[[Item], Result], threads: int
) -> Iterator[tuple[Item, Result]]:
    """Items and results in the order in which they are finished, where results may make new items.

    Args:
        take: the next item; None: there is none now. Called in the thread that iterates, whenever another item could
            be worked on, and after each result again.
        function: called in daemon threads; what it raises is raised here. With one thread it is called in this one.
        threads: at most so many items at a time.
    """
    finished: queue.SimpleQueue[tuple[Item, Future[Result]]] = queue.SimpleQueue()

    def work(item: Item) -> None:
        future: Future[Result] = Future()
        try:
            future.set_result(function(item))
        except BaseException as error:
            future.set_exception(error)
        finished.put((item, future))

    busy = 0
    while True:
        while busy < threads and (item := take()) is not None:
            busy += 1
            if threads > 1:
                threading.Thread(target=work, args=(item,), daemon=True).start()
            else:
                work(item)
        if not busy:
            return
        item, future = finished.get()
        busy -= 1
        yield item, future.result()
