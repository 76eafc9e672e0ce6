"""What is to be inspected: buildings by name, by a place in plan, an outline, or a box.

"way 12", ("way 12", "way 13")     buildings, by the file's names of them or of their parts
(x, y)                             the building there, or the nearest one within a few metres
((x, y), (x, y), (x, y), …)        façades and roofs within an outline
((x, y, z), (x, y, z))             those within a box, by its lowest and highest corner
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.io.geo.rings import signed_area
from maxjax.io.kinds.faces import Faces
from maxjax.sim.worlds.real_city import inside

Target = str | Sequence[Any] | np.ndarray

_BESIDE = 5.0  # how far from a place in plan a building may be that is meant [m]
_SHOWN = 3  # names in a message

Points = Float64[np.ndarray, "n 3"]


@dataclasses.dataclass(frozen=True, eq=False)
class Chosen:
    """Faces that a target names.

    Attributes:
        faces: (n,) those of what stands that may be of it.
        outline: corners of the plan that its points lie in [m]; None: all.
        box: lowest and highest corner that they lie between [m]; None: all.
        name: of it, in words.
    """

    faces: Bool[np.ndarray, " n"]
    outline: Float64[np.ndarray, "k 2"] | None
    box: Float64[np.ndarray, "2 3"] | None
    name: str

    def holds(self, points: Points) -> Bool[np.ndarray, " n"]:
        """Whether points of its faces are of it."""
        if self.outline is not None:
            return inside([self.outline], points[:, :2])
        if self.box is not None:
            return np.asarray(((points >= self.box[0]) & (points <= self.box[1])).all(axis=1))
        return np.ones(len(points), bool)


def choose(faces: Faces, target: Target) -> Chosen:
    """The faces that a target names.

    Raises:
        ValueError: if there is no such building, with those whose names are alike; if the target is none; if its
            outline crosses itself.
    """
    if isinstance(target, str):
        return _by_names(faces, (target,))
    if isinstance(target, Sequence) and len(target) and all(isinstance(name, str) for name in target):
        return _by_names(faces, tuple(target))
    numbers = _numbers("target", target)
    every = np.ones(len(faces.triangles), bool)
    if numbers.shape == (2,):
        return _by_place(faces, numbers)
    if numbers.shape == (2, 3):
        box = np.stack([numbers.min(axis=0), numbers.max(axis=0)])
        return Chosen(every, None, box, f"everything from {_words(box[0])} to {_words(box[1])}")
    outline = check_outline("target", numbers)
    return Chosen(every, outline, None, f"everything within an outline of {len(outline)} corners")


def check_outline(name: str, corners: Any) -> Float64[np.ndarray, "k 2"]:
    """Corners of an outline in plan, its first not repeated.

    Raises:
        ValueError: unless it has three corners and an area, and does not cross itself.
    """
    outline = _numbers(name, corners)
    if outline.ndim != 2 or outline.shape[1] != 2 or len(outline) < 3:
        raise ValueError(f"{name}: expected an outline, (n, 2) with n >= 3 [m], given {outline.shape}")
    if (outline[0] == outline[-1]).all():
        outline = outline[:-1]
    crossing = _crossing(outline)
    if crossing is not None:
        i, j, (x, y) = crossing
        raise ValueError(
            f"{name}: expected an outline that does not cross itself, given one whose edges {i + 1} and {j + 1} do, "
            f"at x {x:.1f}, y {y:.1f}; put its corners in order"
        )
    area = signed_area(outline)
    if len(outline) < 3 or area == 0.0:
        raise ValueError(f"{name}: expected an outline with an area, given {len(outline)} corners on a line")
    return outline if area > 0 else outline[::-1]


def check_line(name: str, corners: Any) -> Float64[np.ndarray, "k 2"]:
    """Corners of a line in plan.

    Raises:
        ValueError: unless it has two corners, none twice in a row.
    """
    line = _numbers(name, corners)
    if line.ndim != 2 or line.shape[1] != 2 or len(line) < 2:
        raise ValueError(f"{name}: expected a line, (n, 2) with n >= 2 [m], given {line.shape}")
    if (np.linalg.norm(np.diff(line, axis=0), axis=1) == 0.0).any():
        raise ValueError(f"{name}: expected a line without a corner twice in a row, given one")
    return line


def _numbers(name: str, given: Any) -> Float64[np.ndarray, "..."]:
    try:
        numbers = np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        buildings = "a building's name or several, a place (x, y), a box (2, 3), or " * (name == "target")
        raise ValueError(f"{name}: expected {buildings}corners (n, 2) [m], given {given!r}") from error
    if not np.isfinite(numbers).all():
        raise ValueError(f"{name}: expected finite numbers [m], given some that are not")
    return numbers


def _by_names(faces: Faces, names: tuple[str, ...]) -> Chosen:
    """Faces of some buildings, each by its name, that of a part, or the last word of it."""
    chosen = np.zeros(len(faces.names), bool)
    for name in names:
        found = np.array([name in (own, whole) for own, whole in zip(faces.names, faces.buildings, strict=True)])
        if not found.any():
            found = np.array([name == whole.rpartition(" ")[2] for whole in faces.buildings])
        if not found.any():
            raise ValueError(_unknown(name, faces))
        chosen |= found
    return Chosen(chosen[faces.part], None, None, ", ".join(names))


def _unknown(name: str, faces: Faces) -> str:
    known = sorted({*faces.names, *faces.buildings})
    near = difflib.get_close_matches(name, known, _SHOWN, 0.5)
    told = f"near it are {', '.join(near)}" if near else f"it has, for example, {', '.join(known[:_SHOWN])}"
    count = len(set(faces.buildings))
    return f"target: expected a building of the map, given {name!r}; of its {count} buildings {told}"


def _by_place(faces: Faces, place: Float64[np.ndarray, "2"]) -> Chosen:
    """Faces of the building that stands at a place, else of the nearest."""
    flat = faces.triangles[:, :, :2]
    away = _distances(flat, place)
    near = np.flatnonzero(away <= _BESIDE)
    if not len(near):
        nearest = f"the nearest is {faces.buildings[faces.part[away.argmin()]]}, {away.min():.1f} m away"
        told = nearest if len(away) else "the map has none"
        raise ValueError(f"target: expected a building at x {place[0]:g}, y {place[1]:g}, found none; {told}")
    # Of several at the place the highest, as a click from above meets it.
    top = faces.triangles[:, :, 2].max(axis=1)
    best = min(near.tolist(), key=lambda k: (round(float(away[k]), 3), -top[k]))
    name = faces.buildings[faces.part[best]]
    same = np.array([whole == name for whole in faces.buildings])
    return Chosen(same[faces.part], None, None, name)


def _distances(flat: Float64[np.ndarray, "n 3 2"], place: Float64[np.ndarray, "2"]) -> Float64[np.ndarray, " n"]:
    """Distance in plan from a place to triangles; 0 within."""
    a, b = flat, np.roll(flat, -1, axis=1)
    edge, to = b - a, place - a
    square = np.einsum("nek,nek->ne", edge, edge)
    share = np.clip(np.einsum("nek,nek->ne", edge, to) / np.where(square > 0, square, 1.0), 0.0, 1.0)
    away = np.linalg.norm(to - share[..., None] * edge, axis=2).min(axis=1)
    turn = edge[..., 0] * to[..., 1] - edge[..., 1] * to[..., 0]
    within = ((turn >= 0).all(axis=1) | (turn <= 0).all(axis=1)) & (np.abs(turn).max(axis=1) > 0)
    return np.where(within, 0.0, away)


def _crossing(outline: Float64[np.ndarray, "k 2"]) -> tuple[int, int, Float64[np.ndarray, "2"]] | None:
    """Two edges of an outline that cross or touch though they are not neighbours, and where; None: it is simple."""
    count, following = len(outline), np.roll(outline, -1, axis=0)
    for i in range(count):
        for j in range(i + 2, count - (i == 0)):
            where = _meeting(outline[i], following[i], outline[j], following[j])
            if where is not None:
                return i, j, where
    return None


def _meeting(
    a: Float64[np.ndarray, "2"], b: Float64[np.ndarray, "2"], c: Float64[np.ndarray, "2"], d: Float64[np.ndarray, "2"]
) -> Float64[np.ndarray, "2"] | None:
    """Where two segments meet; None where they do not."""
    first, second, gap = b - a, d - c, c - a
    turn = first[0] * second[1] - first[1] * second[0]
    if turn == 0.0:  # parallel: they meet where an end of one lies on the other
        for p, q, r in ((a, b, c), (a, b, d), (c, d, a), (c, d, b)):
            off = (q - p)[0] * (r - p)[1] - (q - p)[1] * (r - p)[0]
            if off == 0.0 and 0.0 <= (r - p) @ (q - p) <= (q - p) @ (q - p):
                return r
        return None
    s = (gap[0] * second[1] - gap[1] * second[0]) / turn
    t = (gap[0] * first[1] - gap[1] * first[0]) / turn
    return a + s * first if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0 else None


def _words(point: Float64[np.ndarray, " d"]) -> str:
    return f"({', '.join(f'{x:g}' for x in point.tolist())})"
