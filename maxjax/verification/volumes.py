"""The voxels of maps as the verifier takes them, and which of them a path must not touch."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Int64, Integer

from maxjax.core.voxel_map import VoxelMap


@dataclasses.dataclass(frozen=True, eq=False)
class Volumes:
    """The voxels of each map: what is touched by nothing, what is kept off, and what else is blocked."""

    occupied: Bool[np.ndarray, "m nx ny nz"]
    ground: Bool[np.ndarray, "m nx ny nz"]
    blocked: Bool[np.ndarray, "m nx ny nz"] | None

    @classmethod
    def of(cls, where: VoxelMap, blocked: Bool[np.ndarray, "m nx ny nz"] | None) -> Volumes:
        """Those of a map, or of a batch; raises a `ValueError` for others of another shape."""
        volumes = [np.asarray(volume) for volume in (where.barred, where.kept_off)]
        occupied, ground = (volume if volume.ndim == 4 else volume[None] for volume in volumes)
        if blocked is not None:
            where.grid.check_volume("blocked", blocked)
            if blocked.ndim != 4 or blocked.dtype != np.bool_:
                raise ValueError(
                    f"blocked: expected bool of shape {where.grid.shape}, given {blocked.dtype} {blocked.shape[1:]}"
                )
            if len(blocked) != len(occupied):
                raise ValueError(f"blocked: expected one volume for each of {len(occupied)} maps, given {len(blocked)}")
        return cls(occupied, ground, blocked)

    def forbidden(
        self, map_of: Integer[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"], apart: Bool[np.ndarray, " c"]
    ) -> Bool[np.ndarray, " c"]:
        """Which voxels must not be touched: those held; and, by what is kept `apart`, those beside ground."""
        held = _at(self.occupied, map_of, voxels)
        if self.blocked is not None:
            held |= _at(self.blocked, map_of, voxels)
        asked = np.flatnonzero(apart & ~held)
        held[asked] = _beside(self.ground, map_of[asked], voxels[asked])
        return held


def _flat(
    volumes: Bool[np.ndarray, "m nx ny nz"], map_of: Integer[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"]
) -> tuple[Bool[np.ndarray, " n"], Int64[np.ndarray, " c"]]:
    """Maps in one row, and where voxels are: NumPy takes by one index far faster than by four."""
    shared = volumes.strides[0] == 0  # one map, which a row of copies would multiply
    nx, ny, nz = volumes.shape[1:]
    x, y, z = voxels.T
    first = x if shared else map_of * nx + x
    return (volumes[0] if shared else volumes).reshape(-1), (first * ny + y) * nz + z


def _at(
    volumes: Bool[np.ndarray, "m nx ny nz"], map_of: Integer[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"]
) -> Bool[np.ndarray, " c"]:
    row, index = _flat(volumes, map_of, voxels)
    return np.take(row, index)


def _beside(
    ground: Bool[np.ndarray, "m nx ny nz"], map_of: Integer[np.ndarray, " c"], voxels: Int64[np.ndarray, "c 3"]
) -> Bool[np.ndarray, " c"]:
    """Whether voxels have a face neighbour that is ground."""
    row, index = _flat(ground, map_of, voxels)
    beside = np.zeros(len(index), bool)
    for axis, step in enumerate((ground.shape[2] * ground.shape[3], ground.shape[3], 1)):
        at = voxels[:, axis]
        beside |= np.take(row, index - step, mode="clip") & (at > 0)
        beside |= np.take(row, index + step, mode="clip") & (at < ground.shape[1 + axis] - 1)
    return beside
