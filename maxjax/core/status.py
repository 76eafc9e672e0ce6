"""Outcomes of planning, as codes that travel through `jit`.

A numerical or geometrical outcome is data, not an exception: every result carries a `Status` (int32 on the device).
Success is `OK` and nothing else, and no member is truthy, so `if plan.status` can never pass for success.
Names follow Nav2's planner error codes where they exist.
"""

from __future__ import annotations

import enum


class Status(enum.IntEnum):
    """Outcome of a solve, a plan or a scan; int32 under `jit`."""

    OK = 0
    START_OUTSIDE_MAP = 1
    GOAL_OUTSIDE_MAP = 2
    START_OCCUPIED = 3
    GOAL_OCCUPIED = 4
    NO_VALID_PATH = 5
    NOT_CONVERGED = 6
    NOT_CERTIFIED = 7
    PATH_STALLED = 8
    PATH_IN_COLLISION = 9
    NONFINITE_INPUT = 10
    EMPTY_SCAN = 11
    START_EQUALS_GOAL = 12
    IN_CONTACT = 13
    OUT_OF_PLANS = 14
    NONFINITE_STATE = 15
    NO_SAFE_PATH = 16
    OFF_TRAJECTORY = 17
    START_IN_CLOSED_AREA = 18
    GOAL_IN_CLOSED_AREA = 19
    START_OUTSIDE_BAND = 20
    GOAL_OUTSIDE_BAND = 21
    TIMEOUT = 22
    CANNOT_RETURN = 23

    def __bool__(self) -> bool:
        """No status is truthy: compare with `Status.OK`."""
        return False

    @property
    def advice(self) -> str:
        """One sentence that says what happened and what to do about it."""
        return _ADVICE[self]


class Closure(enum.IntEnum):
    """Why a voxel of the airspace is closed (`io.airspace.airspace`)."""

    OPEN = 0
    BAND = 1
    AREA = 2


_ADVICE = {
    Status.OK: "The path was verified against the map.",
    Status.START_OUTSIDE_MAP: "The start lies outside the map; move it inside, or centre the grid on it.",
    Status.GOAL_OUTSIDE_MAP: "The goal lies outside the map; move it inside, or centre the grid between both.",
    Status.START_OCCUPIED: "The start lies inside an obstacle or the ground; choose a free start.",
    Status.GOAL_OCCUPIED: "The goal lies inside an obstacle or the ground; choose a free goal.",
    Status.NO_VALID_PATH: "No free passage joins start and goal at any radius (proved by flood fill); "
    "choose another goal or a finer grid.",
    Status.NO_SAFE_PATH: "Free passages join start and goal, but none keeps the radius (proved by flood fill); "
    "ask for at most the radius that joins them, or choose another goal.",
    Status.NOT_CONVERGED: "The field solver stopped at its iteration cap; raise it, or plan with method 'astar'.",
    Status.NOT_CERTIFIED: "Some voxels of the goal's component have no higher neighbour; "
    "lengthen the screening length, allow more sweeps, or plan with method 'astar'.",
    Status.PATH_STALLED: "The ascent did not arrive within its steps; allow more steps, or plan with method 'astar'.",
    Status.PATH_IN_COLLISION: "The path failed verification and is withheld; please report this map as a defect.",
    Status.NONFINITE_INPUT: "An input is NaN or infinite; clean it before planning.",
    Status.EMPTY_SCAN: "The scan holds no return inside the grid; check coordinates, units (metres) and sensor.",
    Status.IN_CONTACT: "The vehicle touched an obstacle or the ground; fly with a larger margin, or slower.",
    Status.OUT_OF_PLANS: "The goal was not reached within the planning iterations; allow more, "
    "or look at the log for where the flight held.",
    Status.NONFINITE_STATE: "The state of the vehicle became NaN or infinite; check its constants.",
    Status.OFF_TRAJECTORY: "The vehicle strayed from its trajectory by more than 1 m; fly slower, or in less wind.",
    Status.START_EQUALS_GOAL: "Start and goal are the same point; there is nothing to plan.",
    Status.START_IN_CLOSED_AREA: "The start lies in a keep-out area or outside every keep-in area; move it, "
    "or leave that area out.",
    Status.GOAL_IN_CLOSED_AREA: "The goal lies in a keep-out area or outside every keep-in area; move it, "
    "or leave that area out.",
    Status.START_OUTSIDE_BAND: "The start lies below the floor or above a ceiling; move it, or widen the band.",
    Status.TIMEOUT: "The deadline came before a plan was found; allow more time, or plan in a smaller grid.",
    Status.CANNOT_RETURN: "The battery does not last, with its reserve, to a place of the mission and back; "
    "take a larger one, less payload or less wind, or leave that place out.",
    Status.GOAL_OUTSIDE_BAND: "The goal lies below the floor or above a ceiling; move it, or widen the band.",
}
