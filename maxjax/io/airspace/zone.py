"""A zone as it is published: its name, where it lies in degrees, and between which limits; every reader makes these.

What of a zone a file does not say clearly is its `fault`, and no reason to refuse the others: `io.airspace.zone_areas`
closes what such a zone may cover.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from maxjax.core.files import brief
from maxjax.io.geo.columns import Ring

Polygon = list[Ring]

HIGHEST = 1e7  # of any unit; some files write 999999 for none
_METRES = {"m": 1.0, "ft": 0.3048, "FL": 30.48}
_UNITS = {"m": "m", "meter": "m", "meters": "m", "metre": "m", "metres": "m"}
_UNITS |= {"ft": "ft", "feet": "ft", "foot": "ft", "f": "ft", "fl": "FL"}
_REFERENCES = {"AGL": "AGL", "GND": "AGL", "SFC": "AGL", "AMSL": "AMSL", "MSL": "AMSL", "STD": "STD"}
_REFERENCES |= {"WGS84": "WGS84", "W84": "WGS84"}
# What a reader meets in a file that is not as it expects.
MALFORMED = (AttributeError, IndexError, KeyError, OverflowError, RecursionError, TypeError, ValueError)


class UnclearError(ValueError):
    """A sentence on what of a zone is not as expected."""


@dataclasses.dataclass(frozen=True)
class Limit:
    """Where a zone begins or ends.

    Attributes:
        value: height.
        unit: of it: m, ft, or FL for flight levels.
        reference: what it is counted from: AGL, the ground; AMSL, the sea level; WGS84, the ellipsoid; STD, the
            pressure of the standard atmosphere.
    """

    value: float
    unit: str
    reference: str

    @property
    def metres(self) -> float:
        """The height [m]."""
        return self.value * _METRES[self.unit]

    def __str__(self) -> str:
        return f"FL {self.value:g}" if self.unit == "FL" else f"{self.value:g} {self.unit} {self.reference}"


@dataclasses.dataclass(frozen=True, eq=False)
class Zone:
    """A zone of a file.

    Attributes:
        name: the file's, in quotes.
        polygons: outlines and holes, longitude and latitude [degrees], last point not repeated; longitudes may lie
            beyond 180. Of a zone with a fault, what it may cover; none: it may lie anywhere.
        keep_in: whether one has to stay inside it, or inside another such zone; False: one has to keep out.
        lower, upper: where it begins and ends; None: it does not.
        fault: what of it is not clear, in a sentence; empty: all is clear.
        timed: whether the file names times, outside of which it would not hold.
    """

    name: str
    polygons: tuple[Polygon, ...]
    keep_in: bool = False
    lower: Limit | None = None
    upper: Limit | None = None
    fault: str = ""
    timed: bool = False


@dataclasses.dataclass(frozen=True)
class ZoneFile:
    """A file of zones, whole.

    Attributes:
        path: its name.
        content: its bytes.
        document: the JSON that they are; None for other files.
    """

    path: Path
    content: bytes
    document: Any


@dataclasses.dataclass(frozen=True)
class Published:
    """What a reader makes of a file.

    Attributes:
        zones: all that one may have to keep out of, or in.
        left_out: what else stands in the file, by kind.
        remarks: sentences on what a user should know.
    """

    zones: tuple[Zone, ...]
    left_out: Mapping[str, int] = dataclasses.field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def zone_of(
    name: str,
    outlines: Callable[[], Iterable[Polygon]],
    limits: Callable[[], tuple[Limit | None, Limit | None]],
    reach: Callable[[], Iterable[Polygon]] = tuple,
    *,
    keep_in: bool = False,
    timed: bool = False,
) -> Zone:
    """A zone of what a file says of it; where that is not clear, the zone with its faults.

    Args:
        name: the file's, in quotes.
        outlines, limits: read these.
        reach: reads polygons that cover all that the zone may cover, where its outlines are not clear.
        keep_in, timed: as in `Zone`.
    """
    faults = []
    lower, upper, polygons = None, None, tuple[Polygon, ...]()
    try:
        lower, upper = limits()
        check_order(lower, upper)
    except MALFORMED as error:
        lower, upper = None, None
        faults.append(sentence_of(error))
    try:
        polygons = tuple(outlines())
    except MALFORMED as error:
        faults.append(sentence_of(error))
        try:
            polygons = tuple(reach())
        except MALFORMED:
            polygons = ()
    return Zone(name, polygons, keep_in, lower, upper, "; ".join(faults), timed)


def no_limits() -> tuple[None, None]:
    """Those of a zone that holds at all heights."""
    return None, None


def unclear(name: str, error: Exception) -> Zone:
    """A zone of which nothing is clear."""
    return Zone(name, (), fault=sentence_of(error))


def sentence_of(error: Exception) -> str:
    """What is not clear."""
    return brief(error) if isinstance(error, UnclearError) else f"malformed: {type(error).__name__}: {brief(error)}"


def limit_of(value: Any, unit: Any, reference: Any, name: str) -> Limit | None:
    """A limit of what a file says; None where it says no height.

    Args:
        value: height, a number or a text of one.
        unit: its name; None or empty: metres.
        reference: likewise; None or empty: above ground.
        name: of the limit in the file, for messages.

    Raises:
        UnclearError: for a unit, a reference or a height that is none.
    """
    known = _UNITS.get(str(unit or "m").strip().lower())
    if known is None:
        raise UnclearError(f"expected uom m or ft, found {brief(repr(unit))}")
    above = "STD" if known == "FL" else _REFERENCES.get(str(reference or "AGL").strip().upper())
    if above is None or (above == "STD") != (known == "FL"):
        raise UnclearError(f"expected {name}Reference WGS84, AGL or AMSL, found {brief(repr(reference))}")
    if value is None:
        return None
    height = number_of(value)
    if not abs(height) <= HIGHEST:
        raise UnclearError(f"expected {name} as a height, at most {HIGHEST:g}, found {brief(repr(value))}")
    return Limit(height, known, above)


def number_of(value: Any) -> float:
    """A number, or a text of one; NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return math.nan
    try:
        return float(value)
    except (OverflowError, ValueError):
        return math.nan


def inclusion_of(given: Any) -> bool:
    """Whether one has to stay inside a zone; raises an `UnclearError` where what a file says is neither yes nor no."""
    if not isinstance(given, bool):
        raise UnclearError(f"expected inclusion true or false, found {brief(repr(given))}")
    return given


def check_order(lower: Limit | None, upper: Limit | None) -> None:
    """Raise an `UnclearError` for limits that leave nothing between them, as far as that can be known."""
    if upper is None:
        return
    if lower is None:
        if upper.reference == "AGL" and upper.value <= 0.0:
            raise UnclearError(f"expected a ceiling above the ground, given {upper}; is it without one?")
    elif lower.reference == upper.reference and not lower.metres < upper.metres:
        raise UnclearError(f"expected a ceiling above its floor of {lower}, given {upper}; swap them, or mend one")


def quote(*names: Any) -> str:
    """The first of some names that there is, in quotes; of ED-318 it may be a list in several languages."""
    for name in names:
        if isinstance(name, list):
            texts = [one.get("text") for one in name if isinstance(one, dict)]
            name = next((text for text in texts if text), None)
        if name is not None and name != "":
            return repr(brief(name)[:80])
    return "'?'"
