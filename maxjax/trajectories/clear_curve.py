"""Clearance of a trajectory: where it leaves its plan's verified path, the verifier is asked again.

A smooth curve lies within `bulge` of the polyline through its samples. It is clear where this polyline touches nothing
and keeps the plan's radius and `bulge` to obstacles, or inside an exemption the own distance of its end if that is less
(`verification.verifier`). Doubt counts against it: the tolerance that the verifier allows a path is added to the
distance that is asked for. An end's own distance has nothing to add to it.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.core.voxel_map import VoxelMap
from maxjax.planning.plan import Plan
from maxjax.verification.clearance import distances_at
from maxjax.verification.polylines import Paths
from maxjax.verification.verdicts import Verdicts, Verification
from maxjax.verification.verifier import verify_paths

# A sample this close to the path lies on it [m].
_ON = 1e-7
# Of the radius, as the verifier allows it [voxels].
_TOLERANCE = 1.1e-3
# Samples within this distance of the centre of a voxel that is touched answer for it [voxels].
_BESIDE = 3.0
_CHUNK = 2048


@dataclasses.dataclass(frozen=True, eq=False)
class ClearCurve:
    """A plan's path in its map, beside which a curve has to be clear.

    Attributes:
        map: that the plan was verified in.
        path: (n, 3) of the plan [m], world frame.
        radius: that it keeps [m].
        exemptions: their radii around the ends, in which it keeps their own distances if these are less [m].
    """

    map: VoxelMap
    path: Float64[np.ndarray, "n 3"]
    radius: float
    exemptions: tuple[float, float]

    @classmethod
    def of(cls, plan: Plan) -> ClearCurve:
        """That of a plan."""
        return cls(plan.map, np.asarray(plan.path, np.float64), plan.radius, plan.exemptions)

    @functools.cached_property
    def _volumes(self) -> tuple[Bool[np.ndarray, "1 nx ny nz"], Bool[np.ndarray, "1 nx ny nz"]]:
        """Voxels that no curve enters, and voxels that it keeps off."""
        return np.asarray(self.map.barred)[None], np.asarray(self.map.kept_off)[None]

    def clearance(self, points: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, " m"]:
        """Distance of points to the cube of an occupied voxel [m], ground left out."""
        grid = self.map.grid
        index = (points - np.array(grid.origin)) / grid.spacing + 0.5
        return grid.spacing * distances_at(index, np.zeros(len(points), np.int64), *self._volumes)

    def unclear(self, samples: Float64[np.ndarray, "m 3"], bulge: float) -> Bool[np.ndarray, " m"]:
        """Samples of a curve from the path's start to its goal, where it is not clear; none on the path itself."""
        runs = self._runs(project(samples, self.path)[0] > _ON, samples)
        found = np.zeros(len(samples), bool)
        for (first, last), verdict in zip(runs, self._verified(samples, runs, bulge), strict=True):
            if not verdict.ok:
                found[first:last] |= self._blamed(samples[first:last], verdict, bulge)
        return found

    def least_clearance(self, samples: Float64[np.ndarray, "m 3"]) -> float:
        """Least clearance of the polyline through some samples [m]."""
        local = Paths.of([samples - np.array(self.map.grid.origin)])
        return float(verify_paths(local, self._local(True)).clearance[0])

    def _local(self, keeps_off: bool) -> VoxelMap:
        """The map with its origin at zero; without ground, which then counts as any obstacle does."""
        (occupied,), (ground,) = self._volumes
        return VoxelMap(occupied, ground if keeps_off else np.zeros_like(ground), None, self.map.grid.local)

    def _runs(self, off: Bool[np.ndarray, " m"], samples: Float64[np.ndarray, "m 3"]) -> list[tuple[int, int]]:
        """Runs of samples off the path, with one more at both ends; from the start or to the goal if exempt there."""
        edges = np.flatnonzero(np.diff(off, prepend=False, append=False))
        runs = []
        for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            from_start, to_goal = (
                bool((np.linalg.norm(samples[first:last] - end, axis=1) < exempt).any())
                for end, exempt in zip(self.path[[0, -1]], self.exemptions, strict=True)
            )
            runs.append((0 if from_start else max(first - 1, 0), len(off) if to_goal else min(last + 1, len(off))))
        return runs

    def _verified(self, samples: Float64[np.ndarray, "m 3"], runs: list[tuple[int, int]], bulge: float) -> Verdicts:
        """Verdicts on runs. At radius 0 the ground counts as any obstacle does, as the bulge must not enter it."""
        exemptions = [
            [self.exemptions[0] * (first == 0), self.exemptions[1] * (last == len(samples))] for first, last in runs
        ]
        grid = self.map.grid
        return verify_paths(
            Paths.of([samples[first:last] - np.array(grid.origin) for first, last in runs]),
            self._local(self.radius > 0),
            radius=self.radius + bulge + _TOLERANCE * grid.spacing if bulge else 0.0,
            exemptions=np.array(exemptions).reshape(-1, 2),
        )

    def _blamed(
        self, samples: Float64[np.ndarray, "m 3"], verdict: Verification, bulge: float
    ) -> Bool[np.ndarray, " m"]:
        """The samples of a run that are too near, or beside the voxel that it touches; all where none is."""
        grid = self.map.grid
        kept = np.full(len(samples), self.radius)
        for end, own, exempt in zip(
            self.path[[0, -1]], self.clearance(self.path[[0, -1]]), self.exemptions, strict=True
        ):
            kept = np.where(np.linalg.norm(samples - end, axis=1) < exempt, np.minimum(kept, own), kept)
        found = self.clearance(samples) < kept + 2.0 * (bulge + _TOLERANCE * grid.spacing)
        if verdict.first_hit is not None:
            centre = np.array(grid.origin) + grid.spacing * np.array(verdict.first_hit)
            found |= np.linalg.norm(samples - centre, axis=1) < _BESIDE * grid.spacing
        return found if found.any() else ~found


def project(
    points: Float64[np.ndarray, "m 3"], path: Float64[np.ndarray, "n 3"]
) -> tuple[Float64[np.ndarray, " m"], Float64[np.ndarray, " m"]]:
    """Distance of points to a polyline [m], and the arc length of its point that has it [m]."""
    edges = np.diff(path, axis=0)
    square = np.einsum("ei,ei->e", edges, edges)
    length = np.sqrt(square)
    before = np.concatenate([[0.0], np.cumsum(length)])[:-1]
    distance, arclength = np.empty(len(points)), np.empty(len(points))
    for k in range(0, len(points), _CHUNK):
        away = points[k : k + _CHUNK, None] - path[:-1]
        t = np.clip(np.einsum("pei,ei->pe", away, edges) / square, 0.0, 1.0)
        gap = np.linalg.norm(away - t[..., None] * edges, axis=-1)
        best = gap.argmin(axis=1)
        row = np.arange(len(best))
        distance[k : k + _CHUNK] = gap[row, best]
        arclength[k : k + _CHUNK] = before[best] + t[row, best] * length[best]
    return distance, arclength
