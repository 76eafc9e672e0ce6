"""What boxes hold is what NumPy takes out of a padded map; open layers are found with the library and without it."""

from __future__ import annotations

import numpy as np
import pytest

from maxjax.compile import native
from maxjax.planning.windows.subvolumes import Boxes, lowest_open, voxels_in


@pytest.fixture(params=[True, False])
def either(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the library, and without it."""
    library = request.getfixturevalue("compiled_boxes") if request.param else None
    monkeypatch.setattr(native, "at_hand", lambda source: library)


@pytest.mark.parametrize("size", [(8, 8, 8), (5, 7, 9), (3, 4, 30), (1, 1, 1)])
def test_voxels_are_those_of_the_padded_map(size: tuple[int, int, int]) -> None:
    rng = np.random.default_rng(2)
    for order in ("C", "F"):
        maps = np.asarray(rng.random((3, 20, 21, 22)) < 0.5, order=order)  # type: ignore[call-overload]
        low, map_of = rng.integers(-12, 28, (60, 3)), rng.integers(0, 3, 60)
        boxes = Boxes(maps, map_of, low, low + np.array(size) - 1)
        padded = np.pad(maps, [(0, 0), *[(40, 60)] * 3])
        at = [np.arange(n) + 40 + low[:, [axis]] for axis, n in enumerate(size)]
        x, y, z = at[0][:, :, None, None], at[1][:, None, :, None], at[2][:, None, None, :]
        expected = padded[map_of[:, None, None, None], x, y, z]
        assert np.array_equal(voxels_in(boxes, 0.0), expected)
        prices = np.where(maps, np.float32(2.5), np.float32(1.5))
        outside = ~np.pad(np.ones_like(maps), [(0, 0), *[(40, 60)] * 3])[map_of[:, None, None, None], x, y, z]
        assert np.array_equal(voxels_in(boxes._replace(maps=prices), 1.0), np.where(outside, 1.0, 1.5 + expected))


def test_the_lowest_open_layer_is_the_first_that_is_not_all_occupied(either: None) -> None:
    rng = np.random.default_rng(3)
    maps = np.pad(rng.random((4, 9, 8, 12)) < 0.98, 1)[1:-1, 1:-1, 1:-1, 1:-1]
    maps[1:3, :, :, :5] = True
    low = rng.integers(-3, 6, (300, 3))
    high, map_of = low + rng.integers(0, 6, (300, 3)), rng.integers(0, 4, 300)
    low[:, 2], meets = np.maximum(low[:, 2], 0), (high >= 0).all(axis=1)
    low, high, map_of = low[meets], high[meets], map_of[meets]
    found = lowest_open(Boxes(maps, map_of, low, high))
    for m, first, last, z in zip(map_of, np.maximum(low, 0), high + 1, found, strict=True):
        layers = maps[m, first[0] : last[0], first[1] : last[1], first[2] : last[2]].all(axis=(0, 1))
        assert z == first[2] + np.argmin([*layers, False])
