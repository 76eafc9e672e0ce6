"""Certified flight paths for UAVs in cities: a Maxwell conduction potential, solved and climbed in pure JAX."""

from maxjax.api import PlanBatch, plan, plan_batch, plan_fleet, plan_scan
from maxjax.core.grid import Grid
from maxjax.core.status import Status
from maxjax.fields.conductivity import conductivity
from maxjax.fields.occupancy import Occupancy, dilate, voxelize
from maxjax.planning.judge import Verification, verify
from maxjax.planning.planner import Plan
from maxjax.solvers.potential import Potential, solve_potential

__all__ = [
    "Grid",
    "Occupancy",
    "Plan",
    "PlanBatch",
    "Potential",
    "Status",
    "Verification",
    "conductivity",
    "dilate",
    "plan",
    "plan_batch",
    "plan_fleet",
    "plan_scan",
    "solve_potential",
    "verify",
    "voxelize",
]
