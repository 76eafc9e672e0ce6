"""The FAA's Digital Obstacle File (DOF): what stands tall, as upright prisms; lines of fixed columns, or CSV.

    prism = 16 edges about the place, around its accuracy and half of the obstacle's own width
    base  = AMSL − AGL,  top = AMSL + accuracy of heights                                       [feet in the file]

A code of accuracy that says nothing is taken as the worst that there is, 1 nautical mile and 1000 ft. Widths are not
stated: that of a windmill is taken as its height, that of all else as 10 m. Lines between towers are not stated either.
"""

from __future__ import annotations

import csv
import dataclasses
import io
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from maxjax.core.files import FileError, open_regular, read_text
from maxjax.io.geo.degrees import side_by_side
from maxjax.io.geo.units_and_axes import Stated, reference
from maxjax.io.geo.vertical_zero import VerticalZero
from maxjax.io.kinds.footprints import Footprint, Footprints, check_footprints
from maxjax.io.reading import PLAIN, Reading

_FOOT, _MILE = 0.3048, 1852.0
_HORIZONTAL = dict(zip("12345678", (20, 50, 100, 250, 500, 1000, 0.5 * _MILE / _FOOT, _MILE / _FOOT), strict=True))
_VERTICAL = dict(zip("ABCDEFGH", (3, 10, 20, 50, 125, 250, 500, 1000), strict=True))  # [feet], as those
_HALF_WIDTH = 5.0  # of most obstacles [m]
_CORNERS = 16
_MOST = 1_000_000
_PEEK = 4096
_COLUMNS = ("LATDEC", "LONDEC", "AGL", "AMSL", "ACCURACY")
_SHORTEST = 100  # characters of a line that may be an obstacle
_HEADS = ("CURRENCY", "OAS#", "LATITUDE", "---")
_GONE = "D"  # action of one that is dismantled


@dataclasses.dataclass(frozen=True)
class Obstacle:
    """One line of the file.

    Attributes:
        name: its number.
        kind: what it is, as TOWER.
        place: longitude and latitude [degrees].
        agl, amsl: height of its top above ground and above sea level [m].
        accuracy: codes of its place and of its height.
        gone: whether it is dismantled.
    """

    name: str
    kind: str
    place: tuple[float, float]
    agl: float
    amsl: float
    accuracy: str
    gone: bool

    @property
    def reach(self) -> float:
        """How far from its place it may stand [m]."""
        own = 0.5 * self.agl if self.kind.startswith("WINDMILL") else _HALF_WIDTH
        return own + _FOOT * _HORIZONTAL.get(self.accuracy[:1], _HORIZONTAL["8"])

    @property
    def doubt(self) -> float:
        """How much higher it may be [m]."""
        return _FOOT * _VERTICAL.get(self.accuracy[1:2], _VERTICAL["H"])


def is_obstacle_csv(path: Path) -> bool:
    """Whether a CSV file has the columns of obstacles."""
    with open_regular(path) as file:
        first = file.read(_PEEK).partition(b"\n")[0].upper()
    return all(name.encode() in first for name in _COLUMNS)


def load_obstacles(path: Path, reading: Reading = PLAIN) -> Footprints:
    """The obstacles of a file; lines that are not understood are counted.

    Raises:
        FileError: if it cannot be read, holds no obstacle, or obstacles farther apart than a degree; if a reference
            system or a unit is given.
    """
    if reading.crs or reading.unit or reading.vertical_unit:
        raise FileError(f"{path}: obstacles are in degrees of EPSG:4326 and in feet; leave --crs and units out")
    dropped = Counter[str]()
    text = read_text(path).decode("latin-1")
    lines = _rows(text, path) if is_obstacle_csv(path) else _lines(text)
    found = list[Obstacle]()
    for one in lines:
        if one is None:
            dropped["lines that are no obstacle"] += 1
        elif one.gone:
            dropped["dismantled obstacles"] += 1
        else:
            found.append(one)
        if len(found) > _MOST:
            raise FileError(f"{path}: expected at most {_MOST} obstacles, found more; crop it")
    if not found:
        counts = ", ".join(f"{count} {kind}" for kind, count in dropped.items()) or "an empty file"
        raise FileError(f"{path}: expected obstacles of the FAA's DOF, found none ({counts})")
    places = np.concatenate(side_by_side([np.array([one.place]) for one in found], path))
    try:
        extent = np.array([places.min(axis=0), places.max(axis=0)])
        how = reference(Stated("EPSG:4326", heights="metres"), reading, extent, path)
    except FileError as error:
        raise FileError(f"{error}: keep the lines of obstacles around the place") from error
    prisms = tuple(_prism(one, centre) for one, centre in zip(found, how.plane(places), strict=True))
    none = np.zeros((0, 3, 3))
    read = Counter(one.kind or "obstacles" for one in found)
    how = dataclasses.replace(how, zero=VerticalZero(0.0, "AMSL of the file"))
    whole = Footprints(
        prisms, none, path.name, read=read, dropped=dropped, reference=how, remarks=tuple(_remarks(found))
    )
    return check_footprints(whole, path)


def _prism(one: Obstacle, centre: np.ndarray) -> Footprint:
    """All that an obstacle may fill."""
    angles = 2.0 * np.pi * np.arange(_CORNERS) / _CORNERS
    around = one.reach / np.cos(np.pi / _CORNERS) * np.column_stack([np.cos(angles), np.sin(angles)])
    return Footprint((centre + around,), one.amsl - one.agl, one.amsl + one.doubt, one.name)


def _remarks(found: list[Obstacle]) -> list[str]:
    """Sentences on what the file leaves open."""
    far = max(one.reach for one in found)
    remarks = [f"obstacles are as wide as their places are uncertain: up to {far:.0f} m around them"]
    unknown = sum(one.accuracy[:1] not in _HORIZONTAL or one.accuracy[1:2] not in _VERTICAL for one in found)
    if unknown:
        remarks.append(f"{unknown} obstacles have no known accuracy: 1852 m around, or 305 m above, is taken")
    wires = sum(one.kind.startswith(("T-L", "CATENARY", "TRAMWAY")) for one in found)
    if wires:
        remarks.append(f"{wires} obstacles carry wires whose course is not stated: nothing stands between them")
    return remarks


def _lines(text: str) -> Iterator[Obstacle | None]:
    """Obstacles in fixed columns; None for a line that is none."""
    for line in text.splitlines():
        if not line.strip() or line.lstrip().startswith(_HEADS):
            continue
        try:
            if len(line) < _SHORTEST:
                raise ValueError("too short")
            latitude = _degrees(line[35:37], line[38:40], line[41:46], line[46], "NS")
            longitude = _degrees(line[48:51], line[52:54], line[55:60], line[60], "EW")
            kind, action = line[62:80].strip(), line[118:119]
            yield _obstacle(
                line[:9], kind, (longitude, latitude), (line[83:88], line[89:94]), line[97] + line[99], action
            )
        except ValueError:
            yield None


def _rows(text: str, path: Path) -> Iterator[Obstacle | None]:
    """Obstacles of a CSV; None for a line that is none."""
    try:
        for row in csv.DictReader(io.StringIO(text)):
            values = {str(key).strip().upper(): str(value or "").strip() for key, value in row.items()}
            try:
                place = float(values["LONDEC"]), float(values["LATDEC"])
                heights = values["AGL"], values["AMSL"]
                accuracy = values["ACCURACY"].replace(" ", "")
                kind, action = values.get("TYPE", ""), values.get("ACTION", "")
                yield _obstacle(values.get("OAS", ""), kind, place, heights, accuracy, action)
            except ValueError:
                yield None
    except csv.Error as error:
        raise FileError(f"{path}: expected CSV of obstacles: {error}") from error


def _obstacle(
    name: str, kind: str, place: tuple[float, float], heights: tuple[str, str], accuracy: str, action: str
) -> Obstacle:
    """An obstacle of texts; raises a ValueError for a place that is not on Earth, or heights that are none."""
    agl, amsl = (_FOOT * float(text) for text in heights)
    if not (abs(place[0]) <= 180.0 and abs(place[1]) <= 90.0 and agl > 0.0 and abs(amsl) <= 1e4):
        raise ValueError("no place or no height")
    return Obstacle(name.strip(), kind, place, agl, amsl, accuracy, action.strip().upper() == _GONE)


def _degrees(whole: str, minutes: str, seconds: str, side: str, sides: str) -> float:
    """Degrees of a text; raises a ValueError where it is none."""
    parts = [float(part) for part in (whole, minutes, seconds)]
    if side not in sides or not all(0.0 <= part < most for part, most in zip(parts, (181, 60, 60), strict=True)):
        raise ValueError("no degrees")
    total = parts[0] + parts[1] / 60.0 + parts[2] / 3600.0
    return -total if side == sides[1] else total
