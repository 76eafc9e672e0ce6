"""The rules of the air on a page: areas by the voxels that they hold, see-through and named, the band as two sheets.

A path keeps rules voxel by voxel (`io.airspace.airspace`), so voxels are what is drawn: an area to keep out of with all
that it touches, one to keep in with what lies in it, whole. The sheets end where the band does.
"""

from __future__ import annotations

import functools

import numpy as np

from maxjax.core.status import Closure
from maxjax.io.airspace.airspace import Airspace, Area
from maxjax.ui.page.colors import BAND, KEEP_IN, KEEP_OUT
from maxjax.ui.page.nodes import Node, Scene, Text, point3
from maxjax.ui.page.page_map import Band, City
from maxjax.ui.page.surface import surface
from maxjax.ui.request import Request

_OUT, _IN, _SHEET = 0.3, 0.15, 0.12  # opacities


def air_scene(city: City, request: Request) -> Scene:
    """The rules that a request was planned by."""
    return {**_areas(city), **_band(city, request.altitudes, city.highest(request.places[0]))}


def air_lines(city: City, request: Request) -> list[str]:
    """The rules in words, a line each."""
    lines = [f"{'Green: keep in' if area.keep_in else 'Red: keep out of'} {_plain(area)}" for area in city.areas]
    floor, ceiling = request.altitudes
    limits = [f"from {floor:g} m above ground"] if floor is not None else []
    limits += [f"to {ceiling:g} m above ground"] if ceiling is not None else []
    limits += [f"to {city.above_start:g} m above the start"] if city.above_start is not None else []
    return lines + ([f"Blue sheets: {', '.join(limits)}"] if limits else [])


def _plain(area: Area) -> str:
    """The name without the quotes that sentences need."""
    return area.name.strip("'")


@functools.lru_cache(maxsize=4)
def _areas(city: City) -> Scene:
    scene: dict[str, Node] = {}
    for k, area in enumerate(city.areas):
        closed = Airspace(areas=(area,)).closed_over(city.terrain) != Closure.OPEN
        held = ~closed if area.keep_in else closed
        shown = held & ~city.occupied
        if not shown.any():
            continue
        color, opacity = (KEEP_IN, _IN) if area.keep_in else (KEEP_OUT, _OUT)
        hidden = held | city.occupied
        scene[f"/air/area_{k}/volume"] = surface(shown, city.grid, city.frame, color, opacity, hidden)
        x, y = (places.mean() for places in np.nonzero(shown.any(axis=2)))
        top = np.flatnonzero(shown.any(axis=(0, 1))).max() + 0.5
        place = np.array(city.grid.origin) + city.grid.spacing * np.array([x, y, top])
        words = "keep in" if area.keep_in else "keep out"
        scene[f"/air/area_{k}/name"] = Text(point3(city.frame.page(place)), f"{_plain(area)}: {words}")
    return scene


@functools.lru_cache(maxsize=4)
def _band(city: City, band: Band, highest: float | None) -> Scene:
    """The last open voxels below the ceiling, and the last closed ones below the floor: their upper faces end it."""
    if (*band, highest) == (None, None, None):
        return {}
    closed = Airspace(*band, highest).closed_over(city.terrain) != Closure.OPEN
    above = np.concatenate([closed[:, :, 1:], closed[:, :, -1:]], axis=2)
    scene: dict[str, Node] = {}
    for name, sheet in (("ceiling", ~closed & above), ("floor", closed & ~above)):
        shown = sheet & ~city.occupied
        if shown.any():
            scene[f"/air/{name}"] = surface(shown, city.grid, city.frame, BAND, _SHEET, sheet | city.occupied)
    return scene
