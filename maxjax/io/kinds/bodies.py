"""Bodies of meshes: faces that share an edge, and which of them enclose something.

    closed          iff  every edge lies in an even number of its faces
    open below      iff  every edge that does not is within half a metre of its lowest corner

A body that is open only below is a house without a floor: it is closed by a cap, triangles from each of its open edges
to one point at the bottom, which make it closed under the same parity. A sheet that is nearly level, under everything
and as wide as the mesh is the ground.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int, Int64

from maxjax.io.geo.triangles import Triangles

OPEN = -1
_LEVEL = 0.5  # [m]
_UPRIGHT, _WIDE = 0.7, 0.8  # vertical share of normals, and share of the mesh's box, of a sheet that is the ground
_WELD = 1e-6  # [m]

Faces = Int64[np.ndarray, "t 3"]
Vertices = Float[np.ndarray, "n 3"]


@dataclasses.dataclass(frozen=True)
class Bodies:
    """Bodies of the faces of a mesh.

    Attributes:
        body: number of each face's closed body, from 0 on; -1 where its body is open.
        caps: triangles that close bodies which are open below.
        cap_of: number of the body that each of them closes.
        open_below: how many bodies are closed by caps.
        open_bodies: how many stay open, the ground not among them.
        ground: whether a face is of the ground.
    """

    body: Int[np.ndarray, " t"]
    caps: Float[np.ndarray, "c 3 3"]
    cap_of: Int[np.ndarray, " c"]
    open_below: int
    open_bodies: int
    ground: Bool[np.ndarray, " t"]


def bodies_of(vertices: Vertices, faces: Faces) -> Bodies:
    """The bodies of welded faces."""
    none = np.zeros(0, int)
    body, ground = np.full(len(faces), OPEN), np.zeros(len(faces), bool)
    # A face that occurs twice, as in meshes with two sides, would close any body.
    order, fresh = runs(np.sort(faces, axis=1))
    real = np.sort(order[fresh])
    kept = faces[real]
    proper = (kept[:, 0] != kept[:, 1]) & (kept[:, 1] != kept[:, 2]) & (kept[:, 2] != kept[:, 0])
    real, kept = real[proper], kept[proper]
    if not len(kept):
        return Bodies(body, np.zeros((0, 3, 3)), none, 0, 0, ground)
    part, edges, odd = _parts(kept, len(vertices))
    count = int(part.max()) + 1
    of_edge = part[edges[:, 2]]
    closed = np.ones(count, bool)
    closed[of_edge[odd]] = False
    low, high = _span(vertices[kept][:, :, 2], part, count)
    rim = np.full(count, -np.inf)
    np.maximum.at(rim, of_edge[odd], vertices[edges[odd, :2], 2].max(axis=1))
    below = ~closed & (rim <= low + _LEVEL) & (high > low + _LEVEL)
    sheet = _ground(vertices[kept], part, ~closed & ~below)
    number = np.where(closed | below, np.cumsum(closed | below) - 1, OPEN)
    body[real] = number[part]
    ground[real] = part == sheet
    capped = odd & below[of_edge]
    caps = _caps(vertices, edges[capped, :2], of_edge[capped], low)
    left = int((~closed & ~below).sum()) - int(sheet != OPEN)
    return Bodies(body, caps, number[of_edge[capped]], int(below.sum()), left, ground)


def weld(vertices: Vertices) -> tuple[Float[np.ndarray, "m 3"], Int64[np.ndarray, " n"]]:
    """Vertices without repetition, and the number there of each."""
    low = vertices.min(axis=0)
    lattice = np.round((vertices - low) / _WELD)
    order, fresh = runs(lattice)
    index = np.empty(len(vertices), np.int64)
    index[order] = np.cumsum(fresh) - 1
    return vertices[order[fresh]], index


def runs(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An order in which equal rows follow each other, and whether each there is the first of its kind."""
    order = np.lexsort(rows.T)
    ranked = rows[order]
    return order, np.r_[True, np.any(ranked[1:] != ranked[:-1], axis=1)]


def _parts(faces: Faces, count: int) -> tuple[Int[np.ndarray, " t"], Int64[np.ndarray, "e 3"], Bool[np.ndarray, " e"]]:
    """The part that each face belongs to; edges as two corners and one of their faces; which lie in an odd number."""
    ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, first, edge, faces_of = np.unique(
        ends[:, 0] * count + ends[:, 1], return_index=True, return_inverse=True, return_counts=True
    )
    from scipy.sparse import coo_array, csgraph  # only meshes need them

    face = np.repeat(np.arange(len(faces)), 3)
    size = len(faces) + len(faces_of)
    joined = coo_array((np.ones(len(face), bool), (face, edge + len(faces))), shape=(size, size)).tocsr()
    _, label = csgraph.connected_components(joined, directed=False)
    return label[: len(faces)], np.column_stack([ends[first], face[first]]), faces_of % 2 == 1


def _span(
    heights: Float[np.ndarray, "t 3"], part: Int[np.ndarray, " t"], count: int
) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, " b"]]:
    """Lowest and highest of each part."""
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, part, heights.min(axis=1))
    np.maximum.at(high, part, heights.max(axis=1))
    return low, high


def _caps(
    vertices: Vertices, edges: Int64[np.ndarray, "e 2"], part: Int[np.ndarray, " e"], low: Float[np.ndarray, " b"]
) -> Triangles:
    """A triangle from each open edge to the middle of its part's open edges, at its bottom."""
    if not len(edges):
        return np.zeros((0, 3, 3))
    middle, count = np.zeros((len(low), 2)), np.bincount(part, minlength=len(low))
    np.add.at(middle, part, vertices[edges, :2].mean(axis=1))
    apex = np.column_stack([middle / np.maximum(count, 1)[:, None], low])[part]
    return np.stack([vertices[edges[:, 0]], vertices[edges[:, 1]], apex], axis=1)


def _ground(triangles: Triangles, part: Int[np.ndarray, " t"], candidate: Bool[np.ndarray, " b"]) -> int:
    """The part that is the ground; -1 where none is."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    level = np.abs(normal[:, 2]) >= _UPRIGHT * np.linalg.norm(normal, axis=1)
    steep = np.zeros(len(candidate), bool)
    steep[part[~level]] = True
    low, high = np.full((len(candidate), 3), np.inf), np.full((len(candidate), 3), -np.inf)
    np.minimum.at(low, part, triangles.min(axis=1))
    np.maximum.at(high, part, triangles.max(axis=1))
    lowest, highest = low.min(axis=0), high.max(axis=0)
    area = np.prod((high - low)[:, :2], axis=1)
    wide = area >= _WIDE * np.prod((highest - lowest)[:2])
    # Under everything: at most half of the other parts begin below it by more than its own rounding.
    under = np.array([np.mean(low[:, 2] >= z - _LEVEL) >= 0.5 for z in low[:, 2]]) if wide.any() else wide
    found = np.flatnonzero(candidate & ~steep & wide & under & (len(candidate) > 1))
    return int(found[np.argmax(area[found])]) if len(found) else OPEN
