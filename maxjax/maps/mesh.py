"""Meshes: surfaces as obstacles, and what closed ones enclose.

    closed  iff  every edge of the body lies in an even number of its faces

Corners that agree to a micrometre are one corner, and faces that share an edge are one body. Inside a closed body all
is solid; of one that is open only the surface is an obstacle, and what lies within may be flown through where a way
leads in. The vertices alone are never the map: walls stand between them.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, Int64

from maxjax.core.files import FileError
from maxjax.core.geometry.triangles import Triangles, Volume, enclosed, touched
from maxjax.core.grid import Grid
from maxjax.maps.reading import PLAIN, Reading
from maxjax.maps.reference import UNREFERENCED, Reference, Stated, reference

MAX_FACES = 10_000_000
_WELD = 1e-6  # [m]
_OPEN = -1


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Triangles of a file, on the host.

    Attributes:
        triangles: corners [m], in the file's coordinates, z up.
        body: number of the closed body that a triangle is part of, from 0 on; -1 where its body is open.
        points: vertices that no face uses [m]; obstacles as they are.
        open_bodies: how many bodies are open.
        source: the file's name.
        reference: of its coordinates.
    """

    triangles: Triangles
    body: Int[np.ndarray, " t"]
    points: Float[np.ndarray, "n 3"]
    open_bodies: int
    source: str
    reference: Reference = UNREFERENCED

    @property
    def closed_bodies(self) -> int:
        """How many bodies are closed, and so filled."""
        return int(self.body.max(initial=_OPEN)) + 1

    @property
    def remark(self) -> str:
        """A sentence on what could not be filled; empty where all could."""
        if not self.open_bodies:
            return ""
        share = float(np.mean(self.body == _OPEN))
        return (
            f"{self.open_bodies} of {self.open_bodies + self.closed_bodies} bodies ({100 * share:.0f} % of the faces) "
            "are not closed: their surfaces are obstacles, what they surround is not filled"
        )

    def voxels(self, grid: Grid) -> Volume:
        """Voxels that a face or a loose vertex touches, and those inside closed bodies."""
        corners = np.repeat(self.points[:, None], 3, axis=1)
        closed = self.body != _OPEN
        solid: Volume = enclosed(self.triangles[closed], self.body[closed], grid)
        solid |= touched(self.triangles, grid)
        solid |= touched(corners, grid)
        return solid


def mesh_of(
    vertices: Float[np.ndarray, "n 3"], faces: Int64[np.ndarray, "t 3"], path: Path, reading: Reading = PLAIN
) -> Mesh:
    """A mesh of what a file holds.

    Args:
        vertices: as the file has them.
        faces: three indices of vertices each.
        path: for messages.
        reading: of its coordinates.

    Raises:
        FileError: for no face at all, too many, an index without a vertex, or a coordinate that is not finite; as
            `reference`.
    """
    if not len(faces):
        raise FileError(f"{path}: expected a mesh, found no face")
    if len(faces) > MAX_FACES:
        raise FileError(f"{path}: holds {len(faces)} triangles, expected at most {MAX_FACES}; crop or thin it")
    if faces.min() < 0 or faces.max() >= len(vertices):
        wrong = int(faces.min() if faces.min() < 0 else faces.max())
        raise FileError(f"{path}: a face names vertex {wrong}, expected 0 to {len(vertices) - 1}; damaged")
    if not np.isfinite(vertices).all():
        wrong = int(np.flatnonzero(~np.isfinite(vertices).all(axis=1))[0])
        raise FileError(f"{path}: vertex {wrong} is {vertices[wrong]}, expected finite coordinates; damaged")
    how = reference(Stated(), reading, np.array([vertices.min(axis=0), vertices.max(axis=0)])[:, :2], path)
    welded, index = _welded(how.metres(vertices))
    faces = index[faces]
    body, open_bodies = _bodies(faces, len(welded))
    loose = np.ones(len(welded), bool)
    loose[faces] = False
    return Mesh(welded[faces], body, welded[loose], open_bodies, path.name, how)


def fans(corners: Int64[np.ndarray, " n"], lengths: Int64[np.ndarray, " m"]) -> Int64[np.ndarray, "t 3"]:
    """Polygons as triangles around their first corner, which cover at least the polygon.

    Args:
        corners: of all polygons, one after the other.
        lengths: how many each has; two are a segment and one is a point, as flat triangles.
    """
    start = np.cumsum(lengths) - lengths
    count = np.where(lengths > 2, lengths - 2, np.minimum(lengths, 1))
    one = np.repeat(np.arange(len(lengths)), count)
    step = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    last = lengths[one] - 1
    second, third = np.minimum(step + 1, last), np.minimum(step + 2, last)
    return np.stack([corners[start[one]], corners[start[one] + second], corners[start[one] + third]], axis=1)


def _welded(vertices: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "m 3"], Int64[np.ndarray, " n"]]:
    """Vertices without repetition, and the number there of each."""
    low = vertices.min(axis=0)
    lattice = np.round((vertices - low) / _WELD)
    order, fresh = _runs(lattice)
    index = np.empty(len(vertices), np.int64)
    index[order] = np.cumsum(fresh) - 1
    return vertices[order[fresh]], index


def _runs(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An order in which equal rows follow each other, and whether each there is the first of its kind."""
    order = np.lexsort(rows.T)
    ranked = rows[order]
    return order, np.r_[True, np.any(ranked[1:] != ranked[:-1], axis=1)]


def _bodies(faces: Int64[np.ndarray, "t 3"], count: int) -> tuple[Int[np.ndarray, " t"], int]:
    """Number of each face's closed body, or -1; how many are open."""
    body = np.full(len(faces), _OPEN)
    # A face that occurs twice, as in meshes with two sides, would close any body.
    order, fresh = _runs(np.sort(faces, axis=1))
    real = np.sort(order[fresh])
    kept = faces[real]
    proper = (kept[:, 0] != kept[:, 1]) & (kept[:, 1] != kept[:, 2]) & (kept[:, 2] != kept[:, 0])
    real, kept = real[proper], kept[proper]
    if not len(kept):
        return body, 0
    ends = np.sort(kept[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, edge, faces_of = np.unique(ends[:, 0] * count + ends[:, 1], return_inverse=True, return_counts=True)
    from scipy.sparse import coo_array, csgraph  # only meshes need them

    face = np.repeat(np.arange(len(kept)), 3)
    edge = edge + len(kept)
    size = len(kept) + len(faces_of)
    joined = coo_array((np.ones(len(face), bool), (face, edge)), shape=(size, size)).tocsr()
    bodies, label = csgraph.connected_components(joined, directed=False)
    closed = np.ones(bodies, bool)
    closed[label[len(kept) :][faces_of % 2 == 1]] = False
    number = np.where(closed, np.cumsum(closed) - 1, _OPEN)
    body[real] = number[label[: len(kept)]]
    return body, int((~closed).sum())
