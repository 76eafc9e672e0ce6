"""Surface models: GeoTIFF, grids of Esri (.asc) and tiles of SRTM (.hgt), by rasterio (extra `geotiff`).

    height = scale · stored + offset        [the band's unit, else that of the system's heights]

Unknown is what the file declares so (nodata, masks), and what can be no height: `without_sentinels`.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64

from maxjax.core.files import FileError, check_regular
from maxjax.io.geo.reference_system import UNITS
from maxjax.io.geo.units_and_axes import Reference, Stated, reference
from maxjax.io.kinds.heights import Heights
from maxjax.io.kinds.point_cloud import FARTHEST
from maxjax.io.reading import PLAIN, Reading

MAX_CELLS = 2**27
_DRIVERS = {".tif": "GTiff", ".tiff": "GTiff", ".asc": "AAIGrid", ".hgt": "SRTMHGT"}
_SRTM = "EPSG:4326+5773"
_MISSING = "reading rasters needs the extra geotiff: pip install 'maxjax[geotiff]'"
_HIGHEST = 10_000.0  # [m]; beyond any height on Earth
_TALLEST = 900.0  # [m]; no building is taller
_PIT = 60.0  # [m]; how far what files often write for "no height" has to lie from all that is beside it
_OFTEN = (0.0, -1.0, -99.0, -999.0, -9999.0, -32767.0, -32768.0, 255.0, 999.0, 9999.0, 32767.0, 65535.0)
_SQUARE = 0.25  # cells; a grid on a plane may be so far from one along the axes
_NAMES = {
    "metre": "m", "metres": "m", "meter": "m", "meters": "m", "foot": "ft", "feet": "ft", "international foot": "ft",
    "us survey foot": "us-ft", "us survey feet": "us-ft", "us_survey_foot": "us-ft", "ftus": "us-ft", "usft": "us-ft",
    "centimetre": "cm", "centimeter": "cm", "millimetre": "mm", "millimeter": "mm",
}  # fmt: skip


def load_raster(path: Path, reading: Reading = PLAIN) -> Heights:
    """One band of a raster; a tile of SRTM is in degrees, and in metres above the geoid EGM96.

    Raises:
        FileError: if the extra is missing, or the file is unreadable, too large or turned, holds colours or several
            bands of which none is chosen, or no height, or heights in a unit that nothing states; as `reference`.
    """
    driver = _DRIVERS[path.suffix.lower()]
    check_regular(path)
    try:
        import rasterio
    except ImportError as error:
        raise FileError(f"{path}: {_MISSING}") from error
    try:
        # Without the warning about a file that has no place, which is refused below.
        with (
            warnings.catch_warnings(action="ignore"),
            rasterio.Env(GTIFF_REPORT_COMPD_CS=True),
            rasterio.open(path, driver=driver) as file,
        ):
            if file.width * file.height > MAX_CELLS:
                raise FileError(
                    f"{path}: claims {file.width} x {file.height} cells, expected at most {MAX_CELLS}; crop it"
                )
            place, number = file.transform, _band(file, reading, path)
            system = None if file.crs is None else file.crs.to_wkt()
            system = _SRTM if driver == "SRTMHGT" else system
            unit = _unit(file.units[number - 1], reading, path)
            band = file.read(number, masked=True).astype(np.float64)
            scale, offset = file.scales[number - 1], file.offsets[number - 1]
    except FileError:
        raise
    except Exception as error:
        raise FileError(f"{path}: expected an intact raster ({driver}): {error}") from error
    numbers = [place.a, place.b, place.c, place.d, place.e, place.f]
    if place.b or place.d or not place.a > 0 > place.e or not np.abs(numbers).max() <= FARTHEST:
        raise FileError(
            f"{path}: expected a place, and cells along the axes, north up, within {FARTHEST:g} m, found {numbers}"
        )
    if not (np.isfinite([scale, offset]).all() and scale):
        raise FileError(f"{path}: expected a scale and an offset of heights, found {scale} and {offset}; damaged")
    stored = np.asarray(band.filled(np.nan)).T[:, ::-1]
    nx, ny = stored.shape
    corners = np.array([[place.c, place.f + place.e * ny], [place.c + place.a * nx, place.f]])
    how = reference(Stated(system, None, unit, "asked"), reading, corners, path)
    (west, south), cell = _on_plane(how, corners, (nx, ny), path)
    height = (stored * scale + offset) * how.vertical_unit
    known, remarks = without_sentinels(height, stored)
    if not known.any():
        raise FileError(f"{path}: holds no height, expected at least one")
    height = np.where(known, height, np.nan).astype(np.float32)
    return Heights(height, west, south, cell, path.name, how, remarks)


def without_sentinels(
    height: Float64[np.ndarray, "nx ny"], stored: Float64[np.ndarray, "nx ny"]
) -> tuple[Bool[np.ndarray, "nx ny"], tuple[str, ...]]:
    """Which cells have a height, and a sentence where some that claim one have none.

    A value is no height if it is beyond any on Earth; or if all cells of it lie farther from all cells beside them than
    any building is tall, or, of values that programs often write where there is none, farther than 60 m.

    Args:
        height: [m]; NaN where the file declares it unknown.
        stored: the same as the file has it.
    """
    known = np.abs(height) <= _HIGHEST
    count = int((np.isfinite(height) & ~known).sum())
    values = [f"beyond {_HIGHEST:g} m"] if count else []
    while known.any():
        ends = {float(stored[known].min()), float(stored[known].max())}
        found = next((v for v in (*ends, *_OFTEN) if _is_none(v, height, stored, known)), None)
        if found is None:
            break
        cells = known & (stored == found)
        known &= ~cells
        count += int(cells.sum())
        values.append(f"{found:g}")
    if not count:
        return known, ()
    said = f"{count} cells hold {', '.join(values)}, which is no height beside the others: they are unknown"
    return known, (said,)


def _is_none(
    value: float,
    height: Float64[np.ndarray, "nx ny"],
    stored: Float64[np.ndarray, "nx ny"],
    known: Bool[np.ndarray, "nx ny"],
) -> bool:
    """Whether cells of a value lie too far from all that are beside them."""
    cells = known & (stored == value)
    if not cells.any():
        return False
    beside = np.zeros_like(cells)
    for axis in (0, 1):
        for step in (-1, 1):
            moved = np.roll(cells, step, axis=axis)
            edge: list[slice | int] = [slice(None)] * 2
            edge[axis] = 0 if step == 1 else -1
            moved[tuple(edge)] = False
            beside |= moved
    others = height[beside & known & ~cells]
    if not len(others):
        # An island among cells without a height: beside all the others there are.
        others = height[known & ~cells]
    limit = _PIT if value in _OFTEN else _TALLEST
    return len(others) > 0 and bool(np.abs(others - height[cells][0]).min() > limit)


def _band(file: Any, reading: Reading, path: Path) -> int:
    """The number of the band to read."""
    count = int(file.count)
    if reading.band is not None:
        if reading.band > count:
            raise FileError(f"{path}: expected a band up to {count}, given {reading.band}")
        return reading.band
    colours = [colour.name for colour in file.colorinterp[:3]]
    if colours[0] in ("red", "palette") or (count >= 3 and file.dtypes[0] == "uint8"):
        raise FileError(f"{path}: expected heights, found colours in {count} bands; if one holds heights, give --band")
    heights = count - colours.count("alpha")
    if heights > 1:
        raise FileError(f"{path}: expected one band of heights, found {count}; --band N says which")
    return 1


def _unit(text: str | None, reading: Reading, path: Path) -> float | None:
    """Metres of the unit that a band names; None where it names none, or the user's counts."""
    name = " ".join((text or "").lower().replace("_", " ").split())
    if not name or reading.vertical_unit is not None:
        return None
    short = _NAMES.get(name, name)
    if short not in UNITS:
        raise FileError(f"{path}: expected a unit of heights among {', '.join(UNITS)}, found {text!r}; --vertical-unit")
    return UNITS[short]


def _on_plane(
    how: Reference, corners: Float64[np.ndarray, "2 2"], count: tuple[int, int], path: Path
) -> tuple[tuple[float, float], tuple[float, float]]:
    """South-western corner and edges of a cell [m], where cells lie along the axes of the map."""
    (x0, y0), (x1, y1) = corners
    around = how.plane(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    west, south = around.min(axis=0).tolist()
    east, north = around.max(axis=0).tolist()
    cell = (east - west) / count[0], (north - south) / count[1]
    straight = np.array([[west, south], [east, south], [east, north], [west, north]])
    if not (np.abs(around - straight) <= _SQUARE * min(cell)).all():
        raise FileError(f"{path}: expected cells along east and north, found them turned ({how.crs}); reproject it")
    return (west, south), cell
