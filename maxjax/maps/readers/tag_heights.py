"""Heights in the tags of OpenStreetMap, as its XML and GeoJSON made of it have them.

    height = `height` (or `building:height`, `est_height`), else 3 m · `building:levels` + roof
    roof   = `roof:height`, else 3 m · `roof:levels`          levels leave out the roof, a height holds it

A text may hold units, a range, a list or words: the highest reading that fits is taken, since a height that is too low
is flown into.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping

_LEVEL = 3.0  # height of a storey [m]
_TALLEST = 1000.0  # [m]; a reading beyond fits nothing that stands
_LONGEST = 64  # characters of a text
_FOOT, _INCH = 0.3048, 0.0254
_UNITS = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "mt": 1.0, "mtr": 1.0, "cm": 0.01, "km": 1000.0,
    "ft": _FOOT, "feet": _FOOT, "foot": _FOOT, "'": _FOOT, "′": _FOOT, "’": _FOOT,
    "yd": 0.9144, "yard": 0.9144, "yards": 0.9144, "fathoms": 1.8288,
    "storey": _LEVEL, "storeys": _LEVEL, "story": _LEVEL, "stories": _LEVEL, "floor": _LEVEL, "floors": _LEVEL,
    "level": _LEVEL, "levels": _LEVEL, "fl": _LEVEL,
    "in": _INCH, "inch": _INCH, "inches": _INCH, '"': _INCH, "″": _INCH, "”": _INCH, "''": _INCH,
}  # fmt: skip
_HALF = re.compile(r"(\d+)\s*(?:½|\s1/2)")
_QUANTITY = re.compile(r"(?<![\w.,])[-+]?(\d+(?:[.,]\d+)*|\.\d+)\s*([a-z]+|''|['\"′″’”])?", re.IGNORECASE)


@dataclasses.dataclass(frozen=True)
class Tall:
    """How tall something is.

    Attributes:
        metres: None where nothing says it.
        guessed: whether some text was not plain, and its highest reading was taken.
    """

    metres: float | None
    guessed: bool = False


def tall(tags: Mapping[str, str]) -> Tall:
    """How tall a thing is by its tags."""
    guessed = False
    for key in ("height", "building:height", "est_height"):
        if (text := tags.get(key, "").strip()) and (read := length(text)) is not None:
            if read[0] > 0:
                return Tall(*read)
            guessed = True
        elif text:
            guessed = True
    levels, odd = _count(tags.get("building:levels") or tags.get("levels") or "")
    if levels is None or levels <= 0:
        return Tall(None, guessed)
    roof = length(tags.get("roof:height", ""))
    above = roof[0] if roof is not None else _LEVEL * (_count(tags.get("roof:levels", ""))[0] or 0.0)
    return Tall(_LEVEL * levels + max(above, 0.0), guessed or odd)


def length(text: str) -> tuple[float, bool] | None:
    """The highest length [m] that a text tells, and whether it is not plainly one; None where it tells none."""
    if len(text) > _LONGEST:
        return None
    found: list[float] = []
    text = _HALF.sub(r"\1.5", text)
    rest, before = text, None
    for match in _QUANTITY.finditer(text):
        number, unit = match[1], (match[2] or "").lower()
        scale = _UNITS.get(unit, 1.0)
        value = scale * _number(number, scale)
        # Feet and inches are one length.
        if scale == _INCH and before == _FOOT and found:
            found[-1] += value
        else:
            found.append(value)
        before = scale
        rest = rest.replace(match[0], " ", 1)
    held = [value for value in found if value <= _TALLEST]
    if not found:
        return None
    held = held or found  # what fits nothing is refused where it is used
    low = text.strip().startswith("-")
    best = -held[0] if low and len(held) == 1 else max(held)
    return best, bool(rest.strip()) or len(held) > 1 or len(held) < len(found)


def metres(text: str) -> float | None:
    """A height above sea level [m]; None where it is missing or in words."""
    read = length(text) if text else None
    return None if read is None or not math.isfinite(read[0]) else read[0]


def _number(text: str, scale: float) -> float:
    """A number with commas or points in it; of two readings the higher one that fits."""
    if "," not in text:
        return float(text) if text.count(".") <= 1 else float(text.replace(".", ""))
    grouped = re.fullmatch(r"\d{1,3}(?:,\d{3})+(?:\.\d+)?", text)
    if grouped and scale * float(text.replace(",", "")) <= _TALLEST:
        return float(text.replace(",", ""))
    parts = re.split(r"[.,]", text)
    return float("".join(parts[:-1]) + "." + parts[-1])


def _count(text: str) -> tuple[float | None, bool]:
    """The highest number in a text, and whether it is not plainly one."""
    if not text or len(text) > _LONGEST:
        return None, bool(text)
    found = [_number(match[1], 1.0) for match in _QUANTITY.finditer(_HALF.sub(r"\1.5", text))]
    return (max(found) if found else None), re.fullmatch(r"\s*\d+(?:\.\d+)?\s*", text) is None
