"""Colours of the page: ramps over heights, clearances and fields, for readers with any colour vision.

A ramp is a list of colours at equal distances, between which it is linear in RGB.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

Rgb = tuple[int, int, int]

START, GOAL, VIA, RIVAL = (255, 255, 255), (240, 228, 66), (86, 180, 233), (0, 114, 178)
VEHICLE, FLOWN, FAILED, PLANNED, RETURN = (213, 94, 0), (0, 114, 178), (213, 94, 0), (0, 158, 115), (40, 40, 40)
KEEP_OUT, KEEP_IN, BAND = (200, 40, 40), (0, 158, 115), (70, 130, 200)
KNOWN, REFERENCE, MOVER = (86, 180, 233), (204, 121, 167), (168, 72, 208)
EARTH, EARTH_AT_NIGHT = (196, 184, 160), (72, 68, 60)
PHOTO, NO_SURFACE = (190, 20, 110), (150, 150, 150)
FLIGHTS: tuple[Rgb, ...] = ((0, 114, 178), (86, 180, 233), (230, 159, 0), (0, 158, 115))

# From low to high roofs, in one hue as in `viz`; from near to far; from the goal outwards; from cheap to dear; from one
# photo on.
HEIGHTS = ("#DADFE4", "#A3AFBC", "#6E7F92", "#465669")
CLEARANCES = ("#B2182B", "#EF8A62", "#F0C24B", "#5AAE61", "#1B7837")
FIELD = ("#FDE725", "#5EC962", "#21918C", "#3B528B", "#440154")
PRICE = ("#FFFFFF", "#FDDBC7", "#F4A582", "#D6604D", "#8E0C25")
PHOTOS = FIELD[::-1]


def html_color(color: Rgb) -> str:
    """A colour as HTML has it."""
    return "#{:02X}{:02X}{:02X}".format(*color)


def ramp(colors: tuple[str, ...], values: Float[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n 3"]:
    """Colours of some values in [0, 1]; what lies outside has that of the nearer end, NaN that of the first."""
    table = np.array([[int(color[k : k + 2], 16) for k in (1, 3, 5)] for color in colors], np.float64)
    place = np.clip(np.nan_to_num(np.asarray(values, np.float64)), 0.0, 1.0) * (len(colors) - 1)
    rgb = np.stack([np.interp(place, np.arange(len(colors)), table[:, k]) for k in range(3)], axis=-1)
    return np.round(rgb).astype(np.uint8)
