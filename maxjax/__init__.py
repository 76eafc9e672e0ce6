"""Certified flight paths for UAVs in cities: a Maxwell conduction potential, solved and climbed in pure JAX."""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from maxjax.api import (
        plan,
        plan_batch,
        plan_fleet,
        plan_flights,
        plan_mission,
        plan_route,
        plan_scan,
        plan_to_goal,
        plan_to_nearest,
        trajectory,
    )
    from maxjax.baselines.apf import APF
    from maxjax.baselines.astar_planner import AStar
    from maxjax.baselines.rrt_star import RRTStar
    from maxjax.core.files import FileError
    from maxjax.core.grid import Grid
    from maxjax.core.status import Status
    from maxjax.core.voxel_map import VoxelMap
    from maxjax.energy.airframe import Airframe
    from maxjax.energy.battery import Battery
    from maxjax.energy.consumption import Consumption, measure_consumption
    from maxjax.energy.point_of_no_return import BatteryVerdict, judge_battery
    from maxjax.energy.split_flights import BatteryFlight, Supply
    from maxjax.energy.wind import Wind
    from maxjax.fields.conductivity import conductivity
    from maxjax.fields.occupancy import Occupancy, dilate, voxelize
    from maxjax.fields.price import Price
    from maxjax.inspection.capture import Capture
    from maxjax.inspection.departures import Departures, keep_apart
    from maxjax.inspection.flown_files import FlownFiles, export_inspection
    from maxjax.inspection.inspect_target import inspect
    from maxjax.inspection.inspection import Inspection
    from maxjax.inspection.landing_place import Landing, LandingPlace, find_landing
    from maxjax.inspection.photo_camera import Camera
    from maxjax.inspection.survey_area import survey
    from maxjax.inspection.sweep import Sweep
    from maxjax.inspection.vehicles import Vehicles
    from maxjax.io.airspace.airspace import Airspace, Area
    from maxjax.io.airspace.zone_files import load_airspace
    from maxjax.io.export.autopilot import Autopilot
    from maxjax.io.export.export import export
    from maxjax.io.geo.earth import Projected, TangentPlane
    from maxjax.io.geo.vertical_zero import VerticalZero
    from maxjax.io.load import LoadedMap, load_map
    from maxjax.io.reading import Reading
    from maxjax.nn.model import load_model
    from maxjax.nn.network import Network
    from maxjax.nn.unseen import predict_unseen, price_unseen
    from maxjax.planners import Field
    from maxjax.planning.look import Look
    from maxjax.planning.mission import Mission
    from maxjax.planning.path.route import Route
    from maxjax.planning.plan import Plan, Plans
    from maxjax.planning.planner import Planner
    from maxjax.planning.problem.distances import Distances
    from maxjax.planning.problem.problem import Problem
    from maxjax.planning.touchdown import Touchdown
    from maxjax.planning.waypoint import Waypoint
    from maxjax.replanner import Replanned, Replanner
    from maxjax.sim.loop.trajectory_flight import Tracking, fly
    from maxjax.sim.movers.lookout import MoverSettings
    from maxjax.sim.movers.traffic import SensorScan, Traffic
    from maxjax.solvers.cg import ConjugateGradients
    from maxjax.solvers.paper import PaperSetting
    from maxjax.solvers.potential import Potential, solve_potential
    from maxjax.solvers.screened import Screened
    from maxjax.trajectories.follower import Follower
    from maxjax.trajectories.limits import FlightLimits
    from maxjax.trajectories.trajectory import Trajectory
    from maxjax.ui.request_files import load_mission
    from maxjax.verification.verdicts import Verification
    from maxjax.verification.verifier import verify

__all__ = [
    "APF",
    "AStar",
    "Airframe",
    "Airspace",
    "Area",
    "Autopilot",
    "Battery",
    "BatteryFlight",
    "BatteryVerdict",
    "Camera",
    "Capture",
    "ConjugateGradients",
    "Consumption",
    "Departures",
    "Distances",
    "Field",
    "FileError",
    "FlightLimits",
    "FlownFiles",
    "Follower",
    "Grid",
    "Inspection",
    "Landing",
    "LandingPlace",
    "LoadedMap",
    "Look",
    "Mission",
    "MoverSettings",
    "Network",
    "Occupancy",
    "PaperSetting",
    "Plan",
    "Planner",
    "Plans",
    "Potential",
    "Price",
    "Problem",
    "Projected",
    "RRTStar",
    "Reading",
    "Replanned",
    "Replanner",
    "Route",
    "Screened",
    "SensorScan",
    "Status",
    "Supply",
    "Sweep",
    "TangentPlane",
    "Touchdown",
    "Tracking",
    "Traffic",
    "Trajectory",
    "Vehicles",
    "Verification",
    "VerticalZero",
    "VoxelMap",
    "Waypoint",
    "Wind",
    "conductivity",
    "dilate",
    "export",
    "export_inspection",
    "find_landing",
    "fly",
    "inspect",
    "judge_battery",
    "keep_apart",
    "load_airspace",
    "load_map",
    "load_mission",
    "load_model",
    "measure_consumption",
    "plan",
    "plan_batch",
    "plan_fleet",
    "plan_flights",
    "plan_mission",
    "plan_route",
    "plan_scan",
    "plan_to_goal",
    "plan_to_nearest",
    "predict_unseen",
    "price_unseen",
    "solve_potential",
    "survey",
    "trajectory",
    "verify",
    "voxelize",
]

# Modules that define the public names. A name is imported when it is first used, so that the command line handles
# Ctrl-C and shows its help before JAX is loaded.
_MODULES = {
    "maxjax.api": (
        "plan",
        "plan_batch",
        "plan_fleet",
        "plan_flights",
        "plan_mission",
        "plan_route",
        "plan_scan",
        "plan_to_goal",
        "plan_to_nearest",
        "trajectory",
    ),
    "maxjax.baselines.apf": ("APF",),
    "maxjax.baselines.astar_planner": ("AStar",),
    "maxjax.baselines.rrt_star": ("RRTStar",),
    "maxjax.core.files": ("FileError",),
    "maxjax.core.grid": ("Grid",),
    "maxjax.core.status": ("Status",),
    "maxjax.core.voxel_map": ("VoxelMap",),
    "maxjax.energy.airframe": ("Airframe",),
    "maxjax.energy.battery": ("Battery",),
    "maxjax.energy.consumption": ("Consumption", "measure_consumption"),
    "maxjax.energy.point_of_no_return": ("BatteryVerdict", "judge_battery"),
    "maxjax.energy.split_flights": ("BatteryFlight", "Supply"),
    "maxjax.energy.wind": ("Wind",),
    "maxjax.fields.conductivity": ("conductivity",),
    "maxjax.fields.occupancy": ("Occupancy", "dilate", "voxelize"),
    "maxjax.fields.price": ("Price",),
    "maxjax.inspection.capture": ("Capture",),
    "maxjax.inspection.departures": ("Departures", "keep_apart"),
    "maxjax.inspection.flown_files": ("FlownFiles", "export_inspection"),
    "maxjax.inspection.inspect_target": ("inspect",),
    "maxjax.inspection.inspection": ("Inspection",),
    "maxjax.inspection.landing_place": ("Landing", "LandingPlace", "find_landing"),
    "maxjax.inspection.photo_camera": ("Camera",),
    "maxjax.inspection.survey_area": ("survey",),
    "maxjax.inspection.sweep": ("Sweep",),
    "maxjax.inspection.vehicles": ("Vehicles",),
    "maxjax.io.airspace.airspace": ("Airspace", "Area"),
    "maxjax.io.airspace.zone_files": ("load_airspace",),
    "maxjax.io.export.autopilot": ("Autopilot",),
    "maxjax.io.export.export": ("export",),
    "maxjax.io.geo.earth": ("Projected", "TangentPlane"),
    "maxjax.io.geo.vertical_zero": ("VerticalZero",),
    "maxjax.io.load": ("LoadedMap", "load_map"),
    "maxjax.io.reading": ("Reading",),
    "maxjax.nn.model": ("load_model",),
    "maxjax.nn.network": ("Network",),
    "maxjax.nn.unseen": ("predict_unseen", "price_unseen"),
    "maxjax.planners": ("Field",),
    "maxjax.planning.look": ("Look",),
    "maxjax.planning.mission": ("Mission",),
    "maxjax.planning.touchdown": ("Touchdown",),
    "maxjax.planning.waypoint": ("Waypoint",),
    "maxjax.planning.path.route": ("Route",),
    "maxjax.planning.plan": ("Plan", "Plans"),
    "maxjax.planning.planner": ("Planner",),
    "maxjax.planning.problem.distances": ("Distances",),
    "maxjax.planning.problem.problem": ("Problem",),
    "maxjax.replanner": ("Replanned", "Replanner"),
    "maxjax.sim.loop.trajectory_flight": ("Tracking", "fly"),
    "maxjax.sim.movers.lookout": ("MoverSettings",),
    "maxjax.sim.movers.traffic": ("SensorScan", "Traffic"),
    "maxjax.solvers.cg": ("ConjugateGradients",),
    "maxjax.solvers.paper": ("PaperSetting",),
    "maxjax.solvers.potential": ("Potential", "solve_potential"),
    "maxjax.solvers.screened": ("Screened",),
    "maxjax.trajectories.follower": ("Follower",),
    "maxjax.trajectories.limits": ("FlightLimits",),
    "maxjax.ui.request_files": ("load_mission",),
    "maxjax.trajectories.trajectory": ("Trajectory",),
    "maxjax.verification.verdicts": ("Verification",),
    "maxjax.verification.verifier": ("verify",),
}

if not TYPE_CHECKING:  # which would take any name for a public one

    def __getattr__(name: str) -> object:
        for module, names in _MODULES.items():
            if name in names:
                globals()[name] = getattr(importlib.import_module(module), name)
                return globals()[name]
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted([*(name for name in globals() if name.startswith("__")), *__all__])
