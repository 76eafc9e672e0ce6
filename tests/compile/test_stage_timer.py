"""Time is booked on the innermost recorder, compilation apart."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor

import jax.numpy as jnp
import pytest

from maxjax.compile.program import Program
from maxjax.compile.stage_timer import recording, sum_reports, time_stage


def test_programs_are_timed_apart_from_their_compilation() -> None:
    double = Program("double", lambda x, scale: scale * x, static=("scale",))
    reports = []
    for value, scale in ((2, 2.0), (3, 2.0), (3, 3.0)):
        with recording() as recorder:
            assert double(jnp.float32(value), scale=scale) == value * scale
        reports.append(recorder.report())
    first, second, third = reports
    assert first["compile"] > 0
    assert second["compile"] == 0
    assert third["compile"] > 0
    assert second["total"] == second["double"] > 0


def test_compilation_inside_a_timed_block_is_booked_once() -> None:
    started = time.perf_counter()
    with recording() as recorder, time_stage("whole"):
        with time_stage("compile"):
            time.sleep(0.02)
        time.sleep(0.01)
    assert recorder.seconds["compile"] >= 0.02
    assert recorder.seconds["whole"] >= 0.01
    assert recorder.seconds["whole"] + recorder.seconds["compile"] <= time.perf_counter() - started


def test_the_innermost_recorder_books_and_shares_are_equal() -> None:
    with recording() as outer:
        with time_stage("a"):
            time.sleep(0.01)
        with recording() as inner, time_stage("b"):
            time.sleep(0.02)
    assert set(outer.seconds) == {"compile", "a"}
    assert set(inner.seconds) == {"compile", "b"}
    assert inner.report(4)["b"] == pytest.approx(inner.seconds["b"] / 4)
    assert inner.report(4)["total"] == inner.report(4)["b"] >= 0.005
    both = sum_reports(outer.report(), inner.report())
    assert both["total"] == pytest.approx(both["a"] + both["b"])


def test_nothing_is_booked_without_a_recorder_or_in_another_thread() -> None:
    with time_stage("nowhere"):
        pass

    def work() -> None:
        with time_stage("elsewhere"):
            pass

    with recording() as recorder, ThreadPoolExecutor(1) as pool:
        pool.submit(work).result()
    assert set(recorder.seconds) == {"compile"}
