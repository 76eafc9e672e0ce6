"""Routes of a batch lose padding and nothing else, however they are put together."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from maxjax import Status
from maxjax.planning.path.route import Route, Routes, trim_padding


def padded(rng: np.random.Generator, counts: np.ndarray, width: int) -> Route:
    """Paths of so many points, the last but one repeated up to the last: as planners hand them out."""
    path = rng.random((len(counts), width, 3)).astype(np.float32)
    for row, count in zip(path, counts.tolist(), strict=True):
        row[count - 1 : -1] = row[count - 2]
    return dataclasses.replace(Routes.blank(len(counts), Status.OK).route, path=path)


def corners(path: np.ndarray) -> np.ndarray:
    """A path without repeated points."""
    return path[np.append(True, (path[1:] != path[:-1]).any(axis=1))]


@pytest.mark.parametrize("width", [2, 3, 4, 7, 64, 642])
@pytest.mark.parametrize("longest", [2, 3, 5, 64])
def test_paths_without_padding_are_the_same_paths(width: int, longest: int) -> None:
    rng = np.random.default_rng(width)
    counts = rng.integers(2, min(longest, width) + 1, 9)
    route = padded(rng, counts, width)
    route.status[4] = Status.PATH_STALLED  # which means nothing, and may be as long as it likes
    route.path[4] = rng.random((width, 3))
    found = trim_padding(route)
    rows = np.flatnonzero(route.status == Status.OK)
    for k in rows.tolist():
        np.testing.assert_array_equal(corners(found.path[k]), corners(route.path[k]))
    assert found.path.shape[1] <= min(width, 2 * counts[rows].max() + 2)


def test_no_points_are_no_padding() -> None:
    assert trim_padding(Routes.blank(3).route).path.shape == (3, 0, 3)


def test_routes_put_among_others_keep_their_points() -> None:
    rng = np.random.default_rng(0)
    long, short = (Routes(padded(rng, np.full(4, width), width)) for width in (9, 3))
    rows = np.array([3, 1])
    for first, second in ((long, short.some(np.arange(4) < 2)), (short, long.some(np.arange(4) < 2))):
        found = first.put(rows, second)
        for k in range(4):
            expected = second.route.path[rows.tolist().index(k)] if k in rows else first.route.path[k]
            np.testing.assert_array_equal(corners(found.route.path[k]), expected)
    assert Routes.blank(4).put(np.arange(4), long).route.path.dtype == np.float64
    assert Routes.blank(4).put(rows, Routes.blank(2)).route.path.shape == (4, 0, 3)
