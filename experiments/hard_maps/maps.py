"""The maps and their ends, each drawn from seed and number alone; (n, n, n) voxels, index coordinates."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np

from benchmarks.common.dilation import closed

SIZE = 16
# Radii [voxels] of the maps of each kind: random voxels leave nothing free for a wider vehicle.
NARROW, ALL = (0.5,), (0.5, 1.0, 1.5)

Rng = np.random.Generator


def percolation(rng: Rng) -> np.ndarray:
    """Random voxels: on the cubic lattice free ones span the map from a share of 0.3116 on."""
    return rng.random((SIZE,) * 3) > rng.uniform(0.27, 0.40)


def doors(rng: Rng) -> np.ndarray:
    """One to three walls, each with a door of one to five voxels a side, anywhere, rims too."""
    occupied = np.asarray(rng.random((SIZE,) * 3) < rng.choice([0.0, 0.01]))
    for _ in range(rng.integers(1, 4)):
        axis, at = rng.integers(3), rng.integers(3, SIZE - 3)
        low = rng.integers(0, SIZE - 1, 2)
        (a, b), (c, d) = zip(low, low + rng.integers(1, 6, 2), strict=True)
        wall = np.moveaxis(occupied, axis, 0)[at]  # a view
        kept = wall[a:b, c:d].copy()
        wall[:] = True
        wall[a:b, c:d] = kept & (rng.random() < 0.5)
    return occupied


def diagonals(rng: Rng) -> np.ndarray:
    """Blocks on the cells of one colour of a chequerboard, which touch along edges or at corners, some left out."""
    side = rng.integers(2, 6)
    cell = np.indices((SIZE,) * 3) // side
    colour = cell.sum(axis=0) if rng.random() < 0.5 else cell[0] + cell[1]
    missing = rng.random((SIZE,) * 3)[tuple(cell)] < rng.uniform(0.0, 0.6)
    return np.asarray((colour % 2 == 0) & ~missing)


def rims(rng: Rng) -> np.ndarray:
    """A solid within rims of one to three voxels along the faces of the map, with some voxels in them."""
    wide = rng.integers(1, 4)
    occupied = rng.random((SIZE,) * 3) < rng.uniform(0.0, 0.15)
    inner = slice(wide, SIZE - wide)
    occupied[inner, inner, inner] = True
    return occupied


KINDS: Mapping[str, tuple[Callable[[Rng], np.ndarray], tuple[float, ...]]] = {
    "percolation": (percolation, NARROW),
    "doors": (doors, ALL),
    "diagonals": (diagonals, ALL),
    "rims": (rims, ALL),
}
CELLS = [(kind, radius) for kind, (_, radii) in KINDS.items() for radius in radii]
"""Kind and radius of each row."""


@dataclasses.dataclass(frozen=True)
class Problems:
    """Problems of one kind and radius: `occupied` (b, n, n, n), `ends` (b, 2, 3) in index coordinates."""

    occupied: np.ndarray
    ends: np.ndarray

    @property
    def on_faces(self) -> np.ndarray:
        """Problems with an end on a face, an edge or a corner, which in a mirror is of another voxel."""
        return np.asarray((np.abs(self.ends % 1 - 0.5) < 1e-9).any(axis=(1, 2)))

    def some(self, which: np.ndarray) -> Problems:
        """Those of a mask."""
        return Problems(self.occupied[which], self.ends[which])

    def mirrored(self, axis: int) -> Problems:
        """Flipped along an axis, and the two others exchanged: a mirror image and a turn."""
        one, two = (k for k in range(3) if k != axis)
        ends = self.ends.copy()
        ends[..., axis] = self.occupied.shape[axis + 1] - 1 - ends[..., axis]
        ends[..., [one, two]] = ends[..., [two, one]]
        return Problems(np.swapaxes(np.flip(self.occupied, axis + 1), one + 1, two + 1), ends)

    def embedded(self, offset: tuple[int, int, int], margin: int) -> Problems:
        """In a solid that is wider by `margin` voxels, from voxel `offset` on."""
        sides = [(o, margin - o) for o in offset]
        return Problems(np.pad(self.occupied, [(0, 0), *sides], constant_values=True), self.ends + np.array(offset))


def drawn(seed: int, kind: str, radius: float, numbers: range) -> Problems:
    """The problems of these numbers; a map in which nobody keeps the radius in two voxels is drawn again."""
    found = [
        _one(np.random.default_rng([seed, CELLS.index((kind, radius)), number]), kind, radius) for number in numbers
    ]
    return Problems(np.stack([occupied for occupied, _ in found]), np.stack([ends for _, ends in found]))


def _one(rng: Rng, kind: str, radius: float) -> tuple[np.ndarray, np.ndarray]:
    while True:
        occupied = KINDS[kind][0](rng)
        free = ~closed(occupied, radius)
        places = np.argwhere(free)
        if len(places) > 1:
            voxels = places[rng.choice(len(places), 2, replace=False)]
            ends = np.stack([_end(rng, free, voxel) for voxel in voxels])
            if (ends[0] != ends[1]).any():
                return occupied, ends


def _end(rng: Rng, free: np.ndarray, voxel: np.ndarray) -> np.ndarray:
    """The centre of a voxel, a point between centres that are all free, or one of its faces, edges or corners.

    There the end itself keeps the radius: distance is least at a centre (`maxjax.planning.problem.inflation`). It stays
    half a voxel within the map.
    """
    offset = rng.choice([np.zeros(3), rng.uniform(-0.5, 0.5, 3), rng.choice([-0.5, 0.0, 0.5], 3)])
    reach = voxel + np.sign(offset).astype(int)
    low, high = np.minimum(voxel, reach), np.maximum(voxel, reach)
    inside = (low >= 0).all() and (high < SIZE).all()
    around = free[tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))] if inside else np.array(False)
    return np.asarray(voxel + offset if around.all() else voxel, float)
