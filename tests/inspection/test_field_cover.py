"""Covering by a field: its potential before a sparse solve, climbs that end at sources, photos that are all needed."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import ndimage, sparse
from scipy.sparse.linalg import spsolve

from maxjax.core.grid import Grid
from maxjax.inspection.field_cover import FieldCover, Photos, _climb, _solve, cover_by_field
from maxjax.inspection.free_space import FreeSpace

SHAPE = (14, 12, 9)


def cave(seed: int) -> np.ndarray:
    """Random free voxels, of which the largest part."""
    air = np.random.default_rng(seed).random(SHAPE) < 0.72
    label, _ = ndimage.label(air)
    return np.asarray(label == 1 + np.argmax(np.bincount(label.ravel())[1:]))


def space(air: np.ndarray) -> FreeSpace:
    return FreeSpace(air, air, Grid(SHAPE, 2.0, (10.0, -20.0, 1.0)), 1.0)


def by_elimination(air: np.ndarray, length: float, source: np.ndarray) -> np.ndarray:
    """−Σ (u_j − u_i) + u_i / ℓ² = s_i over the free neighbours j of each free voxel."""
    number = np.where(air, np.cumsum(air).reshape(SHAPE) - 1, -1)
    rows, columns = [], []
    for axis in range(3):
        a, b = (np.moveaxis(number, axis, 0)[part].ravel() for part in (slice(None, -1), slice(1, None)))
        joined = (a >= 0) & (b >= 0)
        rows += [a[joined], b[joined]]
        columns += [b[joined], a[joined]]
    i, j = np.concatenate(rows), np.concatenate(columns)
    count = int(air.sum())
    links = sparse.coo_array((np.ones(len(i)), (i, j)), shape=(count, count)).tocsc()
    matrix = sparse.diags_array(np.asarray(links.sum(axis=1)).ravel() + 1.0 / length**2) - links
    found = np.zeros(SHAPE)
    found[air] = spsolve(matrix.tocsc(), source[air])
    return found


@pytest.mark.parametrize("length", [2.0, 8.0])
def test_the_potential_is_that_of_elimination_and_climbs_end_at_sources(length: float) -> None:
    for seed in range(4):
        air, rng = cave(seed), np.random.default_rng(seed)
        source = np.where(air & (rng.random(SHAPE) < 0.01), rng.uniform(0.5, 1.0, SHAPE), 0.0).astype(np.float32)
        exact = by_elimination(air, length, source)
        found = np.asarray(_solve(jnp.asarray(air), length, source, np.zeros(SHAPE, np.float32)))
        np.testing.assert_allclose(found, exact, rtol=2e-3, atol=2e-5 * exact.max())
        assert found[~air].max(initial=0.0) == 0.0
        for start in rng.permutation(np.argwhere(air))[:40]:
            assert source[tuple(_climb(found, source, air, start))] > 0.0


def random_photos(seed: int, air: np.ndarray, count: int = 40) -> Photos:
    rng = np.random.default_rng(seed)
    voxels = rng.permutation(np.argwhere(air))[:count]
    shows = sparse.csr_array((rng.random((count, 60)) < 0.1).astype(np.int32))
    places = np.array(space(air).grid.origin) + 2.0 * voxels
    return Photos(places, shows, rng.uniform(0.5, 2.0, 60), 2)


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0])
def test_photos_are_taken_once_until_none_shows_what_is_wanted(share: float) -> None:
    for seed in range(3):
        air = cave(seed)
        photos = random_photos(seed, air)
        start = space(air).grid.to_metres(np.argwhere(air)[0].astype(float))
        found = cover_by_field(photos, space(air), tuple(start.tolist()), FieldCover(4.0, share))  # type: ignore[arg-type]
        assert len(set(found.photos.tolist())) == len(found.photos)
        counts = np.asarray(photos.shows[found.photos].sum(axis=0)).ravel()
        could = np.minimum(np.asarray(photos.shows.sum(axis=0)).ravel(), photos.wanted)
        assert (counts >= could).all()
        assert (np.diff(found.seen) >= 0.0).all()
        assert found.seen[-1] == pytest.approx(photos.areas[could > 0].sum())
        # Each showed something that was wanted when it was taken.
        before = np.zeros(60, int)
        for photo in found.photos:
            own = photos.shows[[photo]].toarray()[0]
            assert (before[own > 0] < could[own > 0]).any()
            before += own


def test_what_cannot_be_flown_is_refused() -> None:
    air = cave(0)
    photos = random_photos(0, air)
    far = Photos(photos.places + np.array([0.0, 0.0, 40.0]), photos.shows, photos.areas, 2)
    start = tuple(photos.places[0].tolist())
    with pytest.raises(ValueError, match="expected places in free air"):
        cover_by_field(far, space(air), start)
    for given in ({"length": 0.0}, {"share": 0.0}, {"share": 1.5}):
        with pytest.raises(ValueError, match="FieldCover"):
            FieldCover(**given)
