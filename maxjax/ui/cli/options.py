"""The options of each command: what is typed, with its help. Nothing here imports JAX."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import tyro

from maxjax.ui.option_groups import (
    Count,
    EnergyOptions,
    ExportOptions,
    Flag,
    LandingOptions,
    LimitOptions,
    MapArgument,
    Metres,
    OptionalFolder,
    OptionalXyz,
    PlannerName,
    Point3,
    ReadOptions,
    RouteOptions,
    Speed,
    Xyz,
    optional,
)

_Via = Annotated[tyro.conf.UseAppendAction[tuple[Point3, ...]], tyro.conf.arg(metavar="X Y Z")]
_Folder = Annotated[Path, tyro.conf.arg(metavar="DIR")]
_Seed = Annotated[int, tyro.conf.arg(metavar="S")]


@dataclasses.dataclass(frozen=True)
class PlanOptions(ReadOptions, RouteOptions, LandingOptions, LimitOptions, EnergyOptions, ExportOptions):
    """Plan a path through a map and verify it; with --via a mission, leg by leg.

    Coordinates are those of the map: metres, z up; of a file in degrees, metres east and north of its middle (or, with
    option --frame, latitude, longitude and height). A simulated city is a grid of 101 x 101 x 101 voxels of 2 m; a file
    is as large as it is and the ends need.

    Attributes:
        map: A file (.npz, .ply, .pcd, .las, .e57, .xyz, .obj, .stl, .glb, .json, .osm, .geojson, .gpkg, .bt, .tif,
            .csv, .dat, and more: docs/maps.md), or a simulated city: midtown:SEED, downtown:SEED, suburb:SEED.
        start: Start of the path [m].
        goal: End of the path [m]; may be left out where it ends on a roof.
        or_goal: Another goal [m], several each with its own --or-goal: the path ends at the one that costs least to
            reach, or that the battery lasts to.
        via: A place to fly through on the way [m]; several in order, each with its own --via.
        return_to_start: From the goal back to the start.
        speed: Greatest speed of what is exported [m/s].
    """

    start: Xyz
    goal: OptionalXyz = None
    or_goal: _Via = ()
    via: _Via = ()
    return_to_start: Flag = False
    speed: Speed = 12.0


@dataclasses.dataclass(frozen=True)
class MissionOptions(LandingOptions, ExportOptions):
    """Plan a mission: waypoints in order, with hover times, speeds and distances, verified as a whole.

    Attributes:
        file: A TOML file with a map, options of plan and waypoints; docs/missions.md tells all.
        or_goal: Another place for the last waypoint, in the frame of the file; several, each with its own --or-goal.
        partial: Where a leg fails, write the legs before it; else nothing is written.
    """

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    or_goal: _Via = ()
    partial: Flag = False


@dataclasses.dataclass(frozen=True)
class MapOptions(ReadOptions):
    """Say what a map file holds, and draw it from above.

    Attributes:
        map: A file, as for plan.
        bounds: Lowest and highest corner of what becomes voxels [m]; by default the whole map, with room.
        center: Middle of 101 x 101 x 101 voxels [m], in place of bounds.
        crs: Coordinate reference system, as EPSG:28992, in place of the file's.
        at: A place of the map, x and y [m]: say at what heights something stands there.
        out: Folder for map.png.
        json: Print all as JSON, and nothing else, on stdout.
    """

    map: MapArgument
    at: Annotated[tuple[float, float] | None, optional(metavar="X Y")] = None
    out: OptionalFolder = None
    json: Flag = False


@dataclasses.dataclass(frozen=True)
class ScanOptions:
    """Simulate one LiDAR scan in a city: 32,768 rays, 100 m range, level attitude.

    Attributes:
        map: A simulated city: midtown:SEED, downtown:SEED, suburb:SEED; its ground is z = 0.
        pose: Position of the sensor [m].
        out: Folder for scan.npz (its points, which `maxjax plan` reads) and scan.png.
        json: Print the counts as JSON, and nothing else, on stdout.
    """

    map: MapArgument
    pose: Xyz
    out: OptionalFolder = None
    json: Flag = False


@dataclasses.dataclass(frozen=True)
class FlyOptions(ReadOptions):
    """Fly a plan's trajectory in simulation with the map given, or trials in closed loop.

    With --autopilot and an address, a mission is flown by a real vehicle, over MAVLink (extra mavlink): its items are
    uploaded, read back and compared, or with --setpoints its trajectory is streamed by a clock that waits for the
    vehicle. Nothing is armed without --arm.

    With --start and --goal, in any map that plan reads: plan, give times, and follow that with a simulated quadrotor
    that sees nothing; reported are tracking error and clearance. The exit code is 0 if it touched nothing.

    Without, or with --movers, in closed loop: sense, map, plan, follow, until the goal, contact, or no plan is left; in
    a simulated city, or in the solids of a file that plan reads. Ends are drawn unless given: 50 to 80 m apart, 3 to
    15 m above ground, 10 m clear. 50 trials share a simulated city. Started again with the same --out, a campaign goes
    on.

    Attributes:
        map: A file as for plan; a mission's TOML file; or midtown, downtown or suburb.
        start: Start of the flight, in the coordinates of the map [m].
        goal: End of the flight [m].
        radius: As for plan.
        margin: As for plan.
        speed: Greatest speed of the trajectory [m/s].
        trials: Number of trials, from trial 0 on; 1 by default.
        seed: Seed of the first city; of the wind.
        method: As for plan.
        batch: Flights at a time; by default what suits the device.
        wind: Mean speed of the wind [m/s], with gusts in proportion.
        noise: Standard deviation of measured distances [m].
        dropout: Share of returns lost, 0 to 1.
        dead_sector: Width of a sector without any returns [deg].
        blackout: How long no scan holds any return, some seconds after take-off [s].
        drift: Greatest error of the believed position [m].
        latency: Fly each plan one planning period late.
        snapshot: Plan from the latest scan alone.
        reactive: Gain of the reactive layer [m/s^2]; 0 leaves it out.
        movers: Number of movers around the way, 1 to 256, which the vehicle's own LiDAR has to find; by default none.
        mover_speed: Their greatest speed [m/s].
        mover_kind: drones, birds, cars, cranes, mixed, or encounters, which meet the vehicle's nominal way.
        fleet: Number of vehicles that swap their places in one city, in pairs, each told the others' motions.
        delay: Greatest delay of what the vehicles of a fleet tell each other [s].
        trial: Fly this trial only; with --out, film it.
        shard: Fly the share K of N of the trials, K from 0 to N - 1, into a folder of its own below --out.
        merge: Fly nothing: make the folder --out from those of all its shares.
        distributed: Fly the share of this process of jax.distributed (docs/flight.md), and merge when all are done.
        autopilot: Address of a vehicle that flies the mission: udp://127.0.0.1:14550, where it is listened to, tcp://,
            or serial:///dev/ttyUSB0:57600.
        system: Its MAVLink system.
        arm: Arm and fly it; else all is checked, and nothing moves.
        setpoints: Stream set-points at 20 Hz in place of items.
        tolerance: Distance from its set-point up to which the trajectory's time runs at full pace [m]; at twice that it
            stands.
        out: Folder for flight.json, flight.csv and flight.png; of trials for trials.jsonl, summary.json, flights.png
            and, of one trial, flight.gif; of a fleet for fleet.json and flights.png; of a vehicle maxjax-flight unless
            given.
        json: Print the content of flight.json or summary.json, and nothing else, on stdout.
    """

    map: MapArgument
    start: OptionalXyz = None
    goal: OptionalXyz = None
    radius: Metres = 1.0
    margin: Metres = 8.0
    speed: Speed = 12.0
    trials: Count = None
    seed: _Seed = 0
    method: PlannerName = "field"
    batch: Count = None
    wind: Annotated[float, tyro.conf.arg(metavar="W")] = 0.0
    noise: Metres = 0.0
    dropout: Annotated[float, tyro.conf.arg(metavar="P")] = 0.0
    dead_sector: Annotated[float, tyro.conf.arg(metavar="DEG")] = 0.0
    blackout: Annotated[float, tyro.conf.arg(metavar="SEC")] = 0.0
    drift: Metres = 0.0
    latency: Flag = False
    snapshot: Flag = False
    reactive: Annotated[float, tyro.conf.arg(metavar="G")] = 0.0
    movers: Count = None
    mover_speed: Speed = 5.0
    mover_kind: Annotated[str, tyro.conf.arg(metavar="KIND")] = "drones"
    fleet: Count = None
    delay: Annotated[float, tyro.conf.arg(metavar="SEC")] = 0.0
    trial: Annotated[int | None, optional(metavar="K")] = None
    shard: Annotated[str | None, optional(metavar="K/N")] = None
    merge: Flag = False
    distributed: Flag = False
    autopilot: Annotated[str | None, optional(metavar="URL")] = None
    system: Annotated[int, tyro.conf.arg(metavar="ID")] = 1
    arm: Flag = False
    setpoints: Flag = False
    tolerance: Metres = 1.0
    out: OptionalFolder = None
    json: Flag = False


@dataclasses.dataclass(frozen=True)
class ViewOptions(ReadOptions, RouteOptions, EnergyOptions):
    """Plan by hand in a map, or play flights, on a page in the browser (extra view).

    Start and goal are dragged, waypoints added by click; the path, its figures and slices of the field follow.

    Attributes:
        map: A map as for plan; a plan.json, a mission.json or the TOML file of a mission, whose options hold but for
            those given here; or a folder that fly has written.
        start: Start of the first plan [m]; by default a free place.
        goal: Its end [m].
        via: A place to fly through on the way [m]; several in order, each with its own --via.
        trial: Number of the flight to begin with, of a folder.
        share: One HTML file to write in place of serving a page; it plays in any browser, without network.
        host: Address to serve the page at; beyond this machine a browser needs the token that is printed.
        port: To serve it at, or the next that is free.
        dark: A dark page.
    """

    start: OptionalXyz = None
    goal: OptionalXyz = None
    via: _Via = ()
    trial: Annotated[int | None, optional(metavar="K")] = None
    share: Annotated[Path | None, optional(metavar="FILE")] = None
    host: Annotated[str, tyro.conf.arg(metavar="ADDRESS")] = "127.0.0.1"
    port: Annotated[int, tyro.conf.arg(metavar="N")] = 8080
    dark: Flag = False


@dataclasses.dataclass(frozen=True)
class TrainOptions:
    """Train networks that predict the potential, on simulated scans of midtown.

    A run that was killed goes on from its last checkpoint, bit for bit.

    Attributes:
        config: Networks and their recipes: paper, paper_difference, paper_large, maxjax, maxjax_no_flood.
        out: Folder; each network has its own in it, with weights, log and checkpoint.
        tiny: A small network on a few scenes of 33 x 33 x 33 voxels, to see that all works.
        epochs: By default those of the recipe, 200.
        scenes: Number of training scenes.
        cache: Folder to keep the scenes in.
        seed: Seed of scenes and weights.
    """

    config: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ("maxjax",)
    out: _Folder = Path("maxjax-train")
    tiny: Flag = False
    epochs: Count = None
    scenes: Annotated[int, tyro.conf.arg(metavar="N")] = 749
    cache: OptionalFolder = None
    seed: _Seed = 0


@dataclasses.dataclass(frozen=True)
class DemoOptions:
    """Plan around a street corner from one simulated LiDAR scan, by the field and by A*.

    Attributes:
        out: Folder for plan.json, path.csv and plan.png.
        seed: Seed of the city, of the scan's noise and of the choice of the corner.
    """

    out: _Folder = Path("maxjax-demo")
    seed: _Seed = 0


@dataclasses.dataclass(frozen=True)
class CheckOptions:
    """Show versions and devices, and solve and certify a small potential."""


@dataclasses.dataclass(frozen=True)
class RosOptions:
    """Run as a ROS 2 node: point clouds and odometry in, verified paths and trajectories out.

    Settings are ROS parameters: maxjax ros --ros-args -p radius:=0.8 -r cloud:=/lidar/points (docs/ros.md).

    Attributes:
        managed: Wait for lifecycle transitions; by default the node configures and activates itself.
        ros_arguments: What follows --ros-args.
    """

    managed: Flag = False
    ros_arguments: Annotated[tuple[str, ...], tyro.conf.Suppress] = ()
