"""Faces of what a file holds, as triangles: what stands, part by part, and the ground.

    outward    the side from which a triangle's corners go around counter-clockwise

A prism's walls and its roof are outward by construction, a floor closes it. Faces of a shell or of a mesh's body are
brought outward as a whole, by the sign of the volume Σ a·(b × c)/6, where they close; where they do not, the file's
order is kept and may be either.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float, Int64

from maxjax.io.geo.polygons import covering
from maxjax.io.geo.rings import signed_area, surrounds
from maxjax.io.geo.triangles import Triangles, area_normals
from maxjax.io.kinds.bodies import OPEN
from maxjax.io.kinds.footprints import Fill, Footprint, Footprints
from maxjax.io.kinds.mesh import Mesh


@dataclasses.dataclass(frozen=True, eq=False)
class Faces:
    """Triangles of a file, in the map's coordinates [m].

    Attributes:
        triangles: (n, 3, 3) corners of what stands.
        part: (n,) number of the part that each is of.
        closed: (p,) whether a part's faces close, so that they are known to be outward.
        names: of the parts, the file's.
        buildings: of each part, the building that it belongs to.
        terrain: (t, 3, 3) corners of the ground, upward; none where the file has no such faces.
    """

    triangles: Float[np.ndarray, "n 3 3"]
    part: Int64[np.ndarray, " n"]
    closed: Bool[np.ndarray, " p"]
    names: tuple[str, ...]
    buildings: tuple[str, ...]
    terrain: Float[np.ndarray, "t 3 3"]


def faces_of(contents: Footprints | Mesh) -> Faces:
    """The faces of a city model or of a mesh."""
    return _of_mesh(contents) if isinstance(contents, Mesh) else _of_model(contents)


def _of_model(found: Footprints) -> Faces:
    shells, count = found.shells, len(found.shells.names)
    prisms = [_prism(building) for building in found.buildings]
    triangles = np.concatenate([shells.faces, *prisms])
    part = np.concatenate([shells.of_face, np.repeat(count + np.arange(len(prisms)), [len(one) for one in prisms])])
    closed = np.concatenate([shells.fill == Fill.INSIDE, np.ones(len(prisms), bool)])
    own = tuple(building.name for building in found.buildings)
    part = part.astype(np.int64)
    return Faces(
        _outward(triangles, part, closed),
        part,
        closed,
        (*shells.names, *own),
        (*(shells.buildings or shells.names), *own),
        _upward(found.terrain),
    )


def _of_mesh(mesh: Mesh) -> Faces:
    found = mesh.bodies
    stands = ~found.ground
    triangles = np.concatenate([mesh.triangles[stands], found.caps])
    # What is open is one part more, the last.
    body = np.concatenate([found.body[stands], found.cap_of]).astype(np.int64)
    part = np.where(body == OPEN, mesh.closed_bodies, body)
    closed = np.arange(mesh.closed_bodies + 1) < mesh.closed_bodies
    names = (*(f"body {k}" for k in range(mesh.closed_bodies)), "open faces")
    return Faces(_outward(triangles, part, closed), part, closed, names, names, _upward(mesh.triangles[found.ground]))


def _prism(building: Footprint) -> Triangles:
    """Walls, roof and floor of a prism."""
    found = []
    for k, ring in enumerate(building.rings):
        others = [other for j, other in enumerate(building.rings) if j != k]
        outline = sum(surrounds(other, 0.5 * (ring[0] + ring[1])) for other in others) % 2 == 0
        a = ring if (signed_area(ring) > 0) == outline else ring[::-1]
        b = np.roll(a, -1, axis=0)
        low_a, low_b, high_a, high_b = (
            np.column_stack([side, np.full(len(a), z)]) for z in (building.base, building.top) for side in (a, b)
        )
        found += [np.stack([low_a, low_b, high_b], axis=1), np.stack([low_a, high_b, high_a], axis=1)]
    for z, way in ((building.top, 1.0), (building.base, -1.0)):
        level = covering([np.column_stack([ring, np.full(len(ring), z)]) for ring in building.rings])
        found.append(np.where((way * area_normals(level)[:, 2] < 0)[:, None, None], level[:, ::-1], level))
    return np.concatenate(found)


def _outward(triangles: Triangles, part: Int64[np.ndarray, " n"], closed: Bool[np.ndarray, " p"]) -> Triangles:
    """Triangles with those of closed parts whose volume is negative turned around."""
    first = np.zeros((len(closed), 3))
    first[part] = triangles[:, 0]
    local = triangles - first[part][:, None]
    six = np.einsum("nk,nk->n", local[:, 0], np.cross(local[:, 1], local[:, 2]))
    inward = closed & (np.bincount(part, six, minlength=len(closed)) < 0)
    return np.where(inward[part][:, None, None], triangles[:, ::-1], triangles)


def _upward(triangles: Triangles) -> Triangles:
    return np.where((area_normals(triangles)[:, 2] < 0)[:, None, None], triangles[:, ::-1], triangles)
