"""Work in daemon threads: order, errors, early ends, and an interrupt that does not wait."""

from __future__ import annotations

import os
import signal
import threading
import time

import pytest

from maxjax.compile.threads import as_finished, concurrently, interruptible


def test_results_keep_the_order_of_the_items() -> None:
    def slow_first(k: int) -> int:
        time.sleep(0.02 if k == 0 else 0.0)
        return k * k

    assert list(concurrently(slow_first, range(7), 3)) == [k * k for k in range(7)]
    assert list(concurrently(slow_first, [], 3)) == []


def test_items_run_at_a_time_and_no_more_than_asked() -> None:
    barrier = threading.Barrier(2, timeout=10.0)
    assert list(concurrently(lambda k: barrier.wait() * 0 + k, range(4), 2)) == [0, 1, 2, 3]
    with pytest.raises(ValueError, match="threads: expected at least 1, given 0"):
        next(concurrently(abs, [1], 0))


def test_an_error_is_raised_here_and_ends_the_rest() -> None:
    started: list[int] = []

    def fails(k: int) -> int:
        started.append(k)
        if k == 1:
            raise OSError("no")
        return k

    results = concurrently(fails, range(50), 1)
    assert next(results) == 0
    with pytest.raises(OSError, match="no"):
        next(results)
    assert started == [0, 1]


def test_a_consumer_that_stops_leaves_later_items_unstarted() -> None:
    started: list[int] = []

    def note(k: int) -> int:
        started.append(k)
        time.sleep(0.02)
        return k

    results = concurrently(note, range(50), 1)
    assert next(results) == 0
    results.close()  # type: ignore[attr-defined]
    time.sleep(0.1)
    assert len(started) <= 3


def test_an_interrupt_ends_the_wait_and_not_the_work() -> None:
    ended = threading.Event()

    def work() -> None:
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(1.0)
        ended.set()

    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            interruptible(work)
        assert not ended.is_set()
    finally:
        signal.signal(signal.SIGINT, handler)
    assert ended.wait(10.0)


@pytest.mark.parametrize("threads", [1, 3])
def test_results_that_make_items_come_as_they_are_finished(threads: int) -> None:
    """Numbers below a hundred make their double; each is worked on once, however many threads there are."""
    waiting, seen = [3, 5, 7], []
    for item, result in as_finished(lambda: waiting.pop(0) if waiting else None, lambda k: 2 * k, threads):
        assert result == 2 * item
        seen.append(item)
        if result < 100:
            waiting.append(result)
    assert sorted(seen) == sorted(k * 2**n for k in (3, 5, 7) for n in range(6) if k * 2**n < 100)


def test_no_more_items_are_taken_than_there_are_threads() -> None:
    taken, allowed = [], threading.Semaphore(0)

    def take() -> int | None:
        if len(taken) == 5:
            return None
        taken.append(len(taken))
        return taken[-1]

    finished = as_finished(take, lambda k: allowed.acquire() and k, 2)
    threading.Timer(0.05, allowed.release).start()
    next(finished)
    assert len(taken) == 2
    for _ in range(4):
        allowed.release()
    assert len(list(finished)) == 4


@pytest.mark.parametrize("threads", [1, 2])
def test_what_an_item_raises_is_raised_to_whom_asks(threads: int) -> None:
    waiting = [1, 0]
    with pytest.raises(ZeroDivisionError):
        list(as_finished(lambda: waiting.pop(0) if waiting else None, lambda k: 1 // k, threads))
