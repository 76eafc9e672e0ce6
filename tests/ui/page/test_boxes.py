"""Boxes are disjoint, few, and their union is the volume."""

from __future__ import annotations

import numpy as np
import pytest

from maxjax.ui.page.merged_boxes import merge_voxels


def filled(boxes: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    count = np.zeros(shape, int)
    for x0, x1, y0, y1, z0, z1 in boxes:
        count[x0:x1, y0:y1, z0:z1] += 1
    return count


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 1.0])
def test_boxes_cover_every_voxel_once(share: float) -> None:
    volume = np.random.default_rng(0).random((11, 7, 9)) < share
    np.testing.assert_array_equal(filled(merge_voxels(volume), volume.shape), volume)


def test_a_block_is_one_box_and_a_tower_on_it_another() -> None:
    volume = np.zeros((20, 20, 20), bool)
    volume[3:15, 4:16, :5] = True
    volume[6:9, 6:9, 8:19] = True
    assert sorted(map(tuple, merge_voxels(volume).tolist())) == [(3, 15, 4, 16, 0, 5), (6, 9, 6, 9, 8, 19)]
