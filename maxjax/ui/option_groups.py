"""The options that several commands share, each with its help: reading a map, planning in it, exporting what comes out.

Nothing here imports JAX.
"""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import Annotated, Literal

import tyro

from maxjax.ui.methods import ALIASES, METHODS

Point3 = tuple[float, float, float]
optional = functools.partial(tyro.conf.arg, help_behavior_hint="")  # what its absence means, the help says
MapArgument = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MAP")]
Xyz = Annotated[Point3, tyro.conf.arg(metavar="X Y Z")]
OptionalXyz = Annotated[Point3 | None, optional(metavar="X Y Z")]
Metres = Annotated[float, tyro.conf.arg(metavar="M")]
OptionalMetres = Annotated[float | None, optional(metavar="M")]
OptionalHeight = Annotated[float | None, optional(metavar="Z")]
Bounds = Annotated[tuple[float, float, float, float, float, float] | None, optional(metavar="X0 Y0 Z0 X1 Y1 Z1")]
Speed = Annotated[float, tyro.conf.arg(metavar="V")]
OptionalFolder = Annotated[Path | None, optional(metavar="DIR")]
Count = Annotated[int | None, optional(metavar="N")]
Flag = tyro.conf.FlagCreatePairsOff[bool]
_Limit = Annotated[float | None, optional(metavar="A")]
_Unit = Annotated[str | None, optional(metavar="UNIT")]

# The registry, with solver as another word for field, or an import path.
_METHOD = "{" + ",".join((*METHODS, *ALIASES)) + "}|MODULE:CLASS"
PlannerName = Annotated[str, tyro.conf.arg(metavar=_METHOD)]


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReadOptions:
    """Options of a map: window, voxels, ground.

    Attributes:
        spacing: Edge of a voxel [m]; by default the file's own, else 2 m.
        bounds: Lowest and highest corner of what becomes voxels [m]; by default the map and the ends, with room.
        center: Middle of 101 x 101 x 101 voxels [m], in place of bounds; in simulated cities by default between ends.
        ground: Height of flat ground [m], for maps that do not tell ground apart.
        below: Whether what points hide from the air is solid down to the ground; by default closed for .las and .laz.
        unknown: What space is that a file tells nothing of (OctoMap, surface model, survey); by default occupied.
        crs: Reference system of the map's coordinates, as EPSG:28992, in place of --place; by default the file's own.
        unit: Unit of the map's coordinates: m, ft, us-ft, or a number of metres; by default the file's own.
        vertical_unit: Unit of its heights; by default the file's own.
        band: Band of a raster that holds heights, from 1 on; by default the only one.
        drop_class: ASPRS class of points to leave out; several, each with its own --drop-class.
        only: What to take of a city model, in place of all that stands: building, man_made, power, barrier, natural,
            aerialway or other of OpenStreetMap and GeoJSON, types of CityJSON; several, each with its own --only.
        height: Property of GeoJSON or OpenStreetMap that holds heights, with their unit as in roof_ht:ft; by default
            the first known one that a shape has (docs/maps.md).
        levels: Property that holds numbers of levels.
        up: Axis of a mesh or of points that is up; by default y of .glb, z of all others.
        offset: Added to the coordinates of a mesh or of points [their unit], as from a file of its offset.
        inside: What a closed mesh encloses, solid as a building or free as a room; by default solid.
        accuracy: How true the map's places are on Earth [m]; by default as PROJ knows it of their system.
        height_of_zero: Height above sea level of z = 0 in the map [m]; by default as the file states it, if it does.
    """

    spacing: OptionalMetres = None
    bounds: Bounds = None
    center: OptionalXyz = None
    ground: OptionalHeight = None
    below: Annotated[Literal["closed", "open"] | None, optional(metavar="{closed,open}")] = None
    unknown: Annotated[Literal["occupied", "free"] | None, optional(metavar="{occupied,free}")] = None
    crs: Annotated[str | None, optional(metavar="CODE")] = None
    unit: _Unit = None
    vertical_unit: _Unit = None
    band: Count = None
    drop_class: Annotated[tyro.conf.UseAppendAction[tuple[int, ...]], tyro.conf.arg(metavar="N")] = ()
    only: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="KIND")] = ()
    height: Annotated[str | None, optional(metavar="PROPERTY")] = None
    levels: Annotated[str | None, optional(metavar="PROPERTY")] = None
    up: Annotated[Literal["z", "y", "-y"] | None, optional(metavar="{z,y,-y}")] = None
    offset: OptionalXyz = None
    inside: Annotated[Literal["solid", "free"] | None, optional(metavar="{solid,free}")] = None
    accuracy: OptionalMetres = None
    height_of_zero: OptionalHeight = None


@dataclasses.dataclass(frozen=True)
class RouteOptions:
    """Options of a plan: distances, method, rules of the air.

    Attributes:
        map: A map.
        frame: What start, goal and places on the way are. map: x, y, z of the map; local-agl: x, y of the map and
            height above the ground beneath [m]; agl: latitude, longitude [deg] and that height; home: latitude,
            longitude and height above the ground beneath the start; amsl: those and height above sea level.
        method: field: climb the conduction potential, with a certificate. network: one that a network predicts,
            improved until it is certified; it plans the whole map and takes many times as long. Rivals: astar, rrtstar
            (OMPL's), apf (an artificial potential field). A planner of your own: its import path
            (docs/own_planner.md).
        radius: Distance that nothing on the path comes under [m], except around an end that stands nearer.
        margin: Distance where obstacles cost nothing [m].
        price: What a metre costs nearer than that: quadratic, exponential or speed, with a height as in quadratic:3.5;
            none: its length.
        airspace: File of areas to keep out of, or to keep in: ED-318, GeoJSON, ED-269, KML, KMZ, openAIP, a UAS
            Facility Map, or the geofence of a .plan (docs/airspace.md).
        floor: Least height above ground [m].
        ceiling: Greatest height above ground [m].
        ceiling_above_start: Greatest height above the start [m].
        place: Latitude, longitude [deg] and height above sea level [m] of the map's (0, 0, 0).
    """

    map: MapArgument
    _: dataclasses.KW_ONLY
    frame: Literal["map", "local-agl", "agl", "home", "amsl"] = "map"
    method: PlannerName = "field"
    radius: Metres = 1.0
    margin: Metres = 8.0
    price: Annotated[str, tyro.conf.arg(metavar="LAW")] = "quadratic"
    airspace: Annotated[Path | None, optional(metavar="FILE")] = None
    floor: OptionalMetres = None
    ceiling: OptionalMetres = None
    ceiling_above_start: OptionalMetres = None
    place: Annotated[Point3 | None, optional(metavar="LAT LON H")] = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class LimitOptions:
    """What a trajectory keeps to beside its speed; by default the limits of the autopilot, without one PX4's.

    Attributes:
        acceleration: Greatest acceleration of what is exported [m/s^2].
        jerk: Greatest rate of change of the acceleration [m/s^3].
        ascent: Greatest speed of climb [m/s].
        descent: Greatest speed of sinking [m/s].
        yaw_rate: Greatest rate of change of the heading [deg/s].
        near: Speed where it comes as near to something as the radius [m/s].
        deviation: Greatest distance of rounded corners from the path [m].
    """

    acceleration: _Limit = None
    jerk: _Limit = None
    ascent: _Limit = None
    descent: _Limit = None
    yaw_rate: _Limit = None
    near: _Limit = None
    deviation: _Limit = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class EnergyOptions:
    """What flies a mission, on what battery, in which wind (docs/energy.md).

    Attributes:
        airframe: iris_plus, matrice_100 or mavic_3_enterprise: count the energy of each leg.
        payload: What it carries beyond its own mass [kg].
        battery: Capacity of its battery [Wh]; a mission that it does not last for is split into flights.
        reserve: Share of the battery that no flight touches, as 0.25; there is none by default.
        wind: Speed of the wind [m/s], and where it comes from, clockwise from north [deg].
    """

    airframe: Annotated[str | None, optional(metavar="NAME")] = None
    payload: Annotated[float | None, optional(metavar="KG")] = None
    battery: Annotated[float | None, optional(metavar="WH")] = None
    reserve: Annotated[float | None, optional(metavar="SHARE")] = None
    wind: Annotated[tuple[float, float] | None, optional(metavar="SPEED FROM")] = None


@dataclasses.dataclass(frozen=True, kw_only=True)
class LandingOptions:
    """A roof to land on, at its flattest, freest spot (docs/missions.md).

    Attributes:
        land_on: Name of the building to end on; of several, each with its own --land-on, that which costs least to
            reach, or that the battery lasts to.
        land_at: A place on the roof to end on, x and y of the map [m]; with --frame agl, home and amsl its latitude and
            longitude [deg].
        landing_radius: Clear roof around the spot [m].
        landing_slope: Greatest slope within that [deg].
        landing_edge: Least distance to where the roof falls [m].
        landing_height: Height of the end of the path above the roof [m]; exports land from there.
    """

    land_on: Annotated[tyro.conf.UseAppendAction[tuple[str, ...]], tyro.conf.arg(metavar="NAME")] = ()
    land_at: Annotated[tuple[float, float] | None, optional(metavar="X Y")] = None
    landing_radius: Metres = 1.5
    landing_slope: Annotated[float, tyro.conf.arg(metavar="DEG")] = 5.0
    landing_edge: Metres = 2.0
    landing_height: Metres = 5.0


@dataclasses.dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """Where a plan or a mission goes.

    Attributes:
        out: Folder for plan.json, path.csv and plan.png; of a mission for mission.json, path.csv and mission.png.
        json: Print the content of plan.json or mission.json, and nothing else, on stdout.
        export: Files to write the plan to, for other programs: .plan (QGroundControl), .waypoints (WPL 110), .kmz
            (DJI's WPML), _litchi.csv, .geojson, .kml, .csv and _ned.csv (set-points), .tum, .rosbag (a folder).
        takeoff_and_landing: Begin .plan and .waypoints with a take-off to the start, and end them with a landing; by
            default a take-off alone, where ArduCopter may fly them.
        autopilot: Whom .plan and .waypoints are for, px4 or arducopter, with parameters as arducopter:WPNAV_RADIUS=50;
            by default they are judged for both. Set-points keep its limits.
        params: Write the parameters that .plan and .waypoints rely on beside them.
        keep_radius: Refuse a waypoint that stands nearer to an obstacle than the radius.
    """

    out: OptionalFolder = None
    json: Flag = False
    export: Annotated[tuple[Path, ...], optional(metavar="FILE ...")] = ()
    takeoff_and_landing: Flag = False
    autopilot: Annotated[str | None, optional(metavar="NAME")] = None
    params: Flag = False
    keep_radius: Flag = False
