"""Tagged shapes as solids: what OpenStreetMap's XML and GeoJSON have in common.

    base = ground,  top = base + height          ground by `ele`, or by that of the nearest thing which has one

`ele` is the ground's by definition, yet some files hold the roof's there: then heights go up and down with it. It is
taken as the roof's where the ground between neighbours gets smoother by half and by more than 5 m for that. Los
Angeles County's import has an `elevation`, which is the roof's (over the blocks of Venice it rises with the height, one
to one). What hangs in the air (`min_height`) is taken as solid down to the ground.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float64

from maxjax.core.files import FileError
from maxjax.io.geo.degrees import side_by_side
from maxjax.io.geo.reference_system import unit_of
from maxjax.io.geo.units_and_axes import Reference, Stated, reference
from maxjax.io.geo.vertical_zero import UNSTATED, VerticalZero
from maxjax.io.kinds.footprints import Footprint, Footprints, check_footprints, swept
from maxjax.io.readers.standing import Kind, width_of
from maxjax.io.readers.tag_heights import HEIGHTS, LEVELS, Tall, length, metres, tall
from maxjax.io.reading import Reading

_DEGREES = "EPSG:4326"
_SMOOTHER, _STEP = 0.5, 5.0  # share, and metres between neighbours
# Parts of names of properties that may be heights, and how many of them are told.
_LIKE_HEIGHTS = (
    "height", "hgt", "hoehe", "hohe", "altura", "haut", "elev", "_ht", "ht_", "roof", "stor", "floor", "level",
)  # fmt: skip
_MOST_TOLD = 8
_STEEP = 20.0  # [m]; ground that steps by more, and by more than the way between neighbours, is said

Places = Float64[np.ndarray, "_ 2"]


@dataclasses.dataclass(frozen=True, eq=False)
class Tagged:
    """A shape with tags.

    Attributes:
        shape: an `area` of rings, its outline first, or a `line` of corners, a point of one.
        parts: rings, or the line alone, in the file's coordinates.
        kind: of thing.
        tags: of the file.
        name: the file's.
        levels: lowest and highest third coordinate of its corners, in the file's unit of heights; None: it has none.
    """

    shape: Literal["area", "line"]
    parts: tuple[Places, ...]
    kind: Kind
    tags: Mapping[str, str]
    name: str
    levels: tuple[float, float] | None = None


def solids_of(
    things: Sequence[Tagged], dropped: Mapping[str, int], stated: Stated, reading: Reading, path: Path
) -> Footprints:
    """Tagged shapes as footprints with heights, in metres.

    Args:
        things: of a file.
        dropped: what of the file is none of them, by kind.
        stated: of the coordinates.
        reading: what the user says, of the coordinates and of what is wanted.
        path: for messages.

    Raises:
        FileError: if there is nothing with a height; as `reference`.
    """
    left = Counter(dropped)
    asked = [not reading.only or thing.kind.key in reading.only for thing in things]
    left.update(f"{t.kind.name} that were not asked for" for t, held in zip(things, asked, strict=True) if not held)
    wanted = [thing for thing, held in zip(things, asked, strict=True) if held]
    heights = [_tall(thing.tags, reading) for thing in wanted]
    known = [h.metres is not None or t.kind.height is not None for t, h in zip(wanted, heights, strict=True)]
    left.update(f"{t.kind.name} without a height" for t, held in zip(wanted, known, strict=True) if not held)
    kept = [(t, h) for t, h, held in zip(wanted, heights, known, strict=True) if held]
    if not kept:
        counts = ", ".join(f"{count} {kind}" for kind, count in left.items()) or "0 without"
        hint = _numbers(wanted)
        raise FileError(f"{path}: expected a building with an outline and a height, found none ({counts}){hint}")
    lines, how = _placed([part for thing, _ in kept for part in thing.parts], stated, reading, path)
    parts = iter(lines)
    shapes = [[next(parts) for _ in thing.parts] for thing, _ in kept]
    unit = how.vertical_unit
    if unit != 1.0:
        kept = [(thing, _tall(thing.tags, reading, unit)) for thing, _ in kept]
    height = np.array([h.metres if h.metres is not None else t.kind.height for t, h in kept], np.float64)
    floors, rises, remarks = _floors([thing for thing, _ in kept])
    base, told = grounds(np.array([s[0].mean(axis=0) for s in shapes]), height, floors, unit)
    height += unit * rises
    buildings: list[Footprint] = []
    for (thing, _), shape, foot, top in zip(kept, shapes, base.tolist(), (base + height).tolist(), strict=True):
        if thing.shape == "area":
            buildings.append(Footprint(tuple(shape), foot, top, thing.name))
        else:
            width, _ = width_of(thing.tags, thing.kind)
            buildings += [Footprint((ring,), foot, top, thing.name) for ring in swept(shape[0], width)]
    read = Counter(thing.kind.name for thing, _ in kept)
    none = np.zeros((0, 3, 3))
    found = Footprints(
        tuple(buildings),
        none,
        path.name,
        read=read,
        dropped=dict(left),
        reference=dataclasses.replace(how, zero=_zero([thing for thing, _ in kept], how, by_corners=bool(remarks))),
        remarks=(*remarks, *told, *_said(kept)),
    )
    return check_footprints(found, path)


def _floors(
    things: Sequence[Tagged],
) -> tuple[list[Mapping[str, str]], Float64[np.ndarray, " n"], tuple[str, ...]]:
    """Tags with the lowest third coordinate as `ele` where there is none, how far the highest is above it, a remark.

    A file whose third coordinates are all 0 says nothing by them.
    """
    said = [thing.levels if thing.levels is not None and "ele" not in thing.tags else None for thing in things]
    if not any(any(levels) for levels in said if levels is not None):
        return [thing.tags for thing in things], np.zeros(len(things)), ()
    tags = [t.tags if z is None else {**t.tags, "ele": repr(z[0])} for t, z in zip(things, said, strict=True)]
    rises = np.array([0.0 if z is None else z[1] - z[0] for z in said])
    count = sum(z is not None for z in said)
    return tags, rises, (f"{count} shapes stand on their third coordinate, the lowest of each",)


def _zero(things: Sequence[Tagged], how: Reference, *, by_corners: bool) -> VerticalZero:
    """What floors count from: `ele` from sea level by definition, third coordinates from what the file's heights do.

    Without either, floors lie at 0, wherever that is.
    """
    if by_corners:
        return how.zero
    said = any(metres(thing.tags.get(key, "")) is not None for thing in things for key in ("ele", "elevation"))
    return VerticalZero(0.0, "ele of the file") if said else UNSTATED


def _tall(tags: Mapping[str, str], reading: Reading, unit: float = 1.0) -> Tall:
    """How tall a thing is, by the properties that the user names, else by those that are known."""
    name, _, own = (reading.height or "").partition(":")
    heights = (name,) if name else HEIGHTS
    return tall(tags, unit_of(own) if own else unit, heights, (reading.levels,) if reading.levels else LEVELS)


def _numbers(things: Sequence[Tagged]) -> str:
    """Numeric properties that may be heights, with their ranges, and how to name one; empty where there are none."""
    found: dict[str, list[float]] = {}
    for thing in things:
        for name, text in thing.tags.items():
            if any(part in name.lower() for part in _LIKE_HEIGHTS) and (read := length(text)) is not None:
                found.setdefault(name, []).append(read[0])
    if not found:
        return ""
    told = ", ".join(
        f"{name} ({min(values):g} to {max(values):g})" for name, values in list(found.items())[:_MOST_TOLD]
    )
    return f"; if one of these is the height, name it with its unit, as --height {next(iter(found))}:m: {told}"


def _placed(lines: list[Places], stated: Stated, reading: Reading, path: Path) -> tuple[list[Places], Reference]:
    """Lines of the file's coordinates as metres."""
    if stated.system is None and reading.crs is None:
        raise FileError(f"{path}: expected a reference system, found none; --crs CODE names it")
    corners = np.concatenate(lines)
    if reading.crs not in (None, _DEGREES) and (np.abs(corners).max(axis=0) <= (180.0, 90.0)).all():
        raise FileError(f"{path}: --crs: {_DEGREES} of the file is in degrees, as its coordinates are; leave it out")
    if (reading.crs or stated.system) == _DEGREES:
        lines = side_by_side(lines, path)
        corners = np.concatenate(lines)
    if not np.isfinite(corners).all():
        raise FileError(f"{path}: expected finite coordinates; damaged")
    how = reference(stated, reading, np.array([corners.min(axis=0), corners.max(axis=0)]), path)
    return [how.plane(line) for line in lines], how


def grounds(
    places: Places, height: Float64[np.ndarray, " n"], tags: Sequence[Mapping[str, str]], unit: float = 1.0
) -> tuple[Float64[np.ndarray, " n"], tuple[str, ...]]:
    """Height of the ground under each thing [m], and sentences on what is taken for it.

    Args:
        places: of each [m].
        height: of each [m].
        tags: `ele` and `elevation` among them.
        unit: metres of a number that names none.
    """
    ele = np.array([_or_nan(metres(t.get("ele", ""), unit)) for t in tags])
    roof = np.array([_or_nan(metres(t.get("elevation", ""), unit)) for t in tags])
    remarks = []
    if _of_roofs(places, height, ele):
        ele = ele - height
        remarks.append("ele is taken as that of roofs, since the ground would jump between neighbours otherwise")
    ground = np.where(np.isnan(ele), roof - height, ele)
    missing = np.isnan(ground)
    if (step := _steepest(places[~missing], ground[~missing])) > _STEEP:
        remarks.append(
            f"the ground steps by up to {step:.0f} m between neighbours: is the ele of some that of the roof?"
        )
    if missing.all():
        return np.zeros(len(places)), tuple(remarks)
    if missing.any():
        ground[missing] = ground[~missing][_nearest(places[~missing], places[missing])]
        remarks.append(
            f"{int(missing.sum())} of {len(places)} shapes have no ele, and stand on the ground of the nearest that has"
        )
    return ground, tuple(remarks)


def _of_roofs(places: Places, height: Float64[np.ndarray, " n"], ele: Float64[np.ndarray, " n"]) -> bool:
    """Whether `ele` is that of roofs."""
    known = np.flatnonzero(~np.isnan(ele))
    if len(known) < 2:
        return False
    beside = known[_nearest(places[known], places[known], second=True)]
    as_ground = float(np.median(np.abs(ele[known] - ele[beside])))
    as_roofs = float(np.median(np.abs((ele - height)[known] - (ele - height)[beside])))
    return as_roofs < _SMOOTHER * as_ground and as_ground - as_roofs > _STEP


def _steepest(places: Places, ground: Float64[np.ndarray, " n"]) -> float:
    """Highest step of the ground between neighbours that is steeper than 1 in 1 [m]; 0 where there is none."""
    if len(places) < 2:
        return 0.0
    beside = _nearest(places, places, second=True)
    step = np.abs(ground - ground[beside])
    return float(step[step > np.hypot(*(places - places[beside]).T)].max(initial=0.0))


def _nearest(among: Places, places: Places, *, second: bool = False) -> np.ndarray:
    """Number of the nearest of some places, or of the nearest but itself."""
    from scipy.spatial import cKDTree  # a quarter of a second that most commands can do without

    found = np.asarray(cKDTree(among).query(places, k=2 if second else 1)[1])
    return found[:, 1] if second else found


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def _said(kept: Sequence[tuple[Tagged, Tall]]) -> list[str]:
    """Sentences on widths and heights that no tag says, and on those that were not plain."""
    wide: Counter[tuple[str, float]] = Counter()
    high: Counter[tuple[str, float]] = Counter()
    guessed = 0
    for thing, found in kept:
        guessed += found.guessed
        if found.metres is None and thing.kind.height is not None:
            high[thing.kind.name, thing.kind.height] += 1
        width, stated = width_of(thing.tags, thing.kind)
        if thing.shape == "line" and not stated:
            wide[thing.kind.name, width] += 1
    sentences = []
    if wide:
        each = ", ".join(f"{count} {name} are {width:g} m wide" for (name, width), count in wide.items())
        sentences.append(f"without a width, {each}")
    if high:
        each = ", ".join(f"{count} {name} are {height:g} m tall" for (name, height), count in high.items())
        sentences.append(f"without a height, {each}")
    if guessed:
        sentences.append(f"{guessed} heights are not plain numbers of metres; the highest reading that fits is taken")
    return sentences
