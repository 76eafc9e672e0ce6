"""Heights in the tags of OpenStreetMap, as its XML and GeoJSON made of it have them.

    height = `height` (or the next of `HEIGHTS`), else 3 m · `building:levels` (or the next of `LEVELS`) + roof
    roof   = `roof:height`, else 3 m · `roof:levels`          levels leave out the roof, a height holds it
    of a wind turbine: `height`, or `height:hub` + `rotor:diameter` / 2 where that is more

A text may hold units, a range, a list or words: the highest reading that fits is taken, since a height that is too low
is flown into.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence

HEIGHTS = (
    "height", "building:height", "est_height", "HEIGHT", "Height", "measuredHeight", "measuredheight",
    "building_height", "render_height", "heightroof", "HEIGHTROOF", "height_roof",
)  # fmt: skip
"""Properties that hold heights, the first that a shape has counts."""
LEVELS = ("building:levels", "levels", "building_levels", "num_floors", "numFloors", "number_of_floors")
"""Properties that hold numbers of levels, likewise."""
_LEVEL = 3.0  # height of a storey [m]
_TALLEST, _HIGHEST = 1000.0, 9000.0  # [m]; readings beyond fit nothing that stands, and no ground
_LONGEST = 64  # characters of a text
_FOOT, _INCH = 0.3048, 0.0254
_UNITS = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "mt": 1.0, "mtr": 1.0, "cm": 0.01, "km": 1000.0,
    "ft": _FOOT, "feet": _FOOT, "foot": _FOOT, "'": _FOOT, "′": _FOOT, "’": _FOOT,
    "in": _INCH, "inch": _INCH, "inches": _INCH, '"': _INCH, "″": _INCH, "”": _INCH, "''": _INCH,
    "yd": 0.9144, "yard": 0.9144, "yards": 0.9144,
    **dict.fromkeys(("storey", "storeys", "story", "stories", "floor", "floors", "level", "levels", "fl"), _LEVEL),
}  # fmt: skip
# A number may follow a unit at once, as in 40ft6in.
_QUANTITY = re.compile(
    r"(?<![\d.,])[-+]?(\d+(?:[.,]\d+)*(?:e\+?\d{1,2}(?!\d))?|\.\d+)\s*([a-z]+|''|['\"′″’”])?", re.IGNORECASE
)
_PACKED = re.compile(r'"([^"\\]+)"=>"([^"\\]*)"')
_HALF = re.compile(r"(\d+)\s*(?:½|\s1/2)")
_GROUND_FLOOR = re.compile(r"[a-z]+\s*\+", re.IGNORECASE)  # as in G+4


@dataclasses.dataclass(frozen=True)
class Tall:
    """How tall something is.

    Attributes:
        metres: None where nothing says it.
        guessed: whether some text was not plain, and its highest reading was taken.
    """

    metres: float | None
    guessed: bool = False


def tall(
    tags: Mapping[str, str], unit: float = 1.0, heights: Sequence[str] = HEIGHTS, levels: Sequence[str] = LEVELS
) -> Tall:
    """How tall a thing is by its tags.

    Args:
        tags: of the file.
        unit: metres of a number that names none.
        heights, levels: names of those that say it, the first that is there counts.
    """
    guessed = False
    hub, rotor = length(tags.get("height:hub", ""), unit=unit), length(tags.get("rotor:diameter", ""), unit=unit)
    tip = 0.0 if hub is None else hub[0] + 0.5 * (rotor[0] if rotor else 0.0)
    for key in heights:
        if (text := tags.get(key, "").strip()) and (read := length(text, unit=unit)) is not None:
            if read[0] > 0:
                return Tall(max(read[0], tip), read[1])
            guessed = True
        elif text:
            guessed = True
    if tip > 0:
        return Tall(tip, guessed)
    count, odd = _count(next((tags[key] for key in levels if tags.get(key)), ""))
    if count is None:
        return Tall(None, guessed)
    roof = length(tags.get("roof:height", ""), unit=unit)
    above = roof[0] if roof is not None else _LEVEL * (_count(tags.get("roof:levels", ""))[0] or 0.0)
    total = _LEVEL * count + max(above, 0.0)
    return Tall(total if total > 0 else None, guessed or odd)


def with_other_tags(tags: Mapping[str, str]) -> Mapping[str, str]:
    """Tags, and those that ogr2ogr has put into one: `other_tags` as "height"=>"12","building:levels"=>"3"."""
    packed = tags.get("other_tags", "")
    return {**dict(_PACKED.findall(packed)), **tags} if packed else tags


def length(text: str, most: float = _TALLEST, unit: float = 1.0) -> tuple[float, bool] | None:
    """The highest length [m] that a text tells, and whether it is not plainly one; None where it tells none.

    Args:
        text: of a tag.
        most: that fits [m].
        unit: metres of a number that names none.
    """
    if not text or len(text) > _LONGEST:
        return None
    found: list[float] = []
    text = _HALF.sub(r"\1.5", text)
    rest: str = text
    before: float | str | None = None
    for match in _QUANTITY.finditer(text):
        number, word = match[1], (match[2] or "").lower()
        scale = _UNITS.get(word, 1.0) if word else unit
        value = scale * _number(number, most / scale)
        # Feet and inches are one length, and so are metres and what follows as in 12m50.
        if scale == _INCH and before == _FOOT and found:
            found[-1] += value
        elif before == "m" and not word and re.fullmatch(r"\d\d", number) and text[match.start() - 1] in "mM":
            found[-1] += 0.01 * value
        else:
            found.append(value)
        before = "m" if word == "m" else scale
        rest = rest.replace(match[0], " ", 1)
    held = [value for value in found if value <= most]
    if not found:
        return None
    held = held or found  # what fits nothing is refused where it is used
    low = text.strip().startswith("-")
    best = -held[0] if low and len(held) == 1 else max(held)
    return best, bool(rest.strip()) or len(held) > 1 or len(held) < len(found)


def metres(text: str, unit: float = 1.0) -> float | None:
    """A height above sea level [m]; None where it is missing or in words."""
    read = length(text, _HIGHEST, unit) if text else None
    return None if read is None or not math.isfinite(read[0]) else read[0]


def _number(text: str, most: float) -> float:
    """A number with commas or points in it; of two readings the higher one that is not above `most`."""
    mantissa, _, exponent = text.lower().partition("e")
    if exponent:
        return _number(mantissa, most) * 10.0 ** int(exponent)
    if "," not in text:
        return float(text) if text.count(".") <= 1 else float(text.replace(".", ""))
    grouped = re.fullmatch(r"\d{1,3}(?:,\d{3})+(?:\.\d+)?", text)
    if grouped and float(text.replace(",", "")) <= most:
        return float(text.replace(",", ""))
    parts = re.split(r"[.,]", text)
    return float("".join(parts[:-1]) + "." + parts[-1])


def _count(text: str) -> tuple[float | None, bool]:
    """The highest number in a text, or their sum where it says +; and whether it is not plainly one."""
    if not text or len(text) > _LONGEST:
        return None, bool(text)
    found = [_number(match[1], _TALLEST) for match in _QUANTITY.finditer(_HALF.sub(r"\1.5", text))]
    if "+" in text and found:
        found = [sum(found) + (_GROUND_FLOOR.match(text.strip()) is not None)]
    return (max(found) if found else None), re.fullmatch(r"\s*\d+(?:\.\d+)?\s*", text) is None
