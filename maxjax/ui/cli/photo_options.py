"""The options of commands that take photos: what is typed, with its help. Nothing here imports JAX."""

from __future__ import annotations

import dataclasses
from typing import Annotated, Literal

import tyro

from maxjax.ui.option_groups import (
    EnergyOptions,
    ExportOptions,
    Flag,
    LimitOptions,
    MapArgument,
    Metres,
    OptionalMetres,
    Point3,
    ReadOptions,
    optional,
)

_Names = Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="ID")]
_Homes = Annotated[tyro.conf.UseAppendAction[tuple[Point3, ...]], tyro.conf.arg(metavar="X Y Z")]
_Corners = Annotated[tuple[float, ...], tyro.conf.arg(metavar="X Y ...")]
_Place = Annotated[Point3 | None, optional(metavar="LAT LON H")]
_Degrees = Annotated[float | None, optional(metavar="DEG")]


@dataclasses.dataclass(frozen=True, kw_only=True)
class PhotoOptions(ReadOptions, LimitOptions, EnergyOptions, ExportOptions):
    """What photos are taken with, and by whom.

    Attributes:
        map: A file, or a simulated city, as for plan.
        camera: By name, as "DJI M3E"; a wrong one tells all.
        incidence: Greatest angle between a line of sight and the surface's normal [deg].
        resolution: Greatest side of what a pixel covers [m]; by default twice that straight ahead.
        radius: Distance that nothing on the way comes under [m].
        margin: Distance where obstacles cost nothing [m].
        vehicles: How many share the work.
        home: Where a vehicle begins and ends, in the air above it [m]; one for all, or one for each, each with its own
            --home; by default a free place near the target.
        longest: Longest flight [s]: what takes longer is flown in several; by default as long as --battery lasts.
        separation: Least distance between two vehicles in the air [m]; who would come nearer departs later.
        place: Latitude, longitude [deg] and height above sea level [m] of the map's (0, 0, 0).
        out: Folder for inspection.json and inspection.png.
        json: Print inspection.json, and nothing else, on stdout.
        export: Files for other programs, as for mission; of several flights one each, numbered.
    """

    map: MapArgument
    camera: str = "DJI M3E"
    incidence: float = 60.0
    resolution: OptionalMetres = None
    radius: Metres = 1.5
    margin: Metres = 8.0
    vehicles: int = 1
    home: _Homes = ()
    longest: Annotated[float | None, optional(metavar="S")] = None
    separation: Metres = 10.0
    place: _Place = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class InspectOptions(PhotoOptions):
    """Photograph façades and roofs: viewpoints, their order, and verified flights.

    Every place keeps the radius, and what a photo shows is checked by the rays that the LiDAR uses, point by point.
    What cannot be seen from anywhere that may be flown to is named with its area.

    Attributes:
        building: A building's name in the file; several, each with its own --building.
        at: The building at a place of the map, x and y [m].
        box: All within lowest and highest corner [m].
        outline: All within an outline, its corners one after the other [m].
        distance: Of photos from the surface [m].
        overlap: Shares of a photo that the next one of a row shows, too, and one of the next row.
    """

    building: _Names = ()
    at: Annotated[tuple[float, float] | None, optional(metavar="X Y")] = None
    box: Annotated[tuple[float, float, float, float, float, float] | None, optional(metavar="X0 Y0 Z0 X1 Y1 Z1")] = None
    outline: _Corners = ()
    distance: Metres = 8.0
    overlap: tuple[float, float] = (0.7, 0.6)


@dataclasses.dataclass(frozen=True, kw_only=True)
class SurveyOptions(PhotoOptions):
    """Photograph an area from above, in lines that follow its ground or its roofs.

    What stands in the way is flown around by certified legs; photos that are lost there are named.

    Attributes:
        area: Corners of an outline, one after the other [m]; with --width those of the line that a corridor follows.
        distance: Above what lies below [m].
        overlap: Shares of a photo that the next one of its line shows, too, and one of the next line.
        above: What the distance counts from, ground or roof.
        heading: Of the lines, clockwise from north [deg]; by default that of fewest turns.
        cross: Sweep once more, at right angles.
        beyond: How far lines reach beyond the outline [m].
        turn: How far a line runs on beyond its photos [m].
        pitch: Elevation of the camera [deg], -90 straight down.
        width: Of a corridor [m].
        speed: Greatest on the lines [m/s].
    """

    area: _Corners
    distance: Metres = 60.0
    overlap: tuple[float, float] = (0.75, 0.65)
    above: Literal["ground", "roof"] = "ground"
    heading: _Degrees = None
    cross: Flag = False
    beyond: Metres = 0.0
    turn: Metres = 10.0
    pitch: Annotated[float, tyro.conf.arg(metavar="DEG")] = -90.0
    width: OptionalMetres = None
    speed: Annotated[float, tyro.conf.arg(metavar="V")] = 10.0
