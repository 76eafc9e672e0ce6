"""Choices of photos against integer programs over all of them, and what they promise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import Bounds, LinearConstraint, milp

from maxjax.inspection import set_cover
from maxjax.inspection.set_cover import blocks, choose_photos


def problem(seed: int, photos: int = 40, points: int = 80) -> tuple[sparse.csr_array, np.ndarray, np.ndarray]:
    """Photos of the points in squares of a plane."""
    rng = np.random.default_rng(seed)
    places = np.column_stack([rng.uniform(0.0, 10.0, (points, 2)), np.zeros(points)])
    corner = rng.uniform(-2.0, 10.0, (photos, 2))
    shows = (np.abs(places[None, :, :2] - corner[:, None] - 1.5) < 1.5).all(axis=2)
    return sparse.csr_array(shows.astype(np.int32)), places, rng.uniform(0.5, 2.0, points)


def optimum(shows: sparse.csr_array, wanted: int) -> int:
    """Of an integer program over all photos and points."""
    need = np.minimum(wanted, np.asarray(shows.sum(axis=0)).ravel())
    count = shows.shape[0]
    found = milp(
        np.ones(count),
        integrality=np.ones(count),
        bounds=Bounds(0, 1),
        constraints=LinearConstraint(shows.T.tocsr().astype(float), lb=need),
    )
    return round(found.fun)


def views(shows: sparse.csr_array, photos: np.ndarray) -> np.ndarray:
    """Of each point."""
    return np.asarray(shows[photos].sum(axis=0)).ravel()


@pytest.mark.parametrize("wanted", [1, 2, 4])
@pytest.mark.parametrize("seconds", [0.0, 10.0])
def test_each_point_has_its_views_and_no_photo_counts_twice(wanted: int, seconds: float) -> None:
    """As many as wanted, or as all together give it; every photo once."""
    for seed in range(10):
        shows, points, areas = problem(seed)
        choice = choose_photos(shows, points, areas, wanted, seconds)
        assert len(np.unique(choice.photos)) == len(choice.photos)
        need = np.minimum(wanted, np.asarray(shows.sum(axis=0)).ravel())
        assert (views(shows, choice.photos) >= need).all()


@pytest.mark.parametrize("wanted", [1, 3])
def test_as_few_as_an_integer_program_over_all_of_them(wanted: int) -> None:
    """Within a photo of the optimum, and never below the bound that is told; the greedy choice within a fifth."""
    for seed in range(12):
        shows, points, areas = problem(seed)
        best = optimum(shows, wanted)
        choice = choose_photos(shows, points, areas, wanted)
        assert choice.least <= best <= len(choice.photos) <= best + 1
        assert len(choose_photos(shows, points, areas, wanted, 0.0).photos) <= max(best + 1, 1.2 * best)


def test_no_photo_can_be_left_out() -> None:
    """Without any of them a point lacks a view."""
    for seed in range(5):
        shows, points, areas = problem(seed)
        for seconds in (0.0, 10.0):
            photos = choose_photos(shows, points, areas, 2, seconds).photos
            need = np.minimum(2, np.asarray(shows.sum(axis=0)).ravel())
            assert all((views(shows, photos[photos != k]) < need).any() for k in photos)


def test_blocks_side_by_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """All points in one block each, and a choice in blocks that is nearly as small."""
    shows, points, areas = problem(3, photos=80, points=300)
    whole = choose_photos(shows, points, areas, 2)
    monkeypatch.setattr(set_cover, "_BLOCK", 60)
    parts = blocks(points, np.arange(300))
    assert max(map(len, parts)) <= 60
    np.testing.assert_array_equal(np.sort(np.concatenate(parts)), np.arange(300))
    some = choose_photos(shows, points, areas, 2)
    assert len(some.photos) <= 1.2 * len(whole.photos)
    assert some.least <= whole.least


def test_nothing_to_see() -> None:
    """Photos that show nothing are not taken."""
    shows, points = sparse.csr_array(np.zeros((3, 4), np.int32)), np.zeros((4, 3))
    choice = choose_photos(shows, points, np.ones(4), 2)
    assert len(choice.photos) == 0
    assert choice.least == 0
