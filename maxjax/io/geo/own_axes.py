"""Coordinates of files that name no reference system: turned upright, moved, and recognised where they are no metres.

    up = y      (x, y, z) → (x, −z, y)        graphics: y up, z towards the viewer
    up = −y     (x, y, z) → (x, z, −y)        cameras: y down, z ahead
    offset      (x, y, z) + (E, N, H)          meshes beside a file of their offset
    EPSG:4978   Earth-centred → longitude, latitude and height above the ellipsoid (EPSG:4979)

What is no plane in metres shows in its size: degrees are close together and tall, Earth-centred coordinates lie
6,330 to 6,400 km from 0, millimetres are taller than anything is built, and a scene on its side is flat along y.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float64, Shaped

from maxjax.core.files import FileError
from maxjax.io.reading import GEOCENTRIC, Reading

_TURNS = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "-y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}
_DEGREES = "EPSG:4979"
_EARTH = (6.33e6, 6.4e6)  # from its centre [m]
_OFF_EQUATOR = 2e4  # [m]; who is nearer to it may as well have national coordinates
_CLOSE, _TALL, _SLENDER = 0.5, 2.0, 10.0  # across, upwards, and upwards for each across: of degrees beside metres
_TALLEST = 2000.0  # [m]
_FLAT, _HIGH = 5.0, 20.0  # of a scene on its side: how much wider and taller than deep, and how tall at least [m]


def bring_upright(
    points: Shaped[np.ndarray, "n 3"], reading: Reading, path: Path, up: str = "z"
) -> tuple[Shaped[np.ndarray, "n 3"], Reading]:
    """Coordinates of a file with z up, moved by the user's offset, and how to read them then.

    Args:
        points: of the file.
        reading: of its coordinates.
        path: for messages.
        up: the axis that the format has up.

    Raises:
        FileError: for Earth-centred coordinates that lie nowhere near the ground.
    """
    if (up := reading.up or up) != "z":
        points = points.astype(np.float64) @ _TURNS[up].T
    if reading.offset is not None:
        points = points.astype(np.float64) + np.array(reading.offset)
    if not reading.is_geocentric:
        return points, reading
    import pyproj

    to_degrees = pyproj.Transformer.from_crs(GEOCENTRIC, _DEGREES, always_xy=True)
    geodetic = np.column_stack(to_degrees.transform(*points.astype(np.float64).T))
    finite = np.isfinite(points).all(axis=1) & (points != 0).any(axis=1)  # a missed beam lies at 0
    if finite.any() and not np.abs(geodetic[finite, 2]).max() <= _OFF_EQUATOR:
        raise FileError(
            f"{path}: expected Earth-centred coordinates ({GEOCENTRIC}) near the ground, found heights up to "
            f"{np.abs(geodetic[finite, 2]).max():.3g} m above the ellipsoid; leave --crs out, or name another"
        )
    geodetic[~finite] = np.nan
    return geodetic, dataclasses.replace(reading, crs=_DEGREES)


def check_plane(extent: Float[np.ndarray, "2 3"], reading: Reading, path: Path, *, shaped: bool) -> None:
    """Refuse what is hardly a plane in metres, with the option that settles it.

    Args:
        extent: lowest and highest corner of what a file holds that names no system.
        reading: what the user says of it.
        path: for messages.
        shaped: whether its axes and its unit are open as well, as those of meshes and points.

    Raises:
        FileError: for degrees, Earth-centred coordinates, millimetres, and scenes on their side.
    """
    low, high = np.asarray(extent, np.float64)
    span = high - low
    found = f"found x {low[0]:g} to {high[0]:g}, y {low[1]:g} to {high[1]:g}, z {low[2]:g} to {high[2]:g}"
    for guess, option in _guesses(low, high, span, reading, shaped=shaped):
        raise FileError(f"{path}: expected metres east, north and up, {found}: {guess}? Then {option}")


def _guesses(
    low: Float64[np.ndarray, " 3"], high: Float64[np.ndarray, " 3"], span: Float64[np.ndarray, " 3"], reading: Reading,
    *, shaped: bool,
) -> list[tuple[str, str]]:  # fmt: skip
    """What coordinates may be, and the option that says so, and the one that says otherwise."""
    metres = "; --unit m takes them as metres"
    found = []
    if not reading.unit:
        middle = 0.5 * (low + high)
        if _EARTH[0] <= float(np.linalg.norm(middle)) <= _EARTH[1] and abs(middle[2]) > _OFF_EQUATOR:
            found.append(("Earth-centred coordinates", f"--crs {GEOCENTRIC} brings them to a plane{metres}"))
        across = float(span[:2].max())
        if shaped and 0.0 < across < _CLOSE and span[2] > max(_TALL, _SLENDER * across) and _are_degrees(low, high):
            found.append(("degrees", f"--crs EPSG:4326 brings them to a plane{metres}"))
        if shaped and span[2] > _TALLEST:
            found.append(("millimetres or feet", f"--unit mm or --unit ft says so{metres}"))
    if shaped and not reading.up and span[2] > _HIGH and min(span[0], span[2]) > _FLAT * span[1]:
        found.append(("a scene with y up", "--up y (or --up -y, of a camera) turns it; --up z takes it as it is"))
    return found


def _are_degrees(low: Float64[np.ndarray, " 3"], high: Float64[np.ndarray, " 3"]) -> bool:
    return bool(np.abs([low[0], high[0]]).max() <= 180.0 and np.abs([low[1], high[1]]).max() <= 90.0)
