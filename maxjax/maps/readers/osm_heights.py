"""Heights of buildings in the tags of OpenStreetMap, as its XML and GeoJSON made of it have them.

Height: `height` [m], else 3 m for each of `building:levels`. Floor: `ele`; else, where Los Angeles County's import
gives an `elevation`, that less the height, for there it is the roof's (over the blocks of Venice it rises with the
height, one to one); else 0. What hangs in the air (`min_height`) is taken as solid down to the floor.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

_LEVEL = 3.0  # height of a storey [m]
_NUMBER = re.compile(r"\s*([-+]?\d+(?:\.\d*)?)\s*m?\s*")
_LONGEST = 32  # characters of a number


def span(tags: Mapping[str, str]) -> tuple[float, float] | None:
    """Base and top of a building [m]; None where no height is given or it is not above zero."""
    levels = _number(tags, "building:levels")
    height = _number(tags, "height") or (None if levels is None else _LEVEL * levels)
    if height is None or height <= 0:
        return None
    floor, roof = _number(tags, "ele"), _number(tags, "elevation")
    base = floor if floor is not None else 0.0 if roof is None else roof - height
    return base, base + height


def _number(tags: Mapping[str, str], key: str) -> float | None:
    """A tag's value in metres; None where it is missing or in words or other units."""
    text = tags.get(key, "")
    match = _NUMBER.fullmatch(text) if len(text) <= _LONGEST else None
    if match is None or not math.isfinite(float(match[1])):
        return None
    return float(match[1])
