"""Limits of a zone as heights of an area in the map.

    AGL     value above the ground beneath
    AMSL    height above sea level, which asks for the map's zero (`io.geo.vertical_zero`)
    WGS84   z, where the map's zero lies on the ellipsoid; else height above sea level = value − undulation, which is
            −107 to 86 m everywhere on Earth
    STD     height above sea level = 0.8 value − 1600 m to 1.2 value + 700 m: the air pressure at sea level is 870 to
            1085 hPa, and the air at most a fifth colder or warmer than the standard atmosphere's

Where a range stands for a limit, a zone to keep out of takes all of it, and one to keep in none.
"""

from __future__ import annotations

import math
from typing import Any

from maxjax.io.airspace.zone import Limit, Zone
from maxjax.io.geo.earth import Earth

_UNDULATION = (-107.0, 86.0)  # of the geoid above the ellipsoid [m]


def heights_in(zone: Zone, earth: Earth) -> dict[str, Any]:
    """Floor and ceiling of an `Area`, by name; none where the zone has no limit.

    Raises:
        UnknownZeroError: for a limit above sea level in a map whose zero is not known.
    """
    found: dict[str, Any] = {}
    for ours, limit in (("floor", zone.lower), ("ceiling", zone.upper)):
        if limit is None:
            continue
        above_ground = limit.reference == "AGL"
        found[f"{ours}_above_ground"] = above_ground
        if above_ground:
            # The ground itself has no height to keep.
            found[ours] = -math.inf if ours == "floor" and limit.value <= 0 else limit.metres
        elif limit.reference == "WGS84" and earth.zero.ellipsoidal:
            found[ours] = limit.metres
        else:
            low, high = above_sea_level(limit)
            zero = earth.zero.height(f"the {ours} of {zone.name}, {limit}")
            found[ours] = (low if (ours == "floor") != zone.keep_in else high) - zero
    return found


def above_sea_level(limit: Limit) -> tuple[float, float]:
    """Lowest and highest height above sea level that a limit may have [m]; not of one above ground."""
    value = limit.metres
    if limit.reference == "WGS84":
        return value - _UNDULATION[1], value - _UNDULATION[0]
    if limit.reference == "STD":
        scaled = (0.8 * value, 1.2 * value)
        return min(scaled) - 1600.0, max(scaled) + 700.0
    return value, value


def remarks_on(zones: list[Zone], earth: Earth, source: str) -> list[str]:
    """Sentences on limits for which a range stands."""
    ranges = {
        "WGS84": "above the ellipsoid (WGS84): sea level is taken as -107 to 86 m above it, as closes more",
        "STD": "flight levels: they are taken as 0.8 H - 1600 m to 1.2 H + 700 m above sea level, as closes more",
    }
    remarks = []
    if earth.zero.ellipsoidal:
        del ranges["WGS84"]
    for reference, what in ranges.items():
        count = sum(any(limit and limit.reference == reference for limit in (z.lower, z.upper)) for z in zones)
        if count:
            remarks.append(f"limits of {count} areas of {source} are {what}")
    return remarks
