"""Meshes: surfaces as obstacles, and what closed ones enclose (`io.kinds.bodies`).

Corners that agree to a micrometre are one corner. Inside a closed body all is solid, and under one that is open below
down to the ground; of one that is open elsewhere only the surface is an obstacle, and what lies within may be flown
through where a way leads in. The vertices alone are never the map: walls stand between them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64

from maxjax.core.files import FileError
from maxjax.core.grid import Grid
from maxjax.io.geo.own_axes import bring_upright
from maxjax.io.geo.triangles import Triangles, Volume, voxels_enclosed, voxels_touched
from maxjax.io.geo.units_and_axes import UNREFERENCED, Reference, Stated, reference
from maxjax.io.kinds.airborne import NONE, from_nearest
from maxjax.io.kinds.bodies import OPEN, Bodies, bodies_of, weld
from maxjax.io.reading import PLAIN, Reading

MAX_FACES = 10_000_000


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Triangles of a file, on the host.

    Attributes:
        triangles: corners [m], in the file's coordinates, z up.
        bodies: what each is part of.
        points: vertices that no face uses [m]; obstacles as they are.
        source: the file's name.
        reference: of its coordinates.
        dropped: what of the file is not used, by kind.
    """

    triangles: Triangles
    bodies: Bodies
    points: Float[np.ndarray, "n 3"]
    source: str
    reference: Reference = UNREFERENCED
    dropped: Mapping[str, int] = dataclasses.field(default_factory=dict)

    @property
    def closed_bodies(self) -> int:
        """How many bodies are closed, and so filled; those open below are among them."""
        return int(self.bodies.body.max(initial=OPEN)) + 1

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on what could not be filled, and on what is taken for what it does not say."""
        found, said = self.bodies, []
        if found.open_below:
            said.append(f"{found.open_below} bodies are open below, and are filled down to the ground")
        if found.ground.any():
            said.append(f"a level sheet of {int(found.ground.sum())} faces under everything is taken as the ground")
        if found.open_bodies:
            share = float(np.mean((found.body == OPEN) & ~found.ground))
            said.append(
                f"{found.open_bodies} of {found.open_bodies + self.closed_bodies} bodies ({100 * share:.0f} % of the "
                "faces) are not closed: their surfaces are obstacles, what they surround is not filled"
            )
        return tuple(said)

    def voxels(self, grid: Grid, *, hollow: bool = False) -> tuple[Volume, Volume]:
        """Voxels that a face or a loose vertex touches, with those inside closed bodies; and those of the ground.

        Args:
            grid: of the map.
            hollow: whether closed bodies are free inside, as rooms are.
        """
        found, loose = self.bodies, np.repeat(self.points[:, None], 3, axis=1)
        open_below = np.isin(found.body, found.cap_of)
        closed = (found.body != OPEN) & ~open_below & (not hollow)
        solid: Volume = voxels_enclosed(self.triangles[closed], found.body[closed], grid)
        ground = self._ground(grid)
        if open_below.any():
            whole = np.concatenate([self.triangles[open_below], found.caps])
            filled = voxels_enclosed(whole, np.concatenate([found.body[open_below], found.cap_of]), grid)
            if ground.any():
                filled = np.logical_or.accumulate(filled[:, :, ::-1], axis=2)[:, :, ::-1] & ~ground
            solid |= filled
        solid |= voxels_touched(self.triangles[~found.ground], grid)
        solid |= voxels_touched(loose, grid)
        return solid, ground

    def _ground(self, grid: Grid) -> Volume:
        """Voxels up to the sheet that is the ground; beside it, up to its nearest height."""
        if not self.bodies.ground.any():
            return np.zeros(grid.shape, bool)
        surface = voxels_touched(self.triangles[self.bodies.ground], grid)
        top = np.where(surface.any(axis=2), grid.shape[2] - 1 - surface[:, :, ::-1].argmax(axis=2), NONE)
        found: Volume = np.arange(grid.shape[2]) <= from_nearest(top)[:, :, None]
        return found


def mesh_of(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int64[np.ndarray, "t 3"],
    path: Path,
    reading: Reading = PLAIN,
    up: str = "z",
) -> Mesh:
    """A mesh of what a file holds.

    Args:
        vertices: as the file has them.
        faces: three indices of vertices each.
        path: for messages.
        reading: of its coordinates.
        up: the axis that the format has up.

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
    vertices, reading = bring_upright(vertices, reading, path, up)
    how = reference(Stated(), reading, np.array([vertices.min(axis=0), vertices.max(axis=0)])[:, :2], path)
    corners, index = weld(how.metres(vertices))
    faces = index[faces]
    loose = np.ones(len(corners), bool)
    loose[faces] = False
    return Mesh(corners[faces], bodies_of(corners, faces), corners[loose], path.name, how)


def merge_meshes(meshes: Sequence[Mesh], source: str, dropped: Mapping[str, int]) -> Mesh:
    """Several meshes as one: each keeps its own bodies, and the ground is found among all of them.

    Args:
        meshes: at least one, of one reference.
        source: name of what holds them.
        dropped: what of that is not used, by kind.
    """
    corners, faces, count = [], [], 0
    for mesh in meshes:
        vertices, index = weld(mesh.triangles.reshape(-1, 3))
        corners.append(vertices)
        faces.append(index.reshape(-1, 3) + count)
        count += len(vertices)
    vertices, index = np.concatenate(corners), np.concatenate(faces)
    loose = np.concatenate([mesh.points for mesh in meshes])
    return Mesh(vertices[index], bodies_of(vertices, index), loose, source, meshes[0].reference, dropped)


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
