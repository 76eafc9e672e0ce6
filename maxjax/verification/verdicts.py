"""Verdicts of the verifier: on one path, and on many as arrays over them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float64, Int64

from maxjax.core.grid import Index3, Point3


@dataclasses.dataclass(frozen=True)
class Verification:
    """Verdict on a path.

    Attributes:
        ok: finite, inside, no forbidden voxel touched, and not too near. Nothing else makes a path safe.
        inside: the whole path lies in the volume of the grid.
        finite: no coordinate is NaN or infinite.
        first_hit: index of the first forbidden voxel that the path touches; None if there is none, or if the
            path is not inside.
        too_near: whether the path comes nearer to an occupied voxel, ground left out, than `radius`, or inside an
            exemption than the end's own distance if that is less.
        length: length of the path [m]; NaN unless finite.
        clearance: least distance from the path to the cube of an occupied voxel [m], ground left out: 0 on contact,
            infinite if no voxel is occupied, NaN unless inside.
        nearest: a point of the path that has this distance [m]; None unless it is finite.
        cruise_clearance: the least such distance outside the exemptions and farther than `CRUISE` from both ends;
            `clearance` where it does not leave them.
        cruise_nearest: as `nearest`, of `cruise_clearance`.
        clearance_at: (t,) float64, such a distance from each point that the path was given by.
    """

    ok: bool
    inside: bool
    finite: bool
    first_hit: Index3 | None
    too_near: bool
    length: float
    clearance: float
    nearest: Point3 | None
    cruise_clearance: float
    cruise_nearest: Point3 | None
    clearance_at: Float64[np.ndarray, " t"] = dataclasses.field(compare=False)  # arrays have no single truth


@dataclasses.dataclass(frozen=True, eq=False)
class Verdicts:
    """Verdicts on paths, as arrays over them; attributes as in `Verification`.

    Attributes:
        ok, inside, finite, too_near: (p,) bool.
        first_hit: (p, 3) int64; −1 where there is none.
        length, clearance, cruise_clearance: (p,) float64 [m].
        nearest, cruise_nearest: (p, 3) float64 [m]; NaN where there is none.
        clearance_at: (p, t) float64 [m]; NaN beyond a path.
        counts: (p,) how many points each path has.
    """

    ok: Bool[np.ndarray, " p"]
    inside: Bool[np.ndarray, " p"]
    finite: Bool[np.ndarray, " p"]
    first_hit: Int64[np.ndarray, "p 3"]
    too_near: Bool[np.ndarray, " p"]
    length: Float64[np.ndarray, " p"]
    clearance: Float64[np.ndarray, " p"]
    nearest: Float64[np.ndarray, "p 3"]
    cruise_clearance: Float64[np.ndarray, " p"]
    cruise_nearest: Float64[np.ndarray, "p 3"]
    clearance_at: Float64[np.ndarray, "p t"]
    counts: Int64[np.ndarray, " p"]

    @classmethod
    def joined(cls, parts: Sequence[Verdicts]) -> Verdicts:
        """Verdicts on several lots of paths of one padded length."""
        names = [field.name for field in dataclasses.fields(cls)]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def __len__(self) -> int:
        return len(self.ok)

    def __iter__(self) -> Iterator[Verification]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k: int) -> Verification:
        x, y, z = self.first_hit[k].tolist()
        return Verification(
            ok=bool(self.ok[k]),
            inside=bool(self.inside[k]),
            finite=bool(self.finite[k]),
            first_hit=None if x < 0 else (x, y, z),
            too_near=bool(self.too_near[k]),
            length=float(self.length[k]),
            clearance=float(self.clearance[k]),
            nearest=_point(self.nearest[k]),
            cruise_clearance=float(self.cruise_clearance[k]),
            cruise_nearest=_point(self.cruise_nearest[k]),
            clearance_at=self.clearance_at[k, : self.counts[k]].copy(),
        )


def _point(place: Float64[np.ndarray, "3"]) -> Point3 | None:
    x, y, z = place.tolist()
    return None if math.isnan(x) else (x, y, z)
