"""Certified flight paths for UAVs in cities: a Maxwell conduction potential, solved and climbed in pure JAX."""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from maxjax.airspace.airspace import Airspace, Area
    from maxjax.airspace.geojson import load_airspace
    from maxjax.api import PlanBatch, plan, plan_batch, plan_fleet, plan_scan, trajectory
    from maxjax.api_mission import plan_mission
    from maxjax.core.earth import Projected, TangentPlane
    from maxjax.core.grid import Grid
    from maxjax.core.status import Status
    from maxjax.fields.conductivity import conductivity
    from maxjax.fields.occupancy import Occupancy, dilate, voxelize
    from maxjax.fields.price import Price
    from maxjax.maps.load import Map, load_map
    from maxjax.missions.export import export
    from maxjax.nn.model import load_model
    from maxjax.planning.mission import Mission, Waypoint
    from maxjax.planning.plan import Plan
    from maxjax.sim.tracking import Tracking, fly
    from maxjax.solvers.potential import Potential, solve_potential
    from maxjax.trajectories.limits import FlightLimits
    from maxjax.trajectories.trajectory import Trajectory
    from maxjax.verification.verifier import Verification, verify

__all__ = [
    "Airspace",
    "Area",
    "FlightLimits",
    "Grid",
    "Map",
    "Mission",
    "Occupancy",
    "Plan",
    "PlanBatch",
    "Potential",
    "Price",
    "Projected",
    "Status",
    "TangentPlane",
    "Tracking",
    "Trajectory",
    "Verification",
    "Waypoint",
    "conductivity",
    "dilate",
    "export",
    "fly",
    "load_airspace",
    "load_map",
    "load_model",
    "plan",
    "plan_batch",
    "plan_fleet",
    "plan_mission",
    "plan_scan",
    "solve_potential",
    "trajectory",
    "verify",
    "voxelize",
]

# Modules that define the public names. A name is imported when it is first used, so that the command line handles
# Ctrl-C and shows its help before JAX is loaded.
_MODULES = {
    "maxjax.api": ("PlanBatch", "plan", "plan_batch", "plan_fleet", "plan_scan", "trajectory"),
    "maxjax.api_mission": ("plan_mission",),
    "maxjax.core.grid": ("Grid",),
    "maxjax.core.status": ("Status",),
    "maxjax.fields.conductivity": ("conductivity",),
    "maxjax.fields.occupancy": ("Occupancy", "dilate", "voxelize"),
    "maxjax.fields.price": ("Price",),
    "maxjax.maps.load": ("Map", "load_map"),
    "maxjax.airspace.airspace": ("Airspace", "Area"),
    "maxjax.airspace.geojson": ("load_airspace",),
    "maxjax.core.earth": ("Projected", "TangentPlane"),
    "maxjax.missions.export": ("export",),
    "maxjax.nn.model": ("load_model",),
    "maxjax.verification.verifier": ("Verification", "verify"),
    "maxjax.trajectories.limits": ("FlightLimits",),
    "maxjax.planning.mission": ("Mission", "Waypoint"),
    "maxjax.planning.plan": ("Plan",),
    "maxjax.trajectories.trajectory": ("Trajectory",),
    "maxjax.sim.tracking": ("Tracking", "fly"),
    "maxjax.solvers.potential": ("Potential", "solve_potential"),
}

if not TYPE_CHECKING:  # which would take any name for a public one

    def __getattr__(name: str) -> object:
        for module, names in _MODULES.items():
            if name in names:
                globals()[name] = getattr(importlib.import_module(module), name)
                return globals()[name]
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
